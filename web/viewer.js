// The fitted material under any light: on a mesh, or on the object as it was photographed, beside its photographs.
import { ask, attempt, bytes, say } from "/api.js";
import { scaleBar } from "/chart.js";
import { copied, quoted, resultOf } from "/command.js";
import { field, fill, h, percent, select, slider } from "/show.js";
import { readMaps, readMesh } from "/viewer-files.js";
import { Renderer, SHADOW } from "/viewer-gl.js";
import { hands } from "/viewer-hands.js";
import { FIELD, FROM, axes, scale, turned, unit, wholeDistance } from "/viewer-space.js";

const OBJECT = "object";
const OWN = "own";
const MOVED = "moved";
const SURFACES = { knot: "Knot", sphere: "Sphere", cylinder: "Cylinder", [OBJECT]: "Object as photographed", [OWN]: "Mesh of my own" };
const KINDS = { obj: "model/obj", glb: "model/gltf-binary", gltf: "model/gltf+json" };
/// The light of `rigd render` unless told otherwise, and the nearest a lamp comes to a mesh, in its radius.
const LIGHT = unit([-0.3, 0.4, 1]);
const IRRADIANCE = 6;
const NEAREST = 1.2;
/// No steeper than this above or below, radians: beyond, up and down change places.
const STEEPEST = 1.55;
const PIXELS_A_POINT = 2;
/// So near the line a drag moves it, points on the screen.
const NEAR_LINE = 20;
/// A frame while something moves: slower ones get larger pixels, quicker ones smaller ones again; and how large they may become, each way.
const [SLOW_MS, QUICK_MS, COARSEST] = [66, 30, 4];

const seconds = (value) => (value < 0.5 ? `1/${Math.round(1 / value)} s` : `${+value.toPrecision(2)} s`);
const coordinates = (v) => v.map((x) => +x.toPrecision(6)).join(",");

class Viewer {
  constructor(id, box) {
    this.id = id;
    this.path = `/v1/sessions/${id}`;
    this.state = {
      surface: "knot", show: "mixture", seconds: 2, held: "light", lamp: false, light: LIGHT, away: 3, irradiance: IRRADIANCE, eye: FROM, zoom: 1,
      patch: 64, repeats: 2, station: null, comparing: 1, line: 0.5,
    };
    this.canvas = h("canvas", { tabIndex: 0, role: "application", "aria-label": "The material under the light", "aria-describedby": "viewer-keys" });
    this.renderer = new Renderer(this.canvas);
    this.moving = false;
    this.coarse = 1;
    this.box = box;
  }

  async open() {
    const [material, curves, result] = await Promise.all([ask(`${this.path}/texture?patch=${this.state.patch}`).catch((error) => this.smaller(error)), ask(`${this.path}/response`), resultOf(this.id)]);
    this.material = material;
    this.result = result;
    this.curves = curves;
    await this.renderer.setMaterial(material);
    this.renderer.setResponse(curves);
    await this.take(this.state.surface);
    this.build();
    hands(this.canvas, { turn: this.turn.bind(this), zoom: this.zoomed.bind(this), rest: this.rest.bind(this), held: () => this.state.held, near: this.nearLine.bind(this), draw: (line) => this.drawLine(line) });
    this.watching = new ResizeObserver(() => this.draw());
    this.watching.observe(this.canvas);
    this.update();
  }

  /// Small objects have no square of 64 pixels: the daemon's refusal says so, and half as large a one may do.
  async smaller(error) {
    if (error.problem?.status !== 422 || this.state.patch <= 8) throw error;
    this.state.patch /= 2;
    return ask(`${this.path}/texture?patch=${this.state.patch}`).catch((again) => this.smaller(again));
  }

