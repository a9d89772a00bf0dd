"""The enhanced BRDF once more, in float64 NumPy: written from the literature and the documented conventions.

Forms differ from the package's on purpose: slopes instead of products, Smith's Lambda, Rodrigues' rotation, no graph.
Parameters are dictionaries of arrays (N, size) or (size,).
"""

from __future__ import annotations

import math

import numpy as np

SLOPE = 0.01  # leaky ReLU
SLOTS = ("M", "M+S", "S", "S*D", "D", "D*F", "F", "F*G", "G", "G*1/E", "1/E")  # the paper's 11, in reading order


def unit(v):
    v = np.asarray(v, np.float64)
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def rotate(v, axis, angle):
    """Rodrigues: `v` turned by `angle` about the unit vector `axis`."""
    v, axis = np.asarray(v, np.float64), np.asarray(axis, np.float64)
    angle = np.asarray(angle, np.float64)[..., None]
    along = np.sum(axis * v, -1, keepdims=True) * axis
    return along + np.cos(angle) * (v - along) + np.sin(angle) * np.cross(axis, v)


def frame(n_x, n_y, t_theta):
    """Rows t, b, n: the tangent is the direction closest to +x, turned by t_theta about n."""
    n_x, n_y, t_theta = (np.asarray(v, np.float64) for v in (n_x, n_y, t_theta))
    n = np.stack([n_x, n_y, np.sqrt(1 - n_x**2 - n_y**2)], -1)
    x = np.broadcast_to([1.0, 0.0, 0.0], n.shape)
    t = rotate(unit(x - np.sum(x * n, -1, keepdims=True) * n), n, t_theta)
    return np.stack([t, np.cross(n, t), n], -2)


def cosine_d(i, o):
    """Of half vector and either direction: half the length of their sum, whatever their own lengths round to."""
    return np.linalg.norm(i + o, axis=-1) / 2


def D_ggx(h, alpha_x, alpha_y):
    """Heitz 2014, eq. 85: by tan^2 theta_h (cos^2 phi_h / alpha_x^2 + sin^2 phi_h / alpha_y^2)."""
    slope = ((h[..., 0] / alpha_x) ** 2 + (h[..., 1] / alpha_y) ** 2) / h[..., 2] ** 2
    return 1 / (np.pi * alpha_x * alpha_y * h[..., 2] ** 4 * (1 + slope) ** 2)


def F_schlick(cos_theta_d, F0):
    return F0 + (1 - F0) * (1 - cos_theta_d) ** 5


def G_smith_ggx(wi, wo, alpha_x, alpha_y):
    """Heitz 2014, eqs. 43 and 86: G1 = 1 / (1 + Lambda), uncorrelated."""

    def g1(w):
        a2 = ((alpha_x * w[..., 0]) ** 2 + (alpha_y * w[..., 1]) ** 2) / w[..., 2] ** 2
        return 1 / (1 + (np.sqrt(1 + a2) - 1) / 2)

    return g1(wi) * g1(wo)


def inv_E(cos_theta_i, cos_theta_o):
    """Cosines below 1e-4 count as 1e-4."""
    return 0.25 / (np.maximum(cos_theta_i, 1e-4) * np.maximum(cos_theta_o, 1e-4))


def D_beckmann(h, alpha_x, alpha_y):
    """Slopes normally distributed with variance alpha^2 / 2, as a density of normals (Heitz 2014, eqs. 78 to 80)."""
    slope_x, slope_y = h[..., 0] / h[..., 2], h[..., 1] / h[..., 2]
    normal = lambda v, a: np.exp(-((v / a) ** 2)) / (a * np.sqrt(np.pi))  # noqa: E731
    return normal(slope_x, alpha_x) * normal(slope_y, alpha_y) / h[..., 2] ** 4


def D_ward(h, alpha_x, alpha_y):
    """Ward 1992, eq. 5a, by delta and phi, with 1 / (4 sqrt(cos cos)) left to 1/E."""
    theta, phi = np.arctan2(np.hypot(h[..., 0], h[..., 1]), h[..., 2]), np.arctan2(h[..., 1], h[..., 0])
    exponent = np.tan(theta) ** 2 * (np.cos(phi) ** 2 / alpha_x**2 + np.sin(phi) ** 2 / alpha_y**2)
    return np.exp(-exponent) / (np.pi * alpha_x * alpha_y)


def D_abc(h, B, C):
    """1 - cos(theta_h) = 2 sin^2(theta_h / 2)."""
    theta = np.arctan2(np.hypot(h[..., 0], h[..., 1]), h[..., 2])
    return (1 + 2 * B * np.sin(theta / 2) ** 2) ** -C


