"""The loss of many materials at once, its gradients and normal equations, against float64 central differences."""

from __future__ import annotations

import drjit as dr
import lanes
import mitsuba as mi
import numpy as np
import pytest
import twin
import twin_networks

from mi_enhance.analytic import parameters
from mi_enhance.fitting import losses
from mi_enhance.fitting import objective as objective_module
from mi_enhance.fitting.objective import Objective
from mi_enhance.neural.enhance import enhance

LOSS = 1e-5  # relative; float32 logarithms of float32 reflectance, averaged
GRADIENT = 3e-4  # of the largest entry; float32 through log alpha, four networks and sums over the samples
B, N = 3, 240  # materials and samples each


TWO_LOBES = {"inputs": "shape", "modulated": True, "n_latent": 6, "hidden": (8, 8)}
CASES = {
    "analytic": ("ggx", (), {}),
    "final": ("ggx", ("F", "F*G", "G", "1/E"), {}),
    "colours": ("ggx", ("M", "S*D"), {}),
    "two lobes, analytic": ("ggx2", (), {}),
    "two lobes": ("ggx2", ("B", "G", "G2"), TWO_LOBES),
    "abc": ("abc", ("F", "G"), TWO_LOBES),
}


def reflectance(brdf):
    """The twin of a BRDF: a function of wi, wo and parameters."""
    model, networks = brdf.model.name, brdf.modules
    if brdf.inputs == "shape":
        return lambda wi, wo, p: twin_networks.brdf(model, wi, wo, p, networks)
    if not networks:
        return lambda wi, wo, p: twin.analytic(model, wi, wo, p)
    return lambda wi, wo, p: twin.brdf(wi, wo, p, {slot: mlp.layers for slot, mlp in networks.items()})


def problem(case, seed=0):
    """Objective, optimized parameters (B, P), and the same loss by the twin."""
    model, replace, settings = CASES[case]
    brdf = enhance(model, replace, seed=seed, **settings)
    wi, wo = twin.pairs(B * N, seed=1, min_cos=0.1)
    start, truth = (twin_networks.parameters(brdf, B, s, alpha=(0.1, 0.8), tilt=0.1) for s in (2, 3))
    u, value = np.concatenate([start[p.name] for p in brdf.parameters], 1), reflectance(brdf)
    f = value(wi, wo, {k: np.repeat(v, N, 0) for k, v in truth.items()}).astype(np.float32)
    objective = Objective(brdf, lanes.vectors(wi), lanes.vectors(wo), mi.Color3f(np.ascontiguousarray(f.T)), N)
    u = objective.space.to_free(u).astype(np.float32).astype(np.float64)

    def loss(k, row, epsilon=0.0):
        """Of material k at one optimized vector."""
        values = parameters.unflatten(brdf.parameters, objective.space.to_physical(row))
        part = slice(k * N, (k + 1) * N)
        got = value(wi[part], wo[part], values)
        return twin.log_l1(got, f[part].astype(np.float64), wo[part, 2].astype(np.float64), epsilon)

    return objective, u, loss, (wi, wo, f)


@pytest.mark.parametrize("case", CASES)
def test_loss_is_log_l1_of_each_material(llvm, case):
    objective, u, loss, (wi, wo, f) = problem(case)
    got = objective.loss(u)
    assert got.shape == (B,)
    np.testing.assert_allclose(got, [loss(k, u[k]) for k in range(B)], rtol=LOSS)
    values = parameters.unflatten(objective.brdf.parameters, objective.space.to_physical(u[0]))
    model = lanes.evaluate(objective.brdf, wi[:N], wo[:N], {k: np.tile(v, (N, 1)) for k, v in values.items()})
    expected = losses.log_l1(model, f[:N].astype(np.float64), wo[:N, 2].astype(np.float64))
    assert got[0] == pytest.approx(expected, rel=LOSS)


def test_residuals_are_signed(llvm):
    """Measured minus model: positive where the model is too dark."""
    objective, u, _, _ = problem("analytic")
    dark = u.copy()
    dark[:, 3:9] = 0  # rho_d and rho_s
    assert min(np.array(r).min() for r in objective.residuals(dark)) >= 0


