"""The state of a fit on disk: a run that was killed goes on where it was."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..system.files import replacing

_ABOUT, _SETTINGS = "about", "settings"


def save(path: Path, settings: Mapping[str, Any], about: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Write a state; the file is never half written.

    Parameters
    ----------
    path : Path
        A ``.npz`` file.
    settings : mapping
        What decides the run, as JSON can hold it.
    about : mapping
        What is no array, as JSON can hold it.
    arrays : mapping of str to array
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    texts = {_ABOUT: np.array(json.dumps(about)), _SETTINGS: np.array(json.dumps(settings))}
    with replacing(path) as temporary:
        np.savez(temporary, **texts, **{f"a.{key}": value for key, value in arrays.items()})  # type: ignore[arg-type]


def load(path: Path, settings: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, np.ndarray]] | None:
    """Return what a run with these settings has kept; None if there is none, or it cannot be read.

    Examples
    --------
    >>> load(Path("nothing.npz"), {}) is None
    True
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            if json.loads(str(file[_SETTINGS])) != json.loads(json.dumps(settings)):
                return None
            arrays = {name.removeprefix("a."): file[name] for name in file.files if name.startswith("a.")}
            return json.loads(str(file[_ABOUT])), arrays
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None  # a damaged state is as good as none: the fit begins anew
