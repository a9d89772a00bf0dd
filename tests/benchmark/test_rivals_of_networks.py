"""The hybrid of 2026 and NLBRDF's form: gradients by hand are those of the loss, and Dr.Jit renders what NumPy fits."""

from __future__ import annotations

import numpy as np
import pytest
from mi_enhance.bsdfs.function import function_bsdf

import mi_enhance as me  # before mitsuba
from mi_enhance import Material
from mi_enhance.benchmark import hybrid, hybrid_fit, nlbrdf
from mi_enhance.benchmark.contenders import REFERENCE, contenders
from mi_enhance.benchmark.hybrid_contender import hybrids_of_files
from mi_enhance.data.directions import sample_pairs
from mi_enhance.data.loading import load
from mi_enhance.data.reference_brdfs import ggx
from mi_enhance.evaluation.reflectance import reflectance
from mi_enhance.fitting.losses import log_l1
from mi_enhance.system.bundled_files import demo_data
from mi_enhance.training.sources import build

STEP = 1e-6  # of central differences in float64; errors of 1e-9


def pairs(n):
    return [w.astype(np.float64) for w in sample_pairs(n, seed=0)]


def differences(loss, values, name, index):
    def at(step):
        moved = {k: v.copy() for k, v in values.items()}
        moved[name][index] += step
        return loss(moved)

    return (at(STEP) - at(-STEP)) / (2 * STEP)


def test_core_of_the_hybrid_is_ggx_with_its_derivatives():
    """Against the reference GGX, where both forms of the Fresnel term are near F0: directions near the half vector."""
    wi, wo = pairs(200)
    near = np.linalg.norm(wi + wo, axis=1) > 2 * np.cos(0.4)
    batch = hybrid.Batch.of(wi, wo)
    u = np.array([[-1.0, -2, -3, 4, 4, 4, np.log(0.3), np.log(0.1), 0, 0, 0, 0]])
    value, slopes = hybrid.analytic(batch, u)
    F0 = (np.exp(4) / (np.exp(4) + 2)) ** 2
    truth = ggx(wi, wo, n=[0, 0, 1], t_theta=0, rho_d=np.exp(u[0, :3]), rho_s=[1] * 3, alpha_x=0.3, alpha_y=0.1, F0=F0)
    np.testing.assert_allclose(value[near], truth[near], rtol=1e-3)
    for k in range(8):
        e = STEP * (np.arange(12) == k)
        numeric = (hybrid.analytic(batch, u + e)[0] - hybrid.analytic(batch, u - e)[0]) / (2 * STEP)
        np.testing.assert_allclose(slopes[:, :, k], numeric, rtol=1e-5, atol=1e-7 * np.abs(slopes).max())


def test_gradients_of_the_hybrid_are_those_of_its_loss():
    batch, rng = hybrid.Batch.of(*pairs(40)), np.random.default_rng(0)
    values = {name: rng.normal(0, 0.4, shape) for name, shape in hybrid.SHAPES.items()}
    values["u"], truth = rng.uniform(-1, 0, (10, 12)), rng.uniform(0, 1, (40, 3))
    _, gradient = hybrid._backward(values, batch, truth, 4)
    for name, value in values.items():
        index = tuple(rng.integers(0, n) for n in value.shape)
        numeric = differences(lambda v: hybrid._backward(v, batch, truth, 4)[0], values, name, index)
        assert gradient[name][index] == pytest.approx(numeric, rel=1e-4, abs=1e-8), name  # float32


def test_hybrid_in_drjit_is_that_of_numpy(llvm):
    network, library = hybrid_fit.read_network()
    wi, wo = sample_pairs(1000, seed=1)
    for u in library[::150]:
        expected = hybrid.evaluate(network, hybrid.Batch.of(*(w.astype(np.float64) for w in (wi, wo))), u[None])
        f = reflectance(function_bsdf(hybrid_fit.hybrid_function(network, u), Material.analytic("ggx")), wi, wo)
        np.testing.assert_allclose(f, expected, rtol=5e-3, atol=1e-4)  # float32, peaks of roughness 0.003


