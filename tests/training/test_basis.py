"""The basis of a trained trunk: it starts where read-outs differ most to the loss, falls, and goes on where it was."""

from __future__ import annotations

import numpy as np
import pytest

from mi_enhance.material.low_rank import of_low_rank
from mi_enhance.material.material import Material
from mi_enhance.training.basis_trainer import BasisTrainer, train_basis
from mi_enhance.training.train import train

CONFIG = {
    "model": "ggx2",
    "replace": ["B", "G", "G2"],
    "read_out": "rgb",
    "data": [{"kind": "assorted", "count": 6}],
    "n_samples": 512,
    "batch": 32,
    "steps": 60,
    "hidden": [8, 8, 8],
    "n_latent": 6,
}


def test_a_basis_is_trained_and_goes_on(llvm, tmp_path):
    trained = train(CONFIG, tmp_path)
    weights = np.array(trained.trainable.weights)
    first = BasisTrainer(trained, 6, 40)
    # six numbers are all that six materials need: their read-outs, to the rounding of float32
    read = trained.parameters()[:, -trained.brdf.trunk.size :]
    np.testing.assert_allclose(first._read_outs(), read, atol=2e-3 * np.abs(read).max())
    heard = []
    network = train_basis(trained, tmp_path, rank=2, steps=40, progress=heard.append)
    np.testing.assert_array_equal(np.array(trained.trainable.weights), weights)  # the trunk stays
    start = BasisTrainer(trained, 2, 40)
    end = BasisTrainer(trained, 2, 40)
    end.resume(tmp_path / "basis.npz")
    losses = [np.mean([t.advance().mean() for _ in range(3)]) for t in (start, end)]
    assert heard[-1].step == 40 and losses[1] < losses[0]
    again = Material.load(tmp_path / "network.bsdf")
    low = of_low_rank(again, "test")
    assert low.brdf.n_parameters == 17 + 1 + 6 + 9 + 6 and low.library.shape == (6, low.brdf.n_parameters)
    np.testing.assert_allclose(np.square(low.library[:, -6:]).mean(0), 1, rtol=1e-4)
    np.testing.assert_array_equal(low.library, of_low_rank(network, "test").library.astype(np.float32))
    # a finished run trains no further
    assert train_basis(trained, tmp_path, rank=2, steps=40).report["basis"] == network.report["basis"]
    with pytest.raises(ValueError, match="of a run with other settings \\(steps\\)"):
        train_basis(trained, tmp_path, rank=2, steps=50)


def test_a_basis_needs_a_trunk_and_a_rank(llvm, tmp_path):
    trained = train(
        {"model": "ggx", "data": CONFIG["data"], "n_samples": 64, "steps": 0, "imitation_steps": 0}, tmp_path
    )
    with pytest.raises(ValueError, match="of a trunk"):
        train_basis(trained, tmp_path)
