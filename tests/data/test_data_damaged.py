"""Truncated, flipped, hostile files: a ValueError that explains, never a crash or a huge allocation."""

from __future__ import annotations

import io
import json
import shutil
import struct
import zipfile
from pathlib import Path

import fuzzing
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mi_enhance  # (before mitsuba: it chooses the LLVM)

import mitsuba as mi  # isort: skip
from mi_enhance import data
from mi_enhance.data import merl
from mi_enhance.system import npz, tensor_file

BUNDLED = Path(mi_enhance.__file__).parent / "bundled"
RGL = BUNDLED / "rgl/ilm_solo_m_68_rgb.bsdf"


@pytest.fixture(scope="module", autouse=True)
def rgb():
    mi.set_variant("llvm_ad_rgb")


def load_or_explain(path, **settings):
    """True if the file was read; False if it was refused in the promised way. All else is a failed test."""
    try:
        m = data.load(path, n_samples=50, **settings)
    except (ValueError, FileNotFoundError) as error:
        assert str(error).startswith(f'data.load("{path}"): ') or str(error).startswith("Measurements("), error
        return False
    assert np.isfinite(m.f).all() and m.f.min() >= 0
    return True


@pytest.mark.parametrize(
    "source, material",
    [("rgl/ilm_solo_m_68_rgb.bsdf", None), ("nbrdf/nielsen.npz", "bluebook"), ("nps/merl.npz", "brass")],
)
def test_damaged_files_are_refused_or_read(tmp_path, source, material):
    source = BUNDLED / source
    path, rng, content = tmp_path / source.name, np.random.default_rng(11), source.read_bytes()
    shutil.copy(BUNDLED / "nps/decoder.npz", tmp_path)
    refused = 0
    for _ in range(40):
        path.write_bytes(fuzzing.damage(content, rng))
        refused += not load_or_explain(path, **({"material": material} if material else {}))
    assert refused > 5  # the damage was real


def test_damaged_merl_is_refused_or_read(tmp_path):
    path, rng = tmp_path / "grey.binary", np.random.default_rng(12)
    merl.write_merl(path, lambda wi, wo: np.full((len(wi), 3), 0.1))
    assert load_or_explain(path)
    content, refused = path.read_bytes(), 0
    for _ in range(12):
        with open(path, "r+b") as file:
            file.write(content[:1000])
            file.seek(rng.integers(12 if rng.random() < 0.7 else len(content)))
            file.write(rng.bytes(9))
        refused += not load_or_explain(path)
    assert refused > 5
    for size in (0, 5, 12, 1000, len(content) - 1):
        path.write_bytes(content[:size])
        assert not load_or_explain(path)


@pytest.mark.parametrize(
    "content, message",
    [
        (b"", "0 bytes are too few for a MERL file"),
        (struct.pack("<3i", 90, 90, 360) + bytes(100), r"header says \(90, 90, 360\).*without reciprocity"),
        (struct.pack("<3i", 90, 90, 180) + bytes(100), "112 bytes, a MERL file has 34992012"),
        (struct.pack("<3i", 2**31 - 1, 2**31 - 1, 2**31 - 1), "header says"),
    ],
    ids=["empty", "phi-360", "cut", "absurd"],
)
def test_merl_wrong_sizes_are_named(tmp_path, content, message):
    (tmp_path / "x.binary").write_bytes(content)
    with pytest.raises(ValueError, match=message):
        data.load(tmp_path / "x.binary")


def test_merl_nan_names_the_cell(tmp_path):
    path = tmp_path / "x.binary"
    merl.write_merl(path, lambda wi, wo: np.full((len(wi), 3), 0.1))
    np.memmap(path, "<f8", "r+", offset=12, shape=(3, 90, 90, 180))[2, 5, 6, 7] = np.nan
    with pytest.raises(ValueError, match=r"cell \(5, 6, 7\) .*NaN, infinity or an absurd value"):
        data.load(path)


def write_tensors(path, tensors):
    """The container written anew; a value may be (claimed shape, array)."""
    types = {"uint8": 1, "float32": 10}
    records = [(name, *(v if isinstance(v, tuple) else (v.shape, v))) for name, v in tensors.items()]
    size = 18 + sum(2 + len(name) + 11 + 8 * len(shape) for name, shape, _ in records)
    head, body = tensor_file.MAGIC + struct.pack("<BBI", 1, 0, len(records)), b""
    for name, shape, a in records:
        head += struct.pack("<H", len(name)) + name.encode() + struct.pack("<HB", len(shape), types[str(a.dtype)])
        head += struct.pack(f"<Q{len(shape)}Q", size + len(body), *shape)
        body += a.tobytes()
    path.write_bytes(head + body)


@pytest.fixture
def rgl_tensors():
    fields = tensor_file.fields(RGL, "test")
    return {k: tensor_file.values(RGL, f) for k, f in fields.items() if k not in ("version", "valid")}


def text(s):
    return np.frombuffer(s.encode(), np.uint8)


def without(tensors, *names):
    return {k: v for k, v in tensors.items() if k not in names}


def spectral(t):
    return without(t, "rgb") | {"spectra": t["rgb"], "wavelengths": np.float32([400, 600, 500])}


def changed(name, index, value):
    def edit(tensors):
        a = tensors[name].copy()
        a[index] = value
        return tensors | {name: a}

    return edit


