"""Out of Mitsuba: shaders, a NumPy file, measured files, nearest parameters of other models, a page for the browser."""
