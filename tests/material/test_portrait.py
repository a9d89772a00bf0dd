"""A material shows itself in a notebook."""

from __future__ import annotations

import base64
import io

import mitsuba as mi
import numpy as np
import pytest
from PIL import Image

from mi_enhance import Material
from mi_enhance.material.portrait import portrait


def test_the_picture_is_a_sphere_of_the_colour(llvm):
    picture = portrait(Material.analytic("ggx").edit(rho_d=(0.8, 0.2, 0.05), rho_s=0))
    assert not picture[[0, 0, -1, -1], [0, -1, 0, -1]].any()  # nothing in the corners
    assert (picture[..., 3] == 255).mean() == pytest.approx(np.pi / 4, abs=0.03)
    r, g, b = picture[72, 72, :3].astype(int)
    assert r > g + 20 > b + 40


def test_a_rougher_material_has_a_wider_and_dimmer_highlight(llvm):
    sharp, rough = (
        portrait(Material.analytic("ggx").edit(rho_d=0, rho_s=1, F0=1, alpha_x=a, alpha_y=a))[..., 0]
        for a in (0.02, 0.5)
    )
    assert (sharp > 250).sum() > 100
    assert (rough > 250).sum() < (sharp > 250).sum()


def test_html_holds_picture_equation_and_numbers(llvm):
    text = Material.analytic("ggx").edit(rho_d=0.25)._repr_html_()
    data = text.partition("base64,")[2].partition('"')[0]
    assert Image.open(io.BytesIO(base64.b64decode(data))).size == (144, 144)
    for word in ("M + S * D * F * G * 1/E", "rho_d", "0.25 0.25 0.25"):
        assert word in text


def test_without_a_variant_that_evaluates_it_there_is_the_text(llvm):
    mi.set_variant("scalar_rgb")
    try:
        text = Material.analytic("ggx")._repr_html_()
    finally:
        mi.set_variant("llvm_ad_rgb")
    assert "<img" not in text
    assert "rho_d" in text
