"""Damaged and hostile files for every reader, which may read one or refuse it in a sentence."""

from __future__ import annotations

import io
import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import other_formats

import mi_enhance  # noqa: F401  (before mitsuba)
from mi_enhance import data, models
from mi_enhance.data import directions, merl, nps
from mi_enhance.hypercube import inheritance
from mi_enhance.material.material import Material
from mi_enhance.material.material_maps import MaterialMaps
from mi_enhance.neural.enhance import enhance
from mi_enhance.neural.enhanced_brdf import EnhancedBRDF
from mi_enhance.system import files
from mi_enhance.training.sources import jobs_of, sources_of
from mi_enhance.training.training_set import TrainingSet

ROOT = Path(__file__).resolve().parents[1]
# Numbers that headers trip over: sizes, signs, ends of ranges, NaN and infinity.
_INTERESTING = [
    *(np.array(v, t).tobytes() for t in ("<u2", "<u4", "<u8") for v in (0, 1, np.iinfo(t).max, np.iinfo(t).max // 2)),
    *(np.array(v, t).tobytes() for t in ("<f4", "<f8") for v in (np.nan, np.inf, -np.inf, -1e30, 1e30, 0)),
    *(b'"', b"{", b"[" * 64, b"]", b",", b"\n", b"\0" * 16, b"9" * 40, b"1e999", b"-", b"../../", b"\xff\xfe"),
]


def damage(content: bytes, rng: np.random.Generator) -> bytes:
    """A copy with something wrong: of its bytes; of a member of an archive, with a new checksum; of a JSON value."""
    if content[:2] == b"PK" and rng.random() < 0.8:
        return _damaged_member(content, rng)
    if content[:1] in b"{[" and rng.random() < 0.8:
        lines = content.decode().splitlines()
        k = rng.integers(len(lines))
        lines[k] = json.dumps(_damaged_value(json.loads(lines[k]), rng))
        return "\n".join(lines).encode()
    return _damaged_bytes(content, rng)


def _damaged_member(content: bytes, rng: np.random.Generator) -> bytes:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    names = list(members)
    name = names[rng.integers(len(names))]
    kind = rng.integers(4)
    if kind == 0:
        members[name] = _damaged_bytes(members[name], rng)
    elif kind == 1:
        del members[name]
    elif kind == 2:  # numbers that are none, or of another kind or shape
        a = np.load(io.BytesIO(members[name]))
        kinds = ["U3", "S5", "U0"] if a.dtype.kind == "U" else [np.float64, np.float16, "U3", "c8", ">f4", "?"]
        a = a.astype(kinds[rng.integers(len(kinds))], casting="unsafe")
        a = a.reshape(a.shape[::-1]) if rng.random() < 0.3 else a[..., :-1] if a.ndim and rng.random() < 0.3 else a
        members[name] = _npy(a)
    else:
        a = np.load(io.BytesIO(members[name])).copy()
        if a.dtype.kind == "f" and a.size:
            a.flat[rng.integers(a.size)] = [np.nan, np.inf, -1, 0, 1e30, -1e30, 1e-40][rng.integers(7)]
        members[name] = _npy(a)
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED][rng.integers(2)]) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return file.getvalue()


def _npy(a: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, a)
    return file.getvalue()


def _damaged_value(value, rng: np.random.Generator):
    """A JSON value in which one, anywhere, is replaced or left out."""
    if isinstance(value, (dict, list)) and value and rng.random() < 0.85:
        keys = list(value) if isinstance(value, dict) else range(len(value))
        key = keys[rng.integers(len(keys))]
        result = value.copy()
        if rng.random() < 0.1:
            del result[key]
        else:
            result[key] = _damaged_value(value[key], rng)
        return result
    strange = [None, True, -1, 0, 2**31, 2**63, 10**40, 1e308, float("nan"), "", "F", "../../x", [], {}, [[]]]
    return [*strange, {"G": [3]}, [0] * 100, "1e9", -0.5, 3, "ggx"][rng.integers(21)]


def _damaged_bytes(content: bytes, rng: np.random.Generator) -> bytes:
    """Cut off, flipped, overwritten, stuffed or shuffled in one or two places, most of them near the front."""
    content = bytearray(content)
    for _ in range(rng.integers(1, 3)):
        size = max(len(content), 1)
        place = int(min(rng.integers(size), rng.integers(size), rng.integers(4096 if rng.random() < 0.5 else size)))
        length = int(rng.integers(1, 65))
        kind = rng.integers(7)
        if kind == 0:
            del content[place:]
        elif kind == 1 and content:
            content[place % len(content)] ^= 1 << rng.integers(8)
        elif kind == 2:
            content[place : place + length] = rng.bytes(length)
        elif kind == 3:
            value = _INTERESTING[rng.integers(len(_INTERESTING))]
            content[place : place + len(value)] = value
        elif kind == 4:  # inserted: everything behind it moves
            content[place:place] = _INTERESTING[rng.integers(len(_INTERESTING))] * int(rng.integers(1, 4))
        elif kind == 5:
            del content[place : place + length]
        else:
            content[place:place] = content[place : place + length] * int(rng.integers(1, 9))
    return bytes(content)


def _table() -> data.Measurements:
    rng = np.random.default_rng(0)
    wi, wo = directions.sample_pairs(30, seed=1)
    return data.Measurements(wi, wo, rng.random((30, 3)))


