// What stands in textures: the room (units 0 to 2), the ball with its distances (5), the measured table (6).
function room(gl) {  // the map, its texels drawn in proportion to their light, and how densely; returns the mean of the map
  const { width, height, texels } = ENVIRONMENT, bits = new Uint16Array(bytes(texels)), n = width * height, draws = 128 * 128;
  texture(gl, 0, gl.RGB16F, [width, height], gl.RGB, gl.HALF_FLOAT, bits, gl.LINEAR);
  const light = Float64Array.from({ length: n }, (_, k) =>
    (half(bits[3 * k]) + half(bits[3 * k + 1]) + half(bits[3 * k + 2])) * Math.sin(Math.PI * (Math.floor(k / width) + 0.5) / height));
  const all = light.reduce((a, b) => a + b), drawn = new Uint8Array(2 * draws), densities = new Float32Array(n);
  for (let k = 0, j = 0, sum = 0; k < n; k++) {
    const first = j;
    sum += light[k];
    for (; j < draws && (j + 0.5) / draws * all <= sum; j++) drawn.set([k % width, Math.floor(k / width)], 2 * j);
    densities[k] = (j - first) / draws * n / (2 * Math.PI ** 2);  // times 1 / sin(theta): per solid angle
  }
  texture(gl, 1, gl.R32F, [width, height], gl.RED, gl.FLOAT, densities, gl.NEAREST);
  texture(gl, 2, gl.RG8, [128, 128], gl.RG, gl.UNSIGNED_BYTE, drawn, gl.NEAREST);
  return all * Math.PI / (6 * n);
}

function ball(gl) {  // its vertices, and how many corners its triangles have
  const vertices = bytes(BALL.vertices), faces = new Uint16Array(bytes(BALL.faces)), made = gl.createVertexArray();
  gl.bindVertexArray(made);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.STATIC_DRAW);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
  [[3, gl.UNSIGNED_SHORT, true, 0], [1, gl.UNSIGNED_SHORT, false, 6], [4, gl.SHORT, true, 8]].forEach(([n, kind, unit, offset], k) => {
    gl.enableVertexAttribArray(k);
    gl.vertexAttribPointer(k, n, kind, unit, 16, offset);
  });
  gl.bindVertexArray(null);
  const cells = Array(3).fill(BALL.cells);
  texture(gl, 5, gl.R8, cells, gl.RED, gl.UNSIGNED_BYTE, new Uint8Array(bytes(BALL.distances)), gl.LINEAR);
  return { made, corners: faces.length };
}

function measurement(gl) {  // the table, and the model that reads it
  const bits = TRUTH ? new Uint16Array(bytes(TRUTH.texels)) : new Uint16Array(3), size = TRUTH ? TRUTH.size : [1, 1, 1];
  texture(gl, 6, gl.RGB16F, size, gl.RGB, gl.HALF_FLOAT, bits, gl.LINEAR);
  if (!TRUTH) return [];
  const values = Float32Array.from(bits, half);
  const evaluate = (k, wi, wo) => {  // as truth() in trace.glsl
    const sum = wi.map((v, j) => v + wo[j]), length = Math.hypot(...sum), h = sum.map(v => v / length);
    const s = Math.hypot(h[0], h[1]), e = s > 1e-6 ? [h[0] / s, h[1] / s] : [1, 0];
    const x = h[2] * (wo[0] * e[0] + wo[1] * e[1]) - s * wo[2], y = wo[1] * e[0] - wo[0] * e[1];
    const dot = wo.reduce((a, v, j) => a + v * h[j], 0);
    const angles = [Math.sqrt(2 / Math.PI * Math.atan2(s, h[2])), 2 / Math.PI * Math.atan2(Math.hypot(x, y), dot),
      Math.atan2(Math.abs(y), x) / Math.PI];
    const cells = angles.map((v, j) => clamp(v, 0, 1) * (size[j] - 1)), low = cells.map((v, j) => Math.min(Math.floor(v), size[j] - 2));
    const f = [0, 0, 0];
    for (let corner = 0; corner < 8; corner++) {
      const step = [corner & 1, corner >> 1 & 1, corner >> 2];
      const weight = step.reduce((w, up, j) => w * (up ? cells[j] - low[j] : 1 - cells[j] + low[j]), 1);
      const [i, j, l] = low.map((v, axis) => v + step[axis]), entry = 3 * (i + size[0] * (j + size[1] * l));
      for (let c = 0; c < 3; c++) f[c] += weight * values[entry + c];
    }
    return f.map(v => Math.max(Math.exp(v) - 1e-5, 0));
  };
  return [{ label: TRUTH.label, evaluate, drawn: MODELS[MODELS.length - 1] }];
}
