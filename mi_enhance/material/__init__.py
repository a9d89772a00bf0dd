"""A material: edited, shown, evaluated, saved, loaded."""
