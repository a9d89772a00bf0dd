// Figures of f: the lobe in the plane of incidence, and slices over theta_h and theta_d with their errors.
const COLOURS = ["#d22", "#2a2", "#22d"], WIDTHS = [3, 1, 5];

function plot(viewer) {
  const canvas = $("lobe"), c = canvas.getContext("2d"), theta = viewer.settings.angle * RADIANS;
  const wi = [-Math.sin(theta), 0, Math.cos(theta)], [x0, y0] = [canvas.width / 2, canvas.height - 20];
  const curves = viewer.models.map(m => [...Array(179).keys()].map(j => {
    const t = (j - 89) * RADIANS, f = m.evaluate(m.drawn.k, wi, [Math.sin(t), 0, Math.cos(t)]);
    return [t, f.map(v => Math.cbrt(v * Math.cos(t)))];
  }));
  const largest = Math.max(1e-6, ...curves.flat().flatMap(([, f]) => f)), r = y0 - 20;
  c.clearRect(0, 0, canvas.width, canvas.height);
  c.lineWidth = 1;
  c.strokeStyle = "#bbb";
  for (const part of [0.5, 1]) { c.beginPath(); c.arc(x0, y0, part * r, Math.PI, 0); c.stroke(); }
  c.beginPath(); c.moveTo(x0 - r, y0); c.lineTo(x0 + r, y0); c.stroke();
  c.strokeStyle = "#222";
  c.beginPath(); c.moveTo(x0, y0); c.lineTo(x0 + r * wi[0], y0 - r * wi[2]); c.stroke();
  curves.forEach((curve, k) => COLOURS.forEach((style, channel) => {
    const is_measured = k >= MODELS.length;
    c.strokeStyle = style;
    c.globalAlpha = is_measured ? 0.35 : 1;
    c.lineWidth = is_measured ? 7 : k ? 1 : 3;
    c.beginPath();
    for (const [t, f] of curve) c.lineTo(x0 + r * f[channel] / largest * Math.sin(t), y0 - r * f[channel] / largest * Math.cos(t));
    c.stroke();
  }));
  c.globalAlpha = 1;
  viewer.largest = largest;
  clearTimeout(viewer.waiting);
  viewer.waiting = setTimeout(() => attempt(() => slices(viewer)), 200);
}

// log(1 + f cos) at N x N pairs, theta_h to the right in steps of its root, theta_d upwards, phi_d = 90 degrees. Worked
// out in pieces of 10 ms, so that the picture goes on.
const N = 64;
function slices(viewer) {
  const canvas = $("slices"), c = canvas.getContext("2d"), models = viewer.models, run = viewer.run = {}, rows = [];
  const pairs = j => [...Array(N).keys()].map(i => {
    const h = Math.min((i / (N - 1)) ** 2 * 90, 89) * RADIANS, d = j / (N - 1) * 89 * RADIANS;
    const x = Math.cos(d) * Math.sin(h), z = Math.cos(d) * Math.cos(h);
    return [[x, -Math.sin(d), z], [x, Math.sin(d), z]];
  });
  const step = () => {
    if (viewer.run !== run) return;
    const start = performance.now();
    while (rows.length < N && performance.now() - start < 10)
      rows.push(pairs(rows.length).map(([wi, wo]) => models.map(m => m.evaluate(m.drawn.k, wi, wo).map(v => Math.log1p(Math.max(v, 0) * wo[2])))));
    if (rows.length < N) return setTimeout(step);
    const last = models.length - 1, side = 128, picture = new ImageData(N, N);
    viewer.slices = rows;
    Object.assign(canvas, { width: models.length * (side + 4), height: 2 * side + 4 });
    const largest = Math.max(1e-6, ...rows.flat(2).flat());
    const draw = (x, y, colour) => {
      for (let j = 0; j < N; j++) for (let i = 0; i < N; i++)
        picture.data.set([...colour(rows[N - 1 - j][i]).map(v => 255 * clamp(v, 0, 1)), 255], 4 * (j * N + i));
      createImageBitmap(picture).then(map => c.drawImage(map, x * (side + 4), y * (side + 4), side, side));
    };
    models.forEach((m, k) => draw(k, 0, row => row[k].map(v => Math.cbrt(v / largest))));
    const errors = models.map((m, k) => rows.flat().reduce((sum, row) => sum + row[k].reduce((a, v, j) => a + Math.abs(v - row[last][j]), 0) / 3, 0) / N / N);
    models.forEach((m, k) => k < last && draw(k, 1, row => {  // red: more than the reference, blue: less
      const e = row[k].reduce((a, v, j) => a + v - row[last][j], 0) / 3 / 0.1;
      return e > 0 ? [1, 1 - e, 1 - e] : [1 + e, 1 + e, 1];
    }));
    $("slices-note").textContent = models.map((m, k) => k < last ? `${m.label}: ${errors[k].toPrecision(3)}` : "").filter(Boolean).join("; ");
  };
  step();
}
