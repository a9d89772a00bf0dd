"""The sampling density integrates to what the samples show, and the weights it leaves are finite."""

from __future__ import annotations

import lanes
import mitsuba as mi
import numpy as np
import pytest
import twin

from mi_enhance import models
from mi_enhance.analytic.models.abc import lobes_of_abc
from mi_enhance.material.material import Material
from mi_enhance.sampling import albedo, importance, lobe_mixture

QUADRATURE = 2e-3  # of 1e6 midpoints with a horizon cut through them
DRAWN = 5e-3  # three standard deviations of a fraction of 1e5 samples

FLAT = (0.0, 0.0, 0.0)
TILTED = (0.3, -0.2, 0.8)
LOBES = [(0.02, 0.02), (0.1, 0.1), (0.1, 0.5), (1.0, 1.0)]
VIEWS = {"normal": 0.0, "30 degrees": 0.5, "80 degrees": 1.4}


def parameters(alpha, frame, **other):
    values = dict(zip(("n_x", "n_y", "t_theta"), frame, strict=True))
    values |= {"alpha_x": alpha[0], "alpha_y": alpha[1], "rho_d": 0.2, "rho_s": 1.0, "F0": 0.5, **other}
    return {k: (mi.Color3f if k.startswith("rho") else mi.Float)(v) for k, v in values.items()}


def view(theta):
    return np.float32([np.sin(theta) * np.cos(0.3), np.sin(theta) * np.sin(0.3), np.cos(theta)])


def reflected_grid(wi, alpha, frame, n=1000):
    """Directions wo that mirror wi at midpoints of the lobe, and the solid angle each stands for."""
    axes = twin.frame(*frame)
    v, psi = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n * 2 * np.pi)
    s = v / (1 - v)
    slope = np.stack([alpha[0] * s * np.cos(psi), alpha[1] * s * np.sin(psi)], -1).reshape(-1, 2)
    h = twin.unit(np.concatenate([slope, np.ones((n * n, 1))], 1))
    area = alpha[0] * alpha[1] * (s / (1 - v) ** 2).ravel() * (2 * np.pi / n**2)  # of the slopes
    local = axes @ wi.astype(np.float64)
    dot = h @ local
    wo = (2 * dot[:, None] * h - local) @ axes
    return wo.astype(np.float32), np.where(dot > 0, 4 * dot * h[:, 2] ** 3 * area, 0)


def fraction_above(wi, p, share, n=100_000):
    """Share of the samples above both horizons."""
    rng = np.random.default_rng(0)
    u = [mi.Float(v) for v in rng.random((3, n)).astype(np.float32)]
    wo = np.array(importance.sample(mi.Vector3f(wi), p, [mi.Float(share)], u[0], mi.Point2f(u[1], u[2]))).T
    np.testing.assert_allclose(np.linalg.norm(wo, axis=1), 1, atol=1e-5)
    n_axis = twin.frame(*(np.array(p[k])[0] for k in ("n_x", "n_y", "t_theta")))[2]
    return np.mean((wo[:, 2] > 0) & (wo @ n_axis > 0))


@pytest.mark.parametrize("theta", VIEWS.values(), ids=VIEWS)
@pytest.mark.parametrize("frame", [FLAT, TILTED], ids=["flat", "tilted"])
@pytest.mark.parametrize("alpha", LOBES, ids=str)
def test_density_of_the_lobe_integrates_to_what_is_above_the_horizon(llvm, alpha, frame, theta):
    wi, p = view(theta), parameters(alpha, frame)
    if twin.frame(*frame)[2] @ wi <= 0.01:
        pytest.skip("the view is below the horizon of the tilted normal")
    wo, weight = reflected_grid(wi, alpha, frame)
    density = np.array(importance.pdf(mi.Vector3f(wi), lanes.vectors(wo), p, [mi.Float(1)]), np.float64)
    integral = np.sum(density * weight)
    assert integral <= 1 + QUADRATURE
    assert integral == pytest.approx(fraction_above(wi, p, 1.0), abs=QUADRATURE + DRAWN)
    if theta == 0 and frame == FLAT and max(alpha) <= 0.1:
        assert integral > 0.95  # hardly anything is reflected below the horizon