@pytest.mark.slow
def test_hybrid_is_better_than_its_ggx(llvm):
    m, unseen = (load(demo_data("ilm_solo_m_68_rgb.bsdf"), n_samples=6000, seed=seed) for seed in (0, 1))
    lobe = me.fit(Material.analytic("ggx"), m)
    u, _ = hybrid_fit.fit_hybrid(lobe, m)
    f = hybrid.evaluate(hybrid_fit.read_network()[0], hybrid.Batch.of(unseen.wi, unseen.wo), u[None])
    errors = [log_l1(v, unseen.f, unseen.wo[:, 2]) for v in (f, lobe.evaluate(unseen.wi, unseen.wo))]
    assert errors[0] < 0.9 * errors[1]


def test_a_training_of_the_hybrid_goes_on_where_it_stopped(tmp_path):
    samples = build([{"kind": "two-lobes", "count": 3}], n_samples=64, seed=0, cache=tmp_path)
    start = hybrid.start_from_ggx(*(np.full((3, n), 0.3) for n in (3, 3, 1, 2)))

    def stop(progress):
        if progress.step == 6:
            raise KeyboardInterrupt

    whole = hybrid.train_hybrid(samples, start, tmp_path / "a.npz", steps=8)
    with pytest.raises(KeyboardInterrupt):
        hybrid.train_hybrid(samples, start, tmp_path / "b.npz", steps=8, progress=stop)
    rest = hybrid.train_hybrid(samples, start, tmp_path / "b.npz", steps=8)
    assert all(np.array_equal(whole[0][k], rest[0][k]) for k in whole[0]) and np.array_equal(whole[1], rest[1])


def test_one_network_for_all_files(llvm, tmp_path):
    """Trained once, for a moment; each file has its own numbers, and starts at its own GGX."""
    measured = [load(demo_data(f"{name}_rgb.bsdf"), n_samples=500) for name in ("satin_rosaline", "cc_ibiza_sunset")]
    lobes = [contenders(None, m, tmp_path / m.name, only=[REFERENCE])[REFERENCE] for m in measured]
    told = []
    both = hybrids_of_files(lobes, measured, tmp_path, steps=5, progress=told.append)
    again = hybrids_of_files(lobes, measured, tmp_path, steps=5, progress=told.append)
    assert len(told) == 5 and both == again and both[0].spec != both[1].spec
    f = [reflectance(c.bsdf(), m.wi, m.wo) for c, m in zip(both, measured, strict=True)]
    errors = [[log_l1(v, m.f, m.wo[:, 2]) for m in measured] for v in f]
    assert errors[0][0] < errors[0][1] and errors[1][1] < errors[1][0]


def test_gradients_of_nlbrdf_are_those_of_its_loss(monkeypatch):
    monkeypatch.setattr(nlbrdf, "WIDTH", 16)
    monkeypatch.setattr(nlbrdf, "BLOCKS", 3)
    values = {k: v.astype(np.float64) for k, v in nlbrdf.initial(2).items()}
    rng = np.random.default_rng(0)
    x, latent = rng.normal(size=(20, 6)).astype(np.float32), rng.normal(size=(20, 32)).astype(np.float32)
    given = x, latent, rng.uniform(0.1, 1, 20), rng.uniform(0, 1, 20)
    _, gradient, _ = nlbrdf._backward(values, *given)
    for name in gradient:
        index = tuple(rng.integers(0, n) for n in values[name].shape)
        numeric = differences(lambda v: nlbrdf._backward(v, *given)[0], values, name, index)
        assert gradient[name][index] == pytest.approx(numeric, rel=1e-3, abs=1e-7), name  # float32


def test_nlbrdf_has_as_many_weights_as_it_says():
    values = nlbrdf.initial(1)
    assert sum(v.size for k, v in values.items() if k != "latent") == nlbrdf.N_WEIGHTS
    assert 1.0e6 < nlbrdf.N_WEIGHTS < 1.1e6
