"""Importance sampling (section 5.2 of the paper)."""