def D_abc_normalised(h, B, C):
    """The same over its integral against the cosine, in closed form; C = 1 and C = 2 are its limits."""

    def power(k):  # integral of u^(k - 1) from 1 to 1 + B
        return np.where(k == 0, np.log1p(B), np.expm1(k * np.log1p(B)) / np.where(k == 0, 1, k))

    return D_abc(h, B, C) * B**2 / (2 * np.pi * ((1 + B) * power(1 - C) - power(2 - C)))


def F_dielectric(cos_theta_d, ior):
    """Fresnel's equations with the refracted angle (Snell); cosines below 1e-4 count as 1e-4."""
    c = np.maximum(cos_theta_d, 1e-4)
    t = np.sqrt(1 - (1 - c**2) / ior**2)
    return (((c - ior * t) / (c + ior * t)) ** 2 + ((ior * c - t) / (ior * c + t)) ** 2) / 2


def F_cook_torrance(cos_theta_d, F0):
    """Their index of refraction; F0 = 1 is an index of 2e12."""
    root = np.sqrt(F0)
    return F_dielectric(cos_theta_d, (1 + root) / np.maximum(1 - root, 1e-12))


def G_v_cavity(wi, wo, h):
    """Cook and Torrance 1982."""
    along = np.maximum(cosine_d(wi, wo), 1e-7)
    return np.minimum(1, 2 * h[..., 2] / along * np.minimum(wi[..., 2], wo[..., 2]))


def D_ashikhmin_shirley(h, n_u, n_v):
    """Ashikhmin and Shirley 2000, by theta and phi; the 1/4 of their 1 / (8 pi) is left to 1/E.

    Cosines below 1e-4 count as 1e-4.
    """
    theta, phi = np.arctan2(np.hypot(h[..., 0], h[..., 1]), h[..., 2]), np.arctan2(h[..., 1], h[..., 0])
    exponent = n_u * np.cos(phi) ** 2 + n_v * np.sin(phi) ** 2
    return np.sqrt((n_u + 1) * (n_v + 1)) / (2 * np.pi) * np.maximum(np.cos(theta), 1e-4) ** exponent


def inv_E_ashikhmin_shirley(cos_theta_d, cos_theta_i, cos_theta_o):
    """Cosines below 1e-4 count as 1e-4."""
    return 0.25 / (np.maximum(cos_theta_d, 1e-4) * np.maximum(np.maximum(cos_theta_i, cos_theta_o), 1e-4))


def limits(products, networks):
    """Largest logarithm each network stands for: 20, or 15 where three or more are factors of one product.

    `products` are the factors of every summand; a network of an operator stands for what is right of it.
    """
    result, groups = {}, []
    for names in products:
        group = [names[0]]
        for left, right in zip(names, names[1:], strict=False):
            if f"{left}*{right}" in networks:
                groups += [group[:-1] + [f"{left}*{right}"], group[-1:]]
                group = []
            group.append(right)
        groups.append(group)
    for group in groups:
        own = [name for name in group if name in networks]
        result.update(dict.fromkeys(own, 15 if len(own) > 2 else 20))
    return lambda name: result.get(name, 20)


def mlp(layers, x):
    """(N, in) -> (N, out)."""
    for k, (w, b) in enumerate(layers):
        x = x @ np.asarray(w, np.float64).T + np.asarray(b, np.float64)
        if k < len(layers) - 1:
            x = np.where(x > 0, x, SLOPE * x)
    return x


def parameter_features(p, inputs):
    """Inputs 1 to 39: 12 analytic, 27 latent."""
    if inputs == "directions":
        analytic = [p[k] for k in ("n_x", "n_y", "t_theta", "rho_d", "rho_s", "alpha_x", "alpha_y", "F0")]
    else:
        first = [np.log(p["alpha_x"]) / 4, np.log(p["alpha_y"]) / 4, np.sqrt(p["F0"] + 1e-4)]
        analytic = [*first, p["rho_d"], np.log1p(p["rho_s"]), p["alpha_x"], p["alpha_y"], p["F0"]]
    return np.concatenate(analytic + ([p["latent"]] if "latent" in p else []), -1)


def directional_features(wi, wo, h, alpha_x, alpha_y):
    """Inputs 40 to 45 of the symmetric form; directions in the material's frame."""
    u, v = (h[:, 0] / alpha_x) ** 2, (h[:, 1] / alpha_y) ** 2
    product = wi[:, 2] * wo[:, 2]
    azimuth = (u - v) / (1 + u + v) * (alpha_y - alpha_x) / (alpha_x + alpha_y)
    sin2 = h[:, 0] ** 2 + h[:, 1] ** 2
    cos_d = np.linalg.norm(wi + wo, axis=1) / 2
    return np.stack([sin2, np.log1p(u + v) / 5, azimuth, cos_d, product, np.log(product + 1e-4) / 5], -1)


