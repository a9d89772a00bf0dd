"""Speed of the page of a material in a headless browser whose graphics card is a program on the CPU.

Seconds from the start of the page to the first picture (of the analytic model) and to the first with the networks, and
frames a second at 512 x 512 pixels, of the ball and of the sphere.
The load of the machine is printed with them.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import common

sys.path.insert(0, str(Path(__file__).parents[1] / "export"))

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import browser  # isort: skip
import mitsuba as mi  # isort: skip
from exported_code import own_network  # isort: skip

from mi_enhance import Material
from mi_enhance.benchmark.timing import machine
from mi_enhance.export import viewer

_COLUMNS = {
    "material": ("material", ""),
    "first": ("first picture, s", ".2f"),
    "networks": ("with networks, s", ".2f"),
    "ball": ("ball, frames/s", ".1f"),
    "sphere": ("sphere, frames/s", ".1f"),
    "load": ("load", ".1f"),
}
# The page reads a pixel back to wait for what was drawn. Times count from the start of its navigation.
_SCRIPT = """
viewer.loop = () => {};
const gl = viewer.gl, wait = () => {
  gl.bindFramebuffer(gl.FRAMEBUFFER, viewer.targets[viewer.frames % 2]);
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.FLOAT, new Float32Array(4));
};
const out = {};
wait();
out.first = performance.now() / 1000;
await until(() => viewer.ready());
viewer.scale = 1;
viewer.frame();
wait();
out.networks = performance.now() / 1000;
viewer.settings.split = 1;
for (const shape of ["ball", "sphere"]) {
  viewer.set("shape", shape);
  viewer.frame();
  wait();
  const start = performance.now();
  for (let k = 0; k < FRAMES; k++) viewer.frame();
  wait();
  out[shape] = 1000 * FRAMES / (performance.now() - start);
}
return out;
"""


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("files", nargs="*", metavar="MAT.bsdf", help="materials beside GGX and a network of its own")
    parser.add_argument("--frames", type=int, default=20)
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    materials = {"GGX": Material.analytic("ggx"), "own network, 12 12": own_network((12, 12))}
    materials |= {Path(path).stem: Material.load(path) for path in args.files}
    rows = []
    for name, material in materials.items():
        found = browser.drive(viewer.page(material), _SCRIPT.replace("FRAMES", str(args.frames)))
        rows.append({"material": name, **found, "load": os.getloadavg()[0]})
    common.finish(rows, _COLUMNS, title="viewer", about=machine(), as_json=args.json)


if __name__ == "__main__":
    main()
