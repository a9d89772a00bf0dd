"""From measurements to parameters (section 5.1 of the paper)."""