def brdf(wi, wo, params, networks=None, inputs="symmetric"):
    """f_r (N, 3) of GGX with the slots in `networks` (name -> list of (W, b)) replaced."""
    networks = networks or {}
    limit = limits([["M"], ["S", "D", "F", "G", "1/E"]], networks)
    wi, wo = np.asarray(wi, np.float64), np.asarray(wo, np.float64)
    n = len(wi)
    p = {}
    for key, v in params.items():
        v = np.atleast_1d(np.asarray(v, np.float64))
        p[key] = np.broadcast_to(v, (n, v.shape[-1]))
    axes = frame(p["n_x"][:, 0], p["n_y"][:, 0], p["t_theta"][:, 0])
    i, o = np.einsum("nij,nj->ni", axes, wi), np.einsum("nij,nj->ni", axes, wo)
    up = (wi[:, 2] > 0) & (wo[:, 2] > 0) & (i[:, 2] > 0) & (o[:, 2] > 0)
    i, o, raw_i, raw_o = i[up], o[up], wi[up], wo[up]
    p = {key: v[up] for key, v in p.items()}
    h, a_x, a_y = unit(i + o), p["alpha_x"][:, 0], p["alpha_y"][:, 0]
    constant = parameter_features(p, inputs) if networks else None
    if inputs == "directions":
        varying = np.concatenate([raw_i, raw_o], -1)
    else:
        varying = directional_features(i, o, h, a_x, a_y)

    def term(name, analytic, directional=True):
        if name not in networks:
            return analytic
        x = np.concatenate([constant, varying], -1) if directional else constant
        return np.exp(np.clip(mlp(networks[name], x), -limit(name), limit(name)))

    def operator(name, a, b):
        if name not in networks:
            return a + b if "+" in name else a * b
        a, b = np.broadcast_arrays(a, b)
        x = np.log(np.maximum(np.stack([a, b], -1), 1e-6))
        y = mlp(networks[name], x.reshape(-1, 2)).reshape(a.shape)
        return np.exp(np.clip(y, -limit(name), limit(name)))

    e = term("1/E", inv_E(i[:, 2], o[:, 2])[:, None])
    g = term("G", G_smith_ggx(i, o, a_x, a_y)[:, None])
    f = term("F", F_schlick(cosine_d(i, o)[:, None], p["F0"]))
    d = term("D", D_ggx(h, a_x, a_y)[:, None])
    s, m = term("S", p["rho_s"], False), term("M", p["rho_d"] / np.pi, False)
    below_s = operator("D*F", d, operator("F*G", f, operator("G*1/E", g, e)))
    result = np.zeros((n, 3))
    result[up] = operator("M+S", m, operator("S*D", s, below_s))
    return result


def _lobe_cook_torrance(i, o, h, p):
    d, f = D_beckmann(h, p["alpha_x"], p["alpha_y"]), F_cook_torrance(cosine_d(i, o), p["F0"])
    return p["rho_s"] * (d * f * G_v_cavity(i, o, h) * inv_E(i[:, 2], o[:, 2]) * 4 / np.pi)[:, None]


def _lobe_ward(i, o, h, p):
    d = D_ward(h, p["alpha_x"], p["alpha_y"]) / 4
    return p["rho_s"] * (d / np.sqrt(np.maximum(i[:, 2], 1e-4) * np.maximum(o[:, 2], 1e-4)))[:, None]


def _lobe_abc(i, o, h, p):
    d, f = D_abc(h, p["B"], p["C"]), F_dielectric(cosine_d(i, o), p["ior"])
    return p["A"] * (d * f * G_v_cavity(i, o, h) * inv_E(i[:, 2], o[:, 2]) * 4 / np.pi)[:, None]


def _lobe_ashikhmin_shirley(i, o, h, p):
    cos_d = cosine_d(i, o)
    d, f = D_ashikhmin_shirley(h, p["n_u"], p["n_v"]), F_schlick(cos_d, p["F0"])
    return p["rho_s"] * (d * f * inv_E_ashikhmin_shirley(cos_d, i[:, 2], o[:, 2]))[:, None]


def _diffuse_ashikhmin_shirley(i, o, p):
    """28 rho_d / (23 pi) (1 - R_s) ..., over Lambert's rho_d / pi; F0 for R_s."""
    sides = [1 - (1 - w[:, 2] / 2) ** 5 for w in (i, o)]
    return (28 / 23 * (1 - p["F0"]) * sides[0] * sides[1])[:, None]