@pytest.mark.parametrize("frame", [FLAT, TILTED], ids=["flat", "tilted"])
def test_density_of_the_mixture_integrates_to_what_is_above_the_horizon(llvm, frame):
    wi, p = view(0.5), parameters((0.3, 0.5), frame)
    z, phi = np.meshgrid((np.arange(1000) + 0.5) / 1000, (np.arange(1000) + 0.5) / 1000 * 2 * np.pi)
    r = np.sqrt(1 - z * z)
    wo = np.stack([r * np.cos(phi), r * np.sin(phi), z], -1).reshape(-1, 3)
    density = np.array(importance.pdf(mi.Vector3f(wi), lanes.vectors(wo), p, [mi.Float(0.4)]), np.float64)
    integral = density.mean() * 2 * np.pi
    assert integral == pytest.approx(fraction_above(wi, p, 0.4), abs=QUADRATURE + DRAWN)
    assert 0.8 < integral < 1 + QUADRATURE


@pytest.mark.parametrize("alpha", [(1e-4, 1e-4), (0.01, 1.0), (0.5, 0.5)], ids=str)
def test_random_numbers_on_the_rim_give_directions(llvm, alpha):
    """Renderers draw exact zeros; Mitsuba's own distribution answers some of them with NaN."""
    rim = np.float32([0, 1e-7, 0.25, 0.5, 1 - 2**-24])
    u = [mi.Float(v.ravel()) for v in np.meshgrid(rim, rim, rim)]
    for theta in VIEWS.values():
        wi = mi.Vector3f(view(theta))
        wo = importance.sample(wi, parameters(alpha, FLAT), [mi.Float(0.5)], u[0], mi.Point2f(u[1], u[2]))
        np.testing.assert_allclose(np.linalg.norm(np.array(wo), axis=0), 1, atol=1e-5)  # NaN would not be close


def test_density_is_zero_below_either_horizon(llvm):
    rng = np.random.default_rng(1)
    wi, wo = twin.unit(rng.normal(size=(2, 4000, 3))).astype(np.float32)
    n = twin.frame(*TILTED)[2]
    density = np.array(
        importance.pdf(lanes.vectors(wi), lanes.vectors(wo), parameters((0.3, 0.3), TILTED), [mi.Float(0.5)])
    )
    below = (np.minimum(wi[:, 2], wo[:, 2]) <= 0) | (np.minimum(wi @ n, wo @ n) < -1e-6)
    above = (np.minimum(wi[:, 2], wo[:, 2]) > 0) & (np.minimum(wi @ n, wo @ n) > 1e-3)
    assert not density[below].any() and (density[above] > 0).all()


@pytest.mark.parametrize("alpha", [(1e-4, 1e-4), (1e-4, 1.0), (0.1, 0.4), (1.0, 1.0)], ids=str)
@pytest.mark.parametrize("frame", [FLAT, TILTED], ids=["flat", "tilted"])
def test_weights_are_bounded(llvm, alpha, frame):
    """f cos / pdf of whatever is drawn, for views down to cos 1e-6.

    rho_d / pi against half a cosine weighs 2 rho_d. The lobe against half of itself weighs 2 rho_s F G1(wo), times the
    ratio of the two cosines of wo where the normal is tilted: that ratio is the model's, no sampling can take it away.
    """
    n = 20_000
    rng = np.random.default_rng(2)
    cos = np.geomspace(1e-6, 1, n)
    phi = rng.uniform(0, 2 * np.pi, n)
    wi = np.stack([np.sqrt(1 - cos**2) * np.cos(phi), np.sqrt(1 - cos**2) * np.sin(phi), cos], 1)
    u = [mi.Float(v) for v in rng.random((3, n)).astype(np.float32)]
    p, share, view = parameters(alpha, frame), [mi.Float(0.5)], lanes.vectors(wi)
    wo = importance.sample(view, p, share, u[0], mi.Point2f(u[1], u[2]))
    density = np.array(importance.pdf(view, wo, p, share))
    f = np.array(Material.analytic("ggx").brdf(view, wo, p)).max(0)
    assert np.isfinite(density).all() and (density >= 0).all() and np.isfinite(f).all()
    drawn = density > 0
    weight = f[drawn] * np.array(wo.z)[drawn] / density[drawn]
    assert np.isfinite(weight).all() and drawn.mean() > 0.3
    tilt = np.maximum(np.array(wo).T[drawn] @ twin.frame(*frame)[2], 1e-7)
    assert (weight < 1.01 * 2 * (0.2 + 1.0 * np.maximum(np.array(wo.z)[drawn] / tilt, 1))).all()


