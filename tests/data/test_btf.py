"""BTF archives: a stand-in for `btf-extractor` with its interface (version 1.7), for no archive is at hand."""

from __future__ import annotations

import sys
import types
import zipfile

import numpy as np
import pytest

from mi_enhance.data import btf

ANGLES = [(tl, pl, tv, pv) for tl in (0, 30, 60) for pl in (0, 90) for tv in (0, 45, 90) for pv in (0, 180)]
COLOUR = np.array([0.8, 0.4, 0.2])  # RGB


class Archive:
    """A Lambertian sample whose albedo grows from left to right; BGR, times the cosine of the light."""

    dtype = np.float32

    def __init__(self, path):
        if "damaged" in path:
            raise RuntimeError("duplicated conditions")
        self.angles_set = frozenset(ANGLES)

    def angles_to_image(self, tl, pl, tv, pv):
        ramp = np.linspace(0.1, 1, 6)[None, :, None] * np.ones((4, 1, 1))
        return (ramp * COLOUR[::-1] * np.cos(np.deg2rad(tl))).astype(np.float32)


class EightBit(Archive):
    def angles_to_image(self, *angles):
        v = super().angles_to_image(*angles)
        encoded = np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)
        return np.round(encoded * 255).astype(np.uint8)


@pytest.fixture
def archives(monkeypatch, tmp_path):
    """The package, and a file of each kind; only names and suffix matter to the stand-in."""
    package = types.SimpleNamespace(Ubo2003=EightBit, AtriumHdr=Archive, Ubo2014=Archive)
    monkeypatch.setitem(sys.modules, "btf_extractor", package)
    for name, member in (("jpg.zip", "tl000 pl000 tv000 pv000.jpg"), ("hdr.zip", "tl000 pl000 tv000 pv000.hdr")):
        with zipfile.ZipFile(tmp_path / name, "w") as file:
            file.writestr(member, b"")
    for name in ("a.btf", "damaged.btf", "a.txt"):
        (tmp_path / name).write_bytes(b"BTF")
    return tmp_path


@pytest.mark.parametrize(("name", "step"), [("a.btf", 1e-6), ("hdr.zip", 1e-6), ("jpg.zip", 0.02)])
def test_window_is_the_reflectance_of_its_pixels(archives, name, step):
    wi, wo, f = btf.read(archives / name, rows=(1, 3), columns=(2, 6), n_samples=1000)
    expected = np.linspace(0.1, 1, 6)[2:, None] * COLOUR / np.pi
    assert f.shape == (2, 4, len(wi), 3) and len(wi) == 24  # view angles of 90 degrees are left out
    np.testing.assert_allclose(f, np.broadcast_to(expected[None, :, None], f.shape), rtol=step)  # 8 bits: 2 %
    for w, thetas in ((wi, (0, 45)), (wo, (0, 30, 60))):
        np.testing.assert_allclose(np.linalg.norm(w, axis=1), 1, rtol=1e-6)
        assert set(np.round(np.rad2deg(np.arccos(w[:, 2]))).astype(int)) == set(thetas)


def test_pairs_are_drawn_by_the_seed_and_cosine_is_optional(archives):
    read = lambda **k: btf.read(archives / "a.btf", rows=(0, 1), columns=(0, 1), n_samples=5, **k)  # noqa: E731
    first, again, other = read(), read(), read(seed=1)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[1], other[1])
    wi, wo, f = read(cosine=False)
    np.testing.assert_allclose(f, first[2] * wo[:, 2:], rtol=1e-6)


def test_what_cannot_be_read_is_said(archives, monkeypatch):
    window = {"rows": (0, 2), "columns": (0, 2)}
    with pytest.raises(ValueError, match="rows 0 to 9 do not lie within the 4 there are"):
        btf.read(archives / "a.btf", **{**window, "rows": (0, 9)})
    with pytest.raises(ValueError, match="cannot read this file .duplicated conditions"):
        btf.read(archives / "damaged.btf", **window)
    with pytest.raises(ValueError, match="neither a .zip archive"):
        btf.read(archives / "a.txt", **window)
    with pytest.raises(FileNotFoundError, match="no such file"):
        btf.read(archives / "none.btf", **window)
    monkeypatch.setitem(sys.modules, "btf_extractor", None)  # as if it were not installed
    with pytest.raises(
        ModuleNotFoundError, match=r"needs the package btf-extractor .* pip install 'mi-enhance\[btf\]'"
    ):
        btf.read(archives / "a.btf", **window)
