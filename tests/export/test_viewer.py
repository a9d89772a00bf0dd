"""The page of a material, in a real browser: its picture is right, and everything on it works."""

from __future__ import annotations

import base64
import html
import json

import browser
import mitsuba as mi
import numpy as np
import pytest
from materials import KINDS

from mi_enhance import Material, view
from mi_enhance.cli.main import main
from mi_enhance.data.directions import rusinkiewicz_to_directions
from mi_enhance.data.functions import function_of
from mi_enhance.export import truth, viewer
from mi_enhance.system.bundled_files import demo_data, scene_file

DATA = demo_data("ilm_solo_m_68_rgb.bsdf")

# Stops the page once all programs are there; reads the linear picture as sums over the frames, around a pixel.
HELP = """
await until(() => $("error").textContent || viewer.ready());
viewer.loop = () => {};
viewer.scale = 1;
const mean = (x = viewer.size / 2, y = viewer.size / 2) => {
  const gl = viewer.gl, v = new Float32Array(4 * 16 * 16);
  gl.bindFramebuffer(gl.FRAMEBUFFER, viewer.targets[viewer.frames % 2]);
  gl.readPixels(x - 8, y - 8, 16, 16, gl.RGBA, gl.FLOAT, v);
  return [0, 1, 2].map(c => v.filter((_, k) => k % 4 == c).reduce((a, b) => a + b) / 256 / viewer.frames);
};
const render = n => { viewer.frames = 0; for (let k = 0; k < n; k++) viewer.frame(); };
const choose = (name, value) => {
  const select = document.querySelector(`select[title="${name}"]`);
  select.value = value;
  select.dispatchEvent(new Event("change"));
};
"""


def drive(page, script):
    """What a script on the page returns, once the page is ready."""
    return browser.drive(page, HELP + script)


def test_page_needs_no_network_and_no_other_file(llvm):
    text = viewer.page(KINDS["net ggx2_small"](), name='a "name" </script>')
    for word in ("http", "src=", "import(", "fetch(", "%NAME%", "%SCRIPT%"):
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
    assert '"F0": [0.7]' in text


def test_command_shows_a_measurement_beside_it(llvm, tmp_path, capsys):
    path, page = tmp_path / "gold.bsdf", tmp_path / "page.html"
    Material.analytic("ggx").save(path)
    assert main(["view", str(path), str(DATA), "-o", str(page)]) == 0
    assert "measured: ilm_solo_m_68" in page.read_text()


def test_a_broken_file_is_said_and_nothing_is_written(llvm, tmp_path, capsys):
    path = tmp_path / "broken.bsdf"
    path.write_bytes(b"tensor_file" + bytes(40))
    assert main(["view", str(path), "-o", str(tmp_path / "page.html")]) == 2
    assert "broken.bsdf" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [path]


def test_a_broken_measurement_is_said_and_nothing_is_written(llvm, tmp_path, capsys):
    path, data = tmp_path / "gold.bsdf", tmp_path / "gold.binary"
    Material.analytic("ggx").save(path)
    data.write_bytes(bytes(100))
    assert main(["view", str(path), str(data), "-o", str(tmp_path / "page.html")]) == 2
    assert "gold.binary" in capsys.readouterr().err
    assert sorted(tmp_path.iterdir()) == [data, path]


@pytest.mark.slow
@browser.needs_chromium
def test_every_slider_changes_what_is_seen(llvm):
    page = viewer.page(KINDS["specialized"]().edit(rho_s2=0.5), name="it")
    result = drive(
        page,
        """
        const report = {names: [], same: [], errors: []};
        const state = () => JSON.stringify([MODELS.map(m => [...m.k]), viewer.settings]);
        for (const range of document.querySelectorAll("input[type=range]")) {
          const before = state(), low = +range.min, high = +range.max;
          const moved = Math.abs(+range.value - low) > 0.1 * (high - low);
          range.value = moved ? low + 0.05 * (high - low) : (low + high) / 2;
          range.dispatchEvent(new Event("input"));
          viewer.frame();
          report.names.push(range.title);
          if (state() === before) report.same.push(range.title);
          const error = viewer.gl.getError(), seen = mean();
          if (error || !seen.every(isFinite)) report.errors.push([range.title, error, seen]);
        }
        report.command = $("command").value;
        $("reset").click();
        report.after = $("command").value;
        report.error = $("error").textContent;
        return report;
        """,
    )
    assert result["errors"] == []
    assert result["same"] == []
    assert {"rho_d.R", "alpha_x", "F0", "t_theta", "left | right", "lamp", "viewer"} <= set(result["names"])
    assert result["command"].startswith("mi-enhance show it.bsdf --set n_x=")
    assert (result["after"], result["error"]) == ("", "")


@pytest.mark.slow
@browser.needs_chromium
def test_side_by_side_and_behind_a_slider(llvm):
    """A tile for each model, each with a picture of its own; below them the errors."""
    material = KINDS["of its own"]()
    result = drive(
        viewer.page(material, DATA),
        """
        const all = [], add = () => { render(8); const n = viewer.tiles; all.push({
          size: [$("picture").width, $("picture").height], tiles: n, error: viewer.gl.getError(),
          means: [...Array(n).keys()].map(k => mean(Math.round((k + 0.5) * viewer.size), viewer.size / 2)) }); };
        add();
        choose("left", "2"); choose("right", "2"); add();
        choose("compare", "side"); add();
        choose("compare", "errors"); add();
        choose("shape", "sphere"); add();
        choose("compare", "slider"); add();
        return {all, size: viewer.size, wrong: $("error").textContent, labels: viewer.models.map(m => m.label)};
        """,
    )
    assert result["wrong"] == ""
    assert result["labels"] == ["enhanced", "ggx, fitted", "measured: ilm_solo_m_68"]
    n = result["all"][2]["size"][1]  # a third of the window, whatever its scroll bar takes
    assert 200 < n < 800 / 3
    assert [r["tiles"] for r in result["all"]] == [1, 1, 3, 3, 3, 1]
    assert [r["size"] for r in result["all"]] == [
        [512, 512],
        [512, 512],
        [3 * n, n],
        [3 * n, 2 * n],
        [3 * n, 2 * n],
        [512, 512],
    ]
    for r in result["all"]:
        assert r["error"] == 0
        assert np.isfinite(r["means"]).all()
    tiles = result["all"][4]["means"]  # of the sphere: in the middle of the ball is its grey core
    assert len({tuple(tile) for tile in tiles}) == 3  # three models, three pictures
    assert result["all"][5]["means"][0] == pytest.approx(tiles[2], rel=0.5)  # of the measured one, 8 noisy samples