@pytest.mark.parametrize("case", CASES)
def test_normal_equations_are_central_differences(llvm, case):
    objective, u, loss, _ = problem(case)
    epsilon = 0.1 * objective.loss(u)
    h, g, smooth = objective.normal_equations(u, epsilon)
    for k in range(B):
        e = np.float32(epsilon[k])
        expected = twin.central_differences(lambda row, k=k, e=e: loss(k, row, e), u[k])
        np.testing.assert_allclose(g[k], expected, atol=GRADIENT * np.abs(expected).max())
        assert smooth[k] == pytest.approx(loss(k, u[k], e), rel=LOSS)
    assert np.array_equal(h, h.transpose(0, 2, 1))
    for matrix in h:
        w = np.linalg.eigvalsh(matrix)
        assert w.min() > -1e-6 * w.max()  # semidefinite to the rounding of float32 products


@pytest.mark.parametrize("case", ["final", "two lobes"])
def test_gauss_newton_matrix_is_the_weighted_jacobian(llvm, case):
    """h = mean of J J^T / sqrt(r^2 + epsilon^2), J by central differences of the twin."""
    objective, u, _, (wi, wo, f) = problem(case)
    h, _, _ = objective.normal_equations(u, np.full(B, 0.01))
    value = reflectance(objective.brdf)

    def residuals(row):
        values = parameters.unflatten(objective.brdf.parameters, objective.space.to_physical(row))
        cos = wo[:N, 2:].astype(np.float64)
        return (np.log1p(f[:N] * cos) - np.log1p(value(wi[:N], wo[:N], values) * cos)).ravel()

    r, j = residuals(u[0]), twin.central_differences(residuals, u[0])
    expected = (j / np.sqrt(r * r + 1e-4)[:, None]).T @ j / r.size
    np.testing.assert_allclose(h[0], expected, atol=GRADIENT * np.abs(expected).max())


@pytest.mark.parametrize("case", CASES)
def test_gradient_is_that_of_the_normal_equations(llvm, case):
    """Without smoothing, divided by the number of materials, and parameter after parameter."""
    objective, u, _, _ = problem(case)
    flat = mi.Float(u.T.ravel().astype(np.float32))
    dr.enable_grad(flat)
    loss, gradient = objective.gradient(flat)
    _, g, smooth = objective.normal_equations(u, np.full(B, 1e-7))
    np.testing.assert_allclose(np.array(dr.block_sum(loss, N)) / N, smooth, rtol=LOSS)
    got = np.array(gradient).reshape(-1, B).T * B
    np.testing.assert_allclose(got, g, atol=GRADIENT * np.abs(g).max())


def test_number_of_samples_may_be_prime(llvm, monkeypatch):
    """Blocks must not straddle materials, whatever divides the number of samples; here 63, 63, 63, 62."""
    whole = objective_module._BLOCK
    monkeypatch.setattr(objective_module, "_BLOCK", 64)
    brdf, n = enhance("ggx", ()), 251
    wi, wo = twin.pairs(2 * n, seed=1, min_cos=0.1)
    f = np.ascontiguousarray(np.random.default_rng(0).uniform(0, 1, (3, 2 * n)).astype(np.float32))
    u = np.tile(parameters.flatten(brdf.parameters, parameters.initial(brdf.parameters)), (2, 1))
    both = Objective(brdf, lanes.vectors(wi), lanes.vectors(wo), mi.Color3f(f), n)
    u = both.space.to_free(u)
    h, g, loss = both.normal_equations(u, np.full(2, 0.01))
    monkeypatch.setattr(objective_module, "_BLOCK", whole)
    for k, part in enumerate((slice(0, n), slice(n, 2 * n))):
        one = Objective(
            brdf, lanes.vectors(wi[part]), lanes.vectors(wo[part]), mi.Color3f(np.ascontiguousarray(f[:, part])), n
        )
        h1, g1, loss1 = one.normal_equations(u[:1], np.full(1, 0.01))
        np.testing.assert_allclose(h[k], h1[0], rtol=LOSS, atol=LOSS * np.abs(h1).max())
        np.testing.assert_allclose(g[k], g1[0], atol=LOSS * np.abs(g1).max())
        assert loss[k] == pytest.approx(loss1[0], rel=LOSS)
