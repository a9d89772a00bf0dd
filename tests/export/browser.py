"""GLSL in a real browser: WebGL 2 of a headless Chromium, rendered in software. Not a test itself."""

from __future__ import annotations

import base64
import contextlib
import http.server
import json
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
CHROMIUM = next(filter(None, map(shutil.which, _NAMES)), None)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason=f"no browser on this machine; any of: {', '.join(_NAMES)}")
FLAGS = ("--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")

_PAGE = """<!doctype html><meta charset="utf-8"><pre id="result"></pre><script>
const jobs = JOBS, directions = DIRECTIONS;
function floats(text) {
  return new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
}
function run() {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl || !gl.getExtension("EXT_color_buffer_float")) throw Error("no WebGL 2 with float targets");
  const n = directions.size, textures = directions.data.map((text, unit) => {
    const texture = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, n, n, 0, gl.RGBA, gl.FLOAT, floats(text));
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    return texture;
  });
  const target = gl.createTexture();
  gl.activeTexture(gl.TEXTURE7);
  gl.bindTexture(gl.TEXTURE_2D, target);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, n, n, 0, gl.RGBA, gl.FLOAT, null);
  gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
  gl.viewport(0, 0, n, n);
  const vertex = `#version 300 es
    void main() { gl_Position = vec4(4 * (gl_VertexID & 1) - 1, 2 * (gl_VertexID & 2) - 1, 0, 1); }`;
  const programs = {}, result = [], seconds = [];
  function compiled(text) {
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, text]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw Error(gl.getProgramInfoLog(program));
    return program;
  }
  const pixels = new Float32Array(4 * n * n);
  for (const job of jobs) {
    const program = programs[job.source] ??= compiled(job.source);
    gl.useProgram(program);
    textures.forEach((_, unit) => gl.uniform1i(gl.getUniformLocation(program, "d" + unit), unit));
    for (const uniforms of job.uniforms) {
      for (const [name, v] of Object.entries(uniforms)) gl.uniform4fv(gl.getUniformLocation(program, name), v);
      const start = performance.now();
      gl.drawArrays(gl.TRIANGLES, 0, 3);
      gl.readPixels(0, 0, n, n, gl.RGBA, gl.FLOAT, pixels);
      seconds.push((performance.now() - start) / 1000);
      if (!WANTED) continue;
      const bytes = new Uint8Array(pixels.buffer);
      let text = "";
      for (let k = 0; k < bytes.length; k += 4096) text += String.fromCharCode(...bytes.subarray(k, k + 4096));
      result.push(btoa(text));
    }
  }
  return {result, seconds};
}
let report;
try { report = run(); } catch (error) { report = {error: String(error)}; }
document.getElementById("result").textContent = JSON.stringify(report);
</script>"""


def fragment(source: str, expression: str, name: str, uniform: bool) -> str:
    """A fragment shader that writes `expression` of a, b, c (the texels of three arrays) and the material m."""
    struct = f"uniform {name}_Material m;" if uniform else ""
    made = "" if uniform or f"{name}_Material" not in source else f"{name}_Material m = {name}_material();"
    return f"""#version 300 es
precision highp float;
precision highp int;
uniform highp sampler2D d0, d1;
out vec4 colour;
{source}
{struct}
void main() {{
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec3 a = texelFetch(d0, at, 0).xyz, b = texelFetch(d1, at, 0).xyz;
    {made}
    colour = {expression};
}}"""


def run(jobs: list[dict], a: np.ndarray, b: np.ndarray, timeout: float = 120) -> np.ndarray:
    """Render every job, ``{"source": fragment shader, "uniforms": [{name: numbers}, ...]}``, at all pairs of rows.

    Returns an array (draws, N, 4), float32.
    """
    drawn = _report(jobs, a, b, timeout, wanted=True)["result"]
    return np.array([np.frombuffer(base64.b64decode(text), "<f4").reshape(-1, 4)[: len(a)] for text in drawn])


def seconds(jobs: list[dict], a: np.ndarray, b: np.ndarray, timeout: float = 600) -> list[float]:
    """The time of every draw of :func:`run`; a source is compiled at its first, which counts."""
    return _report(jobs, a, b, timeout, wanted=False)["seconds"]


def _report(jobs: list[dict], a: np.ndarray, b: np.ndarray, timeout: float, *, wanted: bool) -> dict:
    n = int(np.ceil(np.sqrt(len(a))))
    texels = []
    for rows in (a, b):
        texel = np.zeros((n * n, 4), np.float32)
        texel[: len(rows), :3] = rows
        texels.append(base64.b64encode(texel.tobytes()).decode())
    page = _PAGE.replace("DIRECTIONS", json.dumps({"size": n, "data": texels})).replace("JOBS", json.dumps(jobs), 1)
    dom = dump(page.replace("WANTED", json.dumps(wanted)), timeout)
    report = json.loads(dom.partition('<pre id="result">')[2].partition("</pre>")[0].replace("&gt;", ">"))
    if "error" in report:
        raise AssertionError(report["error"])
    return report


def dump(page: str, timeout: float = 120) -> str:
    """The document of a page after its scripts have run."""
    with _opened(page, "--timeout=100000", "--dump-dom") as process:
        return process.communicate(timeout=timeout)[0]


def drive(page: str, script: str, timeout: float = 120) -> object:
    """What the body of an asynchronous function returns on a page; ``until(f)`` waits until f() is true."""
    received: list[bytes] = []
    answered = threading.Event()

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self) -> None:  # noqa: N802  (the name that http.server calls)
            received.append(self.rfile.read(int(self.headers["Content-Length"])))
            self.send_response(204)
            self.end_headers()
            answered.set()

        def log_message(self, *args: object) -> None:
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        run = f"""<script>(async () => {{
        const until = async f => {{ while (!f()) await new Promise(r => setTimeout(r, 10)); }};
        let out;
        try {{ out = await (async () => {{ {script} }})(); }} catch (error) {{ out = {{failed: String(error.stack)}}; }}
        fetch("http://127.0.0.1:{server.server_port}/", {{method: "POST", mode: "no-cors", body: JSON.stringify(out)}});
        }})();</script></body>"""
        with _opened(page.replace("</body>", run), "--remote-debugging-port=0"):
            answered.wait(timeout)
        server.shutdown()
    if not received:
        raise AssertionError(f"the page did not answer within {timeout} s")
    result = json.loads(received[0])
    if isinstance(result, dict) and "failed" in result:
        raise AssertionError(result["failed"])
    return result


@contextlib.contextmanager
def _opened(page: str, *flags: str) -> Iterator[subprocess.Popen]:
    """Have the browser open a page while the block runs."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        path = Path(folder) / "page.html"
        path.write_text(page, encoding="utf-8")
        command = [CHROMIUM, *FLAGS, f"--user-data-dir={folder}/profile", *flags, path.as_uri()]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
            try:
                yield process
            finally:
                process.terminate()  # a killed browser would leave its own children behind
