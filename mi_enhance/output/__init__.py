"""For the eye: tables, figures, Pareto fronts, sRGB."""