@pytest.mark.parametrize(
    "rho_d, rho_s, lobe, expected",
    [
        (0, 0, 0.5, 0.05),
        (1, 0, 0.5, 0.05),
        (0, 1, 0.5, 0.95),
        (0.5, 1, 0.5, 0.5),
        (0.5, 1, 0.0, 0.05),
        (0.1, 10, 0.04, 0.8),
    ],
)
def test_share_follows_the_albedos_and_never_leaves_a_technique_out(llvm, rho_d, rho_s, lobe, expected):
    p = {"rho_d": mi.Color3f(rho_d), "rho_s": mi.Color3f(rho_s), "alpha_x": mi.Float(0.1), "alpha_y": mi.Float(0.1)}
    (share,) = lobe_mixture.shares(p, lobe)
    assert share[0] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("alpha", [0.02, 0.2, 0.8])
def test_lobe_albedo_is_the_albedo_of_the_lobe(llvm, alpha):
    material = Material.analytic("ggx").edit(alpha_x=alpha, alpha_y=alpha, rho_d=0.3, rho_s=2.0, F0=0.5)
    wi = np.float32([0.5, 0, np.sqrt(0.75)])
    wo, weight = reflected_grid(wi, (alpha, alpha), FLAT)
    keep = wo[:, 2] > 0
    pairs = np.broadcast_to(wi, wo[keep].shape), wo[keep]
    f = twin.brdf(*pairs, {**material.params, "rho_d": np.zeros(3), "rho_s": np.ones(3)})[:, 0]
    expected = np.sum(f * wo[keep, 2] * weight[keep])
    assert albedo.lobe_albedo(material.brdf, material.as_drjit()) == pytest.approx(
        expected, rel=0.05
    )  # its purpose asks for no more


def weights(name, p, n=20_000, seed=2):
    """Views down to a cosine of 1e-6, directions drawn for them (half of them from the lobe), and f cos / pdf."""
    model = models.get(name)
    rng = np.random.default_rng(seed)
    cos, phi = np.geomspace(1e-6, 1, n), rng.uniform(0, 2 * np.pi, n)
    wi = np.stack([np.sqrt(1 - cos**2) * np.cos(phi), np.sqrt(1 - cos**2) * np.sin(phi), cos], 1)
    u = [mi.Float(v) for v in rng.random((3, n)).astype(np.float32)]
    share, view = [mi.Float(0.5)], lanes.vectors(wi)
    wo = importance.sample(view, p, share, u[0], mi.Point2f(u[1], u[2]), model)
    density = np.array(importance.pdf(view, wo, p, share, model))
    f = np.array(Material.analytic(name).brdf(view, wo, p)).max(0)
    assert np.isfinite(density).all() and (density >= 0).all() and np.isfinite(f).all()
    drawn = density > 0
    weight = f[drawn] * np.array(wo.z)[drawn] / density[drawn]
    assert np.isfinite(weight).all() and drawn.mean() > 0.3
    return wi[drawn], np.array(wo, np.float64).T[drawn], weight


@pytest.mark.parametrize("alpha", [(1e-4, 1e-4), (1e-4, 1.0), (0.1, 0.4), (1.0, 1.0)], ids=str)
@pytest.mark.parametrize("frame", [FLAT, TILTED], ids=["flat", "tilted"])
@pytest.mark.parametrize("name", ["cook_torrance", "ward"])
def test_weights_of_gaussian_lobes_are_bounded(llvm, name, alpha, frame):
    """As for GGX, times exp(-t) (1 + t)^2, at most 4/e, of the two distributions.

    Cook and Torrance's 1/pi adds 4/pi. Ward's root of the cosines adds sqrt(cos_o / cos_i): its albedo grows like that.
    """
    wi, wo, weight = weights(name, parameters(alpha, frame))
    n = twin.frame(*frame)[2]
    cos_i, cos_o = np.maximum(wi @ n, 1e-7), np.maximum(wo @ n, 1e-7)
    factor = 4 / np.pi if name == "cook_torrance" else np.sqrt(cos_o / np.maximum(cos_i, 1e-4))
    assert (weight < 1.01 * 2 * (0.2 + 4 / np.e * factor * np.maximum(wo[:, 2] / cos_o, 1))).all()


