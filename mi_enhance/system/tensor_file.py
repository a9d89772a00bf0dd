"""The header of Mitsuba's tensor file (`.bsdf`), checked: Mitsuba itself maps the file and trusts every offset in it.

Both the measured files of RGL and the materials of this package use the container. Whoever hands one to Mitsuba asks
`fields` first, so that a truncated download is a sentence and not a crash.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

MAGIC = b"tensor_file\0"
# Mitsuba's Struct types 1 to 11
_DTYPES = "u1 i1 <u2 <i2 <u4 <i4 <u8 <i8 <f2 <f4 <f8".split()
_MAX_AXES = 32  # measured files have up to 5
_MAX_FIELDS = 4096  # a material has a few dozen; stops a damaged count before its names fill the memory


@dataclass(frozen=True)
class Field:
    """Type, shape and place of one tensor in the file."""

    dtype: np.dtype
    shape: tuple[int, ...]
    offset: int


def fields(path: str | Path, where: str) -> dict[str, Field]:
    """Read the header and hold every size against the length of the file.

    Parameters
    ----------
    path : str or Path
    where : str
        Opens the error messages.

    Returns
    -------
    dict
        Name -> `Field`. Each lies inside the file and behind the header.

    Raises
    ------
    ValueError
        If the file is not a tensor file of version 1.0 or a part of it is missing.
    """
    size = os.path.getsize(path)
    result: dict[str, Field] = {}
    with open(path, "rb") as file:

        def take(form: str) -> tuple:
            data = file.read(struct.calcsize(form))
            if len(data) < struct.calcsize(form):
                raise ValueError(f"{where}: the file ends inside its header ({size} bytes). Download or save it again.")
            return struct.unpack(form, data)

        if file.read(len(MAGIC)) != MAGIC:
            raise ValueError(
                f"{where}: does not begin like a tensor file (.bsdf), it is damaged or something else "
                "(a web page?). Download or save it again."
            )
        version, (count,) = take("<BB"), take("<I")
        if version != (1, 0) or count > _MAX_FIELDS:
            raise ValueError(
                f"{where}: tensor file version {version[0]}.{version[1]} with {count} fields; known is 1.0 "
                f"with at most {_MAX_FIELDS}. The file is damaged or newer than this package."
            )
        for _ in range(count):
            name = take(f"<{take('<H')[0]}s")[0].decode("utf8", errors="replace")
            n_dim, type_id, offset = take("<HBQ")
            shape = take(f"<{n_dim}Q")
            if not 1 <= type_id <= len(_DTYPES) or name in result:
                raise ValueError(
                    f"{where}: field {name!r} appears twice or has the unknown type {type_id}. "
                    "The file is damaged; get it again."
                )
            result[name] = Field(np.dtype(_DTYPES[type_id - 1]), shape, offset)
        end_of_header = file.tell()
    for name, field in result.items():
        end = field.offset + math.prod(field.shape) * field.dtype.itemsize  # Python integers: no overflow
        # An empty field fits anywhere, but NumPy refuses an axis of 2**63, or 65 axes, without naming the file.
        absurd = len(field.shape) > _MAX_AXES or max(field.shape, default=0) > size
        if field.offset < end_of_header or end > size or absurd:
            raise ValueError(
                f"{where}: field {name!r} with shape {field.shape} lies at bytes {field.offset} to {end}, "
                f"the file has {size}. It is cut off or damaged; get it again."
            )
    return result


def values(path: str | Path, field: Field) -> np.ndarray:
    """Return the numbers of one checked field."""
    return np.fromfile(path, field.dtype, math.prod(field.shape), offset=field.offset).reshape(field.shape)


def write(path: str | Path, tensors: Mapping[str, np.ndarray | str]) -> None:
    """Write a tensor file with Mitsuba's own writer.

    Parameters
    ----------
    path : str or Path
    tensors : dict
        Name -> array, or str for a text.
    """
    import mitsuba as mi

    # The writer prints a line of its own; a program that prints JSON to standard output has no use for it.
    with contextlib.redirect_stdout(io.StringIO()):
        mi.tensor_io.write(str(path), **tensors)  # type: ignore[attr-defined]  # Mitsuba's stubs miss it
