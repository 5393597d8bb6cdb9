// Draws a fitted material with WebGL2: on a mesh, with a shadow map, or on the object as the camera saw it. It shades what `rigd render` and
// `rigd relight` shade (docs/viewer.md says where it differs).
import { load } from "/api.js";
import { bounds, camera, cross, dot, lampView, length, minus } from "/viewer-space.js";

const MODELS = ["lambert", "blinn-phong", "torrance-sparrow", "cook-torrance", "ward", "ward-duer", "lafortune", "ggx"];
const MODEL_NAMES = MODELS.map((name) => name.toUpperCase().replaceAll("-", "_"));
/// Most materials a texel has room for.
const CHANNELS = 4;
/// Entries of the table of levels an octave of exposure.
const STEPS = 1024;
/// Columns and rows of the shadow map: while the light is dragged, and once it stands.
export const SHADOW = { moving: 1024, standing: 4096 };

const TEXTS = ["brdf", "depth", "mesh", "mesh-vertex", "object", "screen-vertex", "shade", "show"];
let texts = null;
const shaders = () => (texts ??= Promise.all(TEXTS.map(async (name) => [name, await (await load(`/viewer-${name}.glsl`)).text()])).then(Object.fromEntries));

function compiled(gl, kind, text) {
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, `#version 300 es\n${text}`);
  gl.compileShader(shader);
  return shader;
}

function program(gl, vertex, fragment) {
  const made = gl.createProgram();
  const parts = [compiled(gl, gl.VERTEX_SHADER, vertex), compiled(gl, gl.FRAGMENT_SHADER, fragment)];
  parts.forEach((part) => gl.attachShader(made, part));
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) {
    throw new Error(`the graphics driver refuses a shader: ${parts.map((part) => gl.getShaderInfoLog(part)).join(" ")} ${gl.getProgramInfoLog(made)}`);
  }
  const places = {};
  for (let i = 0; i < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); i++) {
    const { name } = gl.getActiveUniform(made, i);
    places[name.replace("told.", "")] = gl.getUniformLocation(made, name);
  }
  return { made, places };
}

/// A table of levels (0 to 255) over exposure, as `Response::level` has them: straight between levels over ln exposure, 0 below the curve, 255
/// above it. A row is an octave; its steps are those of the first ten bits of a float's mantissa.
export function levels({ log_exposure: curves }) {
  const octave = (ln) => Math.floor(ln / Math.LN2);
  const low = octave(Math.min(...curves.map((curve) => curve[0])));
  const high = octave(Math.max(...curves.map((curve) => curve[255]))) + 1;
  const rows = high - low + 1;
  const table = new Uint8ClampedArray(4 * STEPS * rows);
  curves.forEach((curve, channel) => {
    let above = 0;
    for (let i = 0; i < STEPS * rows; i++) {
      // The first entry stands for all that lies below, others for the middle of their step.
      const x = i ? (low + Math.floor(i / STEPS)) * Math.LN2 + Math.log1p(((i % STEPS) + 0.5) / STEPS) : -Infinity;
      while (above < 256 && curve[above] <= x) above++;
      const part = above > 0 && above < 256 ? (x - curve[above - 1]) / (curve[above] - curve[above - 1]) : 0;
      table[4 * i + channel] = above === 0 ? 0 : above === 256 ? 255 : above - 1 + part;
    }
  });
  return { table, rows, first: (low + 127) * STEPS, last: STEPS * rows - 1 };
}

/// The materials' parameters as constants of a shader.
function parameters(materials) {
  const constant = (kind, name, value) => `const highp ${kind} ${name}[MATERIALS] = ${kind}[](${materials.map(value)});`;
  const number = (x) => x.toExponential(9);
  return [constant("vec3", "RHO_D", (m) => `vec3(${m.rho_d.map(number)})`), constant("vec3", "RHO_S", (m) => `vec3(${m.rho_s.map(number)})`),
    constant("float", "BETA2", (m) => number(m.beta ** 2))];
}

/// Planes side by side as texels of four numbers.
function interleaved(planes) {
  const [{ length: count }] = planes;
  const texels = new Float32Array(4 * count);
  planes.forEach((plane, channel) => plane.forEach((value, i) => { texels[4 * i + channel] = value; }));
  return texels;
}

/// The corners of a mesh's triangles, counterclockwise as seen from where their normals point.
function outward({ positions, normals, corners }) {
  const vector = (list, corner) => [list[3 * corner], list[3 * corner + 1], list[3 * corner + 2]];
  const turned = corners.slice();
  for (let i = 0; i < corners.length; i += 3) {
    const [a, b, c] = [0, 1, 2].map((k) => vector(positions, corners[i + k]));
    if (dot(cross(minus(b, a), minus(c, a)), vector(normals, corners[i])) < 0) turned.set([corners[i + 1], corners[i]], i);
  }
  return turned;
}