def _material() -> Material:
    brdf = enhance("ggx2", ("B", "G"), inputs="shape", modulated=True, n_latent=3, hidden=(4, 3), seed=1)
    return Material(brdf, {}, {"log_l1": 0.01, "undetermined": ["F0"], "name": "gold"})


def _write_maps(path: Path) -> None:
    rng = np.random.default_rng(0)
    MaterialMaps(_material(), {name: rng.random((4, 5, n)) for name, n in (("rho_d", 3), ("latent", 3))}).save(path)


def _checkpoint() -> EnhancedBRDF:
    return enhance("ggx", ("G",), inputs="shape", n_latent=2, hidden=(3,), seed=1)


def _write_checkpoint(path: Path) -> None:
    brdf = _checkpoint()
    np.savez(path, weights=np.zeros(brdf.n_weights, np.float32), parameters=np.zeros(4 * brdf.n_parameters, np.float32))


def _write_set(path: Path) -> None:
    np.savez(path, names=np.array(["a", "b"]), kinds=np.array(["nps", "nps"]), samples=np.ones((9, 8), np.float32))


def _load(name: str = "", **settings) -> Callable:
    return lambda path: data.load(path, n_samples=20, **({"material": name} if name else {}), **settings)


def _jobs(path: Path) -> list:
    return [jobs_of(source, 10, 0) for source in sources_of(path)]


def _latents(path: Path) -> data.Measurements:
    shutil.copy(ROOT / "mi_enhance/bundled/nps/decoder.npz", path.parent)
    return data.load(path, n_samples=20, material="brass")


_SOURCES = [
    {"kind": "nps", "path": str(ROOT / "mi_enhance/bundled/nps/merl.npz"), "held_out": "without"},
    {
        "kind": "nps-mixtures",
        "path": str(ROOT / "mi_enhance/bundled/nps/merl.npz"),
        "count": 3,
        "albedo": [0.1, 0.9],
        "warp": True,
    },
    {"kind": "nbrdf", "path": str(ROOT / "mi_enhance/bundled/nbrdf/nielsen.npz")},
    {"kind": "assorted", "count": 2},
]
# Reader: file name, what writes an intact file there (or the file itself), what reads it.
READERS: dict[str, tuple[str, Callable | Path, Callable]] = {
    "RGL": ("x.bsdf", ROOT / "mi_enhance/bundled/rgl/ilm_solo_m_68_rgb.bsdf", _load()),
    "MERL": ("x.binary", lambda p: merl.write_merl(p, lambda wi, wo: np.full((len(wi), 3), 0.1)), _load()),
    "NBRDF": ("x.npz", ROOT / "mi_enhance/bundled/nbrdf/nielsen.npz", _load("bluebook")),
    "NPs": ("x.npz", ROOT / "mi_enhance/bundled/nps/merl.npz", _latents),
    "NPs decoder": ("decoder.npz", ROOT / "mi_enhance/bundled/nps/decoder.npz", nps.read_decoder),
    "table .csv": ("x.csv", lambda p: data.save_table(_table(), p), _load()),
    "table .npz": ("x.npz", lambda p: data.save_table(_table(), p), _load(kind="table")),
    **{kind: (name, write, _load()) for kind, (name, write) in other_formats.FILES.items()},
    "material": ("x.bsdf", lambda p: _material().save(p), lambda p: Material.load(p).show()),
    "network": ("x.bsdf", ROOT / "mi_enhance/networks/ggx.bsdf", lambda p: Material.load(p).show()),
    "description": (
        "x.json",
        lambda p: p.write_text(_material().to_dict()["description"]),
        lambda p: Material.from_arrays(p.read_text(errors="replace"), *map(_material().to_dict().get, _ARRAYS)),
    ),
    "maps": ("x.exr", _write_maps, lambda p: MaterialMaps.load(p, _material())),
    "model .toml": ("x.toml", ROOT / "docs/ashikhmin_shirley.toml", models.from_toml),
    "training set": ("x.npz", _write_set, TrainingSet.read),
    "sources .json": ("x.json", lambda p: p.write_text(json.dumps(_SOURCES)), _jobs),
    "checkpoint": ("x.npz", _write_checkpoint, lambda p: inheritance.restore(_checkpoint(), p)),
    "search log": (
        "x.jsonl",
        lambda p: p.write_text('{"stage": 1, "best": [0, 1]}\n{"stage": 2, "best": [1, 1]}\n'),
        lambda p: files.read_json(p, "search()", ("stage", "best"), lines=True),
    ),
}
_ARRAYS = ("params", "weights")
_BEGINNINGS = ("Measurements(", 'bsdf "enhanced"', "training set", "data.load(")  # of messages that name another file


def intact(reader: str, folder: Path) -> tuple[Path, bytes]:
    """Where the reader's file lies in `folder`, and what a good one holds."""
    name, source, _ = READERS[reader]
    path = folder / name
    if callable(source):
        source(path)
        return path, path.read_bytes()
    return path, source.read_bytes()


def attempt(reader: str, path: Path) -> str:
    """``"read"``, ``"refused"``, or what went wrong: another error, or a message that does not say where."""
    try:
        READERS[reader][2](path)
    except ValueError as error:
        says_where = path.name in str(error) or str(error).startswith(_BEGINNINGS)
        return "refused" if says_where else f"message {error}"
    except FileNotFoundError as error:
        return "refused" if "no such file" in str(error) else f"message {error}"
    except Exception as error:  # noqa: BLE001  (what this file is here to find)
        return f"{type(error).__name__}: {error}"
    return "read"
