"""Readers of measured data: each against an independent twin or a number; conventions so that a swap would show."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

import mi_enhance  # noqa: F401  (before mitsuba: it chooses the LLVM)

import mitsuba as mi  # isort: skip
from mi_enhance import data
from mi_enhance.data import directions, merl, nbrdf, nps, reference_brdfs, rgl, synthetic

COLOURED_GGX = dict(
    n=[0, 0, 1], t_theta=0, rho_d=[0.1, 0.2, 0.3], rho_s=[1, 0.5, 0.2], alpha_x=0.15, alpha_y=0.15, F0=0.04
)


@pytest.fixture
def rgb():
    mi.set_variant("llvm_ad_rgb")


def wavy_ggx(wi, wo):
    """A reciprocal, isotropic material that depends on all three angles of MERL, phi_d included."""
    _, _, theta_d, phi_d = directions.directions_to_rusinkiewicz(wi, wo)
    wave = 1 + 0.5 * np.sin(theta_d) ** 2 * np.sin(2 * phi_d + 0.3)
    return reference_brdfs.ggx(wi, wo, **COLOURED_GGX) * wave[:, None]


def log_l1(f, g, wo):
    return np.mean(np.abs(np.log1p(f * wo[:, 2:]) - np.log1p(g * wo[:, 2:])))


# ---- directions


def test_rusinkiewicz_round_trip():
    rng = np.random.default_rng(1)
    angles = rng.random((4, 20_000)) * np.array([[np.pi / 2], [2 * np.pi], [np.pi / 2], [2 * np.pi]])
    back = directions.directions_to_rusinkiewicz(*directions.rusinkiewicz_to_directions(*angles))
    # phi loses digits where its theta is small: 1e-16 / 1e-4
    assert max(np.abs(np.sin((a - b) / 2)).max() for a, b in zip(angles, back, strict=True)) < 1e-11


def test_rusinkiewicz_turns_the_light():
    wi, wo = directions.rusinkiewicz_to_directions(0.0, 0.0, 0.5, 0.3)  # h is the normal: d is the light itself
    light = np.sin(0.5) * np.cos(0.3), np.sin(0.5) * np.sin(0.3), np.cos(0.5)
    np.testing.assert_allclose(wo, light, atol=1e-15)
    np.testing.assert_allclose(wi, (-light[0], -light[1], light[2]), atol=1e-15)
    theta_h, _, d = directions.half_difference(wi, wo)
    assert theta_h == pytest.approx(0, abs=1e-15) and d == pytest.approx(light)


def test_sample_pairs_uniform_in_the_four_angles():
    wi, wo = directions.sample_pairs(40_000, seed=2)
    for w in (wi, wo):
        assert w.dtype == np.float32 and np.abs(np.linalg.norm(w, axis=1) - 1).max() < 1e-6
        assert w[:, 2].min() >= np.float32(0.01)
    theta_h, phi_h, theta_d, phi_d = directions.directions_to_rusinkiewicz(wi, wo)
    # In the triangle theta_h + theta_d < 85 degrees nothing meets the horizon, so the density there is constant:
    # mean 1/3 of the side for both. phi_h is uniform everywhere, and phi_d within the triangle.
    side = np.radians(85)
    inside = theta_h + theta_d < side
    four_sigma = 4 * np.sqrt(1 / 18 / inside.sum())  # variance of a triangular distribution on [0, 1]
    assert theta_h[inside].mean() / side == pytest.approx(1 / 3, abs=four_sigma)
    assert theta_d[inside].mean() / side == pytest.approx(1 / 3, abs=four_sigma)
    for phi in (phi_h, phi_d[inside]):
        counts = np.histogram(phi, 16, (0, 2 * np.pi))[0]
        chi2 = np.sum((counts - counts.mean()) ** 2 / counts.mean())
        assert chi2 < 40  # 15 degrees of freedom: exceeded by chance in 0.05 % of the seeds


def test_sample_pairs_seeded():
    assert np.array_equal(directions.sample_pairs(50, seed=3), directions.sample_pairs(50, seed=3))
    assert not np.array_equal(directions.sample_pairs(50, seed=3), directions.sample_pairs(50, seed=4))


def test_sample_pairs_gives_up_on_an_empty_source():
    with pytest.raises(ValueError, match="holds .almost. no valid data"):
        directions.sample_pairs(5, accept=lambda wi, wo: np.zeros(len(wi), bool))


# ---- the record

UP, TILTED, GREY = [[0, 0, 1]], [[0, 0.6, 0.8]], [[0.1, 0.1, 0.1]]


@pytest.mark.parametrize(
    "wi, wo, f, message",
    [
        (UP, TILTED, [[0.1, 0.1]], r"\(1, 2\).*must be \(N, 3\)"),
        (UP + UP, TILTED, GREY, r"wi, wo and f have shapes \(\(2, 3\), \(1, 3\)"),
        (np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3)), "no sample at all"),
        (UP, TILTED, [[np.nan, 0, 0]], r"f\[0\] is .*must be finite"),
        (UP, TILTED, [[1e300, 0, 0]], r"f\[0\] is .*must be finite"),
        (UP, [[0, 0, 2]], GREY, r"wo\[0\] .*must have length 1"),
        (UP, [[0, 0.6, -0.8]], GREY, r"wo\[0\] .*above the horizon"),
        (UP, TILTED, [[0.1, -0.1, 0]], r"f\[0\] .*must be >= 0"),
    ],
    ids=["channels", "lengths", "empty", "nan", "overflow", "unit", "horizon", "negative"],
)
def test_measurements_refuse(wi, wo, f, message):
    with pytest.raises(ValueError, match=message):
        data.Measurements(wi, wo, f, "x", "test")


# ---- RGL


@pytest.mark.parametrize("name", ["aurora_white", "ilm_solo_m_68"])
def test_rgl_is_mitsubas_measured_with_light_as_wo(rgb, name):
    path = f"mi_enhance/bundled/rgl/{name}_rgb.bsdf"
    viewer, light = (np.array(v) / np.linalg.norm(v) for v in ([0.3, 0.1, 1.0], [-0.9, 0.4, 0.5]))
    bsdf = mi.load_dict({"type": "measured", "filename": path})

    def measured(wi, wo):
        si = mi.SurfaceInteraction3f()
        si.wi = mi.Vector3f(wi)
        return np.array(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(wo)))[:, 0] / wo[2]

    f = rgl.evaluate(path, [viewer, light], [light, viewer])
    np.testing.assert_allclose(f[0], measured(viewer, light), rtol=1e-5)
    np.testing.assert_allclose(f[1], measured(light, viewer), rtol=1e-5)
    assert np.abs(f[0] / f[1] - 1).max() > 0.01  # the files are not reciprocal: a swap would fail above


@pytest.mark.parametrize("name, share", [("aurora_white", 0.0), ("cg_sunflower", 0.27)])
def test_rgl_negative_values_clamped_and_counted(rgb, name, share):
    path = f"mi_enhance/bundled/rgl/{name}_rgb.bsdf"
    m = data.load(path, n_samples=20_000, seed=1)
    raw = rgl.evaluate(path, m.wi, m.wo)
    assert np.array_equal(m.f, np.maximum(raw, 0)) and m.name == name
    assert (
        m.clamped_fraction == np.mean(raw < 0) == pytest.approx(share, abs=0.01)
    )  # 0.27: mi_enhance/bundled/rgl/README.md


def test_rgl_in_scalar_variant_says_which_to_set():
    mi.set_variant("scalar_rgb")
    try:
        with pytest.raises(
            RuntimeError,
            match=r'an RGB variant that is not scalar; "scalar_rgb" is active. Call mi.set_variant\("llvm_ad_rgb"\)',
        ):
            data.load("mi_enhance/bundled/rgl/aurora_white_rgb.bsdf", n_samples=10)
    finally:
        mi.set_variant("llvm_ad_rgb")


# ---- MERL


@pytest.fixture(scope="module")
def merl_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("merl") / "wavy-ggx.binary"
    merl.write_merl(path, wavy_ggx)
    return path


def test_merl_round_trip_of_an_analytic_brdf(merl_file):
    m = data.load(merl_file, n_samples=20_000)
    exact = wavy_ggx(m.wi, m.wo)
    assert m.name == "wavy-ggx" and m.clamped_fraction == 0
    assert np.median(np.abs(m.f / exact - 1)) < 2e-4  # linear interpolation of a smooth lobe in 1 to 2 degree cells
    assert log_l1(m.f, exact, m.wo) < 2e-4  # larger errors only beside cells below the horizon, which hold nothing


def test_merl_layout_is_that_of_merls_own_code(merl_file):
    raw, table = np.fromfile(merl_file, "<f8", offset=12), merl.read_table(merl_file)
    rng = np.random.default_rng(5)
    for theta_h, theta_d, phi_d in rng.random((20, 3)) * (0.6, 0.6, np.pi):
        j = int(np.sqrt(np.degrees(theta_h) / 90 * 90 * 90))
        k, p = int(np.degrees(theta_d) / 90 * 90), int(phi_d / np.pi * 180)
        middle = (j + 0.5) ** 2 / 90**2 * np.pi / 2, 0.0, (k + 0.5) / 90 * np.pi / 2, (p + 0.5) / 180 * np.pi
        wi, wo = directions.rusinkiewicz_to_directions(*middle)
        index = p + 180 * k + 180 * 90 * j
        stored = [raw[index + c * 90 * 90 * 180] * s for c, s in enumerate((1 / 1500, 1.15 / 1500, 1.66 / 1500))]
        np.testing.assert_allclose(stored, wavy_ggx(wi[None], wo[None])[0], rtol=1e-12)
        found = merl.lookup(table, wi[None], wo[None])[0]
        np.testing.assert_allclose(found, stored, rtol=1e-4)  # in the middle of a cell nothing is interpolated


@pytest.fixture
def editable_merl(merl_file, tmp_path):
    path = shutil.copy(merl_file, tmp_path / "edited.binary")
    return path, np.memmap(path, "<f8", "r+", offset=12, shape=(3, 90, 90, 180))


def test_merl_unmeasured_cells_are_never_sampled_nor_mixed_in(editable_merl):
    path, raw = editable_merl
    raw[:, 20:40] = -1
    raw.flush()
    m = data.load(path, n_samples=20_000)
    theta_h = directions.directions_to_rusinkiewicz(m.wi, m.wo)[0]
    cell = np.sqrt(theta_h / (np.pi / 2)) * 90
    assert not ((cell > 20.001) & (cell < 39.999)).any()
    edge = (np.abs(cell - 19.75) < 0.25) | (np.abs(cell - 40.25) < 0.25)
    assert edge.sum() > 50 and m.clamped_fraction == 0
    # half a cell of extrapolation; a -1 taken for a value would give 0 or far less
    assert np.abs(m.f[edge] / wavy_ggx(m.wi, m.wo)[edge] - 1).max() < 0.2


def test_merl_real_negatives_are_clamped_and_counted(editable_merl):
    path, raw = editable_merl
    raw[1, 60:][raw[1, 60:] != -1] = -0.25
    raw.flush()
    m = data.load(path, n_samples=20_000)
    theta_h = directions.directions_to_rusinkiewicz(m.wi, m.wo)[0]
    negative = np.sqrt(theta_h / (np.pi / 2)) * 90 > 60.5
    assert (m.f[negative, 1] == 0).all() and (m.f[negative, 0] > 0).all()
    assert m.clamped_fraction == pytest.approx(negative.mean() / 3, rel=0.05)


# ---- NBRDF and NPs


def features(wi, wo):
    """Polar angles of h and the light turned with it, written again with matrices."""
    h = (wi + wo) / np.linalg.norm(wi + wo)
    theta, phi = np.arccos(h[2]), np.arctan2(h[1], h[0])
    about_z = np.array([[np.cos(phi), np.sin(phi), 0], [-np.sin(phi), np.cos(phi), 0], [0, 0, 1]])
    about_y = np.array([[np.cos(theta), 0, -np.sin(theta)], [0, 1, 0], [np.sin(theta), 0, np.cos(theta)]])
    return theta, about_y @ about_z @ wo


def test_nbrdf_decoder_is_the_readmes():
    materials, networks = nbrdf.read_networks("mi_enhance/bundled/nbrdf/merl.npz")
    net = {k: w[materials.index("blue-acrylic")].astype(np.float64) for k, w in networks.items()}
    wi, wo = (w.astype(np.float64) for w in directions.sample_pairs(200, seed=6))
    expected = np.empty((200, 3))
    for k in range(200):
        theta, d = features(wi[k], wo[k])
        y = np.array([np.sin(theta), 0, np.cos(theta), *d])
        for i in (1, 2, 3):
            y = net[f"W{i}"].T @ y + net[f"b{i}"]
            y = np.maximum(y, 0) if i < 3 else np.maximum(np.exp(y) - 1, 0)
        expected[k] = y
    f = nbrdf.decode({k: w.astype(np.float32) for k, w in net.items()}, wi, wo)
    np.testing.assert_allclose(f, expected, rtol=1e-4, atol=1e-5)  # float32 sums of 21 terms, through exp
    swapped = nbrdf.decode({k: w.astype(np.float32) for k, w in net.items()}, wo, wi)
    assert np.median(np.abs(swapped / f - 1)) > 1e-3  # not reciprocal: a swapped light would fail above


@pytest.fixture(scope="module")
def nps_merl():
    materials, latents = nps.read_latents("mi_enhance/bundled/nps/merl.npz")
    return materials, latents, nps.read_decoder("mi_enhance/bundled/nps/decoder.npz")


@pytest.mark.parametrize("with_cosine", [False, True], ids=["merl", "rgl"])
def test_nps_decoder_is_the_readmes(nps_merl, with_cosine):
    materials, latents, decoder = nps_merl
    z = latents[[materials.index("blue-acrylic"), materials.index("brass")]].mean(0)  # mixtures are allowed
    wi, wo = (w.astype(np.float64) for w in directions.sample_pairs(50, seed=7))
    expected = np.empty((50, 3))
    for k in range(50):
        theta_h, d = features(wi[k], wo[k])
        theta_d, phi_d = np.arccos(d[2]), np.arctan2(d[1], d[0])
        angles = [
            0.5 + 0.5 * np.cos(2 * phi_d),
            0.5 + 0.5 * np.sin(2 * phi_d),
            theta_h / (np.pi / 2),
            theta_d / (np.pi / 2),
        ]
        y = np.array([*angles, *z])
        for i in range(1, 8):
            y = np.maximum(decoder[f"W{i}"].astype(np.float64).T @ y + decoder[f"b{i}"], 0)
        y *= 0.15
        for _ in range(4):
            y = np.exp(y) - 1
        expected[k] = y / (np.cos(theta_h) * np.cos(theta_d)) if with_cosine else y
    f = nps.decode(decoder, z, wi, wo, with_cosine=with_cosine)
    np.testing.assert_allclose(f, expected, rtol=1e-3, atol=1e-5)  # four exponentials multiply the float32 rounding


def test_nps_exactly_reciprocal(nps_merl):
    _, latents, decoder = nps_merl
    wi, wo = directions.sample_pairs(3000, seed=8)
    for latent in latents[:3]:
        assert np.array_equal(nps.decode(decoder, latent, wi, wo), nps.decode(decoder, latent, wo, wi))


def test_nps_and_nbrdf_tell_the_same_materials(nps_merl):
    materials, latents, decoder = nps_merl
    names, networks = nbrdf.read_networks("mi_enhance/bundled/nbrdf/merl.npz")
    wi, wo = directions.sample_pairs(1500, seed=9)
    difference, others = [], []
    for i in range(0, 100, 4):
        f = nps.decode(decoder, latents[i], wi, wo)
        for j, into in ((names.index(materials[i]), difference), ((names.index(materials[i]) + 50) % 100, others)):
            into.append(log_l1(f, nbrdf.decode({k: w[j] for k, w in networks.items()}, wi, wo), wo))
    assert np.mean(difference) < 0.006  # mi_enhance/bundled/nps/README.md: .0038 over all 100
    assert np.mean(others) > 10 * np.mean(difference)  # another material is told apart


def test_nps_latents_with_rgl_names_divide_by_the_cosines(nps_merl, tmp_path):
    _, latents, decoder = nps_merl
    shutil.copy("mi_enhance/bundled/nps/decoder.npz", tmp_path)
    np.savez(tmp_path / "rgl.npz", names=["chm_orange", "spectralon"], mean=latents[:2])
    m = data.load(tmp_path / "rgl.npz", material="spectralon", n_samples=500)
    assert np.array_equal(m.f, nps.decode(decoder, latents[1], m.wi, m.wo, with_cosine=True))


def test_nps_without_decoder_says_what_is_missing(tmp_path):
    shutil.copy("mi_enhance/bundled/nps/merl.npz", tmp_path)
    with pytest.raises(FileNotFoundError, match="decoder.npz is not in the same folder"):
        data.load(tmp_path / "merl.npz", material="brass")


# ---- synthetic


def test_synthetic_formula_is_mitsubas_roughconductor(rgb):
    p = dict(n=[0, 0, 1], t_theta=0.0, rho_d=np.zeros(3), rho_s=np.ones(3), alpha_x=0.35, alpha_y=0.08, F0=1.0)
    bsdf = mi.load_dict(
        {"type": "roughconductor", "distribution": "ggx", "material": "none", "alpha_u": 0.35, "alpha_v": 0.08}
    )
    wi, wo = directions.sample_pairs(2000, seed=10)
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(wi.T.copy())
    expected = np.array(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(wo.T.copy()))).T / wo[:, 2:]
    f = reference_brdfs.ggx(wi, wo, **p)
    compared = expected > 1e-4 * expected.max()  # Mitsuba flushes the far tail of D to 0
    assert compared.mean() > 0.2
    np.testing.assert_allclose(f[compared], expected[compared], rtol=1e-3)  # float32 half vectors near sharp lobes
    turned = reference_brdfs.ggx(wi, wo, **(p | {"t_theta": np.pi / 2, "alpha_x": 0.08, "alpha_y": 0.35}))
    np.testing.assert_allclose(turned, f, rtol=1e-9)


def test_synthetic_frame_is_the_packages(rgb):
    from mi_enhance.analytic import geometry

    n = np.array([0.2, -0.1, np.sqrt(1 - 0.05)])
    frame = geometry.frame(mi.Float(0.2), mi.Float(-0.1), mi.Float(0.7))
    for ours, theirs in zip(reference_brdfs.frame(n, 0.7), (frame.s, frame.t, frame.n), strict=True):
        np.testing.assert_allclose(ours, np.array(theirs)[:, 0], atol=1e-6)


def test_synthetic_noise_and_ranges():
    m, truth = synthetic.ggx_anisotropic(5, n_samples=20_000, max_tilt=0.2)
    ratio = m.f / reference_brdfs.ggx(m.wi, m.wo, **truth)
    n = ratio.size
    assert ratio.mean() == pytest.approx(1, abs=4 * 0.1 / np.sqrt(n))
    assert ratio.std() == pytest.approx(0.1, abs=4 * 0.1 / np.sqrt(2 * n))
    truths = [synthetic.ggx_anisotropic(s, n_samples=1)[1] for s in range(300)]
    alphas = np.array([(t["alpha_x"], t["alpha_y"]) for t in truths])
    assert (alphas[:, 0] >= alphas[:, 1]).all() and 0.006 <= alphas.min() < 0.0065 and 0.47 < alphas.max() <= 0.503
    median = np.sqrt(0.006 * 0.503)  # of a log-uniform distribution
    assert np.mean(alphas < median) == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(600))
    for key, highest in (("t_theta", np.pi), ("rho_d", 1), ("rho_s", 10)):
        values = np.array([t[key] for t in truths])
        assert 0 <= values.min() < 0.02 * highest and 0.98 * highest < values.max() <= highest
    assert m.f.min() >= 0 and np.arccos(truth["n"][2]) <= 0.2


WARD = dict(t_theta=0.4, rho_d=[0.3, 0.2, 0.1], rho_s=[0.1, 0.2, 0.4], alpha_x=0.3, alpha_y=0.1)
BECKMANN = dict(t_theta=0.4, F0=[0.9, 0.5, 0.1], alpha_x=0.3, alpha_y=0.1)


@pytest.mark.parametrize("f, p", [(reference_brdfs.ward, WARD), (reference_brdfs.beckmann, BECKMANN)])
def test_synthetic_validation_lobes_are_reciprocal_positive_and_turn_with_the_tangent(f, p):
    wi, wo = directions.sample_pairs(2000, seed=11)
    values = f(wi, wo, **p)
    assert (values >= 0).all() and (values > 0).any()  # far from its peak a lobe alone underflows to 0
    np.testing.assert_allclose(f(wo, wi, **p), values, rtol=1e-12)
    c, s = np.cos(0.4), np.sin(0.4)
    back = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])  # rows times this: turned by -0.4 about the normal
    np.testing.assert_allclose(f(wi @ back, wo @ back, **{**p, "t_theta": 0.0}), values, rtol=1e-9)
    np.testing.assert_allclose(f(wi, wo, **{**p, "t_theta": 0.4 + np.pi}), values, rtol=1e-9)


def test_synthetic_ward_by_angles():
    # eq. 5a as Ward writes it: delta between h and n, phi of h to the tangent
    theta_h, phi_h, theta_d, phi_d = 0.3, 1.1, 0.5, 2.0
    wi, wo = directions.rusinkiewicz_to_directions(*np.array([[theta_h], [phi_h], [theta_d], [phi_d]]))
    phi = phi_h - WARD["t_theta"]
    exponent = np.tan(theta_h) ** 2 * (np.cos(phi) ** 2 / 0.3**2 + np.sin(phi) ** 2 / 0.1**2)
    lobe = np.exp(-exponent) / (4 * np.pi * 0.3 * 0.1) / np.sqrt(wi[0, 2] * wo[0, 2])
    expected = np.array(WARD["rho_d"]) / np.pi + np.array(WARD["rho_s"]) * lobe
    np.testing.assert_allclose(reference_brdfs.ward(wi, wo, **WARD)[0], expected, rtol=1e-12)


def test_synthetic_beckmann_is_mitsubas_roughconductor(rgb):
    bsdf = mi.load_dict(
        {"type": "roughconductor", "distribution": "beckmann", "material": "none", "alpha_u": 0.35, "alpha_v": 0.1}
    )
    wi, wo = directions.sample_pairs(2000, seed=12)
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(wi.T.copy())
    expected = np.array(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(wo.T.copy()))).T / wo[:, 2:]
    f = reference_brdfs.beckmann(wi, wo, t_theta=0.0, F0=np.ones(3), alpha_x=0.35, alpha_y=0.1)
    compared = expected > 1e-4 * expected.max()  # Mitsuba flushes the far tail of D to 0
    assert compared.mean() > 0.1
    np.testing.assert_allclose(f[compared], expected[compared], rtol=1e-3)  # float32 half vectors


@pytest.mark.parametrize("draw", [synthetic.ward_anisotropic, synthetic.beckmann_mixture])
def test_synthetic_validation_kinds_are_seeded_and_anisotropic(draw):
    a, b, other = draw(4, n_samples=500), draw(4, n_samples=500), draw(5, n_samples=500)
    assert (a.f == b.f).all() and (a.wi == b.wi).all() and not (a.f == other.f).any()
    assert a.name == f"{draw.__name__}_4" and (a.f > 0).all() and "validation only" in a.source


# ---- choosing the reader


def test_load_goes_by_content_not_by_suffix(merl_file, tmp_path):
    shutil.copy("mi_enhance/bundled/nbrdf/nielsen.npz", tmp_path / "nielsen.dat")
    assert data.load(tmp_path / "nielsen.dat", material="bluebook", n_samples=10).source.startswith("NBRDF")
    shutil.copy(merl_file, tmp_path / "table.bin")
    assert data.load(tmp_path / "table.bin", n_samples=10).source.startswith("MERL")


def test_names_lists_collections():
    assert (
        len(data.names("mi_enhance/bundled/nbrdf/merl.npz"))
        == len(data.names("mi_enhance/bundled/nps/merl.npz"))
        == 100
    )
    assert data.names("mi_enhance/bundled/rgl/chm_mint_rgb.bsdf") == ["chm_mint"]


MERL_NPZ, NIELSEN = "mi_enhance/bundled/nps/merl.npz", "mi_enhance/bundled/nbrdf/nielsen.npz"


@pytest.mark.parametrize(
    "path, settings, error, message",
    [
        ("data/none.npz", {}, FileNotFoundError, "no such file"),
        ("mi_enhance/bundled/nbrdf", {}, ValueError, "this is a folder"),
        (
            "mi_enhance/bundled/nbrdf/README.md",
            {},
            ValueError,
            r"neither content nor suffix '.md' .* kind= \(alta, .*merl, mit, nbrdf",
        ),
        (MERL_NPZ, {}, ValueError, r"holds 100 materials \(alum-bronze, .*material= \(--material\)"),
        (MERL_NPZ, {"material": "blue-acryl"}, ValueError, "no material 'blue-acryl' .*Did you mean \"blue-acrylic\""),
        (
            "mi_enhance/bundled/nps/decoder.npz",
            {},
            ValueError,
            r"holds the arrays W1, .* NPs .npz .the latents, with the decoder beside them.: names, mean",
        ),
        (
            "mi_enhance/bundled/rgl/chm_mint_rgb.bsdf",
            {"material": "mint"},
            ValueError,
            "holds one material, 'mint' was asked for",
        ),
        (NIELSEN, {"kind": "nbdrf"}, ValueError, "kind is 'nbdrf'. .*Did you mean \"nbrdf\""),
        (NIELSEN, {"kind": "nps"}, ValueError, "the array 'mean' is missing"),
        (NIELSEN, {"n_samples": 0}, ValueError, "n_samples is 0; it must be a positive integer"),
    ],
    ids="missing folder unknown which misspelt decoder single kind wrong-kind count".split(),
)
def test_load_explains(path, settings, error, message):
    with pytest.raises(error, match=rf'data.load\("{path}"\): .*{message}'):
        data.load(path, **settings)
