"""Arrays out of a .npz that may be damaged or hostile: no pickle, and no allocation the file's length does not back.

`numpy.load` trusts the shape in a header and raises a dozen kinds of errors; here a bad file gives a ValueError.
"""

from __future__ import annotations

import math
import os
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

# 1e7 rows of a table are 0.7 GB; an array above that, and above what lies on the disk, is a mistake or a zip bomb.
_MAX_BYTES = 2**30


def keys(path: str | Path, where: str) -> set[str]:
    """Return the names of the arrays in the file."""
    try:
        with zipfile.ZipFile(path) as archive:
            return {n.removesuffix(".npy") for n in archive.namelist()}
    except Exception as error:  # zipfile raises at least six types on damaged bytes
        raise ValueError(_damaged(where, error)) from error


def read(path: str | Path, wanted: Sequence[str], where: str) -> dict[str, np.ndarray]:
    """Return {name: array} for the names in `wanted`.

    Raises
    ------
    ValueError
        If the file is no .npz, an array is missing, holds Python objects, or is not as long as its header says.
    """
    missing = set(wanted) - keys(path, where)
    if missing:
        raise ValueError(f"{where}: the array {min(missing)!r} is missing; needed are {', '.join(wanted)}.")
    try:
        with zipfile.ZipFile(path) as archive:
            limit = max(_MAX_BYTES, os.path.getsize(path))
            return {name: _member(archive, name, limit) for name in wanted}
    except Exception as error:  # as above, and numpy's header parser adds more
        raise ValueError(_damaged(where, error)) from error


def _member(archive: zipfile.ZipFile, name: str, limit: int) -> np.ndarray:
    """Return one array, after its header was held against the stored length."""
    size = archive.getinfo(name + ".npy").file_size
    if size > limit:
        raise ValueError(f"{name} has {size} bytes, more than the {limit} allowed")
    with archive.open(name + ".npy") as file:
        version = np.lib.format.read_magic(file)
        reader = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
        if version not in reader:
            raise ValueError(f"{name} has .npy version {version}; 1.0 and 2.0 are known")
        shape, fortran_order, dtype = reader[version](file)
        if dtype.hasobject:
            raise ValueError(f"{name} holds Python objects, which could run code; save plain numbers")
        expected = math.prod(shape) * dtype.itemsize
        if min(shape, default=0) < 0 or expected != size - file.tell():
            raise ValueError(f"{name} with shape {shape} needs {expected} bytes, {size - file.tell()} are there")
        data = file.read()  # the archive's checksum is verified here
    return np.frombuffer(data, dtype).reshape(shape, order="F" if fortran_order else "C")


def numbers(arrays: Mapping[str, np.ndarray], name: str, shape: tuple[int, ...], where: str) -> np.ndarray:
    """Return the array as float32 after checking its shape and that all values are finite."""
    a = arrays[name]
    if a.dtype.kind not in "fiu" or a.shape != shape:
        raise ValueError(f"{where}: {name} is {a.dtype} with shape {a.shape}; numbers with shape {shape} are needed.")
    with np.errstate(over="ignore"):
        a = a.astype(np.float32)
    if not np.isfinite(a).all():
        raise ValueError(f"{where}: {name} holds NaN or infinite values. The file is damaged; get it again.")
    return a


def words(arrays: Mapping[str, np.ndarray], name: str, where: str) -> list[str]:
    """Return a one-dimensional array of strings as a list."""
    a = arrays[name]
    if a.dtype.kind != "U" or a.ndim != 1 or a.size == 0:
        raise ValueError(f"{where}: {name} is {a.dtype} with shape {a.shape}; a list of strings is needed.")
    # Code points beyond Unicode, from flipped bits: Python makes strings of some, and fails when they are used.
    codes = np.ascontiguousarray(a.astype(a.dtype.newbyteorder("="))).view(np.uint32) if a.itemsize else np.zeros(0)
    if (codes > 0x10FFFF).any() or ((codes >= 0xD800) & (codes < 0xE000)).any():
        raise ValueError(_damaged(where, f"{name} holds characters that do not exist"))
    return [str(n) for n in a]


def _damaged(where: str, error: object) -> str:
    return f"{where}: not a readable .npz ({str(error) or type(error).__name__}). Get or write it again."
