"""Every language is accepted by a compiler of its own, for every kind of material."""

from __future__ import annotations

import shutil
import subprocess
import sys

import browser
import pytest
from materials import KINDS

from mi_enhance.export import brdf_explorer, shaders
from mi_enhance.export.program import record

GLSLANG = shutil.which("glslangValidator")
CALLS = "vec4(it_eval(m, a, b) + it_sample(m, a, b), it_pdf(it_prepare(it_defaults()), a, b))"
HLSL = """
RWStructuredBuffer<float3> result;
[shader("compute")] [numthreads(64, 1, 1)]
void main(uint3 id : SV_DispatchThreadID)
{
    float3 a = result[id.x];
    it_Material m = it_prepare(it_defaults());
    result[id.x] = it_eval(m, a, a) + it_sample(m, a, a) + it_pdf(m, a, a);
}
"""
SLANG = (
    HLSL
    + """
[Differentiable] float brightness(float alpha, no_diff float3 wi)
{
    var p = it_defaults();
    p.alpha_x = alpha;
    return it_eval(it_prepare(p), wi, wi).x;
}
[shader("compute")] [numthreads(64, 1, 1)]
void slope(uint3 id : SV_DispatchThreadID)
{
    result[id.x] = fwd_diff(brightness)(diffPair(0.2, 1.0), result[id.x]).d;
}
"""
)
# In a process of its own, which may crash: it takes Slang's compiler, but no GPU.
COMPILE = """
import sys, slangpy
device = slangpy.Device(type=slangpy.DeviceType.cpu)
for path in sys.argv[1:]:
    module = device.load_module_from_source(path.replace("/", "_").replace(".", "_"), open(path).read())
    for entry in module.entry_points:
        device.link_program([module], [entry])
print("accepted", len(sys.argv) - 1)
"""


def glslang(path):
    done = subprocess.run([GLSLANG, str(path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


@pytest.mark.skipif(GLSLANG is None, reason="glslangValidator is not installed (Debian: glslang-tools)")
@pytest.mark.parametrize("kind", [kind for kind in KINDS if "net" not in kind or "small" in kind])
def test_glslang_accepts_glsl(llvm, tmp_path, kind):
    text = shaders.source(record(KINDS[kind]()), "it")
    path = tmp_path / "it.frag"
    path.write_text(browser.fragment(text, CALLS, "it", uniform=True))
    glslang(path)
    path.write_text(path.read_text().replace("300 es", "330 core"))
    glslang(path)


@pytest.mark.skipif(GLSLANG is None, reason="glslangValidator is not installed (Debian: glslang-tools)")
@pytest.mark.parametrize("version", ["130", "410"])
@pytest.mark.parametrize("kind", ["ggx2", "abc", "text", "net ggx2_small", "bounded", "mixture"])
def test_glslang_accepts_what_brdf_explorer_makes_of_brdf(llvm, tmp_path, kind, version):
    """Its templates are of these versions; a line of the file that begins with # is left out."""
    lines = brdf_explorer.source(record(KINDS[kind]()), "it").splitlines()
    assert lines[0] == "analytic"
    parameters = lines[lines.index("::begin parameters") + 1 : lines.index("::end parameters")]
    kinds = {"float": "float", "color": "vec3"}
    uniforms = [f"uniform {kinds[line.split()[0]]} {line.split()[1]};" for line in parameters]
    numbers = [tuple(map(float, line.split()[2:])) for line in parameters]
    assert all(n[0] <= n[2] <= n[1] for n, line in zip(numbers, parameters, strict=True) if line[0] == "f")
    assert all(max(n) <= 1 for n, line in zip(numbers, parameters, strict=True) if line[0] == "c")
    body = [v for v in lines[lines.index("::begin shader") + 1 : lines.index("::end shader")] if v[:1] != "#"]
    main = "uniform vec3 d[5]; out vec4 o;\nvoid main() { o = vec4(BRDF(d[0], d[1], d[2], d[3], d[4]), 1.0); }"
    path = tmp_path / "it.frag"
    path.write_text(
        "\n".join([f"#version {version}", *uniforms, *body, main.replace("in vec3 d[5]", "uniform vec3 d[5]")])
    )
    glslang(path)


@pytest.mark.parametrize("language", ["hlsl", "slang"])
def test_slangs_compiler_accepts_hlsl_and_slang(llvm, tmp_path, language):
    """Slang's also reads HLSL; in Slang the functions can be differentiated."""
    pytest.importorskip("slangpy", reason="Slang's compiler is not installed (pip install slangpy)")
    style, entry = {"hlsl": (shaders.HLSL, HLSL), "slang": (shaders.SLANG, SLANG)}[language]
    paths = []
    for kind in ("ggx2", "ward", "net ggx2_small", "specialized", "bounded", "mixture"):
        paths.append(tmp_path / f"{kind.replace(' ', '_')}.{language}")
        paths[-1].write_text(shaders.source(record(KINDS[kind]()), "it", style) + entry)
    done = subprocess.run([sys.executable, "-c", COMPILE, *map(str, paths)], capture_output=True, text=True)
    assert f"accepted {len(paths)}" in done.stdout, done.stderr[-2000:]