  /// Loads what the surface needs that is not there.
  async take(surface) {
    if (surface === OBJECT) {
      if (!this.lights) {
        const [{ lights }, maps] = await Promise.all([ask(`${this.path}/lights`), bytes(`${this.path}/surface`)]);
        Object.assign(this, { lights, maps: readMaps(maps) });
        this.renderer.setObject(this.maps);
        this.middle = this.middleOf(this.maps.planes);
      }
      await this.photograph(this.state.station ?? 0);
    } else {
      this.mesh = surface === OWN ? this.own.mesh : readMesh(await bytes(`/v1/meshes/${surface}`));
      this.renderer.setMesh({ ...this.mesh, closed: surface !== OWN });
    }
    this.state.surface = surface;
    // The name beside the file's button is that of the mesh that is shown, or none.
    if (this.file && surface !== OWN) this.file.value = "";
  }

  /// Mean of the points of the object that are seen, mm: a lamp turns about it.
  middleOf(planes) {
    const seen = [...planes["normal.Z"].keys()].filter((i) => planes["normal.Z"][i] !== 0);
    return ["X", "Y", "Z"].map((axis) => seen.reduce((sum, i) => sum + planes[`position.${axis}`][i], 0) / seen.length);
  }

  async photograph(station) {
    this.renderer.setPhotograph(readMaps(await bytes(`${this.path}/surface/${station}`)));
    this.state.station = station;
    const { position_mm, intensity, direction, irradiance } = this.lights[station];
    this.real = position_mm ? { light: [...position_mm, 1], strength: intensity } : { light: [...direction, 0], strength: irradiance };
    this.placed = this.real;
  }

  async ownMesh(file) {
    const kind = KINDS[file.name.split(".").pop().toLowerCase()];
    const refused = (reason) => {
      this.fileError.textContent = `${file.name}: ${reason}`;
      this.file.value = "";
    };
    if (!kind) return refused("a mesh has a name that ends in .obj, .gltf or .glb.");
    const sent = await attempt(() => bytes("/v1/meshes", { method: "POST", headers: { "Content-Type": kind }, body: file }), refused);
    if (!sent) return;
    this.own = { name: file.name, mesh: readMesh(sent) };
    await this.show(OWN);
  }

  /// Shows a surface from where it is seen best.
  async show(surface) {
    await this.take(surface);
    Object.assign(this.state, { eye: FROM, zoom: 1 });
    if (!this.onObject && !this.onMesh(this.state.show)) this.state.show = "mixture";
  }

  /// What the last action was told of does not hold for the next one.
  forget() {
    say();
    this.fileError.textContent = "";
  }

  get onObject() { return this.state.surface === OBJECT; }
  onMesh(show) { return !/^(sigma|residual)/.test(show); }

  /// What there is to see; on a mesh there is no residual, nor a standard error: they belong to points that were measured.
  shows() {
    const each = (key, words) => this.material.materials.map((_, m) => [`${key}-${m}`, words(m + 1)]);
    return Object.fromEntries([
      ["mixture", "All materials, as fitted"], ...each("weight", (m) => `Weight map of material ${m}`), ...each("alone", (m) => `Material ${m} alone`),
      ["residual", "Residual of the fit"], ...each("sigma", (m) => `Standard error of weight ${m}`),
    ]);
  }