@pytest.mark.parametrize(
    "edit, message",
    [
        (lambda t: t, None),
        (spectral, r"the wavelengths \[400.0, 600.0, 500.0\] must be lengths in nm that increase"),
        (lambda t: {"description": text(json.dumps({"model": "ggx"})), "rho_d": np.float32([1, 1, 1])},
         "is a material of mi_enhance, not a measurement"),
        (lambda t: {"image": np.zeros((2, 2), np.float32)}, "not a measured RGL material: description, .* missing"),
        (lambda t: without(t, "ndf"), "not a measured RGL material: ndf missing"),
        (lambda t: t | {"rgb": ((1, 8, 3, 1 << 40, 32), t["rgb"])}, "field 'rgb' .* cut off or damaged"),
        (lambda t: t | {"rgb": ((1 << 32, 1 << 32, 3, 32, 32), t["rgb"])}, "field 'rgb' .* cut off or damaged"),
        (lambda t: t | {"rgb": t["rgb"][:, :4].copy()}, "field 'rgb' has shape .* the other fields ask for"),
        (lambda t: t | {"ndf": t["ndf"].ravel()}, "field 'ndf' is float32 .* 2 dimensions of float32 are expected"),
        (changed("vndf", (0, 3, 5, 5), np.nan), "field 'vndf' holds NaN, infinite or absurd"),
        (changed("rgb", (0, 3, 1, 5, 5), 1e30), "field 'rgb' holds NaN, infinite or absurd"),
        (changed("sigma", (0, 5), -1), "ndf, sigma or vndf is negative"),
        (changed("vndf", (0, 3), 0), "is 0 everywhere for one direction"),
        (changed("theta_i", 4, 0.1), "theta_i does not increase"),
    ],
    ids="intact spectral own other field huge overflow shape dims nan absurd negative empty order".split(),
)  # fmt: skip
def test_rgl_contents_are_checked_before_mitsuba(tmp_path, rgl_tensors, edit, message):
    path = tmp_path / "chm_mint_spec.bsdf"
    write_tensors(path, edit(rgl_tensors))
    if message is None:  # the writer of this test is right: the same values as from the original
        np.testing.assert_array_equal(data.load(path, n_samples=99).f, data.load(RGL, n_samples=99).f)
    else:
        with pytest.raises(ValueError, match=message):
            data.load(path)


@pytest.mark.parametrize(
    "content, message",
    [
        (b"<html>not found</html>", "does not begin like a tensor file"),
        (tensor_file.MAGIC, "the file ends inside its header"),
        (tensor_file.MAGIC + b"\2\0" + bytes(4), "tensor file version 2.0"),
        (tensor_file.MAGIC + b"\1\0\xff\xff\xff\xff", "with 4294967295 fields"),
    ],
    ids=["html", "cut", "version", "count"],
)
def test_bsdf_header_is_checked(tmp_path, content, message):
    (tmp_path / "x.bsdf").write_bytes(content)
    with pytest.raises(ValueError, match=message):
        data.load(tmp_path / "x.bsdf")


def npz_with(path, **members):
    """A .npz whose members are raw bytes."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)


def npy(array, shape=None, pickled=False):
    file = io.BytesIO()
    header = {"descr": array.dtype.str, "fortran_order": False, "shape": shape or array.shape}
    if pickled:
        np.lib.format.write_array(file, array, allow_pickle=True)
        return file.getvalue()
    np.lib.format.write_array_header_1_0(file, header)
    return file.getvalue() + array.tobytes()


ROWS = npy(np.float32([[0, 0, 1]]))


@pytest.mark.parametrize(
    "f, message",
    [
        (ROWS, None),
        (npy(np.zeros((1, 3)), shape=(10**12, 3)), "f with shape .* needs 24000000000000 bytes, 24 are there"),
        (npy(np.array([["a", {}, 1]], object), pickled=True), "holds Python objects"),
        (npy(np.array([["a", "b", "c"]])), "f is <U1 with shape"),
        (npy(np.zeros((2, 3))), r"f is float64 with shape \(2, 3\); .* wi has N = 1"),
        (npy(np.array([[1.0, np.nan, 2.0]])), r"row 1 has nan in column f\[1\]"),
        (b"", "not a readable .npz"),
    ],
    ids="intact huge pickle words lengths nan empty".split(),
)
def test_npz_contents_are_checked(tmp_path, f, message):
    path = tmp_path / "t.npz"
    npz_with(path, wi=ROWS, wo=ROWS, f=f)
    if message is None:
        assert data.load(path).f.tolist() == [[0, 0, 1]]
    else:
        with pytest.raises(ValueError, match=message):
            data.load(path)


def test_npz_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    npz_with(tmp_path / "t.npz", wi=ROWS, wo=ROWS, f=ROWS + bytes(2000))
    monkeypatch.setattr(npz, "_MAX_BYTES", 1000)
    with pytest.raises(ValueError, match="bytes, more than the 1000 allowed"):
        data.load(tmp_path / "t.npz")


def test_nps_decoder_of_another_network_is_refused(tmp_path):
    shutil.copy(BUNDLED / "nps/merl.npz", tmp_path)
    with np.load(BUNDLED / "nps/decoder.npz") as decoder:
        np.savez(tmp_path / "decoder.npz", **{k: w[:300] if k == "W4" else w for k, w in decoder.items()})
    with pytest.raises(ValueError, match=r"decoder.npz.*W4 is float32 with shape \(300, 400\); .* \(400, 400\)"):
        data.load(tmp_path / "merl.npz", material="brass", n_samples=10)


@settings(max_examples=50)
@given(st.text(alphabet='0123456789.,-einfa"_ \nwoxyzthpfrgb\x00é', max_size=120), st.booleans())
def test_csv_of_any_text_is_refused_or_read(tmp_path_factory, rows, header):
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_text(("theta_i,phi_i,theta_o,phi_o,f\n0.1,0,0.1,0,1\n" if header else "") + rows, encoding="utf-8")
    load_or_explain(path)


def test_csv_that_is_no_text_is_refused(tmp_path):
    (tmp_path / "x.csv").write_bytes(bytes(range(256)))
    assert not load_or_explain(tmp_path / "x.csv")
