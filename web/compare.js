// Two fitted materials side by side: figures, parameters with what their standard errors say of the difference, pictures.
import { ask, attempt, blob, link } from "/api.js";
import { scaleBar } from "/chart.js";
import { FILES, rows, shown } from "/material.js";
import { chooser } from "/history.js";
import { rig } from "/rig.js";
import { badge, count, errorOf, h, percent, when } from "/show.js";

const DIFFERS = 3;      // standard deviations
const GAP = 4;          // pixels between the pictures of preview.png

const permutations = (list) => (list.length < 2 ? [list] : list.flatMap((one, i) => permutations(list.filter((_, j) => j !== i)).map((rest) => [one, ...rest])));

/// How unlike two materials are: logarithms of their diffuse albedos and roughness.
function unlike(a, b) {
  const apart = (p, q) => Math.abs(Math.log((p.value + 1e-3) / (q.value + 1e-3)));
  const beta = a.beta && b.beta ? apart(a.beta, b.beta) : 0;
  return a.rho_d.reduce((sum, p, i) => sum + apart(p, b.rho_d[i]), beta);
}

/// For each material of the one with fewer, which of the other is most like it: materials are ordered by share, which may differ.
function pairs(a, b) {
  const [few, many] = a.length <= b.length ? [a, b] : [b, a];
  const cost = (order) => few.reduce((sum, one, i) => sum + unlike(one, many[order[i]]), 0);
  const best = permutations([...many.keys()]).reduce((one, other) => (cost(other) < cost(one) ? other : one));
  return few.map((_, i) => (few === a ? [i, best[i]] : [best[i], i]));
}

/// What two values with their standard errors say of each other.
function difference(p, q) {
  if (p.identified === "unidentified" || q.identified === "unidentified") return ["", "not determined in both"];
  if (p.identified === "weak" || q.identified === "weak") return ["", "weak in one: no verdict"];
  const sigma = Math.hypot(p.standard_error ?? 0, q.standard_error ?? 0);
  if (!sigma) return ["", "no standard error: fixed by the gauge"];
  const z = (q.value - p.value) / sigma;
  return [`${z >= 0 ? "+" : ""}${z.toFixed(1)} σ`, Math.abs(z) > DIFFERS ? "differs" : "within the errors"];
}

function table(caption, titles, lines) {
  return h("div", { className: "scroll", role: "region", tabIndex: 0, "aria-label": caption }, h("table", { className: "compared" }, h("caption", {}, caption),
    h("thead", {}, h("tr", {}, titles.map((title) => h("th", { scope: "col" }, title)))),
    h("tbody", {}, lines.map(([name, ...cells]) => h("tr", { className: cells.at(-1) === "differs" ? "differs" : "" }, h("th", { scope: "row" }, name), cells.map((cell) => h("td", {}, cell)))))));
}

const orNone = (x) => (x == null ? "none" : percent(x));
const FIGURES = [
  ["State", ({ session }) => badge(session.state)],
  ["Started", ({ session }) => when(session.started)],
  ["Frames", ({ session }) => `${session.frames_committed} of ${session.frames_planned}`],
  ["Taken up again", ({ session }) => (session.interruptions ? `${session.interruptions} times` : "never")],
  ["Calibration", ({ session }) => (session.calibration ? String(session.calibration.version) : "rig file")],
  ["Model", ({ report }) => `${count(report.materials, "material")}, ${report.model}, ${report.lobe}`],
  ["Mean relative error", ({ session, report }) => errorOf({ ...session, mean_relative_error: report.mean_relative_error })],
  ["On highlights", ({ report }) => orNone(report.highlight_relative_error)],
  ["On left-out lights", ({ report }) => orNone(report.left_out_relative_error)],
  ["Chi² per degree of freedom", ({ report }) => report.reduced_chi2.toPrecision(3)],
  ["Points, samples", ({ report }) => `${report.pixels.toLocaleString("en")}, ${report.samples.toLocaleString("en")}`],
  ["Solver", ({ report }) => `${report.solver}, ${report.objective}, ${report.termination} after ${count(report.iterations, "iteration")}`],
  ["Time", ({ report }) => `${report.seconds.total.toFixed(2)} s`],
];

