"""A material: edited, shown, evaluated, saved, loaded."""

from .._moved import names_of

__getattr__ = names_of("material")  # the module of that name in version 0.1