  build() {
    const { state } = this;
    const set = (values) => {
      this.forget();
      Object.assign(state, values);
      this.update();
    };
    const later = (work) => attempt(async () => {
      this.forget();
      try {
        await work();
      } finally {
        // Also after a refusal, controls say what is shown.
        this.offer();
        this.update();
      }
    });
    this.surfaces = select("viewer-surface", SURFACES, (surface) => later(() => (surface === OWN && !this.own ? this.file.click() : this.show(surface))));
    this.fileError = h("p", { id: "viewer-file-error", className: "fault", role: "alert" });
    this.file = h("input", { id: "viewer-file", type: "file", accept: ".obj,.gltf,.glb", "aria-describedby": "viewer-file-error",
      onchange: () => this.file.files[0] && later(() => this.ownMesh(this.file.files[0])) });
    this.shown = select("viewer-show", this.shows(), (show) => set({ show }));
    this.exposure = slider("viewer-exposure", -11, 6, 1, (value) => set({ seconds: value }));
    this.brightness = slider("viewer-irradiance", -6, 9, Math.log2(IRRADIANCE), (value) => set({ irradiance: value }));
    this.distance = slider("viewer-away", Math.log2(NEAREST), 4, Math.log2(state.away), (value) => set({ away: value }));
    const kind = select("viewer-lamp", { distant: "distant", lamp: "lamp: falls off with 1/d²" }, (value) => set({ lamp: value === "lamp" }));
    const held = select("viewer-held", { light: "the light", camera: "the camera" }, (value) => set({ held: value }));
    const patch = select("viewer-patch", Object.fromEntries([16, 32, 64, 128].map((n) => [n, `${n} pixels`])), (value) => later(async () => {
      try {
        this.renderer.setTile(await ask(`${this.path}/texture?patch=${value}`));
        state.patch = Number(value);
      } finally {
        patch.value = state.patch;
      }
    }));
    patch.value = state.patch;
    const repeats = h("input", { id: "viewer-repeats", type: "number", min: 1, max: 1000, step: 1, value: state.repeats, onchange: () => {
      if (repeats.checkValidity() && repeats.value) set({ repeats: Number(repeats.value) });
    } });
    this.stations = h("select", { id: "viewer-station", onchange: () => later(() => this.photograph(Number(this.stations.value))) });
    this.compare = select("viewer-compare", { 1: "a line to draw across", 2: "side by side", 0: "the fitted one alone" }, (value) => set({ comparing: Number(value) }));
    this.line = h("input", { id: "viewer-line", type: "range", min: 0, max: 1, step: 0.01, value: state.line, oninput: () => set({ line: Number(this.line.value) }) });
    const back = h("button", { type: "button", onclick: () => {
      this.placed = this.real;
      set({ light: LIGHT, eye: FROM, zoom: 1 });
    } }, "Light and camera back");
    this.legend = h("p", { className: "ramp", role: "status" });
    this.moved = h("p", { className: "moved", role: "status" });
    this.realLight = h("button", { type: "button", onclick: () => {
      this.placed = this.real;
      set({});
      this.canvas.focus();
    } }, "The session's light back");
    this.command = h("code", {});
    this.meshControls = h("div", {}, field("Light", kind), field("Irradiance in the middle", this.brightness.control, this.brightness.told),
      this.away = field("Lamp's distance", this.distance.control, this.distance.told), field("Texture: square of", patch), field("Repeats", repeats),
      h("details", {}, h("summary", {}, "The same by command"), h("p", { className: "small" }, "In a terminal on the daemon's machine:"), copied(this.command)));
    this.objectControls = h("div", {}, field("Light of the session", this.stations), field("Compare with what was measured", this.compare),
      this.lineField = field("Line: measured left of it, fitted right", this.line));
    this.box.replaceChildren(h("div", { className: "viewer" }, h("figure", {}, this.canvas, this.moved, this.realLight, this.legend,
      h("figcaption", { id: "viewer-keys" }, "Drag, or the arrow keys: the light; near the line between measured and fitted: the line. With Shift or the right button: the camera. + and −, two fingers, or Ctrl and the wheel: nearer and farther.")),
      h("div", { className: "controls" }, field("On", this.surfaces), field("Open a mesh (.obj, .glb, .gltf)", this.file), this.fileError, field("Show", this.shown),
        field("Exposure", this.exposure.control, this.exposure.told), this.through = h("p", { className: "small" }), field("Dragging turns", held),
        this.meshControls, this.objectControls, h("p", {}, back))));
    this.offer();
  }

  /// Which controls the surface has.
  offer() {
    this.surfaces.value = this.state.surface;
    this.surfaces.querySelector(`[value="${OWN}"]`).textContent = this.own?.name ?? SURFACES[OWN];
    for (const option of this.shown.options) option.disabled = !this.onObject && !this.onMesh(option.value);
    this.meshControls.hidden = this.onObject;
    this.objectControls.hidden = !this.onObject;
    if (this.onObject && !this.stations.options.length) {
      // With one of its own for the moved light, every light of the session can be chosen, the one before as well.
      this.stations.append(h("option", { value: MOVED, disabled: true, hidden: true }, "moved by hand"), ...this.lights.map((_, i) => h("option", { value: i }, `light ${i}`)));
    }
  }

