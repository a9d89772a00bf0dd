"""Pages whose code is a program: all their blocks run, in order, and do what the page says.

Each in a process of its own, from another folder, as a reader runs it; and Dr.Jit compiles what BSDFs they make into
every render of a process, which other tests would notice.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"

NEURAL = """
import numpy as np
assert float(loss[0]) < 0.02  # mean of |log(1 + f cos) - log(1 + f cos)|; the material's own is about 0.1
# one network, two ways to evaluate it: rounding of float32, and the same random numbers
np.testing.assert_allclose(again.numpy(), image.numpy(), rtol=1e-3, atol=1e-4)
expected = mi.render(ball(truth), spp=64).numpy()
assert abs(image.numpy()[16:48, 16:48].mean() / expected[16:48, 16:48].mean() - 1) < 0.1
"""
YOUR_CODE = """
assert picture.numpy()[16, 16].min() > 0.1  # lit, not black
"""
BESIDE = """
from mi_enhance import Material, fit_images
from mi_enhance.images.cameras import around, render_views
paint = Material.analytic("ggx").to_dict()
views = render_views(ball(paint), around(1, target=(0, 0, 0), distance=4, resolution=8), spp=4)
fit_images(ball(paint), views, stages=[(1, 1, 1)], unknowns=["rho_d"])
"""


def blocks(page: str) -> list[str]:
    found = re.findall(r"^```python\n(.*?)^```", (DOCS / page).read_text(), re.DOTALL | re.MULTILINE)
    assert found, f"{page} holds no Python"
    return found


def run(code: str, folder: Path) -> subprocess.CompletedProcess:
    (folder / "page.py").write_text(code)
    return subprocess.run([sys.executable, "page.py"], cwd=folder, capture_output=True, text=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    "page, checks", [("neural_bsdf.md", NEURAL), ("networks_in_your_code.md", YOUR_CODE)], ids=["bsdf", "code"]
)
def test_page_is_a_program(page, checks, tmp_path):
    done = run("\n".join([*blocks(page), checks]), tmp_path)
    assert done.returncode == 0, done.stderr


def test_neural_bsdf_has_40_lines():
    code = [line for line in blocks("neural_bsdf.md")[0].splitlines() if line.strip()]
    assert len(code) <= 40, f"the title says 40 lines, the plugin has {len(code)}"


@pytest.mark.slow
def test_fit_images_says_what_keeps_it_from_recording(tmp_path):
    """A BSDF of the page, whose weights Dr.Jit does not find, is alive in the process: it takes longer, and works."""
    done = run("\n".join(["import mi_enhance", *blocks("neural_bsdf.md")[:3], BESIDE]), tmp_path)
    assert done.returncode == 0 and done.stderr.count("Dr.Jit cannot record renders") == 1, done.stderr
