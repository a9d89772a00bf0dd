"""Frames, half vectors and cosines against the float64 twin, and on directions that have none."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import twin
from lanes import vectors

from mi_enhance.analytic import geometry

ROUNDING = 1e-6  # float32 has 6e-8; a few operations deep


def test_frame_is_the_twins(llvm):
    p = twin.parameters(1000, seed=1, tilt=0.5)
    f = geometry.frame(*(mi.Float(p[k][:, 0]) for k in ("n_x", "n_y", "t_theta")))
    rows = np.stack([np.array(v).T for v in (f.s, f.t, f.n)], 1)
    expected = twin.frame(p["n_x"][:, 0], p["n_y"][:, 0], p["t_theta"][:, 0])
    np.testing.assert_allclose(rows, expected, atol=ROUNDING)


def test_frame_is_right_handed_and_orthonormal(llvm):
    p = twin.parameters(1000, seed=2, tilt=0.5)
    f = geometry.frame(*(mi.Float(p[k][:, 0]) for k in ("n_x", "n_y", "t_theta")))
    rows = np.stack([np.array(v).T for v in (f.s, f.t, f.n)], 1).astype(np.float64)
    np.testing.assert_allclose(rows @ rows.transpose(0, 2, 1), np.tile(np.eye(3), (1000, 1, 1)), atol=ROUNDING)
    np.testing.assert_allclose(np.linalg.det(rows), 1, atol=ROUNDING)


def test_frame_without_tilt_is_the_convention(llvm):
    f = geometry.frame(mi.Float(0), mi.Float(0), mi.Float(0))
    assert np.array_equal(np.array([f.s, f.t, f.n])[..., 0], np.eye(3))


def test_tangent_turns_from_x_to_y(llvm):
    f = geometry.frame(mi.Float(0), mi.Float(0), mi.Float(np.pi / 2))
    np.testing.assert_allclose(np.array(f.s)[:, 0], [0, 1, 0], atol=ROUNDING)


def test_quantities_are_the_twins(llvm):
    wi, wo = twin.pairs(5000, seed=3)
    q = geometry.quantities(vectors(wi), vectors(wo))
    h = twin.unit(wi.astype(np.float64) + wo)
    np.testing.assert_allclose(np.array(q["h"]).T, h, atol=ROUNDING)
    np.testing.assert_allclose(q["cos_theta_d"], np.sum(h * wi, 1), atol=ROUNDING)
    np.testing.assert_allclose(q["cos_theta_h"], h[:, 2], atol=ROUNDING)
    assert np.array_equal(q["cos_theta_i"], wi[:, 2]) and np.array_equal(q["cos_theta_o"], wo[:, 2])


def test_half_vector_keeps_its_digits_at_grazing_angles(llvm):
    """wi almost opposite to wo: h has 1e-3 of their length; 1 - dot(wi, h) forms would lose everything."""
    a = np.linspace(0, 2 * np.pi, 50)
    wi = twin.unit(np.stack([np.cos(a), np.sin(a), 0 * a + 1e-3], 1)).astype(np.float32)
    wo = twin.unit(np.stack([-np.cos(a), -np.sin(a), 0 * a + 1e-3], 1)).astype(np.float32)
    q = geometry.quantities(vectors(wi), vectors(wo))
    expected = np.linalg.norm(wi.astype(np.float64) + wo, axis=1) / 2
    np.testing.assert_allclose(q["cos_theta_d"], expected, rtol=ROUNDING)


@pytest.mark.parametrize("sign", [1, -1], ids=["wi = wo", "wi = -wo"])
def test_equal_and_opposite_directions_stay_finite(llvm, sign):
    wi, _ = twin.pairs(1000, seed=4)
    v, w = vectors(wi), vectors(sign * wi)
    dr.enable_grad(v)
    q = geometry.quantities(v, w)
    for value in q.values():
        assert np.isfinite(np.array(value)).all()
    cos_d = np.array(q["cos_theta_d"])
    assert cos_d.max() <= 1 and np.allclose(cos_d, 1 if sign > 0 else 0, atol=ROUNDING)
    if sign > 0:
        np.testing.assert_allclose(np.array(q["h"]).T, wi, atol=ROUNDING)
    dr.backward(dr.sum(q["h"].x + q["h"].z))
    assert np.isfinite(np.array(dr.grad(v))).all()