export class Renderer {
  /// Throws in words where there is no WebGL2.
  constructor(canvas) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { antialias: false, depth: false });
    if (!this.gl) throw new Error("this browser shows no WebGL2, which the viewer needs");
    this.shadow = null;
    this.seen = null;
    this.mesh = null;
    this.textures = {};
  }

  /// The material, as `GET .../texture` tells it; its shaders are made here.
  async setMaterial(material) {
    const { gl } = this;
    const { brdf, depth, show, ...own } = await shaders();
    if (!MODELS.includes(material.model)) throw new Error(`this page does not know the model ${material.model}: load it again`);
    const defined = [...MODEL_NAMES.map((name, i) => `#define ${name} ${i}`),
      `#define MODEL ${MODELS.indexOf(material.model)}`, `#define MATERIALS ${material.materials.length}`, ...parameters(material.materials)].join("\n");
    const made = {};
    /// The program of a surface ("shade" for a mesh, "object") for what is shown there, made when it is first asked for.
    this.program = (surface, textured, map, raw) => (made[[surface, textured, map, raw]] ??= program(gl, own["screen-vertex"], [defined,
      `#define TEXTURED ${Number(textured)}\n#define RADIANCE 0\n#define MAP 1\n#define SHOWING ${Number(map)}\n#define RAW ${Number(raw)}`, brdf, show, own[surface]].join("\n")));
    this.depthProgram = program(gl, depth, "precision highp float;\nvoid main() {}");
    this.meshProgram = program(gl, own["mesh-vertex"], own.mesh);
    this.material = material;
    this.setTile(material);
  }

  /// Another square of the same material.
  setTile({ side, weights, materials }) {
    const texels = new Float32Array(CHANNELS * side * side);
    for (let i = 0; i < side * side; i++) materials.forEach((_, m) => { texels[CHANNELS * i + m] = weights[materials.length * i + m]; });
    // Half precision is what every device filters; it is 0.05 % of a weight, and a processor takes long to unpack it.
    const { gl } = this;
    this.texture("tile", side, side, texels, gl.getExtension("OES_texture_float_linear") ? gl.RGBA32F : gl.RGBA16F, gl.LINEAR);
  }

  setResponse(curves) {
    const { table, rows, ...places } = levels(curves);
    this.curve = places;
    this.texture("response", STEPS, rows, table, this.gl.RGBA8);
  }

  /// A mesh as viewer-files.js reads it; of one that is `closed`, its normals outward, from outside its backs are not drawn.
  setMesh(mesh) {
    const { gl } = this;
    this.mesh?.buffers.forEach((buffer) => gl.deleteBuffer(buffer));
    const buffers = [];
    const filled = (kind, data) => {
      const buffer = gl.createBuffer();
      buffers.push(buffer);
      gl.bindBuffer(kind, buffer);
      gl.bufferData(kind, data, gl.STATIC_DRAW);
    };
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    [mesh.positions, mesh.normals, mesh.uv].forEach((data, i) => {
      if (!data) return;
      filled(gl.ARRAY_BUFFER, data);
      gl.enableVertexAttribArray(i);
      gl.vertexAttribPointer(i, i === 2 ? 2 : 3, gl.FLOAT, false, 0, 0);
    });
    filled(gl.ELEMENT_ARRAY_BUFFER, mesh.closed ? outward(mesh) : mesh.corners);
    gl.bindVertexArray(null);
    this.mesh = { array, buffers, count: mesh.corners.length, extent: mesh.extent / mesh.radius, textured: Boolean(mesh.uv), closed: mesh.closed };
    this.shadowOf = this.seenOf = null;
  }

  /// The object as the camera saw it, from `GET .../surface`.
  setObject({ columns, rows, planes }) {
    const vectors = (name, axes) => axes.map((axis) => planes[`${name}.${axis}`]);
    const each = (name) => this.material.materials.map((_, m) => planes[`${name}_${m + 1}`]);
    const maps = {
      positions: vectors("position", ["X", "Y", "Z"]), normals: vectors("normal", ["X", "Y", "Z"]), views: vectors("view", ["X", "Y", "Z"]),
      weight_maps: each("material"), sigma_maps: each("sigma"), residuals: vectors("residual", ["R", "G", "B"]),
    };
    for (const [name, list] of Object.entries(maps)) this.texture(name, columns, rows, interleaved(list));
    this.object = [columns, rows];
  }

  /// What was measured under one light, from `GET .../surface/{light}`.
  setPhotograph({ columns, rows, planes }) {
    this.texture("measured", columns, rows, interleaved(["R", "G", "B", "valid"].map((name) => planes[name])));
  }

  texture(name, width, height, texels, format = this.gl.RGBA32F, filter = this.gl.NEAREST) {
    const { gl } = this;
    const texture = (this.textures[name] ??= gl.createTexture());
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, format, width, height, 0, gl.RGBA, format === gl.RGBA8 ? gl.UNSIGNED_BYTE : gl.FLOAT, texels);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, filter);
  }

  /// Draws a scene at the size of the canvas. `scene`: `light` (a position with 1, or a direction with 0), `strength`, `seconds`, `alone` (a material or
  /// -1), `showing` ("radiance", "weight", "sigma", "residual"), `weight` (of which material), `most`; of a mesh `eye`, `middle`, `field`, `repeats`,
  /// `shadow` (size of its map); of the object (`object` is true) `comparing` and `line`.
  draw(scene) {
    const { width, height } = this.canvas;
    this.prepare(scene, width, height);
    this.gl.bindFramebuffer(this.gl.FRAMEBUFFER, null);
    this.paint(scene, width, height, false);
  }

  /// Waits until all that was drawn is there; a renderer without a graphics card is then known to be slow.
  async finished() {
    const { gl } = this;
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    while (!gl.isContextLost() && gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED) await new Promise((later) => setTimeout(later, 2));
    gl.deleteSync(fence);
  }

  /// Radiance of every pixel, R G B and 1 where something is seen, from the top left; what the tests compare.
  radiance(scene, width, height) {
    const { gl } = this;
    if (!gl.getExtension("EXT_color_buffer_float")) throw new Error("no float targets here");
    this.prepare(scene, width, height);
    const target = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, target);
    const colour = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, colour);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA32F, width, height);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, colour);
    this.paint(scene, width, height, true);
    const upward = new Float32Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, upward);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(target);
    gl.deleteRenderbuffer(colour);
    const pixels = new Float32Array(upward.length);
    for (let row = 0; row < height; row++) pixels.set(upward.subarray(4 * width * row, 4 * width * (row + 1)), 4 * width * (height - 1 - row));
    return pixels;
  }

  /// The shadow map, where it is not there already, and what of the mesh is seen where.
  prepare(scene, width, height) {
    if (scene.object) return;
    const size = Math.min(scene.shadow, this.gl.getParameter(this.gl.MAX_TEXTURE_SIZE));
    const key = `${scene.light} ${size}`;
    if (this.shadowOf !== key) this.castShadow(scene.light, size);
    this.shadowOf = key;
    const view = [...scene.eye, ...scene.middle, scene.field, scene.repeats, width, height].join();
    if (this.seenOf !== view) this.see(scene, width, height);
    this.seenOf = view;
  }

  see(scene, width, height) {
    const { gl } = this;
    if (this.seen?.width !== width || this.seen?.height !== height) this.seen = this.seenTargets(width, height);
    const { made, places } = this.meshProgram;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.seen.target);
    gl.viewport(0, 0, width, height);
    gl.enable(gl.DEPTH_TEST);
    this.cutTo(bounds(scene.eye, scene.middle, scene.field, width / height), width, height);
    for (const i of [0, 1]) gl.clearBufferuiv(gl.COLOR, i, [0, 0, 0, 0]);
    gl.clearBufferfv(gl.DEPTH, 0, [1]);
    gl.useProgram(made);
    gl.uniformMatrix4fv(places.camera, false, camera(scene.eye, scene.middle, scene.field, width / height));
    gl.uniform1f(places.repeats, scene.repeats);
    this.drawMesh(length(scene.eye) > 1);
    gl.disable(gl.SCISSOR_TEST);
  }

  drawMesh(fromOutside) {
    const { gl, mesh } = this;
    if (fromOutside && mesh.closed) gl.enable(gl.CULL_FACE);
    gl.bindVertexArray(mesh.array);
    gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_INT, 0);
    gl.disable(gl.CULL_FACE);
  }

  seenTargets(width, height) {
    const { gl } = this;
    if (this.seen) {
      this.seen.textures.forEach((texture) => gl.deleteTexture(texture));
      gl.deleteRenderbuffer(this.seen.depth);
      gl.deleteFramebuffer(this.seen.target);
    }
    const [target, depth] = [gl.createFramebuffer(), gl.createRenderbuffer()];
    gl.bindFramebuffer(gl.FRAMEBUFFER, target);
    // Bits of whole numbers: every WebGL2 can write them, floats only some.
    const textures = [0, 1].map((i) => {
      const texture = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32UI, width, height);
      for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.NEAREST);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + i, gl.TEXTURE_2D, texture, 0);
      return texture;
    });
    gl.bindRenderbuffer(gl.RENDERBUFFER, depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, width, height);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);
    gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
    return { width, height, target, depth, textures };
  }

  castShadow(light, size) {
    const { gl } = this;
    const { matrix, across } = lampView(light);
    if (this.shadow?.size !== size) this.shadow = this.shadowMap(size);
    Object.assign(this.shadow, { matrix, texel: across / size });
    const { made, places } = this.depthProgram;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadow.target);
    gl.viewport(0, 0, size, size);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.useProgram(made);
    gl.uniformMatrix4fv(places.camera, false, matrix);
    this.drawMesh(true);
  }

  shadowMap(size) {
    const { gl } = this;
    if (this.shadow) {
      gl.deleteTexture(this.shadow.texture);
      gl.deleteFramebuffer(this.shadow.target);
    }
    const [texture, target] = [gl.createTexture(), gl.createFramebuffer()];
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT32F, size, size);
    for (const [key, value] of [[gl.TEXTURE_MIN_FILTER, gl.NEAREST], [gl.TEXTURE_MAG_FILTER, gl.NEAREST], [gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE],
      [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) gl.texParameteri(gl.TEXTURE_2D, key, value);
    gl.bindFramebuffer(gl.FRAMEBUFFER, target);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, texture, 0);
    gl.drawBuffers([gl.NONE]);
    gl.readBuffer(gl.NONE);
    return { size, texture, target };
  }

  /// Shades every pixel once, into the target that is bound.
  paint(scene, width, height, raw) {
    const { gl } = this;
    const { made, places } = this.program(scene.object ? "object" : "shade", !scene.object && this.mesh.textured, scene.showing !== "radiance", raw);
    gl.viewport(0, 0, width, height);
    gl.disable(gl.DEPTH_TEST);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.useProgram(made);
    let unit = 0;
    const bind = (name, texture) => {
      if (!places[name] || !texture) return;
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.uniform1i(places[name], unit++);
    };
    for (const [name, texture] of Object.entries(this.textures)) bind(name, texture);
    if (!scene.object) {
      bind("shadow", this.shadow.texture);
      this.seen.textures.forEach((texture, i) => bind(["where", "facing"][i], texture));
    }
    gl.uniform1i(places.alone, scene.alone);
    gl.uniform4fv(places.light, scene.light);
    gl.uniform3fv(places.strength, scene.strength);
    gl.uniform1i(places.first, this.curve.first);
    gl.uniform1i(places.last, this.curve.last);
    gl.uniform1f(places.seconds, scene.seconds);
    gl.uniform1f(places.most, scene.most);
    gl.uniform1i(places.weight, scene.weight);
    if (scene.object) this.tellObject(scene, places, width, height);
    else this.tellMesh(scene, places);
    if (!scene.object) this.cutTo(bounds(scene.eye, scene.middle, scene.field, width / height), width, height);
    gl.bindVertexArray(null);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.SCISSOR_TEST);
    gl.activeTexture(gl.TEXTURE0);
  }

  /// Leaves out what of the picture the mesh cannot be in.
  cutTo([left, right, bottom, top], width, height) {
    const { gl } = this;
    const pixel = (x, size) => Math.round((0.5 + 0.5 * x) * size);
    const [x, y] = [Math.max(0, pixel(left, width) - 1), Math.max(0, pixel(bottom, height) - 1)];
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(x, y, pixel(right, width) + 1 - x, pixel(top, height) + 1 - y);
  }

  tellMesh(scene, places) {
    const { gl, mesh, shadow } = this;
    gl.uniform3fv(places.eye, scene.eye);
    gl.uniform1f(places.scale, scene.repeats / mesh.extent);
    gl.uniformMatrix4fv(places.lamp, false, shadow.matrix);
    gl.uniform1f(places.texel, shadow.texel);
  }

  tellObject(scene, places, width, height) {
    const { gl } = this;
    gl.uniform2f(places.screen, width, height);
    gl.uniform2fv(places.size, this.object);
    gl.uniform1i(places.map, ["weight", "sigma", "residual"].indexOf(scene.showing));
    gl.uniform1i(places.comparing, scene.comparing);
    gl.uniform1f(places.line, scene.line);
  }
}
