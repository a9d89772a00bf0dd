"""Readers of further formats: each a small file written here to the format's public description, and damaged ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from other_formats import (
    FILES,
    SHAPE_MIT,
    smooth,
    write_alta,
    write_astm,
    write_lighttools,
    write_mit,
    write_rgl,
    write_utia,
    write_zemax,
)

import mi_enhance  # noqa: F401  (before mitsuba: it chooses the LLVM)

import mitsuba as mi  # isort: skip
from mi_enhance import data
from mi_enhance.data import functions, loading, mit, rgl, rgl_forms, spectra, utia
from mi_enhance.data.directions import direction, sample_pairs
from mi_enhance.evaluation.truth import rendered_truth


@pytest.fixture(autouse=True)
def rgb():
    mi.set_variant("llvm_ad_rgb")


@pytest.mark.parametrize("kind", FILES)
def test_a_file_is_known_by_its_content_and_read(kind, tmp_path):
    name, write = FILES[kind]
    write(tmp_path / name)
    m = data.load(tmp_path / name, n_samples=500)
    assert len(m.f) > 0 and m.f.max() > 0 and m.name == Path(name).stem.removesuffix("_spec")
    # every file holds `smooth`, as far as its format can: coarse grids interpolate it to a few percent
    expected = smooth(m.wi, m.wo)
    if kind in ("utia", "utia exr", "mit", "zemax", "lighttools", "alta"):
        assert np.median(np.abs(m.f / expected - 1)) < 0.02
    again = data.load(tmp_path / name, n_samples=500, kind=kind.split()[0].split("_")[0])
    np.testing.assert_array_equal(m.f, again.f)


@pytest.mark.parametrize("kind", FILES)
def test_the_function_of_a_file_gives_what_the_reader_gives(kind, tmp_path):
    name, write = FILES[kind]
    write(tmp_path / name)
    m = data.load(tmp_path / name, n_samples=300)
    f = functions.function_of(tmp_path / name)(m.wi, m.wo)
    assert f.shape == m.f.shape and f.min() >= 0
    # scattered points are planes through their neighbours, of a material that is taken for reciprocal
    assert np.median(np.abs(f - m.f)) < (0.05 if loading.is_scattered(tmp_path / name) else 1e-5) * m.f.max()


@pytest.mark.parametrize("kind", ["rgl_spectral", "rgl_anisotropic"])
def test_rgl_forms_that_mitsuba_does_not_render_are_no_rendered_truth(kind, tmp_path):
    name, write = FILES[kind]
    write(tmp_path / name)
    assert rendered_truth(tmp_path / name, "compare()") is None


# ---- UTIA


def test_utia_is_exact_at_its_points_and_linear_between(tmp_path):
    write_utia(tmp_path / "m001_cloth.bin")
    table = utia.read_table(tmp_path / "m001_cloth.bin")
    rng = np.random.default_rng(1)
    i, j, k, n = rng.integers(0, 5, 50), rng.integers(0, 48, 50), rng.integers(0, 5, 50), rng.integers(0, 48, 50)

    def at(theta_i, phi_i, theta_v, phi_v):
        light, viewer = (
            direction(np.deg2rad(15 * t), np.deg2rad(7.5 * p)) for t, p in ((theta_i, phi_i), (theta_v, phi_v))
        )
        return utia.lookup(table, viewer, light)

    np.testing.assert_allclose(at(i, j, k, n), table[i, j, k, n], rtol=1e-5)
    # half way in every angle, over the seam of phi as elsewhere: the mean of the 16 points around
    corners = [table[i + a, (j + b) % 48, k + c, (n + d) % 48] for a, b, c, d in np.ndindex(2, 2, 2, 2)]
    np.testing.assert_allclose(at(i + 0.5, j + 0.5, k + 0.5, n + 0.5), np.mean(corners, 0), rtol=1e-5)


def test_utia_interpolates_a_function(tmp_path):
    write_utia(tmp_path / "m001_cloth.bin")
    m = data.load(tmp_path / "m001_cloth.bin", n_samples=5000)
    # 15 degrees of a smooth function: the second derivative times h^2 / 8 is 1 percent
    np.testing.assert_allclose(m.f, smooth(m.wi, m.wo), rtol=0.03)
    assert min(m.wi[:, 2].min(), m.wo[:, 2].min()) > np.cos(np.deg2rad(75))


def test_utia_negative_values_are_counted_and_other_sizes_refused(tmp_path):
    path = tmp_path / "m001_cloth.bin"
    write_utia(path, -0.25)
    m = data.load(path, n_samples=1000)
    assert m.f.min() == 0 and 0 < m.clamped_fraction < 1
    path.write_bytes(path.read_bytes()[:-8])
    with pytest.raises(ValueError, match="a UTIA file of 6 x 48 by 6 x 48 directions has 1990656. It is cut off"):
        data.load(path)


# ---- MIT


def test_mit_swaps_no_angle_and_leaves_unmeasured_bins_out(tmp_path):
    path = tmp_path / "brushed.dat"
    write_mit(path, hole=True)
    table, half = mit.read_table(path)
    assert not half and np.isnan(table).any()
    m = data.load(path, n_samples=3000)
    assert np.median(np.abs(m.f / smooth(m.wi, m.wo) - 1)) < 0.01
    theta = np.rad2deg(np.arccos(np.minimum(m.wo[:, 2], 1)))
    assert not ((theta > 46) & (theta < 62)).any()  # the hole, without the edges of its bins
    swapped = np.median(np.abs(m.f / smooth(m.wo, m.wi) - 1))
    assert swapped > 0.05


def test_mit_half_data_is_the_same_on_both_sides(tmp_path):
    path = tmp_path / "satin.dat"
    write_mit(path, half=True)
    table, half = mit.read_table(path)
    assert half and table.shape == (*SHAPE_MIT[:2], SHAPE_MIT[2] // 2, SHAPE_MIT[3], 3)
    m = data.load(path, n_samples=100)
    mirror = np.array([1, -1, 1])  # of a pair whose light lies in the plane y = 0
    phi = np.arctan2(m.wo[:, 1], m.wo[:, 0])
    assert len(m.f) == 100 and np.isfinite(phi).all() and mirror.sum() == 1


def test_mit_header_and_length_must_agree(tmp_path):
    path = tmp_path / "satin.dat"
    write_mit(path)
    path.write_bytes(path.read_bytes()[:-4])
    with pytest.raises(ValueError, match="asks for .* It is cut off or damaged"):
        data.load(path)


# ---- spectra


def test_white_is_white_and_blue_is_blue():
    nm = np.arange(360.0, 801.0, 4)
    weights = spectra.rgb_weights(nm, "test")
    np.testing.assert_allclose(np.ones(len(nm)) @ weights, 1, atol=1e-12)
    r, g, b = np.where(nm < 480, 1.0, 0.05) @ weights
    assert b > 0.5 and b > 3 * max(r, g)


def test_rgb_weights_are_colour_sciences():
    import colour

    nm = np.arange(380, 781, 5)
    f = 0.3 + 0.2 * np.sin(nm / 40)
    sd = colour.SpectralDistribution(dict(zip(nm.tolist(), f.tolist(), strict=True)))
    shape = colour.SpectralShape(380, 780, 5)
    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    light = colour.SDS_ILLUMINANTS["D65"].copy().align(shape)
    xyz = colour.sd_to_XYZ(sd, cmfs, light, method="Integration") / 100
    expected = xyz @ colour.RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB.T
    # ours has white at exactly 1; and is linear between the wavelengths where theirs is a Sprague polynomial
    np.testing.assert_allclose(f @ spectra.rgb_weights(nm, "test"), expected, atol=5e-4)


def test_table_takes_any_number_of_wavelengths(tmp_path):
    rng = np.random.default_rng(4)
    wi, wo = sample_pairs(20, seed=1)
    for n in (1, 2, 3, 31):
        nm = np.linspace(410, 690, n).round()
        f = rng.random((20, n))
        names = ["wi_x", "wi_y", "wi_z", "wo_x", "wo_y", "wo_z", *(f"f_{v:g}nm" for v in nm)]
        np.savetxt(tmp_path / "s.csv", np.hstack((wi, wo, f)), delimiter=",", header=",".join(names), comments="")
        np.savez(tmp_path / "s.npz", wi=wi, wo=wo, f=f, wavelengths=nm)
        expected = np.maximum(f @ spectra.rgb_weights(nm, "test"), 0)
        for suffix in ("csv", "npz"):
            m = data.load(tmp_path / f"s.{suffix}")
            np.testing.assert_allclose(m.f, expected, rtol=1e-5, atol=1e-6)
            assert (spectra.NOTE in m.source) == (n > 1)


def test_table_refuses_wavelengths_that_cannot_be_seen(tmp_path):
    (tmp_path / "ir.csv").write_text("theta_i,phi_i,theta_o,phi_o,f_905nm,f_1550nm\n0,0,0.5,0,0.1,0.2\n")
    with pytest.raises(ValueError, match="none of its 2 wavelengths, 905 to 1550 nm, is visible .* name it f"):
        data.load(tmp_path / "ir.csv")


# ---- RGL


def test_rgl_spectra_are_those_of_each_wavelength(tmp_path):
    """The conversion is linear: a file whose RGB was made beforehand gives the same."""
    spec, rgb_file = tmp_path / "paper_spec.bsdf", tmp_path / "paper_rgb.bsdf"
    table, nm = write_rgl(spec, spectral=True)
    weights = spectra.rgb_weights(nm, "test")
    write_rgl(rgb_file, rgb=np.einsum("ptwuv,wc->ptcuv", table, weights))
    wi, wo = sample_pairs(500, seed=2)
    np.testing.assert_allclose(rgl.evaluate(spec, wi, wo), rgl.evaluate(rgb_file, wi, wo), rtol=1e-5, atol=1e-7)
    m = data.load(spec, n_samples=50)
    assert m.name == "paper" and "D65" in m.source


def test_rgl_azimuths_to_a_whole_turn_are_those_from_minus_pi(tmp_path):
    """The same anisotropic material written over 0 to 2 pi and over -pi to pi."""
    write_rgl(tmp_path / "a_rgb.bsdf", phi=np.linspace(-np.pi, np.pi, 9))
    write_rgl(tmp_path / "b_rgb.bsdf", phi=np.linspace(0, 2 * np.pi, 9))
    wi, wo = sample_pairs(2000, seed=3)
    a, b = (rgl.evaluate(tmp_path / f"{n}_rgb.bsdf", wi, wo) for n in "ab")
    np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-6)
    assert np.ptp(a[:, 0]) > 0.02  # it does depend on the azimuth


def test_rgl_cut_between_two_azimuths(tmp_path):
    phi = np.linspace(0, 2 * np.pi, 8)  # pi is none of them
    fields = rgl_forms.rewritten(
        dict(phi_i=phi, vndf=phi[:, None], luminance=phi[:, None], rgb=np.cos(phi)[:, None]), "t"
    )
    assert fields["phi_i"][0] == -fields["phi_i"][-1] == pytest.approx(-np.pi)
    assert (np.diff(fields["phi_i"]) > 0).all()
    assert fields["rgb"][0] == fields["rgb"][-1] == pytest.approx(np.cos(phi[3]))  # mean of the two points beside pi


def test_rgl_azimuths_of_no_turn_are_refused(tmp_path):
    write_rgl(tmp_path / "c_rgb.bsdf", phi=np.linspace(0, 5, 9))
    with pytest.raises(ValueError, match="phi_i runs from 0 to 5; known are files from 0 or -pi"):
        data.load(tmp_path / "c_rgb.bsdf", n_samples=10)


# ---- optics


def test_zemax_specular_direction_and_horizon(tmp_path):
    write_zemax(tmp_path / "vinyl.bsdf")
    m = data.load(tmp_path / "vinyl.bsdf")
    assert "turned about the normal at random" in m.source and "below the horizon dropped" in m.source
    h = (m.wi + m.wo) / np.linalg.norm(m.wi + m.wo, axis=1)[:, None]
    mirror = h[:, 2] > 1 - 1e-6  # radial 0: seen in the specular direction
    assert mirror.sum() >= 3
    np.testing.assert_allclose(m.wi[mirror, 2], m.wo[mirror, 2], atol=1e-6)


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("BRDF", "BTDF", "holds transmission"),
        ("PlaneSymmetrical", "Spherical", "says Symmetry is 'Spherical'; known are PlaneSymmetrical"),
        ("TIS 0.5", "TIS x", "has 'x' where the total scatter should be"),
        ("DataEnd", "", "the file ends where DataEnd should be"),
        ("ScatterRadial  6", "ScatterRadial  5", "has the number '80' where .* there are more numbers"),
    ],
)
def test_zemax_refuses(tmp_path, old, new, message):
    path = tmp_path / "vinyl.bsdf"
    write_zemax(path)
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ValueError, match=message):
        data.load(path)


def test_a_comment_makes_no_other_format_of_a_zemax_file(tmp_path):
    path = tmp_path / "vinyl.bsdf"
    write_zemax(path)
    before = data.load(path)
    path.write_text("# AOI: angle of incidence" + 5000 * " " + "\n" + path.read_text())
    assert "Zemax" in data.load(path).source and (data.load(path).f == before.f).all()


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("AOI 30", "", "each must have an AOI"),
        ("Side Back", "", "that others have"),
        ("AOI 30", "AOI 0", "a block that stood there before"),
        ("ScatterRadial 5", "ScatterRadial 4", "there are more numbers"),
    ],
)
def test_lighttools_refuses(tmp_path, old, new, message):
    path = tmp_path / "paint.bsdf"
    write_lighttools(path)
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ValueError, match=message):
        data.load(path)


def test_astm_with_fewer_rows_than_it_says_is_cut_off(tmp_path):
    path = tmp_path / "garnet.astm"
    write_astm(path)
    path.write_text("\n".join(path.read_text().splitlines()[:-1]) + "\n")
    with pytest.raises(ValueError, match="NUM_POINTS says 45, and there are 44 rows"):
        data.load(path)


def test_alta_in_degrees_is_refused(tmp_path):
    path = tmp_path / "tape.dat"
    write_alta(path)
    lines = path.read_text().splitlines()
    rows = [line if line.startswith("#") else "57 " + line.split(maxsplit=1)[1] for line in lines]
    path.write_text("\n".join(rows) + "\n")
    with pytest.raises(ValueError, match="the largest angle is 57; ALTA's are in radians"):
        data.load(path)


@pytest.mark.parametrize(
    "channels", [["R", "G", "B"], ["X", "Y", "Z"], ["Bs"], [f"{v}nm" for v in range(400, 701, 20)]]
)
def test_astm_channels(tmp_path, channels):
    path = tmp_path / "garnet.astm"
    write_astm(path, channels)
    m = data.load(path)
    assert (
        np.ptp(m.f, axis=1).max() < (0.3 if channels[0] == "X" else 1e-5) * m.f.max()
    )  # grey, but for XYZ: its white is not 1


def test_astm_in_degrees_is_the_same(tmp_path):
    write_astm(tmp_path / "a.astm", ["Bs"])
    write_astm(tmp_path / "b.astm", ["Bs"], degrees=True)
    a, b = (data.load(tmp_path / f"{n}.astm") for n in "ab")
    np.testing.assert_allclose(a.wi, b.wi, atol=1e-6)
    assert "angles in degrees" in b.source


# ---- ALTA


def test_alta_divides_the_cosine_of_the_viewer_out(tmp_path):
    for out in ("INV_STERADIAN", "INV_STERADIAN_COSINE_FACTOR", None):
        write_alta(tmp_path / "tape.dat", out)
        m = data.load(tmp_path / "tape.dat", n_samples=10**6)
        error = np.abs(m.f / smooth(m.wi, m.wo) - 1).max()
        assert (error > 0.5) if out is None else (error < 1e-4)
        assert ("no PARAM_OUT" in m.source) == (out is None)


@pytest.mark.parametrize(
    "name", ["RETRO_TL_TVL_PROJ_DPHI", "ISOTROPIC_TV_TL_DPHI", "SPHERICAL_TL_PL_TV_PV", "CARTESIAN"]
)
def test_alta_parameterizations(tmp_path, name):
    rows = {
        "RETRO_TL_TVL_PROJ_DPHI": [0.4, 0.0, 0.0],
        "ISOTROPIC_TV_TL_DPHI": [0.4, 0.4, 0.0],
        "SPHERICAL_TL_PL_TV_PV": [0.4, 1.0, 0.4, 1.0],
        "CARTESIAN": [0.6, 0.0, 0.8, 1.2, 0.0, 1.6],
    }[name]
    text = f"#DIM {len(rows)} 1\n#PARAM_IN {name}\n#PARAM_OUT INV_STERADIAN\n" + " ".join(map(str, [*rows, 0.5])) + "\n"
    (tmp_path / "a.alta").write_text(text)
    m = data.load(tmp_path / "a.alta")
    np.testing.assert_allclose(m.wi, m.wo, atol=1e-6)  # each says: seen from the light
    assert m.wi[0, 2] == pytest.approx(0.8 if name == "CARTESIAN" else np.cos(0.4)) and m.f[0, 0] == 0.5


@pytest.mark.parametrize(
    "text, message",
    [
        ("#PARAM_IN COS_TH\n#DIM 1 1\n1 2\n", "#PARAM_IN is 'COS_TH'; known are ISOTROPIC_TL_TV_PROJ_DPHI"),
        ("#PARAM_IN CARTESIAN\n#DIM 6 2\n1 2\n", '#DIM is "6 2"; CARTESIAN has 6 angles'),
        ("#PARAM_IN CARTESIAN\n#DIM 6 1\n1 2\n", "rows have 2 columns, #DIM asks for 6 . 1"),
        ("#PARAM_IN CARTESIAN\n#DIM 6 1\n1 2\n1 x\n", "line 4 is '1 x'"),
        ("#PARAM_IN CARTESIAN\n#DIM 6 1\n", "no numbers below the header"),
    ],
)
def test_alta_refuses(tmp_path, text, message):
    (tmp_path / "a.dat").write_text(text)
    with pytest.raises(ValueError, match=message):
        data.load(tmp_path / "a.dat")
