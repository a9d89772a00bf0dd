"""Models by name, and models from a text."""

from __future__ import annotations

import difflib
from pathlib import Path

from ...system.files import require_file
from ..text_model import toml_model
from .abc import abc
from .ashikhmin_shirley import ashikhmin_shirley
from .cook_torrance import cook_torrance
from .ggx import ggx, ggx2
from .model import Model
from .ward import ward

MODELS = {
    "ggx": ggx,
    "ggx2": ggx2,
    "cook_torrance": cook_torrance,
    "ward": ward,
    "abc": abc,
    "ashikhmin_shirley": ashikhmin_shirley,
}


def get(name: str) -> Model:
    """Return the model called `name`, or the one in a file of :func:`from_expression`.

    Parameters
    ----------
    name : str
        ``"ggx"``, or a path that ends in ``.toml``.

    Raises
    ------
    KeyError
        If there is none; the message lists the choices.
    FileNotFoundError, ValueError
        If there is no such file, or it is not a model.

    Examples
    --------
    >>> get("ggx").name
    'ggx'
    """
    return from_expression(Path(name)) if str(name).endswith(".toml") else registered(name)


def registered(name: str) -> Model:
    """Return one of the package's own models by name, as :func:`get`; never a file."""
    if name not in MODELS:
        hint = difflib.get_close_matches(name, MODELS, 1)
        raise KeyError(
            f'models.get(): unknown model "{name}". Choose one of: {", ".join(sorted(MODELS))}, or give a .toml file.'
            + (f' Did you mean "{hint[0]}"?' if hint else "")
        )
    return MODELS[name]()


def from_expression(text: str | Path) -> Model:
    """Make a model from a text in which every term is an expression; see docs/files.md for the format.

    Parameters
    ----------
    text : str or Path
        The text itself, or a ``Path`` to a file that holds it. A text is never taken for a path: texts come out of
        material files, which must not make the package read others.

    Returns
    -------
    Model
        With `text`, so that a material of it can be saved and loaded where the file is not.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such file, or the text is not a model; the message says what is wrong and what is allowed.

    Examples
    --------
    >>> blinn_phong = from_expression('''
    ... name = "blinn_phong"
    ... formula = "M + S * D"
    ... [terms]
    ... M = "rho_d / pi"
    ... S = "rho_s"
    ... D = "(n + 2) / (2 * pi) * cos_theta_h ** n"
    ... [parameters]
    ... rho_d = true
    ... rho_s = true
    ... n = { low = 1, high = 1e5, initial = 100, log = true }
    ... [[lobes]]
    ... rho_s = "rho_s"
    ... alpha_x = "sqrt(2 / (n + 2))"
    ... alpha_y = "sqrt(2 / (n + 2))"
    ... ''')
    >>> print(blinn_phong, blinn_phong.graph.slots)
    M + S * D ('M', 'M+S', 'S', 'S*D', 'D')
    """
    where = "from_expression()"
    if isinstance(text, Path):
        where = f'models.get("{text}")'
        try:
            text = require_file(text, where).read_text(encoding="utf-8")
        except UnicodeDecodeError as error:
            raise ValueError(f"{where}: this is not text in UTF-8 ({error}). Save it as one.") from None
    elif str(text).endswith(".toml") and "\n" not in str(text):
        raise ValueError(f'{where}: "{text}" is a path, not a model. Use models.get("{text}"), or give a Path.')
    return Model(**toml_model.parse(text, where), text=text)
