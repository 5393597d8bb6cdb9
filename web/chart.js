// Charts by hand: a line over iterations, a map of errors, a value with its error bar, the colours of a map with their numbers.
import { h, percent, svg } from "/show.js";

const [WIDTH, HEIGHT] = [520, 260];
const [LEFT, RIGHT, TOP, BOTTOM] = [68, 12, 12, 40];
const WORST = 0.1;      // relative error that is shown in full colour

const STEPS = [1, 2, 5, 10];

/// The least of 1, 2 and 5 times a power of ten that is no smaller.
function rounded(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return +(power * STEPS.find((step) => step * power >= value * (1 - 1e-9))).toPrecision(1);
}

/// Numbers between two positive ones, for a logarithmic axis: steps of 1, 2 and 5, or even ones where the axis is too short for three of those.
function ticks(from, to) {
  const steps = decades(from, to);
  if (steps.length > 2) return steps;
  const step = rounded((to - from) / 5);
  return Array.from({ length: Math.floor(to / step) - Math.ceil(from / step) + 1 }, (_, i) => (Math.ceil(from / step) + i) * step);
}

function decades(from, to) {
  const all = [];
  for (let power = Math.floor(Math.log10(from)); power <= Math.log10(to); power++) {
    for (const step of [1, 2, 5]) if (step * 10 ** power >= from && step * 10 ** power <= to) all.push(step * 10 ** power);
  }
  return all.length > 7 ? all.filter((tick) => Number.isInteger(Math.log10(tick))) : all;
}

/// Runs of points that can be joined by a line: those over the same number of points of the object.
function runs(iterations) {
  const found = [];
  for (const at of iterations) {
    if (found.at(-1)?.at(-1).points === at.points) found.at(-1).push(at);
    else found.push([at]);
  }
  return found;
}

/// Error against iteration, logarithmic; `what` the error is stands beside its axis, `words` say the same to who does not see.
export function errors(iterations, what, words) {
  const known = iterations.filter((at) => at.error > 0);
  if (!known.length) return "";
  const last = Math.max(1, known.at(-1).iteration);
  const [least, most] = [Math.min(...known.map((at) => at.error)) / 1.1, Math.max(...known.map((at) => at.error)) * 1.1];
  const x = (at) => LEFT + ((WIDTH - LEFT - RIGHT) * at) / last;
  const y = (error) => TOP + ((HEIGHT - TOP - BOTTOM) * Math.log(most / error)) / Math.log(most / least);
  const grid = ticks(least, most).flatMap((tick) => [
    svg("line", { x1: LEFT, x2: WIDTH - RIGHT, y1: y(tick), y2: y(tick), class: "tick" }),
    svg("text", { x: LEFT - 6, y: y(tick) + 4, "text-anchor": "end" }, String(+tick.toPrecision(3)))]);
  const lines = runs(known).map((part) => svg("polyline", { points: part.map((at) => `${x(at.iteration).toFixed(1)},${y(at.error).toFixed(1)}`).join(" "), class: "line" }));
  const now = known.at(-1);
  const label = svg("text", { x: WIDTH / 2, y: HEIGHT - 6, "text-anchor": "middle" }, "iteration");
  const name = svg("text", { x: 12, y: (HEIGHT + TOP - BOTTOM) / 2, "text-anchor": "middle", transform: `rotate(-90 12 ${(HEIGHT + TOP - BOTTOM) / 2})` }, what);
  return svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": words, class: "chart" },
    grid, svg("text", { x: LEFT, y: HEIGHT - 22, "text-anchor": "middle" }, "0"), svg("text", { x: WIDTH - RIGHT, y: HEIGHT - 22, "text-anchor": "end" }, String(last)), label, name,
    lines, svg("circle", { cx: x(now.iteration), cy: y(now.error), r: 4, class: "now" }));
}

/// Where the error is: a cell a square, the stronger the worse.
export function residuals({ columns, cells }) {
  const rows = cells.length / columns;
  const known = cells.filter((cell) => cell != null);
  const mean = known.reduce((sum, cell) => sum + cell, 0) / (known.length || 1);
  const squares = cells.flatMap((cell, i) => (cell == null ? [] : [svg("rect", { x: i % columns, y: Math.floor(i / columns), width: 1.02, height: 1.02, "fill-opacity": (0.08 + 0.92 * Math.min(1, cell / WORST)).toFixed(2) })]));
  return svg("svg", { viewBox: `0 0 ${columns} ${rows}`, role: "img", "aria-label": `Residual map: mean relative error ${percent(mean)}, worst cell ${percent(Math.max(0, ...known))}`, class: "map" }, squares);
}

/// The end of a scale that holds all of these.
export const end = (values) => rounded(Math.max(1e-6, ...values));

/// How uncertain a value is: `relative` to each side of it, on a scale that ends at `most` to each side.
export function bar(relative, most) {
  const half = 50 * Math.min(1, relative / most);
  return svg("svg", { viewBox: "-2 0 104 10", "aria-hidden": "true", class: "bar-chart", preserveAspectRatio: "none" },
    svg("line", { x1: 0, x2: 100, y1: 5, y2: 5, class: "scale" }), svg("line", { x1: 50 - half, x2: 50 + half, y1: 5, y2: 5, class: "sigma" }), svg("line", { x1: 50, x2: 50, y1: 1, y2: 9, class: "value" }));
}

/// Colours of a map (`kind` as in the style: "" the viewer's ramp, "greys", "reds"), the numbers along them, and what they are.
export const scaleBar = (numbers, words, kind = "") => h("span", {},
  h("span", { className: "scale-bar" }, h("span", { className: `colours ${kind}` }), h("span", { className: "numbers" }, numbers.map((number) => h("span", {}, number)))), words);
