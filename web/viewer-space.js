// Points and directions of the viewer: about the middle of what is shown, in lengths of its radius; matrices column by column.
export const add = (a, b) => a.map((x, i) => x + b[i]);
export const scale = (a, s) => a.map((x) => x * s);
export const minus = (a, b) => a.map((x, i) => x - b[i]);
export const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
export const cross = ([a, b, c], [d, e, f]) => [b * f - c * e, c * d - a * f, a * e - b * d];
export const length = (a) => Math.hypot(...a);
export const unit = (a) => scale(a, 1 / length(a));

/// From where a mesh is looked at unless it was turned, and the room around it, as `rigd render` has them.
export const FROM = unit([0, 0.35, 1]);
const ROOM = 1.05;
export const FIELD = 30;

/// Distance from which a picture of this shape shows all of a mesh of radius 1.
export function wholeDistance(width, height) {
  const narrower = Math.tan((0.5 * FIELD * Math.PI) / 180) * Math.min(1, width / height);
  return ROOM / Math.sin(Math.atan(narrower));
}

/// Right, up and forward of somebody at `eye` who looks at `middle`.
export function axes(eye, middle = [0, 0, 0]) {
  const forward = unit(minus(middle, eye));
  let right = cross(forward, [0, 1, 0]);
  if (length(right) < 1e-6) right = cross(forward, [0, 0, -1]);
  right = unit(right);
  return { right, up: cross(right, forward), forward };
}

const multiply = (a, b) => Float64Array.from({ length: 16 }, (_, i) => {
  const [column, row] = [i >> 2, i & 3];
  return a[row] * b[4 * column] + a[row + 4] * b[4 * column + 1] + a[row + 8] * b[4 * column + 2] + a[row + 12] * b[4 * column + 3];
});

/// What turns points into those before the eye.
function looking(eye, middle) {
  const { right, up, forward } = axes(eye, middle);
  const back = scale(forward, -1);
  const rows = [right, up, back];
  return Float64Array.from([0, 1, 2].flatMap((axis) => [...rows.map((row) => row[axis]), 0]).concat(rows.map((row) => -dot(row, eye)), 1));
}

function perspective(half, aspect, near, far) {
  const m = new Float64Array(16);
  m[0] = 1 / (half * aspect);
  m[5] = 1 / half;
  m[10] = -(far + near) / (far - near);
  m[11] = -1;
  m[14] = (-2 * far * near) / (far - near);
  return m;
}

/// Depths of all that lies in the sphere of radius 1, whose middle is this deep, and a little more than that.
function depths(middle) {
  return [Math.max(middle - 1.001, 0.002), Math.max(middle, 0) + 1.001];
}

/// The camera of `rigd render`: a pinhole with the vertical field of view `field`, degrees.
export function camera(eye, middle, field, aspect) {
  const half = Math.tan((0.5 * field * Math.PI) / 180);
  const [near, far] = depths(-dot(axes(eye, middle).forward, eye));
  return multiply(perspective(half, aspect, near, far), looking(eye, middle));
}

/// Left, right, bottom and top, -1 to 1, of what of a picture the sphere of radius 1 can be in.
export function bounds(eye, middle, field, aspect) {
  const half = Math.tan((0.5 * field * Math.PI) / 180);
  const { right, up, forward } = axes(eye, middle);
  const deep = -dot(forward, eye);
  const along = (axis, edge) => {
    const aside = -dot(axis, eye);
    const away = Math.hypot(aside, deep);
    if (away <= 1) return [-1, 1];
    const [at, spread] = [Math.atan2(aside, deep), Math.asin(1 / away)];
    // Beyond a right angle there is no tangent: to the edge.
    const end = (angle) => (Math.abs(angle) < 1.57 ? Math.max(-1, Math.min(1, Math.tan(angle) / edge)) : Math.sign(angle));
    return [end(at - spread), end(at + spread)];
  };
  return [...along(right, half * aspect), ...along(up, half)];
}

/// What a light sees of the sphere of radius 1, and the size of its picture at depth 1; a lamp stands outside the sphere.
export function lampView([x, y, z, w]) {
  const at = [x, y, z];
  if (w) {
    const distance = length(at);
    const half = Math.tan(Math.asin(Math.min(1 / distance, 0.999)));
    const [near, far] = depths(distance);
    return { matrix: multiply(perspective(half, 1, near, far), looking(at, [0, 0, 0])), across: 2 * half };
  }
  const m = new Float64Array(16);
  m[0] = m[5] = m[15] = 1;
  m[10] = -1 / 1.002;
  m[14] = -2 / 1.002;
  return { matrix: multiply(m, looking(scale(unit(at), 2), [0, 0, 0])), across: 2 };
}

/// A vector turned about a unit axis, radians.
export function turned(v, axis, angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return add(add(scale(v, c), scale(cross(axis, v), s)), scale(axis, dot(axis, v) * (1 - c)));
}
