"""Importance sampling (section 5.2 of the paper)."""

from .._moved import names_of

__getattr__ = names_of("sampling")  # the module of that name in version 0.1