@pytest.mark.slow
@browser.needs_chromium
def test_the_picture_takes_the_room_that_the_window_has(llvm):
    result = drive(
        viewer.page(Material.analytic("ggx")),
        """
        const sizes = [];
        for (const width of ["300px", "2000px", "10px", ""]) {
          document.body.style.width = width;
          dispatchEvent(new Event("resize"));
          render(2);
          sizes.push([$("picture").width, $("picture").height, viewer.gl.getError(), mean().every(v => v > 0)]);
        }
        return sizes;
        """,
    )
    assert result == [[n, n, 0, True] for n in (300, 512, 64, 512)]


@pytest.mark.slow
@browser.needs_chromium
def test_the_ball_throws_a_shadow_on_the_ground(llvm):
    """By the lamp alone: behind the ball only the grey of what is in the way is left, which is that of a dark room."""
    result = drive(
        viewer.page(Material.analytic("ggx")),
        """
        Object.assign(viewer.settings, {yaw: 0, pitch: 89, azimuth: 90, height: 45, lamp: 20, strength: 0});
        viewer.changed();
        render(16);
        return [mean(20, 256), mean(492, 256)];
        """,
    )
    shadow, lit = np.array(result)
    assert (shadow < 0.01 * lit).all()
    assert (lit > 0.01).all()


@pytest.mark.slow
@browser.needs_chromium
def test_the_picture_is_what_the_light_says(llvm):
    """A diffuse sphere seen from the lamp: rho B sin(radius)^2; and under the room alone: the integral of the map."""
    page = viewer.page(Material.analytic("ggx").edit(rho_s=0, rho_d=(0.8, 0.4, 0.2)))
    result = drive(
        page,
        """
        choose("shape", "sphere");
        Object.assign(viewer.settings, {yaw: 60, pitch: 50, azimuth: 60, height: 50, lamp: 20, strength: 0});
        render(64);
        const lamp = mean();
        Object.assign(viewer.settings, {yaw: 0, pitch: 0, lamp: 0, strength: 1});
        render(64);
        return {lamp, room: mean()};
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
def test_figures_of_the_page_are_the_material_and_the_measurement(llvm):
    material, f = KINDS["edited"](), function_of(DATA)
    theta = np.array([0, 0.3, 0.6, 0.9, 1.2])
    wo = np.stack([np.sin(theta), 0 * theta, np.cos(theta)], 1).astype(np.float32)
    wi = np.tile(np.float32([[np.sin(-0.6), 0, np.cos(-0.6)]]), (5, 1))
    result = drive(
        viewer.page(material, DATA),
        f"""
        const [wi, wo] = {json.dumps([wi.tolist(), wo.tolist()])};
        await until(() => viewer.slices);
        return {{
          values: viewer.models.map(m => wi.map((w, k) => m.evaluate(m.drawn.k, w, wo[k]))),
          slices: [viewer.slices.length, viewer.slices[0].length, viewer.slices[0][0].length],
          drawn: [$("slices").width, $("slices").height], note: $("slices-note").textContent,
        }};
        """,
    )
    enhanced, _, measured = np.array(result["values"])
    assert enhanced == pytest.approx(material.evaluate(wi, wo), rel=1e-3)
    assert measured == pytest.approx(f(wi, wo), rel=0.1, abs=0.002)  # interpolated; the mean over azimuths
    assert result["slices"] == [64, 64, 3]
    assert result["drawn"][0] > result["drawn"][1] > 200
    assert result["note"].startswith("enhanced: 0.")


@pytest.mark.slow
@browser.needs_chromium
def test_without_webgl_the_page_says_so(llvm):
    without = '"use strict"; HTMLCanvasElement.prototype.getContext = () => null;'
    page = viewer.page(Material.analytic("ggx")).replace('"use strict";', without, 1)
    assert "This page needs WebGL 2" in browser.drive(page, 'return $("error").textContent')


def test_table_of_a_measurement_holds_its_values():
    """At the nodes, but for those below the horizon, which have the nearest ones' values."""
    f = lambda wi, wo: np.stack([wi[:, 2], wo[:, 2], 1 + 0 * wi[:, 2]], 1)  # noqa: E731
    texels = np.frombuffer(base64.b64decode(truth.table(f)), "<f2").astype(float).reshape(*truth.SIZE[::-1], 3)
    k, j, i = np.meshgrid([0, 9, 18], [0, 16], [0, 30, 60], indexing="ij")
    wi, wo = rusinkiewicz_to_directions((i / 95) ** 2 * np.pi / 2, 0.0, j / 31 * np.pi / 2, k / 18 * np.pi)
    found = np.exp(texels[k, j, i])
    above = (wi[..., 2] > 0.02) & (wo[..., 2] > 0.02)
    assert found[above] == pytest.approx(f(wi[above], wo[above]), rel=0.01)
    assert np.isfinite(texels).all()
