"""Size and speed of exported code: a row for each material, an analytic GGX first.

Bytes of the files, multiply-adds, and the time of an evaluation of f_r in a headless browser (WebGL 2, software
rendering: a CPU) over that of GGX: medians of interleaved draws of 512 x 512 pairs. The parameters are uniforms, as in
a viewer with sliders.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import common
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "export"))

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import browser  # isort: skip
import mitsuba as mi  # isort: skip

from mi_enhance import Material
from mi_enhance.benchmark.timing import machine
from mi_enhance.export import brdf_explorer, numpy_file, shaders
from mi_enhance.export.program import record
from mi_enhance.neural.distilled_network import DistilledNetwork
from mi_enhance.neural.inputs import names_of

_COLUMNS = {
    "material": ("material", ""),
    "multiply_adds": ("multiply-adds", ",d"),
    "glsl": (".glsl", ",d"),
    "constant": (".glsl, constant", ",d"),
    "hlsl": (".hlsl", ",d"),
    "slang": (".slang", ",d"),
    "python": (".py", ",d"),
    "brdf": (".brdf", ",d"),
    "uniforms": ("vec4 of uniforms", "d"),
    "to_ggx": ("time to GGX", ".2f"),
}


def main() -> None:
    """Run the benchmark of the command line."""
    parser = common.parser(__doc__)
    parser.add_argument("files", nargs="*", metavar="MAT.bsdf", help="materials beside the shipped networks")
    parser.add_argument("--rounds", type=int, default=7)
    args = parser.parse_args()
    mi.set_variant("llvm_ad_rgb")
    materials = {"GGX": Material.analytic("ggx"), "GGX, two lobes": Material.analytic("ggx2")}
    materials |= {f"own network, {n}-{n}": own_network((n, n)) for n in (8, 12)}
    names = ("ggx2_rgb", "ggx2", "ggx2_small", "paper")
    materials |= {f"shared network {name}": shared(name) for name in names}
    materials |= {Path(path).stem: Material.load(path) for path in args.files}
    programs = {name: record(material) for name, material in materials.items()}
    rows = [{"material": name, **sizes(programs[name], materials[name])} for name in materials]
    for row, ratio in zip(rows, times(list(programs.values()), args.rounds), strict=True):
        row["to_ggx"] = ratio
    common.finish(rows, _COLUMNS, title="exported code", about=machine(), as_json=args.json)


def own_network(hidden: tuple[int, ...]) -> Material:
    """Two lobes with a network as `fit` gives a material of its own; size and time do not ask for its weights."""
    material, rng = Material.analytic("ggx2").edit(rho_s2=0.1), np.random.default_rng(0)
    inputs = tuple(n for n in names_of("shape") if "log_ratio" not in n and "azimuth" not in n)
    slots, layers, seen = ("B", "G", "G2"), [], len(inputs)
    for n in (*hidden, 3 * len(slots)):
        w, b = rng.normal(0, 0.3, (n, seen)), rng.normal(0, 0.1, n)
        layers.append((w.astype(np.float32), b.astype(np.float32)))
        seen += n
    network = DistilledNetwork(slots, inputs, tuple(layers), channels=3)
    brdf = dataclasses.replace(material.brdf, distilled=(network,), inputs="shape")
    return dataclasses.replace(material, brdf=brdf, params={**material.params, "asymmetry": np.ones(1)})


def shared(name: str) -> Material:
    """A shipped network, with read-outs as a fit finds them: at 0 there is nothing to be computed."""
    material = Material.pretrained(name)
    if not material.brdf.trunk:
        return material
    return material.edit(read_out=np.random.default_rng(0).normal(0, 0.1, material.params["read_out"].size), rho_s2=0.1)


def sizes(program, material) -> dict:
    """Bytes of the files of a material."""

    def n(text: str) -> int:
        return len(text.encode())

    return {
        "multiply_adds": program.multiply_adds,
        "glsl": n(shaders.source(program, "it")),
        "constant": n(shaders.source(record(material, editable=False), "it")),
        "hlsl": n(shaders.source(program, "it", shaders.HLSL)),
        "slang": n(shaders.source(program, "it", shaders.SLANG)),
        "python": n(numpy_file.source(program, "it")),
        "brdf": n(brdf_explorer.source(program, "it")),
        "uniforms": -(-len(program.prepared) // 4),
    }


def times(programs, rounds: int) -> list[float]:
    """Time of a draw over that of the first program, medians; the draw that compiles does not count."""
    wi, wo = np.random.default_rng(0).normal(size=(2, 512 * 512, 3)).astype(np.float32)
    for w in (wi, wo):
        w /= np.linalg.norm(w, axis=1, keepdims=True)
        w[:, 2] = abs(w[:, 2])
    jobs = []
    for program in programs:
        evaluated = dataclasses.replace(program, functions={"eval": program.functions["eval"]})
        source = browser.fragment(shaders.source(evaluated, "it"), "vec4(it_eval(m, a, b), 0)", "it", uniform=True)
        k = program.prepare()
        jobs.append({"source": source, "uniforms": [{"m.k": np.pad(k, (0, -len(k) % 4)).tolist()}]})
    seconds = np.reshape(browser.seconds(jobs * (rounds + 1), wi, wo), (rounds + 1, len(jobs)))[1:]
    return list(np.median(seconds / seconds[:, :1], axis=0))


if __name__ == "__main__":
    main()
