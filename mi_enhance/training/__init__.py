"""From many materials to weights (section 4.3 of the paper)."""