def _lobe_ggx2(i, o, h, p):
    """Two of GGX's with one Fresnel term."""
    f = F_schlick(cosine_d(i, o), p["F0"]) * inv_E(i[:, 2], o[:, 2])
    total = 0
    for k in ("", "2"):
        a_x, a_y = p[f"alpha_x{k}"], p[f"alpha_y{k}"]
        total = total + p[f"rho_s{k}"] * (D_ggx(h, a_x, a_y) * G_smith_ggx(i, o, a_x, a_y) * f)[:, None]
    return total


def back(i, o):
    """Half vector of the light and the viewer turned by half a turn about the normal."""
    return unit(np.stack([np.cos(np.pi) * i[..., 0], np.cos(np.pi) * i[..., 1], i[..., 2]], -1) + o)


def D_retro_ggx(i, o, alpha_x, alpha_y):
    return D_ggx(back(i, o), alpha_x, alpha_y)


def F_retro_schlick(i, o, F0):
    """The angle is between the back vector and the light."""
    return F_schlick(np.minimum(np.sum(back(i, o) * o, -1), 1), F0)


def _slope2(h, alpha_x, alpha_y):
    return ((h[..., 0] / alpha_x) ** 2 + (h[..., 1] / alpha_y) ** 2) / h[..., 2] ** 2


def D_generalized_beckmann(h, alpha_x, alpha_y, gamma):
    """Slopes with the density exp(-r^(2 gamma)), over its integral."""
    r = np.sqrt(_slope2(h, alpha_x, alpha_y))
    scale = np.pi * alpha_x * alpha_y * np.vectorize(math.gamma)(1 + 1 / np.asarray(gamma, np.float64))
    return np.exp(-(r ** (2 * gamma))) / (scale * h[..., 2] ** 4)


def D_hyper_cauchy(h, alpha_x, alpha_y, q):
    """The integral of (1 + r^2)^-q over the plane of slopes is pi / (q - 1)."""
    return (q - 1) / (np.pi * alpha_x * alpha_y) * (1 + _slope2(h, alpha_x, alpha_y)) ** -q / h[..., 2] ** 4


def D_student_t(h, alpha_x, alpha_y, gamma):
    """Hyper-Cauchy with a roughness that grows with gamma."""
    k = np.sqrt(gamma - 1)
    return D_hyper_cauchy(h, alpha_x * k, alpha_y * k, gamma)


def B_eon(i, o, r):
    """Portsmouth et al. 2025 with albedo 1: Fujii's Oren-Nayar by angles, and what it lacks, by its exact albedo."""
    theta_i, theta_o = np.arccos(np.clip(i[..., 2], -1, 1)), np.arccos(np.clip(o[..., 2], -1, 1))
    phi = np.arctan2(i[..., 1], i[..., 0]) - np.arctan2(o[..., 1], o[..., 0])
    s = np.sin(theta_i) * np.sin(theta_o) * np.cos(phi)
    t = np.where(s > 0, np.maximum(np.maximum(np.cos(theta_i), np.cos(theta_o)), 1e-4), 1)
    a = 1 / (1 + (1 / 2 - 2 / (3 * np.pi)) * r)

    def albedo(theta):
        sin, tan = np.sin(theta), np.tan(np.minimum(theta, np.pi / 2 - 1e-9))
        g = sin * (theta - sin * np.cos(theta)) + 2 / 3 * (tan * (1 - sin**3) - sin)
        return a * (1 + r * g / np.pi)

    mean = a * (1 + (2 / 3 - 28 / (15 * np.pi)) * r)
    with np.errstate(invalid="ignore"):
        rest = np.where(r > 0, (1 - albedo(theta_i)) * (1 - albedo(theta_o)) / (1 - mean), 0)
    return a * (1 + r * s / t) + rest


def _lobe_ggx_retro(i, o, h, p):
    """GGX, and GGX by the back vector."""
    g = [G_smith_ggx(i, o, p[f"alpha_x{k}"], p[f"alpha_y{k}"]) * inv_E(i[:, 2], o[:, 2]) for k in ("", "2")]
    first = D_ggx(h, p["alpha_x"], p["alpha_y"]) * F_schlick(cosine_d(i, o), p["F0"]) * g[0]
    second = D_retro_ggx(i, o, p["alpha_x2"], p["alpha_y2"]) * F_retro_schlick(i, o, p["F0"]) * g[1]
    return p["rho_s"] * first[:, None] + p["rho_s2"] * second[:, None]


