// The fitted material of a session: how well it explains the measurements, its parameters with their errors, its pictures and files.
import { ask, blob, link } from "/api.js";
import { exports, resultOf } from "/command.js";
import { count, facts, h, list, percent } from "/show.js";

export const FILES = ["report.json", "material.json", "weights.exr", "weights_sigma.exr", "valid.png", "residual.exr", "residual.png", "preview.png"];

const orNot = (x, why) => (x == null ? `none: ${why}` : percent(x));

/// How well the material explains the measurements; a figure that does not exist says why.
function errors(report) {
  const leftOut = report.left_out.length ? ` (${report.left_out.join(", ")}; numbered from 0)` : "";
  const theirs = report.left_out_highlight_relative_error;
  return facts([
    ["Mean relative error", percent(report.mean_relative_error)],
    ["On highlights", orNot(report.highlight_relative_error, "no highlight was sampled")],
    [`On left-out lights${leftOut}`, orNot(report.left_out_relative_error, "no light was left out")],
    ["On their highlights", theirs == null ? "" : percent(theirs)],
    ["Chi² per degree of freedom", report.reduced_chi2.toPrecision(3)],
    ["Points, samples", `${report.pixels.toLocaleString("en")}, ${report.samples.toLocaleString("en")}`],
  ]);
}

export function rows(material) {
  const channels = (name, list) => list.map((p, i) => [`${name} ${["red", "green", "blue"][i]}`, p]);
  const roughness = material.beta ? [["roughness β", material.beta]] : [];
  return [...channels("diffuse ρd", material.rho_d), ...channels("specular ρs", material.rho_s), ...roughness];
}

/// Value with its standard error, and a note; the value of a parameter that the data do not determine would pass for a measurement.
export function shown({ value, standard_error, identified, reason }) {
  if (identified === "unidentified") return ["not determined", reason ?? ""];
  const note = identified === "weak" ? `weak: ${reason ?? ""}` : "";
  if (standard_error == null) return [value.toPrecision(4), note];
  // Two digits of the standard error, and as many decimals of the value.
  const decimals = Math.min(9, Math.max(4, 1 - Math.floor(Math.log10(standard_error || 1))));
  return [`${value.toFixed(decimals)} ± ${standard_error.toFixed(decimals)}`, note];
}

/// One material: a row a parameter, with its standard error and whether the data determine it.
function parameters(material, index) {
  const head = ["parameter", "value ± standard error", "note"].map((title) => h("th", { scope: "col" }, title));
  const body = rows(material).map(([name, parameter]) => {
    const [value, note] = shown(parameter);
    return h("tr", { className: parameter.identified }, h("th", { scope: "row" }, name), h("td", {}, value), h("td", {}, note));
  });
  return h("table", {}, h("caption", {}, `Material ${index + 1}: ${percent(material.share)} of the surface`), h("thead", {}, h("tr", {}, head)), h("tbody", {}, body));
}

/// A combination that left-out lights judged, in words that tell it from the others.
export const combination = (one) => `${count(one.materials, "material")}, ${one.model}, ${one.lobe}${one.light_gains ? ", light gains" : ""}`;

function candidates(report) {
  const error = (one) => (one.left_out_relative_error == null ? "no light can be left out" : percent(one.left_out_relative_error));
  return list("Materials and models tried, mean relative error on left-out lights", report.candidates.map((one) => `${combination(one)}: ${error(one)}${one.taken ? " (taken)" : ""}`));
}

function how(material, report) {
  const stages = ["load", "observe", "initialise", "fit", "total"].map((stage) => `${stage} ${report.seconds[stage].toFixed(2)} s`);
  return h("p", { className: "small" },
    `${material.model} model, ${report.solver} solver, ${report.weights} weights, ${report.objective} objective; `
    + `${report.termination} after ${count(report.iterations, "iteration")}; gauge: ${material.gauge}; cosines above ${report.cosine_cutoff}; `
    + `${material.provenance.software}${material.provenance.simulated ? ", simulated frames" : ""}. `
    + `Time: ${stages.join(", ")}; ${report.cpu_seconds.toFixed(2)} s of processor.`);
}

/// The material to look at: measured, and as fitted.
export async function pictured(id) {
  const image = await blob(`/v1/sessions/${id}/result/preview.png`);
  if (!image) return "";
  return h("figure", { className: "preview" },
    h("img", { src: image, onload: () => URL.revokeObjectURL(image), alt: "Measured radiance, fitted radiance and material weight maps, a row each" }),
    h("figcaption", {}, "Rows: measured under some of the lights; the same as fitted; material weight maps."));
}

/// Its figures, as one section.
export async function material(id) {
  const path = `/v1/sessions/${id}/result`;
  const [{ material: fitted, report }, result] = await Promise.all([ask(`/v1/sessions/${id}/material`), resultOf(id)]);
  return h("section", {}, h("h3", {}, "Material"), errors(report), list("Warnings", report.warnings, "warnings"),
    h("div", { className: "tables", role: "region", tabIndex: 0, "aria-label": "Parameters" }, fitted.materials.map(parameters)), candidates(report), how(fitted, report),
    h("p", {}, "Files: ", FILES.flatMap((name) => [link(name, `${path}/${name}`), " "])), exports(result));
}