async function load(id) {
  const [session, { material, report }] = await Promise.all([ask(`/v1/sessions/${id}`), ask(`/v1/sessions/${id}/material`)]);
  return { session, material, report };
}

/// The lowest of the three rows of preview.png: the weight maps.
async function weights(id, name) {
  const file = await blob(`/v1/sessions/${id}/result/preview.png`);
  if (!file) return h("p", {}, "The weight maps cannot be had.");
  const image = h("img", { src: file });
  await image.decode();
  URL.revokeObjectURL(file);
  const height = (image.naturalHeight - GAP) / 3 - GAP;
  const canvas = h("canvas", { width: image.naturalWidth, height, role: "img", "aria-label": `Material weight maps of ${name}, one beside the other` });
  canvas.getContext("2d").drawImage(image, 0, GAP + 2 * (height + GAP), image.naturalWidth, height, 0, 0, image.naturalWidth, height);
  return h("figure", {}, canvas, h("figcaption", {}, scaleBar(["0", "0.5", "1"], "Material weight maps: weight", "greys")));
}

async function residual(id, name) {
  const file = await blob(`/v1/sessions/${id}/result/residual.png`);
  if (!file) return h("p", {}, "No residual map: fitted by an earlier version.");
  return h("figure", {}, h("img", { src: file, onload: () => URL.revokeObjectURL(file), alt: `Residuals of ${name}` }), h("figcaption", {}, scaleBar(["0 %", "5 %", "10 %"], "Mean relative error, white from 10 % on", "greys")));
}

async function show(box, ids) {
  const both = await Promise.all(ids.map(load));
  const names = both.map(({ session }) => session.name);
  const titles = names.map((name, i) => `${["first", "second"][i]}: ${name}`);
  const lists = both.map(({ material }) => material.materials);
  const matched = pairs(...lists);
  const parameters = matched.map(([i, j]) => {
    const [first, second] = [rows(lists[0][i]), rows(lists[1][j])];
    const lines = first.map(([name, p]) => {
      const q = second.find(([other]) => other === name)?.[1];
      return q ? [name, shown(p)[0], shown(q)[0], ...difference(p, q)] : [name, shown(p)[0], "none", "", "only in the first"];
    });
    return table(`Material ${i + 1} of the first, ${j + 1} of the second`, ["parameter", ...titles, "difference", "which"], lines);
  });
  const alone = [0, 1].flatMap((side) => lists[side].map((_, i) => i).filter((i) => !matched.some((pair) => pair[side] === i)).map((i) => h("p", {}, `Material ${i + 1} of the ${["first", "second"][side]} has no counterpart.`)));
  const pictures = await Promise.all(ids.map(async (id, i) => h("section", {}, h("h3", {}, h("a", { href: `#/results/${id}` }, titles[i])), await weights(id, names[i]), await residual(id, names[i]),
    h("p", {}, FILES.map((file) => [link(file, `/v1/sessions/${id}/result/${file}`), " "]).flat()))));
  box.replaceChildren(table("Figures", ["", ...titles], FIGURES.map(([name, of]) => [name, ...both.map(of)])), ...parameters, ...alone,
    h("p", { className: "small" }, `A difference of more than ${DIFFERS} standard deviations is called one. Standard errors know of noise alone: what both sessions have wrong in common, or differently (light positions, calibration, lamp), is not in them.`),
    h("div", { className: "columns" }, pictures));
}

export function compare(view, first, second) {
  const chosen = chooser(first, second);
  const known = () => rig.sessions.filter((s) => s.mean_relative_error != null);
  const hint = h("p", {});
  const update = () => {
    if (!rig.status) return;
    chosen.update(known());
    hint.textContent = known().length < 2 ? "Two fitted sessions are needed, and there are not so many yet." : "";
  };
  view.append(h("h2", {}, "Compare"), chosen.form, hint);
  update();
  if (!first || !second) return { update };
  const box = h("div", {}, h("p", {}, "Loading …"));
  view.append(box);
  attempt(() => show(box, [first, second]), (reason) => box.replaceChildren(h("p", { className: "warnings" }, reason)));
  return { update };
}
