"""Pages whose code is a program: all their blocks run, in order, and do what the page says."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

DOCS = Path(__file__).parents[2] / "docs"


def run(page: str) -> dict:
    """Run the Python of a page; a line of an error is that of the page."""
    text = (DOCS / page).read_text()
    names: dict = {"__name__": page}
    blocks = list(re.finditer(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE))
    assert blocks, f"{page} holds no Python"
    for found in blocks:
        before = "\n" * (text[: found.start(1)].count("\n"))
        exec(compile(before + found[1], page, "exec"), names)
    return names


@pytest.mark.slow
def test_neural_bsdf_in_40_lines(llvm):
    text = (DOCS / "neural_bsdf.md").read_text()
    plugin = re.search(r"```python\n(.*?)```", text, re.DOTALL)[1]
    code = [line for line in plugin.splitlines() if line.strip()]
    assert len(code) <= 40, f"the title says 40 lines, the plugin has {len(code)}"
    names = run("neural_bsdf.md")
    assert float(names["loss"][0]) < 0.02  # mean of |log(1 + f cos) - log(1 + f cos)|; the material's own is about 0.1
    # one network, two ways to evaluate it: rounding of float32, and the same random numbers
    np.testing.assert_allclose(names["again"].numpy(), names["image"].numpy(), rtol=1e-3, atol=1e-4)
    truth = names["mi"].render(names["ball"](names["truth"]), spp=64).numpy()
    assert abs(names["image"].numpy()[16:48, 16:48].mean() / truth[16:48, 16:48].mean() - 1) < 0.1


@pytest.mark.slow
def test_networks_in_your_own_code(llvm):
    names = run("networks_in_your_code.md")
    assert names["picture"].numpy()[16, 16].min() > 0.1  # lit, not black
