// The light dome from above: the arm's travel, the stations on it, the object in the middle, the camera below.
import { degrees, numbered, svg } from "/show.js";

const RADIUS = 100;
const LABELS_APART = 16;

/// At 0 degrees the lamp is between object and camera; positive angles turn towards the right.
function at(angle, radius) {
  const turn = (angle * Math.PI) / 180;
  return [radius * Math.sin(turn), radius * Math.cos(turn)];
}

function arc([from, to]) {
  const [x0, y0] = at(from, RADIUS);
  const [x1, y1] = at(to, RADIUS);
  return `M ${x0} ${y0} A ${RADIUS} ${RADIUS} 0 ${to - from > 180 ? 1 : 0} 0 ${x1} ${y1}`;
}

/// Stations that get their angle written: far enough apart, and the one being shot.
function labelled(angles, active) {
  const chosen = new Set();
  let last = -Infinity;
  for (const i of [...angles.keys()].sort((a, b) => angles[a] - angles[b])) {
    if (angles[i] - last < LABELS_APART && i !== active) continue;
    chosen.add(i);
    last = angles[i];
  }
  return chosen;
}

function label(angle, text, className) {
  const [x, y] = at(angle, RADIUS + 15);
  const side = Math.sin((angle * Math.PI) / 180);
  const anchor = side > 0.3 ? "start" : side < -0.3 ? "end" : "middle";
  return svg("text", { x: x - 6 * side, y: y + 4, "text-anchor": anchor, class: className }, text);
}

/// The box that holds the arc, its labels and the camera.
function extent([from, to]) {
  const points = [[0, 0], [0, RADIUS + 42]];
  for (let angle = from; angle <= to; angle += 5) points.push(at(angle, RADIUS));
  points.push(at(to, RADIUS));
  const [xs, ys] = [0, 1].map((axis) => points.map((point) => point[axis]));
  const [left, top] = [Math.min(-110, ...xs) - 40, Math.min(-20, ...ys) - 24];
  return [left, top, Math.max(110, ...xs) + 40 - left, Math.max(...ys) + 12 - top];
}

/// `angles` in shooting order, the arm's `travel` (lower, upper), `active` station or null, `mark(i)` one of `done`, `bad`, `todo`; `words` say the
/// same to who does not see.
export function dome(angles, travel, active, mark, words) {
  const dot = angles.length > 60 ? 2.2 : 5;
  const stations = angles.map((angle, i) => {
    const [x, y] = at(angle, RADIUS);
    const kind = i === active ? "active" : mark(i);
    const title = svg("title", {}, `station ${numbered(i)}, ${degrees(angle)}: ${i === active ? "being shot" : { done: "on disk", bad: "refused", todo: "to come" }[kind]}`);
    if (kind === "bad") return svg("path", { d: `M ${x - dot} ${y - dot} l ${2 * dot} ${2 * dot} m 0 ${-2 * dot} l ${-2 * dot} ${2 * dot}`, class: kind }, title);
    return svg("circle", { cx: x, cy: y, r: i === active ? dot + 3 : dot, class: kind }, title);
  });
  const shown = labelled(angles, active);
  const labels = [...shown].map((i) => label(angles[i], degrees(angles[i]), i === active ? "now" : ""));
  const arm = active == null ? [] : [svg("line", { x1: 0, y1: 0, x2: at(angles[active], RADIUS)[0], y2: at(angles[active], RADIUS)[1], class: "arm" })];
  return svg("svg", { viewBox: extent(travel).join(" "), role: "img", "aria-label": words, class: "light-dome" },
    svg("path", { d: arc(travel), class: "travel" }), arm,
    svg("circle", { cx: 0, cy: 0, r: 12, class: "object" }),
    svg("path", { d: `M -12 ${RADIUS + 28} h 24 v 14 h -24 z m 7 0 v -6 h 10 v 6`, class: "camera" }),
    stations, labels);
}

export const legend = "● on disk, ◉ being shot, ✕ refused, ○ to come; seen from above, the camera below.";
