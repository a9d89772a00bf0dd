"""Levenberg-Marquardt on problems whose answer is known; plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from mi_enhance.numerics.levenberg_marquardt import minimize

FREE = 1e9  # a box nobody reaches


class Problem:
    """Mean absolute residual of B problems: ``residuals(u) -> r (B, R), J (B, R, P)``."""

    def __init__(self, residuals):
        self.residuals = residuals

    def loss(self, u):
        return np.abs(self.residuals(u)[0]).mean(1)

    def normal_equations(self, u, epsilon):
        r, j = self.residuals(u)
        smooth = np.sqrt(r * r + epsilon[:, None] ** 2)
        h = np.einsum("brp,brq->bpq", j / smooth[..., None], j) / r.shape[1]
        return h, np.einsum("brp,br->bp", j, r / smooth) / r.shape[1], smooth.mean(1)

    def run(self, start, low=-FREE, high=FREE, **settings):
        start = np.atleast_2d(np.asarray(start, np.float64))
        box = (np.broadcast_to(np.asarray(v, np.float64), start.shape[1]) for v in (low, high))
        return minimize(self.loss, self.normal_equations, start, *box, **settings)


def linear(a, b):
    """|A u - b| for each of B problems."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    return Problem(lambda u: (np.einsum("...rp,bp->br", a, u) - b, np.broadcast_to(a, (len(u), *a.shape[-2:]))))


def rosenbrock(u):
    x, y = u.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    j = np.stack([np.stack([-20 * x, 10 * one], -1), np.stack([-one, zero], -1)], 1)
    return np.stack([10 * (y - x * x), 1 - x], 1), j


def test_l1_finds_the_median_not_the_mean():
    data = np.array([[1.0, 2.0, 3.0, 4.0, 30.0]])  # mean 8
    (u,), (loss,) = linear(np.ones((5, 1)), data).run([0.0], steps=100, tolerance=1e-9)
    assert u[0] == pytest.approx(3, abs=0.6)  # residuals below a share of the mean loss, 6, count as squares
    assert loss == pytest.approx(np.abs(data - 3).mean(), rel=0.03)


def test_l1_ignores_outliers_in_a_line():
    rng = np.random.default_rng(0)
    x = np.linspace(-1, 1, 101)
    y = 2 * x - 0.5
    y[rng.choice(101, 20, replace=False)] += 5
    (u,), _ = linear(np.stack([x, x**0], 1), y[None]).run([0.0, 0.0], steps=200, tolerance=1e-12)
    least_squares = np.linalg.lstsq(np.stack([x, x**0], 1), y, rcond=None)[0]
    assert abs(least_squares[1] + 0.5) > 0.5
    np.testing.assert_allclose(u, [2, -0.5], atol=0.15)  # least squares is off by 1; the rest is the smoothing


@pytest.mark.parametrize("start", [(-1.2, 1.0), (5.0, -5.0), (0.0, 0.0)], ids=str)
def test_rosenbrock_valley_is_followed_to_its_end(start):
    (u,), (loss,) = Problem(rosenbrock).run(start, steps=200)
    np.testing.assert_allclose(u, [1, 1], atol=1e-3)
    assert loss < 1e-3


def test_solution_stays_in_the_box_and_on_its_wall():
    """The free optimum is (3, 1); with u0 <= 2 the best of the rest is (2, 1)."""
    problem = linear([[1, 0], [0, 1]], [[3, 1]])
    (u,), (loss,) = problem.run([0.0, 0.0], low=[0, 0], high=[2, 9], steps=100)
    np.testing.assert_allclose(u, [2, 1], atol=1e-3)
    assert u[0] == 2 and loss == pytest.approx(0.5, abs=1e-3)


def test_every_trial_stays_in_the_box():
    seen = []
    problem = Problem(rosenbrock)
    low, high = np.array([-2.0, 0.0]), np.array([0.5, 3.0])
    minimize(lambda u: seen.append(u) or problem.loss(u), problem.normal_equations, np.array([[-1.2, 9.0]]), low, high)
    seen = np.concatenate(seen)
    assert (seen >= low).all() and (seen <= high).all()


