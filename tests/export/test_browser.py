"""GLSL in a real browser gives the values of the material."""

from __future__ import annotations

import browser
import materials
import numpy as np
import pytest
from any_material import pairs
from materials import KINDS, pretrained

from mi_enhance.export import shaders
from mi_enhance.export.program import record

pytestmark = [pytest.mark.slow, browser.needs_chromium]
TOLERANCE = 1e-3  # relative to f, or to 1e-6 1/sr where it is darker; measured: 1e-5


def check(value, reference, what):
    assert np.isfinite(value).all(), what
    assert (np.abs(value - reference) / np.maximum(np.abs(reference), 1e-6)).max() < TOLERANCE, what


def job(material, uniforms=None):
    text = shaders.source(record(material), "it")
    values = "vec4(it_eval(m, a, b), it_pdf(m, a, b))"
    return {"source": browser.fragment(text, values, "it", uniforms is not None), "uniforms": uniforms or [{}]}


def test_values_of_every_kind(llvm):
    wi, wo = pairs(10_000)
    wo[::7] = wi[::7] * [-1, -1, 1]
    found = {kind: make() for kind, make in KINDS.items()}
    for (kind, material), drawn in zip(
        found.items(), browser.run([job(m) for m in found.values()], wi, wo), strict=True
    ):
        check(drawn[:, :3], material.evaluate(wi, wo), kind)
        check(drawn[:, 3], materials.module(material).pdf(wi, wo), kind)


def test_values_of_two_hundred_edited_materials_of_one_shader(llvm):
    """What is prepared of the parameters as uniforms; extreme ones among them."""
    wi, wo = pairs(1000)
    base, rng = pretrained("ggx2_small", 5), np.random.default_rng(0)
    edits = []
    for k in range(200):
        edit = {}
        for q in base.brdf.model.parameters:
            low, high = (np.log(q.low), np.log(q.high)) if q.log else (q.low, q.high)
            v = rng.uniform(low, high, q.size) if k % 4 else rng.choice([low, high], q.size)
            edit[q.name] = np.float32(np.exp(v) if q.log else v)
        edits.append({**edit, "n_x": edit["n_x"] * 0.5, "n_y": edit["n_y"] * 0.5})
    prepare = materials.module(base).prepare
    uniforms = [{"m.k": prepare(**edit).ravel().tolist()} for edit in edits]
    for edit, drawn in zip(edits, browser.run([job(base, uniforms)], wi, wo), strict=True):
        check(drawn[:, :3], base.edit(**edit).evaluate(wi, wo), edit)