LOBES = {
    "ggx_retro": _lobe_ggx_retro,
    "ggx2": _lobe_ggx2,
    "cook_torrance": _lobe_cook_torrance,
    "ward": _lobe_ward,
    "abc": _lobe_abc,
    "ashikhmin_shirley": _lobe_ashikhmin_shirley,
}
DIFFUSE = {"ashikhmin_shirley": _diffuse_ashikhmin_shirley}  # where it is not Lambert's alone


def analytic(model, wi, wo, params):
    """f_r (N, 3) of an analytic model by name; a model without n and t has the surface's frame."""
    if model == "ggx":
        return brdf(wi, wo, params)
    i, o, p, up = local(wi, wo, params)
    result = np.zeros((len(up), 3))
    factor = DIFFUSE[model](i, o, p) if model in DIFFUSE else 1
    result[up] = p["rho_d"] / np.pi * factor + LOBES[model](i, o, unit(i + o), p)
    return result


def local(wi, wo, params):
    """Directions and parameters (n,) or (n, size) of the pairs above the horizon, and which those are."""
    wi, wo = np.asarray(wi, np.float64), np.asarray(wo, np.float64)
    n = len(wi)
    p = {
        key: np.broadcast_to(np.atleast_1d(np.asarray(v, np.float64)), (n, np.shape(v)[-1]))
        for key, v in params.items()
    }
    i, o = wi, wo
    if "n_x" in p:
        axes = frame(p["n_x"][:, 0], p["n_y"][:, 0], p["t_theta"][:, 0])
        i, o = np.einsum("nij,nj->ni", axes, wi), np.einsum("nij,nj->ni", axes, wo)
    up = np.minimum(np.minimum(wi[:, 2], wo[:, 2]), np.minimum(i[:, 2], o[:, 2])) > 0
    return i[up], o[up], {key: v[up, 0] if v.shape[1] == 1 else v[up] for key, v in p.items()}, up


def log_l1(f, f_gt, cos, epsilon=0.0):
    """The paper's eq. 1 as a mean, smoothed by `epsilon`."""
    r = np.log1p(f_gt * cos[:, None]) - np.log1p(f * cos[:, None])
    return np.mean(np.sqrt(r * r + epsilon * epsilon))


# ---------------------------------------------------------------------- random inputs, rounded to what float32 holds


def pairs(n, seed=0, min_cos=0.0):
    """n random pairs of unit vectors above the horizon, float32."""
    rng = np.random.default_rng(seed)
    w = unit(rng.normal(size=(2, n, 3)))
    w[..., 2] = np.abs(w[..., 2])
    if min_cos:
        w[..., 2] = np.maximum(w[..., 2], min_cos)
        w = unit(w)
    return w.astype(np.float32)


def awkward_pairs(n, seed):
    """A third mirror pairs, a third grazing, the rest random; some equal, some opposite."""
    wi, wo = pairs(n, seed)
    wo[::3] = wi[::3] * [-1, -1, 1]
    wi[1::3, 2] *= 1e-6
    wi = unit(wi).astype(np.float32)
    wo[::7], wo[::11] = wi[::7], -wi[::11]
    return wi, wo


def parameters(n, seed=0, latent=27, alpha=(0.05, 1.0), tilt=0.3):
    """n random materials; float64 arrays that float32 holds exactly."""
    rng = np.random.default_rng(seed)
    p = {
        "n_x": rng.uniform(-tilt, tilt, (n, 1)),
        "n_y": rng.uniform(-tilt, tilt, (n, 1)),
        "t_theta": rng.uniform(-3, 3, (n, 1)),
        "rho_d": rng.uniform(0, 1, (n, 3)),
        "rho_s": rng.uniform(0, 4, (n, 3)),
        "alpha_x": np.exp(rng.uniform(*np.log(alpha), (n, 1))),
        "alpha_y": np.exp(rng.uniform(*np.log(alpha), (n, 1))),
        "F0": rng.uniform(0, 1, (n, 1)),
    }
    if latent:
        p["latent"] = rng.normal(0.5, 0.5, (n, latent))
    return {key: v.astype(np.float32).astype(np.float64) for key, v in p.items()}


def central_differences(function, x, step=1e-7):
    """Gradient (P,) or Jacobian (..., P) of a float64 function of a vector; few kinks of a ReLU lie within the step."""
    x = np.asarray(x, np.float64)
    columns = []
    for k in range(len(x)):
        e = np.zeros(len(x))
        e[k] = step
        columns.append((function(x + e) - function(x - e)) / (2 * step))
    return np.stack(columns, -1)