  get isMoved() { return this.onObject && this.placed !== this.real; }

  /// Whether the line between measured and fitted is at this place across the picture.
  nearLine(x) {
    return this.comparing === 1 && Math.abs(x - this.state.line) * this.canvas.clientWidth < NEAR_LINE;
  }

  drawLine(line) {
    this.moving = true;
    this.state.line = line;
    this.update();
  }

  /// How what was measured is shown beside what was fitted; 0 where it is not.
  get comparing() {
    return this.onObject && this.state.show === "mixture" && !this.isMoved ? this.state.comparing : 0;
  }

  turn(what, across, down) {
    this.moving = true;
    if (what === "camera" && this.onObject) return;
    if (what === "camera") this.turnCamera(across, down);
    else if (this.onObject) this.turnObjectLight(across, down);
    else this.state.light = unit(this.dragged(this.state.light, axes(scale(this.state.eye, 3)), across, down));
    this.update();
  }

  /// A direction moved as the hand moves in front of it.
  dragged(v, { right, up }, across, down) {
    return turned(turned(v, up, across), right, down);
  }

  turnCamera(across, down) {
    const [x, y, z] = this.state.eye;
    const steep = Math.max(-STEEPEST, Math.min(STEEPEST, Math.asin(y) + down));
    const around = Math.atan2(x, z) - across;
    this.state.eye = [Math.cos(steep) * Math.sin(around), Math.sin(steep), Math.cos(steep) * Math.cos(around)];
  }

  /// In the camera's frame, where y is down and z away: about the object, at the distance at which it stands.
  turnObjectLight(across, down) {
    const { light: [x, y, z, w], strength } = this.placed;
    const from = w ? this.middle : [0, 0, 0];
    const moved = this.dragged([x, y, z].map((c, i) => c - from[i]), { right: [1, 0, 0], up: [0, -1, 0] }, across, down);
    this.placed = { light: [...moved.map((c, i) => c + from[i]), w], strength };
  }

  zoomed(factor) {
    if (this.onObject) return;
    this.moving = true;
    this.state.zoom = Math.max(0.2, Math.min(5, this.state.zoom * factor));
    this.update();
  }

  rest() {
    this.moving = false;
    this.update();
  }

  /// What is to be drawn at this size; renderer's units: the radius of the mesh, or mm.
  scene(width, height) {
    const { state } = this;
    const [kind, index] = state.show.split("-");
    const shown = { alone: kind === "alone" ? Number(index) : -1, showing: ["weight", "sigma", "residual"].includes(kind) ? kind : "radiance", weight: Number(index ?? 0), most: this.most(kind, index), seconds: state.seconds };
    if (this.onObject) {
      return { ...shown, ...this.placed, object: true, comparing: this.comparing, line: state.line };
    }
    const light = state.lamp ? [...scale(state.light, state.away), 1] : [...state.light, 0];
    const strength = Array(3).fill(state.irradiance * (state.lamp ? state.away ** 2 : 1));
    const eye = scale(state.eye, state.zoom * wholeDistance(width, height));
    return { ...shown, light, strength, eye, middle: [0, 0, 0], field: FIELD, repeats: state.repeats, shadow: this.moving ? SHADOW.moving : SHADOW.standing };
  }

  /// The end of a map's scale: 1 for weights; what all but a twentieth of the points stay below, for errors.
  most(kind, index) {
    if (kind !== "sigma" && kind !== "residual") return 1;
    const name = kind === "sigma" ? `sigma_${Number(index) + 1}` : "residual.G";
    const values = this.maps.planes[name].filter((value) => value > 0 && Number.isFinite(value)).sort();
    return values[Math.floor(0.95 * values.length)] || 1;
  }

