"""A model from a text that is never executed."""
