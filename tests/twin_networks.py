"""Models with networks that see shapes only, once more in float64 NumPy: last layers of the material, asymmetry.

The older inputs, and the operators of GGX, are in twin.py. Networks are records with layers, n_folded and modulated.
"""

from __future__ import annotations

import numpy as np
import twin

# The parameters that networks read, in order, and the formula of each model: factors of every summand.
SHAPES = {
    "ggx": ("alpha_x", "alpha_y", "F0"),
    "ggx2": ("alpha_x", "alpha_y", "F0", "alpha_x2", "alpha_y2"),
    "cook_torrance": ("alpha_x", "alpha_y", "F0"),
    "ward": ("alpha_x", "alpha_y"),
    "abc": ("B", "C", "ior"),
}
GGX = (("M",), ("S", "D", "F", "G", "1/E"))
FORMULAS = {
    "ggx": GGX,
    "ggx2": (("M", "B"), ("S", "D", "F", "G", "1/E"), ("S2", "D2", "F2", "G2", "1/E2")),
    "cook_torrance": GGX,
    "ward": (("M",), ("S", "D", "1/E")),
    "abc": GGX,
}
COLOURS = ("M", "S", "S2")  # terms without directions


def mlp(network, x):
    """(N, in) -> (N, out); a modulated last layer is computed from the folded inputs of each row."""
    if not network.modulated:
        return twin.mlp(network.layers, x)
    *hidden, (w, b) = [[np.asarray(v, np.float64) for v in layer] for layer in network.layers]
    a = x
    for w_hidden, b_hidden in hidden:
        a = a @ w_hidden.T + b_hidden
        a = np.maximum(a, twin.SLOPE * a)
    own = (x[:, : network.n_folded] @ w.T + b).reshape(len(x), len(b) // (a.shape[1] + 1), a.shape[1] + 1)
    return np.einsum("noh,nh->no", own[..., :-1], a) + own[..., -1]


def constant_features(model, p):
    """Logarithms of what is positive, roots of F0, latent numbers."""
    shape = [np.sqrt(p[k] + 1e-4) if k == "F0" else np.log(p[k]) / 4 for k in SHAPES[model]]
    latent = p.get("latent")
    return np.stack(shape + ([] if latent is None else list(np.atleast_2d(latent.T))), -1)


def directional_features(i, o, p, inputs="shape"):
    """By angles of half and difference vector; d is half the difference of the directions."""
    s = i + o
    theta_h, phi_h = np.arctan2(np.hypot(s[:, 0], s[:, 1]), s[:, 2]), np.arctan2(s[:, 1], s[:, 0])
    sin_d, cos_d = np.linalg.norm(i - o, axis=1) / 2, np.linalg.norm(s, axis=1) / 2
    cos_i, cos_o = i[:, 2], o[:, 2]
    columns = [np.sin(theta_h) ** 2]
    for k in ("", "2"):
        if f"alpha_x{k}" in p:
            a_x, a_y = p[f"alpha_x{k}"], p[f"alpha_y{k}"]
            u, v = (np.sin(theta_h) * np.cos(phi_h) / a_x) ** 2, (np.sin(theta_h) * np.sin(phi_h) / a_y) ** 2
            columns += [np.log1p(u + v) / 5, (u - v) / (1 + u + v) * (a_y - a_x) / (a_y + a_x)]
    columns += [cos_d, cos_i * cos_o, np.log(cos_i * cos_o + 1e-4) / 5, np.sqrt(sin_d**2 + 1e-4)]
    differences = [cos_i - cos_o, np.log(cos_i + 0.01) - np.log(cos_o + 0.01)]
    if inputs == "reciprocal":  # a size without a kink
        differences = [np.hypot(differences[0], 0.05), np.hypot(differences[1], 0.05)]
    return np.stack([*columns, p["asymmetry"] * differences[0], p["asymmetry"] * differences[1] / 5], -1)


def own_features(name, i, o, p):
    """What one network sees of the directions with inputs "own": what the term of its slot sees."""
    s, lobe = i + o, "2" if name.endswith("2") else ""
    cos_i, cos_o = i[:, 2], o[:, 2]
    if name[0] == "D":
        theta, phi = np.arctan2(np.hypot(s[:, 0], s[:, 1]), s[:, 2]), np.arctan2(s[:, 1], s[:, 0])
        a_x, a_y = p[f"alpha_x{lobe}"], p[f"alpha_y{lobe}"]
        u, v = (np.sin(theta) * np.cos(phi) / a_x) ** 2, (np.sin(theta) * np.sin(phi) / a_y) ** 2
        azimuth = (u - v) / (1 + u + v) * (a_y - a_x) / (a_y + a_x)
        return np.stack([np.sin(theta) ** 2, np.log1p(u + v) / 5, azimuth], -1)
    if name[0] == "F":
        return np.stack([twin.cosine_d(i, o), np.sqrt(np.linalg.norm(i - o, axis=1) ** 2 / 4 + 1e-4)], -1)
    difference = np.log(cos_i + 0.01) - np.log(cos_o + 0.01)
    columns = [cos_i + cos_o, cos_i * cos_o, np.log(cos_i * cos_o + 1e-4) / 5]
    columns += [p["asymmetry"] * (cos_i - cos_o), p["asymmetry"] * difference / 5]
    if name[0] == "G":
        a_x, a_y = p[f"alpha_x{lobe}"], p[f"alpha_y{lobe}"]
        t_i, t_o = (((a_x * w[:, 0]) ** 2 + (a_y * w[:, 1]) ** 2) / (w[:, 2] ** 2 + 1e-4) for w in (i, o))
        columns += [np.log1p(t_i) + np.log1p(t_o), np.log1p(t_i) * np.log1p(t_o)]
    return np.stack(columns, -1)


def terms(model, i, o, p):
    """Analytic value of every term, (n,) or (n, 3)."""
    h = twin.unit(i + o)
    cos_d, e = twin.cosine_d(i, o), twin.inv_E(i[:, 2], o[:, 2])
    result = {"M": p["rho_d"] / np.pi, "S": p["A" if model == "abc" else "rho_s"], "1/E": e}
    if model == "ward":
        root = np.sqrt(np.maximum(i[:, 2], 1e-4) * np.maximum(o[:, 2], 1e-4))
        return {**result, "D": twin.D_ward(h, p["alpha_x"], p["alpha_y"]), "1/E": 1 / (4 * root)}
    if model in ("ggx", "ggx2"):
        result |= {"B": np.ones(len(i)), "F": twin.F_schlick(cos_d, p["F0"])}
        for k in ("", "2")[: 1 + (model == "ggx2")]:
            a = p[f"alpha_x{k}"], p[f"alpha_y{k}"]
            result |= {f"D{k}": twin.D_ggx(h, *a), f"G{k}": twin.G_smith_ggx(i, o, *a)}
        return {**result, "S2": p.get("rho_s2"), "F2": result["F"], "1/E2": e}
    cavity = {**result, "G": twin.G_v_cavity(i, o, h), "1/E": 4 * e / np.pi}
    if model == "abc":
        return {**cavity, "D": twin.D_abc(h, p["B"], p["C"]), "F": twin.F_dielectric(cos_d, p["ior"])}
    return {**cavity, "D": twin.D_beckmann(h, p["alpha_x"], p["alpha_y"]), "F": twin.F_cook_torrance(cos_d, p["F0"])}


def brdf(model, wi, wo, params, networks, inputs="shape", trunk=None):
    """f_r (N, 3) of `model` with the slots in `networks` (name -> network) replaced, or scaled by a `trunk`."""
    i, o, p, up = twin.local(wi, wo, params)
    constant, varying = constant_features(model, p), directional_features(i, o, p, inputs)
    both = np.concatenate([constant, varying], -1)
    values, limit = terms(model, i, o, p), twin.limits(FORMULAS[model], networks)
    for name in set(networks) & set(values):
        if name not in COLOURS and inputs == "own":
            both = np.concatenate([constant, own_features(name, i, o, p)], -1)
        x = constant if name in COLOURS else both
        value = np.exp(np.clip(mlp(networks[name], x) + p[f"norm_{name}"][:, None], -limit(name), limit(name)))
        values[name] = values[name] * value if name in COLOURS else value  # a colour is scaled
    values = {name: v[:, None] if np.ndim(v) == 1 else v for name, v in values.items()}
    if trunk:
        for slot, factor in factors(trunk, varying, p).items():
            values[slot] = values[slot] * factor

    def operator(name, a, b):
        if name not in networks:
            return a + b if "+" in name else a * b
        a, b = np.broadcast_arrays(a, b)
        y = mlp(networks[name], np.log(np.maximum(np.stack([a.ravel(), b.ravel()], -1), 1e-6)))
        return np.exp(np.clip(y, -limit(name), limit(name))).reshape(a.shape)

    def product(names):
        first, *rest = names
        return operator(f"{first}*{rest[0]}", values[first], product(rest)) if rest else values[first]

    first, *rest = FORMULAS[model]
    f = product(first)
    for names in rest:
        f = operator(f"{first[0]}+{names[0]}", f, product(names))
    result = np.zeros((len(up), 3))
    result[up] = f
    return result


def factors(trunk, varying, p):
    """Factors (n, channels) of the slots of a trunk: exp of its leaky units, read out by the numbers of each row."""
    a = np.concatenate([np.broadcast_to(p["latent"], (len(varying), p["latent"].shape[-1])), varying], -1)
    for w, b in trunk.mlp.layers:
        a = a @ w.T.astype(np.float64) + b
        a = np.maximum(a, twin.SLOPE * a)
    a = np.append(a, np.ones((len(a), 1)), 1)
    read = np.broadcast_to(p["read_out"], (len(a), p["read_out"].shape[-1]))
    read = read.reshape(len(a), len(trunk.slots), trunk.channels, a.shape[1])
    y = np.clip(np.einsum("nsck,nk->nsc", read, a), -20, 20)
    return {slot: np.exp(y[:, k]) for k, slot in enumerate(trunk.slots)}


class Network:
    """What `brdf` takes, with float64 weights."""

    def __init__(self, layers, n_folded, modulated):
        self.layers, self.n_folded, self.modulated = layers, n_folded, modulated


def unflatten(networks, flat):
    """Networks of the shapes of `networks` from one float64 vector.

    In order: of the first matrix the part that is folded, then the rest of it; bias; matrix and bias of later layers.
    """
    rest, result = np.asarray(flat, np.float64), {}

    def take(*shape):
        nonlocal rest
        part, rest = rest[: np.prod(shape, dtype=int)], rest[np.prod(shape, dtype=int) :]
        return part.reshape(shape)

    for slot, m in networks.items():
        n_out, n_in = m.layers[0][0].shape
        first = np.concatenate([take(n_out, m.n_folded), take(n_out, n_in - m.n_folded)], 1), take(n_out)
        later = [(take(*w.shape), take(*b.shape)) for w, b in m.layers[1:]]
        result[slot] = Network([first, *later], m.n_folded, m.modulated)
    assert not len(rest)
    return result


def parameters(brdf, n, seed=0, alpha=(0.05, 1.0), tilt=0.3):
    """n random materials of an EnhancedBRDF, (n, size) each, as float32 holds them; asymmetry over all its range."""
    rng = np.random.default_rng(seed)
    result = {}
    for q in brdf.parameters:
        low, high = {"n_x": (-tilt, tilt), "n_y": (-tilt, tilt), "rho_s": (0, 4), "rho_s2": (0, 4)}.get(
            q.name, alpha if q.name.startswith("alpha") else USUAL.get(q.name.split("_")[0], (q.low, q.high))
        )
        x = rng.uniform(np.log(low) if q.log else low, np.log(high) if q.log else high, (n, q.size))
        result[q.name] = np.exp(x) if q.log else x
    return {name: v.astype(np.float32).astype(np.float64) for name, v in result.items()}


# Of ABC narrower than what is allowed, where float32 directions still say something of the lobe.
USUAL = {
    "A": (0.1, 100),
    "B": (3, 1e3),
    "C": (0.1, 3),
    "ior": (1.05, 20),
    "latent": (-0.5, 1.5),
    "norm": (-1, 1),
    "read": (-0.1, 0.1),
}
