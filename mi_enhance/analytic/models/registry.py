"""The analytic models by name."""

from __future__ import annotations

from collections.abc import Callable

from ...system.messages import did_you_mean
from .model import Model

MODELS: dict[str, Callable[[], Model]] = {}


def model(make: Callable[[], Model]) -> Callable[[], Model]:
    """Register a function that returns a model; the model has the name of the function."""
    MODELS[make.__name__] = make
    return make


def get(name: str) -> Model:
    """Return the model called `name`.

    Parameters
    ----------
    name : str
        One of the package's own models, such as ``"ggx"``. :func:`from_toml` reads a model from a file.

    Raises
    ------
    KeyError
        If there is none; the message lists the choices.

    Examples
    --------
    >>> get("ggx").name
    'ggx'
    """
    if name not in MODELS:
        raise KeyError(
            f'models.get(): unknown model "{name}". Choose one of: {", ".join(sorted(MODELS))}, or read one from a '
            f".toml file with models.from_toml().{did_you_mean(name, MODELS)}"
        )
    return MODELS[name]()