def test_unknown_without_influence_stays_where_it_is():
    problem = linear([[1.0, 0.0], [2.0, 0.0]], [[1, 2]])
    (u,), (loss,) = problem.run([0.0, 7.0])
    assert u[1] == 7 and loss < 1e-5


def test_dependent_unknowns_find_one_of_many_solutions():
    problem = linear([[1.0, 1.0], [2.0, 2.0]], [[3, 6]])
    (u,), (loss,) = problem.run([0.0, 0.0])
    assert u.sum() == pytest.approx(3, abs=1e-4) and loss < 1e-4


def test_matrix_of_zeros_leaves_the_start():
    start = np.array([[1.0, 2.0]])
    u, loss = linear([[0.0, 0.0]], [[5.0]]).run(start)
    assert np.array_equal(u, start) and loss == 5


@pytest.mark.parametrize("bad", [np.nan, np.inf], ids=str)
def test_trials_that_are_not_finite_are_never_accepted(bad):
    """Beyond 2 the loss is not a number; the downhill direction leads there."""
    problem = linear([[1.0]], [[3.0]])
    loss = lambda u: np.where(u[:, 0] > 2, bad, problem.loss(u))  # noqa: E731
    u, best = minimize(loss, problem.normal_equations, np.zeros((1, 1)), np.full(1, -9.0), np.full(1, 9.0), steps=60)
    assert np.isfinite(u).all() and np.isfinite(best).all()
    assert u[0, 0] <= 2 and best[0] < 3


def test_normal_equations_of_nan_leave_the_start():
    nothing = lambda u, e: (np.full((1, 2, 2), np.nan), np.full((1, 2), np.nan), np.full(1, np.nan))  # noqa: E731
    start = np.array([[0.5, 0.5]])
    loss = lambda u: np.abs(u).sum(1)  # noqa: E731
    u, best = minimize(loss, nothing, start, np.zeros(2), np.ones(2))
    assert np.array_equal(u, start) and best[0] == 1


def test_result_is_never_worse_than_the_start():
    """Gradients that lie: noise in place of derivatives."""
    rng = np.random.default_rng(1)
    loss = lambda u: np.abs(u - 0.3).sum(1)  # noqa: E731
    start = rng.uniform(-1, 1, (50, 4))
    lie = lambda u, e: (np.tile(np.eye(4), (50, 1, 1)), rng.normal(size=(50, 4)), loss(u))  # noqa: E731
    u, best = minimize(loss, lie, start, np.full(4, -1.0), np.ones(4))
    assert (best <= loss(start)).all()
    np.testing.assert_array_equal(best, loss(u))


def test_problems_are_independent():
    """Eight in one call end where each ends alone, to the bit; no tolerance, so all take every step."""
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(20, 3)), rng.normal(size=(8, 20))
    start = rng.normal(size=(8, 3))
    together, losses = linear(a, b).run(start, steps=12, tolerance=-1)
    for k in range(8):
        (alone,), (loss,) = linear(a, b[k : k + 1]).run(start[k], steps=12, tolerance=-1)
        np.testing.assert_allclose(alone, together[k], rtol=1e-9)
        assert loss == pytest.approx(losses[k], rel=1e-9)


def test_callback_sees_losses_that_never_rise():
    seen = []
    Problem(rosenbrock).run([(-1.2, 1.0), (2.0, 2.0)], callback=lambda step, losses: seen.append(losses.copy()))
    assert len(seen) > 3 and (np.diff(seen, axis=0) <= 0).all()


def test_small_improvements_end_the_search():
    steps = []
    linear(np.ones((5, 1)), [[1, 2, 3, 4, 5]]).run([0.0], steps=1000, callback=lambda step, _: steps.append(step))
    assert len(steps) < 100
