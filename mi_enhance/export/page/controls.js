// Sliders, choices and texts of the page; and its start.
function slider(box, text, low, high, log, get, set) {
  const label = document.createElement("label"), range = document.createElement("input"), field = document.createElement("input");
  const [to, back] = log ? [Math.log, Math.exp] : [v => v, v => v];
  label.append(text, range, field);
  Object.assign(range, { type: "range", min: to(low), max: to(high), step: (to(high) - to(low)) / 1000, title: text });
  Object.assign(field, { type: "number", min: low, max: high, step: "any", title: text });
  label.show = () => { range.value = to(get()); field.value = +get().toPrecision(5); };
  range.oninput = () => attempt(() => { set(clamp(back(+range.value), low, high)); label.show(); });
  field.onchange = () => attempt(() => { if (isFinite(parseFloat(field.value))) set(clamp(+field.value, low, high)); label.show(); });
  label.show();
  $(box).append(label);
  return label;
}

function choice(text, options, get, set) {
  const label = document.createElement("label"), select = document.createElement("select");
  select.title = text;
  options.forEach(([value, name]) => select.add(new Option(name, value)));
  select.value = get();
  select.onchange = () => attempt(() => set(select.value));
  label.append(text, select);
  $("choices").append(label);
}

function controls(viewer) {
  const labels = [], { settings: s, models } = viewer, of = name => [() => s[name], v => viewer.set(name, v)];
  const names = models.map((m, k) => [k, m.label]), index = name => [() => s[name], v => viewer.set(name, +v)];
  choice("shape", [["ball", "shader ball"], ["sphere", "sphere"]], ...of("shape"));
  if (models.length > 1) {
    choice("compare", [["slider", "behind a slider"], ["side", "side by side"], ["errors", "side by side, with errors"]],
      () => s.mode === "slider" ? "slider" : s.errors ? "errors" : "side",
      v => { s.errors = v === "errors"; viewer.set("mode", v === "slider" ? v : "side"); });
    choice("left", names, ...index("left"));
    choice("right", names, ...index("right"));
    slider("view", "left | right", 0, 1, false, ...of("split"));
  }
  for (const p of PARAMETERS) p.low.forEach((low, k) => {
    const text = p.low.length > 1 ? `${p.name}.${"RGB"[k]}` : p.name;
    labels.push(slider("parameters", text, low, p.high[k], p.log, () => viewer.values(MODELS[0])[p.name][k], v => viewer.edit(p.name, k, v)));
  });
  const settings = [["view", "exposure", "exposure", -6, 6], ["view", "turn", "turn room", 0, 360], ["view", "strength", "room", 0, 4],
    ["view", "lamp", "lamp", 0, 200], ["view", "azimuth", "lamp around", -180, 180], ["view", "height", "lamp height", -90, 90],
    ["angle", "angle", "viewer", 0, 89]];
  for (const [box, name, text, low, high] of settings) slider(box, text, low, high, false, ...of(name));
  $("reset").onclick = () => { viewer.edits = {}; labels.forEach(label => label.show()); viewer.changed(); };
  $("copy").onclick = () => { $("command").select(); document.execCommand("copy"); };
  const picture = $("picture");
  picture.onpointerdown = e => picture.setPointerCapture(e.pointerId);
  picture.onpointermove = e => {
    if (!e.buttons) return;
    s.yaw -= 0.5 * e.movementX;
    s.pitch = clamp(s.pitch + 0.5 * e.movementY, -10, 89);
    viewer.frames = 0;
    viewer.moved = performance.now();
  };
  addEventListener("resize", () => attempt(() => viewer.resize()));
}

function describe(viewer) {  // the command that repeats the edits
  const edited = PARAMETERS.filter(p => viewer.values(MODELS[0])[p.name].some((v, k) => v !== MODELS[0].values[p.name][k]));
  const texts = edited.map(p => ` --set ${p.name}=${viewer.values(MODELS[0])[p.name].map(v => +v.toPrecision(6)).join(",")}`);
  $("command").value = edited.length ? `mi-enhance show ${NAME}.bsdf${texts.join("")} -o edited.bsdf` : "";
}

function note(viewer, ready) {
  const { settings: s, models, frames } = viewer, names = models.map(m => m.label);
  const shown = s.mode !== "slider" ? `from the left: ${names.join(", ")}${s.errors ? `; below: difference to ${names[names.length - 1]}, white where it is 0.25 of the range` : ""}`
    : s.left === s.right ? names[s.left] : `left: ${names[s.left]}, right: ${names[s.right]}`;
  $("note").textContent = `${frames} samples a pixel; ${shown}${ready ? "" : "; the networks are being compiled"}`;
}

attempt(() => { viewer.start(); controls(viewer); requestAnimationFrame(t => attempt(() => viewer.loop(t))); });
