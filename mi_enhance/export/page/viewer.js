// The picture: what is seen is drawn once a frame, then each model adds one sample to each pixel of its tile.
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
const $ = id => document.getElementById(id), RADIANS = Math.PI / 180;
const LARGEST = 512;   // pixels of a tile
const BLOCK_ROW = LARGEST / 16;
const SLOW = 100;  // milliseconds of a frame: a slower one has fewer pixels while something is moved

const viewer = {
  edits: {}, frames: 0, scale: 1, moved: -1e9, cost: 0, size: LARGEST,
  settings: { shape: "ball", mode: "slider", left: 0, right: 1, errors: false, yaw: 25, pitch: 25, split: 0.5, turn: 0, strength: 1,
    lamp: 20, azimuth: 60, height: 50, exposure: 0, angle: 45 },

  start() {
    const gl = this.gl = $("picture").getContext("webgl2", { antialias: false, preserveDrawingBuffer: true });
    if (!gl || !gl.getExtension("EXT_color_buffer_float")) throw Error("This page needs WebGL 2 with float textures.");
    this.mean = room(gl);
    this.ball = ball(gl);
    this.models = [...MODELS.map(m => ({ ...m, evaluate: m.eval.bind(m), drawn: m })), ...measurement(gl)];
    this.surfaces = { ball: program(gl, HEAD + "#define BALL\n" + SURFACE, HEAD + "#define VERTEX\n" + SURFACE) };
    this.blocks = program(gl, HEAD + BLOCKS);
    this.ground = this.traced(TRACE.replace("%MATERIAL%", ""));
    this.show = program(gl, HEAD + SHOW);
    // The last of MODELS is the analytic one: its program is the smallest, and stands in while the others are compiled.
    const simplest = MODELS.length - 1;
    this.models[simplest].program = this.compiled(simplest);
    this.models.forEach((m, k) => m.stand_in = this.models[simplest]);
    if (this.models.length < 2) this.settings.right = 0;
    this.resize();
    this.changed();
    this.scale = 0.5;  // the first picture is there sooner
    this.frame();
    this.models.forEach((m, k) => m.program ??= this.compiled(k));
    this.surfaces.sphere = program(gl, HEAD + SURFACE);
  },

  compiled(k) {
    const { source } = this.models[k].drawn;
    const names = { EVAL: k < MODELS.length ? "m_eval(m, wi, wo)" : "truth(wi, wo)", PDF: "m_pdf(m, wi, wo)", SAMPLE: "m_sample(m, wi, u)" };
    let text = TRACE.replace("%MATERIAL%", () => source + "uniform m_Material m;");
    for (const [name, call] of Object.entries(names)) text = text.replace(new RegExp(`${name}\\(w[io], [uw]o?\\)`, "g"), call);
    return this.traced("#define MATERIAL\n" + text);
  },

  traced(text) { return program(this.gl, HEAD + text, HEAD + "#define VERTEX\n" + BLOCKS); },

  resize() {  // tiles as large as the page has room for
    const gl = this.gl, { mode, errors } = this.settings, n = mode === "slider" ? 1 : this.models.length;
    const room = $("stage").parentElement.clientWidth || innerWidth;
    this.size = Math.max(64, Math.min(LARGEST, Math.floor(room / n)));
    this.tiles = n;
    const rows = errors && n > 1 ? 2 : 1, [width, height] = [n * this.size, rows * this.size];
    Object.assign($("picture"), { width, height });
    for (const made of this.owned || []) discard(gl, made);
    const float = (unit, w) => texture(gl, unit, gl.RGBA32F, [w, this.size], gl.RGBA, gl.FLOAT, null, gl.NEAREST);
    const [a, b, where, facing] = [float(3, width), float(4, width), float(7, this.size), float(8, this.size)];
    this.targets = [target(gl, a), target(gl, b)];
    this.seen = target(gl, where, facing);
    const depth = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, this.size, this.size);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);
    const found = texture(gl, 9, gl.RGBA8, [BLOCK_ROW, BLOCK_ROW], gl.RGBA, gl.UNSIGNED_BYTE, null, gl.NEAREST);
    this.found = target(gl, found);
    this.owned = [a, b, where, facing, depth, found, ...this.targets, this.seen, this.found];
    this.frames = 0;
  },

  values(model) {  // of the parameters: a model's own, but for what was edited
    const values = {};
    for (const p of PARAMETERS) values[p.name] = model.values[p.name].map((v, k) => this.edits[p.name]?.[k] ?? v);
    return values;
  },

  edit(name, component, value) { (this.edits[name] ??= [])[component] = value; this.changed(); },

  set(name, value) {
    this.settings[name] = value;
    if (["mode", "errors"].includes(name)) this.resize();
    this.changed();
  },

  changed() {  // everything that depends on parameters and settings is made anew
    for (const m of MODELS) {
      const k = m.prepare(this.values(m));
      m.k = new Float32Array([...k, ...Array((4 - k.length % 4) % 4).fill(0)]);
    }
    this.frames = 0;
    this.moved = performance.now();
    describe(this);
    plot(this);
  },

  parts(k, pixels) {  // which models are in a tile, and in which columns: two where a slider is
    const { mode, left, right, split } = this.settings, line = Math.round(split * pixels);
    if (mode !== "slider") return [[k, k * pixels, pixels]];
    return left === right ? [[left, 0, pixels]] : [[left, 0, line], [right, line, pixels - line]].filter(part => part[2] > 0);
  },

  look(pixels, camera) {  // find out what is seen in each pixel, and in which blocks there is material
    const { gl, settings: s, blocks } = this, surface = this.surfaces[s.shape];
    const radical = base => { let r = 0, f = 1; for (let n = this.frames / 4 + 1; n; n = Math.floor(n / base)) r += (f /= base) * (n % base); return r; };
    this.shift = [radical(2) - 0.5, radical(3) - 0.5];
    surface.ready(true);
    gl.useProgram(surface.made);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.seen);
    gl.viewport(0, 0, pixels, pixels);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix3fv(surface.at("camera"), false, camera);
    gl.uniform2fv(surface.at("shift"), this.shift);
    gl.uniform1f(surface.at("size"), pixels);
    gl.uniform1f(surface.at("reach"), BALL.reach);
    if (s.shape === "ball") {
      gl.enable(gl.DEPTH_TEST);
      gl.bindVertexArray(this.ball.made);
      gl.drawElements(gl.TRIANGLES, this.ball.corners, gl.UNSIGNED_SHORT, 0);
      gl.bindVertexArray(null);
      gl.disable(gl.DEPTH_TEST);
    } else gl.drawArrays(gl.TRIANGLES, 0, 3);
    blocks.ready(true);
    gl.useProgram(blocks.made);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.found);
    gl.viewport(0, 0, BLOCK_ROW, BLOCK_ROW);
    gl.uniform1i(blocks.at("wheres"), 7);
    gl.uniform1f(blocks.at("size"), pixels);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  },

  frame() {
    const { gl, settings: s, size } = this, pixels = Math.round(size * this.scale), is_ball = s.shape === "ball";
    const [cy, sy, cp, sp] = [s.yaw, s.pitch].flatMap(v => [Math.cos(v * RADIANS), Math.sin(v * RADIANS)]);
    const [ch, sh] = [Math.cos(s.height * RADIANS), Math.sin(s.height * RADIANS)];
    const camera = [cy, 0, -sy, -sp * sy, cp, -sp * cy, cp * sy, sp, cp * cy];
    if (this.frames % 4 === 0) this.look(pixels, camera);  // what is seen where changes four times less often than the light
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.targets[(this.frames + 1) % 2]);
    gl.enable(gl.SCISSOR_TEST);
    const row = Math.ceil(pixels / 16);
    const numbers = { size: pixels, turn: s.turn / 360, strength: s.strength, grey: 0.25 * s.strength * this.mean,
      reach: is_ball ? BALL.reach : 0, ground: BALL.floor, brightness: s.lamp };
    const units = { env: 0, densities: 1, drawn: 2, before: 3 + this.frames % 2, distances: 5, measured: 6, wheres: 7, facings: 8, blocks: 9 };
    const draw = ({ made, at, ready }, corner, k) => {
      ready(true);
      gl.useProgram(made);
      for (const [name, unit] of Object.entries(units)) gl.uniform1i(at(name), unit);
      if (k) gl.uniform4fv(at("m.k"), k);
      gl.uniform1ui(at("frame"), this.frames);
      gl.uniform1i(at("left"), corner);
      gl.uniform1i(at("row"), row);
      gl.uniform1i(at("is_material"), k ? 1 : 0);
      gl.uniform2fv(at("shift"), this.shift);
      for (const [name, v] of Object.entries(numbers)) gl.uniform1f(at(name), v);
      gl.uniform4f(at("lamp"), ch * Math.sin(s.azimuth * RADIANS), sh, ch * Math.cos(s.azimuth * RADIANS), Math.cos(0.15));
      gl.uniformMatrix3fv(at("camera"), false, camera);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, row * row);
    };
    for (let k = 0; k < this.tiles; k++) {
      const corner = k * pixels;
      gl.viewport(corner, 0, pixels, pixels);
      gl.scissor(corner, 0, pixels, pixels);
      draw(this.ground, corner);
      for (const [index, left, width] of this.parts(k, pixels)) {
        const model = this.models[index], { program: trace, drawn } = model.program?.ready() ? model : model.stand_in;
        gl.scissor(left, 0, width, pixels);
        draw(trace, corner, drawn.k);
      }
    }
    gl.disable(gl.SCISSOR_TEST);
    this.frames++;
    this.display(pixels);
  },

  display(pixels) {
    const { gl, show, size, settings: s } = this, height = $("picture").height;
    show.ready(true);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.useProgram(show.made);
    gl.uniform1i(show.at("total"), 3 + this.frames % 2);
    gl.uniform1f(show.at("frames"), this.frames);
    gl.uniform1f(show.at("exposure"), s.exposure);
    gl.uniform1f(show.at("scale"), pixels / size);
    gl.uniform1i(show.at("line"), s.mode === "slider" && s.left !== s.right ? Math.round(s.split * size) : -1);
    for (let row = 0; row * size < height; row++) for (let k = 0; k < this.tiles; k++) {
      const corner = [k * size, height - (row + 1) * size];
      gl.viewport(...corner, size, size);
      gl.uniform2iv(show.at("corner"), corner);
      gl.uniform1i(show.at("tile"), k * pixels);
      gl.uniform1i(show.at("other"), row ? reference(this) * pixels : -1);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
  },

  ready() { return this.models.every(m => m.program.ready()); },

  loop(now) {
    const moving = now - this.moved < 250, step = now - this.last;
    if (this.last && this.frames > 1 && this.scale === 1) this.cost = 0.7 * this.cost + 0.3 * step;
    this.last = now;
    const scale = moving && this.cost > SLOW ? (this.cost > 4 * SLOW ? 0.25 : 0.5) : 1;
    if (scale !== this.scale) this.frames = 0;
    this.scale = scale;
    const ready = this.ready();
    if (ready && !this.was_ready) this.frames = 0;
    this.was_ready = ready;
    if (this.frames < 4096) this.frame();
    note(this, ready);
    requestAnimationFrame(t => attempt(() => this.loop(t)));
  },
};

function reference(viewer) { return viewer.models.length - 1; }  // measured if there is a measurement, else the analytic model

function attempt(f) { try { f(); } catch (error) { $("error").textContent = error.message || String(error); } }
