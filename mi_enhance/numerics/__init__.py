"""Numerical methods that know no optics."""
