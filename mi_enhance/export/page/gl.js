// WebGL: programs that compile while the page goes on, and textures.
const HEAD = `#version 300 es
precision highp float; precision highp int; precision highp sampler2D; precision highp sampler3D;
`;
const WHOLE = HEAD + "void main() { gl_Position = vec4(4 * (gl_VertexID & 1) - 1, 2 * (gl_VertexID & 2) - 1, 0, 1); }";

function program(gl, fragment, vertex = WHOLE) {  // ready() tells whether it may be used; it throws what the compiler says
  const made = gl.createProgram(), parallel = gl.getExtension("KHR_parallel_shader_compile"), places = {};
  const shaders = [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]].map(([kind, text]) => {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
    return shader;
  });
  gl.linkProgram(made);
  let linked = false;
  return {
    made,
    at: name => places[name] ??= gl.getUniformLocation(made, name),
    ready(wait = false) {
      if (linked || !wait && parallel && !gl.getProgramParameter(made, parallel.COMPLETION_STATUS_KHR)) return linked;
      if (!gl.getProgramParameter(made, gl.LINK_STATUS))
        throw Error(shaders.map(s => gl.getShaderInfoLog(s)).join("") || gl.getProgramInfoLog(made));
      return linked = true;
    },
  };
}

function texture(gl, unit, inner, size, outer, kind, data, filter) {
  const made = gl.createTexture(), target = size.length > 2 ? gl.TEXTURE_3D : gl.TEXTURE_2D;
  gl.activeTexture(gl.TEXTURE0 + unit);
  gl.bindTexture(target, made);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  if (size.length > 2) gl.texImage3D(target, 0, inner, ...size, 0, outer, kind, data);
  else gl.texImage2D(target, 0, inner, ...size, 0, outer, kind, data);
  gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, filter);
  gl.texParameteri(target, gl.TEXTURE_MAG_FILTER, filter);
  for (const axis of [gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) gl.texParameteri(target, axis, gl.CLAMP_TO_EDGE);
  if (size.length > 2) gl.texParameteri(target, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  return made;
}

function target(gl, ...textures) {  // a framebuffer
  const made = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, made);
  textures.forEach((t, k) => gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + k, gl.TEXTURE_2D, t, 0));
  gl.drawBuffers(textures.map((_, k) => gl.COLOR_ATTACHMENT0 + k));
  return made;
}

function discard(gl, made) {
  for (const kind of ["Texture", "Framebuffer", "Renderbuffer"]) if (made instanceof window[`WebGL${kind}`]) gl[`delete${kind}`](made);
}

const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;

function half(bits) {
  const e = bits >> 10 & 31, m = bits & 1023;
  return (bits & 0x8000 ? -1 : 1) * (e ? 2 ** (e - 15) * (1 + m / 1024) : m * 2 ** -24);
}