  update() {
    const { state } = this;
    this.exposure.told.value = seconds(state.seconds);
    this.brightness.told.value = state.irradiance.toPrecision(2);
    this.distance.told.value = `${state.away.toPrecision(2)} radii`;
    this.away.hidden = !state.lamp;
    this.through.textContent = this.curves.calibration == null ? "Levels of sRGB: this session has no calibrated response." : `Through the response of calibration ${this.curves.calibration}.`;
    this.shown.value = state.show;
    if (this.onObject) this.stations.value = this.isMoved ? MOVED : state.station;
    this.compare.value = state.comparing;
    this.compare.disabled = this.isMoved;
    this.line.value = state.line;
    this.lineField.hidden = this.comparing !== 1;
    fill(this.moved, this.isMoved ? "The light was moved by hand: there is no photograph under it to compare with." : "");
    this.realLight.hidden = !this.isMoved;
    this.canvas.dataset.surface = state.surface;
    this.draw();
  }

  /// What colours mean, with numbers.
  describe({ showing, most }) {
    const words = {
      weight: "Weight", sigma: "Standard error of the weight (a weight is 0 to 1); the last colour: that and more; blue: not determined",
      residual: "Mean relative error over lights and channels; the last colour: that and more",
    }[showing];
    const number = (part) => (showing === "residual" ? percent(part * most) : String(+(part * most).toPrecision(2)));
    fill(this.legend, words ? scaleBar([0, 0.5, 1].map(number), words) : "");
  }

  /// What makes `rigd render` draw the same picture.
  same(scene, width, height) {
    const { middle, radius } = this.mesh;
    const place = (v) => coordinates(v.map((x, i) => middle[i] + radius * x));
    const light = scene.light[3] ? `--light-position=${place(scene.light.slice(0, 3))} --intensity=${+(scene.strength[0] * radius ** 2).toPrecision(6)}`
      : `--light-direction=${coordinates(scene.light.slice(0, 3))} --irradiance=${+scene.strength[0].toPrecision(6)}`;
    return `rigd render ${this.result} --out picture --mesh ${this.state.surface === OWN ? quoted(this.own.name) : this.state.surface} --camera=${place(scene.eye)} --look-at=${place(scene.middle)} `
      + `${light} --exposure ${+this.state.seconds.toPrecision(4)} --patch ${this.state.patch} --repeats ${this.state.repeats} --size ${width}x${height}`;
  }

  /// Draws what there is to be drawn, one frame after the other; changes in between make one more.
  async draw() {
    this.changed = true;
    if (this.drawing) return;
    this.drawing = true;
    while (this.changed && !this.closed) {
      this.changed = false;
      await new Promise(requestAnimationFrame);
      const start = performance.now();
      this.frame();
      await this.renderer.finished();
      if (this.moving) this.keepUp(performance.now() - start);
    }
    this.drawing = false;
  }

  /// Pixels are made larger while something moves and a frame takes longer than a hand waits for; what stands is drawn in full.
  keepUp(took) {
    if (took > SLOW_MS) this.coarse = Math.min(COARSEST, this.coarse * 1.4);
    else if (took < QUICK_MS) this.coarse = Math.max(1, this.coarse / 1.4);
  }

  frame() {
    const points = Math.min(devicePixelRatio, PIXELS_A_POINT);
    const [columns, rows] = [this.canvas.clientWidth, this.canvas.clientHeight].map((side) => Math.round(side * points));
    const [width, height] = [columns, rows].map((side) => Math.round(side / (this.moving ? this.coarse : 1)));
    if (!width || !height) return;
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    const scene = this.scene(width, height);
    this.renderer.draw(scene);
    this.describe(scene);
    if (!this.onObject) this.command.textContent = this.same(this.scene(columns, rows), columns, rows);
  }

  close() {
    this.closed = true;
    this.watching?.disconnect();
    this.renderer.gl.getExtension("WEBGL_lose_context")?.loseContext();
  }
}

/// The view: `#/viewer/{session}`.
export async function view(box, id) {
  let viewer;
  try {
    viewer = new Viewer(id, box);
  } catch (error) {
    box.replaceChildren(h("p", { className: "warnings" }, error.message));
    return () => {};
  }
  await attempt(() => viewer.open(), (reason) => box.replaceChildren(h("p", { className: "warnings" }, reason)));
  return () => viewer.close();
}
