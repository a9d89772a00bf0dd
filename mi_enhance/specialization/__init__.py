"""One material made cheaper to render."""