@pytest.mark.parametrize("n", [(1, 1), (1, 1e6), (20, 20), (3, 1e5), (1e4, 1e4), (1e6, 1e6)], ids=str)
@pytest.mark.parametrize("frame", [FLAT, TILTED], ids=["flat", "tilted"])
def test_weights_of_ashikhmin_shirley_are_bounded(llvm, n, frame):
    """As for Gaussian lobes, which cos^n becomes for large n; the diffuse term is at most 28/23 of Lambert's."""
    values = dict(zip(("n_x", "n_y", "t_theta"), frame, strict=True)) | {"n_u": n[0], "n_v": n[1]}
    p = {k: mi.Float(v) for k, v in values.items()} | {"F0": mi.Float(0.5)}
    wi, wo, weight = weights("ashikhmin_shirley", p | {"rho_d": mi.Color3f(0.2), "rho_s": mi.Color3f(1)})
    tilt = np.maximum(wo[:, 2] / np.maximum(wo @ twin.frame(*frame)[2], 1e-7), 1)
    assert (weight < 1.01 * 2 * (0.2 * 28 / 23 + 4 / np.e * tilt)).all()


# Low et al. 2012, as in dj_brdf: the most extreme ones of each parameter, and those with the widest tails.
PUBLISHED = {
    "chrome": (987.0, 64661.0, 1.905, 99.9994),
    "white-fabric2": (0.08, 6166446.0, 0.0235, 2.997),
    "black-fabric": (3.1, 871445.0, 0.292, 1.057),
    "aventurnine": (1836.0, 324914.0, 1.11, 1.404),
    "two-layer-silver": (126.0, 1048835.0, 0.598, 8.718),
    "gold-metallic-paint2": (205.0, 1705397.0, 0.622, 8.6),
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_weights_of_abc_are_bounded(llvm, name):
    """No lobe of GGX is as wide in its tail: there the cosine bounds the weight, 2 pi f, however grazing the view."""
    p = {k: mi.Float(v) for k, v in zip(("B", "C", "ior"), PUBLISHED[name][1:], strict=True)}
    p |= {"rho_d": mi.Color3f(0.2), "A": mi.Color3f(PUBLISHED[name][0])}
    _, _, weight = weights("abc", p)
    assert weight.max() < 150 and weight.mean() < 2
    assert np.quantile(weight, 0.99) < 5


@pytest.mark.parametrize("B", [1.0, 300.0, 3e5, 1e8])
@pytest.mark.parametrize("C", [0.01, 0.5, 1 - 1e-5, 1.0, 2.0, 10.0])
def test_lobe_of_abc_lies_between_its_two_widths(llvm, B, C):
    ((rho_s, alpha, _),) = lobes_of_abc({"A": mi.Color3f(2), "B": mi.Float(B), "C": mi.Float(C)})
    alpha = alpha[0]
    assert 0.999e-4 < alpha <= 1
    assert np.array(rho_s)[0, 0] == pytest.approx(8 * alpha**2, rel=1e-5)  # as high as A / pi
    x = np.concatenate([[0], np.geomspace(1e-12, 1, 200_000)])
    inside = np.cumsum((1 + B * (x[1:] + x[:-1]) / 2) ** -C * np.diff(x))
    half_weight = x[1:][np.searchsorted(inside, inside[-1] / 2)]
    half_height = min((2 ** (1 / C) - 1) / B, 1)
    by_weight = np.sqrt(half_weight * (2 - half_weight))
    sin2 = half_height * (2 - half_height)
    by_height = np.sqrt(sin2 / (sin2 + np.sqrt(2) - 1))
    assert alpha == pytest.approx(max(np.sqrt(by_weight * by_height), 1e-4), rel=0.02)
