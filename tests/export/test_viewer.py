"""The page of a material, in a real browser: its picture is right, and everything on it works."""

from __future__ import annotations

import html
import json

import browser
import mitsuba as mi
import numpy as np
import pytest
from materials import KINDS

from mi_enhance import Material, view
from mi_enhance.cli.main import main
from mi_enhance.export import viewer
from mi_enhance.system.bundled_files import scene_file

# Reads the linear picture as sums over the frames so far, at the pixels in the middle.
HELP = """
const middle = () => {
  const gl = viewer.gl, v = new Float32Array(4 * 16 * 16);
  gl.bindFramebuffer(gl.FRAMEBUFFER, viewer.targets[viewer.frames % 2]);
  gl.readPixels(248, 248, 16, 16, gl.RGBA, gl.FLOAT, v);
  const mean = [0, 1, 2].map(c => v.filter((_, k) => k % 4 == c).reduce((a, b) => a + b) / 256 / viewer.frames);
  return mean;
};
const rendered = n => { viewer.frames = 0; for (let k = 0; k < n; k++) viewer.frame(); return middle(); };
"""


def drive(page, script):
    """What a script on the page returns, once the page has started."""
    run = f"""<pre id="out"></pre><script>{HELP}
    let out; try {{ out = (() => {{ {script} }})(); }} catch (error) {{ out = {{failed: String(error)}}; }}
    document.getElementById("out").textContent = JSON.stringify(out);</script></body>"""
    document = browser.dump(page.replace("</body>", run))
    result = json.loads(html.unescape(document.partition('<pre id="out">')[2].partition("</pre>")[0]))
    assert "failed" not in result, result
    return result


def test_page_needs_no_network_and_no_other_file(llvm):
    text = viewer.page(KINDS["net ggx2_small"](), 'a "name" </script>')
    for word in ("http", "src=", "import(", "fetch(", "%NAME%", "%SHADER%"):
        assert word not in text
    assert text.count("</script>") == 1


def test_notebook_shows_the_page(llvm):
    shown = view(Material.analytic("ggx"))._repr_html_()
    assert shown.startswith("<iframe srcdoc=")
    assert html.unescape(shown.partition('srcdoc="')[2].partition('"')[0]) == viewer.page(Material.analytic("ggx"))


def test_command_writes_the_edited_material(llvm, tmp_path, capsys):
    path = tmp_path / "gold.bsdf"
    Material.analytic("ggx").save(path)
    assert main(["view", str(path), "--set", "F0=0.7", "-o", str(tmp_path / "page.html"), "--json"]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    text = (tmp_path / "page.html").read_text()
    assert report["bytes"] == len(text.encode())
    assert '"name": "F0", "low": 0.0, "high": 1.0, "log": false, "value": [0.7]' in text


def test_a_broken_file_is_said_and_nothing_is_written(llvm, tmp_path, capsys):
    path = tmp_path / "broken.bsdf"
    path.write_bytes(b"tensor_file" + bytes(40))
    assert main(["view", str(path), "-o", str(tmp_path / "page.html")]) == 2
    assert "broken.bsdf" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
@browser.needs_chromium
def test_every_slider_changes_what_is_seen(llvm):
    page = viewer.page(KINDS["specialized"]().edit(rho_s2=0.5), "it")
    result = drive(
        page,
        """
        const report = {names: [], same: [], errors: []};
        const state = () => JSON.stringify([viewer.k.map(k => [...k]), viewer.settings]);
        for (const range of document.querySelectorAll("input[type=range]")) {
          const before = state(), low = +range.min, high = +range.max;
          const moved = Math.abs(+range.value - low) > 0.1 * (high - low);
          range.value = moved ? low + 0.05 * (high - low) : (low + high) / 2;
          range.dispatchEvent(new Event("input"));
          viewer.frame();
          report.names.push(range.title);
          if (state() === before) report.same.push(range.title);
          const error = viewer.gl.getError(), mean = middle();
          if (error || !mean.every(isFinite)) report.errors.push([range.title, error, mean]);
        }
        report.command = document.getElementById("command").value;
        document.getElementById("reset").click();
        report.after = document.getElementById("command").value;
        report.error = document.getElementById("error").textContent;
        return report;
        """,
    )
    assert result["errors"] == []
    assert result["same"] == []
    assert {"rho_d.R", "alpha_x", "F0", "t_theta", "with | without", "lamp", "viewer"} <= set(result["names"])
    assert result["command"].startswith("mi-enhance show it.bsdf --set n_x=")
    assert (result["after"], result["error"]) == ("", "")


@pytest.mark.slow
@browser.needs_chromium
def test_the_picture_is_what_the_light_says(llvm):
    """A diffuse ball seen from the lamp: rho B sin(radius)^2; and under the room alone: the integral of the map."""
    page = viewer.page(Material.analytic("ggx").edit(rho_s=0, rho_d=(0.8, 0.4, 0.2)))
    result = drive(
        page,
        """
        Object.assign(viewer.settings, {yaw: 60, pitch: 50, azimuth: 60, height: 50, lamp: 20, strength: 0, split: 1});
        viewer.changed();
        const lamp = rendered(64);
        Object.assign(viewer.settings, {yaw: 0, pitch: 0, lamp: 0, strength: 1, split: 0});
        viewer.changed();
        return {lamp, room: rendered(64)};
        """,
    )
    rho = np.array([0.8, 0.4, 0.2])
    assert result["lamp"] == pytest.approx(rho * 20 * np.sin(0.15) ** 2, rel=0.02)
    bitmap = mi.Bitmap(str(scene_file("envmaps/apartment.exr")))
    bitmap = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
    texels = np.array(bitmap.resample(mi.ScalarVector2u(128, 64)))
    theta = np.pi * (np.arange(64)[:, None] + 0.5) / 64
    phi = 2 * np.pi * ((np.arange(128) + 0.5) / 128 - 0.5)
    cos = np.maximum(-np.sin(theta) * np.cos(phi), 0)  # to the viewer in (0, 0, 1)
    solid = np.sin(theta) * (np.pi / 64) * (2 * np.pi / 128)
    expected = rho / np.pi * (texels * (cos * solid)[..., None]).sum((0, 1))
    assert result["room"] == pytest.approx(expected, rel=0.05)  # bilinear there, texel by texel here; noise 1 %


@pytest.mark.slow
@browser.needs_chromium
def test_lobe_of_the_page_is_the_material(llvm):
    material = KINDS["edited"]()
    result = drive(
        viewer.page(material),
        "const w = t => [Math.sin(t), 0, Math.cos(t)];"
        "return [0, 0.3, 0.6, 0.9, 1.2].map(t => MODELS[0].eval(viewer.k[0], w(-0.6), w(t)));",
    )
    theta = np.array([0, 0.3, 0.6, 0.9, 1.2])
    wo = np.stack([np.sin(theta), 0 * theta, np.cos(theta)], 1)
    wi = np.tile([[np.sin(-0.6), 0, np.cos(-0.6)]], (5, 1))
    assert np.array(result) == pytest.approx(material.evaluate(wi, wo), rel=1e-3)


@pytest.mark.slow
@browser.needs_chromium
def test_without_webgl_the_page_says_so(llvm):
    without = '"use strict"; HTMLCanvasElement.prototype.getContext = () => null;'
    document = browser.dump(viewer.page(Material.analytic("ggx")).replace('"use strict";', without, 1))
    assert "This page needs WebGL 2" in document.partition('id="error">')[2][:200]
