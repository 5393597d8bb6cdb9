// Charts by hand: a line over iterations, a map of errors, a value with its error bar.
import { percent, svg } from "/show.js";

const [WIDTH, HEIGHT] = [520, 260];
const [LEFT, RIGHT, TOP, BOTTOM] = [56, 12, 12, 40];
const WORST = 0.1;      // relative error that is shown in full colour

/// Steps of 1, 2 and 5 between two positive numbers, for a logarithmic axis.
function ticks(from, to) {
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

/// Error against iteration, logarithmic; `words` say the same to who does not see.
export function errors(iterations, words) {
  const known = iterations.filter((at) => at.error > 0);
  if (!known.length) return "";
  const last = Math.max(1, known.at(-1).iteration);
  const [least, most] = [Math.min(...known.map((at) => at.error)) / 1.1, Math.max(...known.map((at) => at.error)) * 1.1];
  const x = (at) => LEFT + ((WIDTH - LEFT - RIGHT) * at) / last;
  const y = (error) => TOP + ((HEIGHT - TOP - BOTTOM) * Math.log(most / error)) / Math.log(most / least);
  const grid = ticks(least, most).flatMap((tick) => [
    svg("line", { x1: LEFT, x2: WIDTH - RIGHT, y1: y(tick), y2: y(tick), class: "tick" }),
    svg("text", { x: LEFT - 6, y: y(tick) + 4, "text-anchor": "end" }, String(+tick.toPrecision(2)))]);
  const lines = runs(known).map((part) => svg("polyline", { points: part.map((at) => `${x(at.iteration).toFixed(1)},${y(at.error).toFixed(1)}`).join(" "), class: "line" }));
  const now = known.at(-1);
  const label = svg("text", { x: WIDTH / 2, y: HEIGHT - 6, "text-anchor": "middle" }, "iteration");
  return svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": words, class: "chart" },
    grid, svg("text", { x: LEFT, y: HEIGHT - 22, "text-anchor": "middle" }, "0"), svg("text", { x: WIDTH - RIGHT, y: HEIGHT - 22, "text-anchor": "end" }, String(last)), label,
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

/// A value between 0 and `most` with two standard errors to each side.
export function bar(value, sigma, most) {
  const at = (v) => (100 * Math.min(1, Math.max(0, v / most))).toFixed(2);
  const error = sigma == null ? [] : [svg("line", { x1: at(value - 2 * sigma), x2: at(value + 2 * sigma), y1: 5, y2: 5, class: "sigma" })];
  return svg("svg", { viewBox: "-2 0 104 10", "aria-hidden": "true", class: "bar-chart", preserveAspectRatio: "none" },
    svg("line", { x1: 0, x2: 100, y1: 5, y2: 5, class: "scale" }), error, svg("circle", { cx: at(value), cy: 5, r: 1.6, class: "value" }));
}
