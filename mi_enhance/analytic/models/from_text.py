"""Models from a text or a file."""

from __future__ import annotations

from pathlib import Path

from ...system.files import require_file
from ..text_model import toml_model
from .model import Model


def from_toml(path: str | Path) -> Model:
    """Read a model from a file that holds a text of :func:`from_expression`.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such file, or it is not a model; the message says what is wrong and what is allowed.
    """
    where = f'models.from_toml("{path}")'
    try:
        text = require_file(Path(path), where).read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{where}: this is not text in UTF-8 ({error}). Save it as one.") from None
    return Model(**toml_model.parse(text, where), text=text)


def from_expression(text: str) -> Model:
    """Make a model from a text in which every term is an expression; see docs/files.md for the format.

    Parameters
    ----------
    text : str
        The text itself. It is never taken for a path: texts come out of material files, which must not make the package
        read others.

    Returns
    -------
    Model
        With `text`, so that a material of it can be saved and loaded where the file is not.

    Raises
    ------
    ValueError
        If the text is not a model; the message says what is wrong and what is allowed.

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
    if isinstance(text, Path) or (str(text).endswith(".toml") and "\n" not in str(text)):
        raise ValueError(f'{where}: "{text}" is a path, not a model. Use models.from_toml("{text}").')
    return Model(**toml_model.parse(text, where), text=text)
