// A fit while it goes on: which step, the error over the iterations, the parameters so far, and where the error is.
import { ask, attempt, post, say } from "/api.js";
import { bar, end, errors, residuals, scaleBar } from "/chart.js";
import { combination, rows, shown } from "/material.js";
import { current, ended } from "/rig.js";
import { run, watch } from "/run.js";
import { badge, count, facts, fill, h, percent, weakness } from "/show.js";

/// Of a part that may be tiny.
const share = (part) => `${+(100 * part).toPrecision(2)}\u00a0%`;

const STEPS = {
  load: "read the dataset", observe: "gather samples", choose: "choose model and materials by left-out lights", fit: "fit", uncertainty: "standard errors",
};

function steps({ step, running, error }) {
  const all = Object.keys(STEPS);
  const at = all.indexOf(step);
  const mark = (i) => (i < at || (!running && !error) ? "passed" : i === at ? "now" : "");
  return h("ol", { className: "steps" }, all.map((name, i) => h("li", { className: mark(i), "aria-current": mark(i) === "now" ? "step" : "false" }, STEPS[name])));
}

function chart({ iterations }) {
  const now = iterations.at(-1);
  if (!now) return h("p", {}, "No iteration yet.");
  const words = `Residual against iteration: ${now.error.toPrecision(3)} after ${count(now.iteration, "iteration")}`;
  return h("figure", {}, errors(iterations, "rms residual, objective's unit", words), h("figcaption", {},
    `Root mean square residual in the unit of the objective, now ${now.error.toPrecision(3)} over ${count(now.points, "point")}. Unless another objective was asked for, 1 is what noise and a model floor of 2 % explain: `
    + "it is no relative error. A new line begins where the search goes on with more points."));
}

/// Two standard errors, relative to the value; none where there is no error, or the value tells nothing.
const spread = ({ value, standard_error, identified }) => (standard_error == null || identified === "unidentified" || !value ? null : (2 * standard_error) / Math.abs(value));

/// The parameters; bars of one material share a scale, so that the less certain ones are seen to be.
function material(one, index) {
  const all = rows(one);
  const most = end(all.map(([, parameter]) => spread(parameter)).filter((relative) => relative != null));
  const lines = all.map(([name, parameter]) => {
    const [value] = parameter.identified == null ? [parameter.value.toPrecision(4)] : shown(parameter);
    const relative = spread(parameter);
    return h("tr", { className: parameter.identified ?? "" }, h("th", { scope: "row" }, name), h("td", {}, value), h("td", { className: "drawn" }, relative == null ? "" : [bar(relative, most), ` ${share(relative)}`]));
  });
  return h("table", {}, h("caption", {}, `Material ${index + 1}`),
    h("thead", {}, h("tr", {}, ["parameter", "value", `± 2 standard errors, relative (bar: up to ± ${share(most)})`].map((title) => h("th", { scope: "col" }, title)))), h("tbody", {}, lines));
}

function tried({ candidates }) {
  if (!candidates.length) return "";
  const lines = candidates.map((one) => h("tr", {}, h("th", { scope: "row" }, combination(one)),
    h("td", {}, one.left_out_relative_error == null ? "none left out" : percent(one.left_out_relative_error)), h("td", {}, one.best ? "best so far" : one.reason)));
  return h("div", { className: "scroll", role: "region", tabIndex: 0, "aria-label": "Candidates" }, h("table", {}, h("caption", {}, "Tried"),
    h("thead", {}, h("tr", {}, ["candidate", "error on left-out lights", "verdict"].map((title) => h("th", { scope: "col" }, title)))), h("tbody", {}, lines)));
}

/// Why there is nothing to watch, in words.
function absent(session) {
  if (!ended(session)) return "The fit has not begun: it does when the frames are there.";
  if (session.mean_relative_error == null) return "Nothing of this session was fitted.";
  return "This fit ended a while ago, and the daemon shows the last one alone. What came of it is in the result; “Fit again” lets you watch it anew.";
}

export function live(view, id) {
  const names = ["head", "steps", "chart", "materials", "map", "tried"];
  const parts = Object.fromEntries(names.map((name) => [name, h("div", { className: `fit-${name}` })]));
  const refit = h("button", { type: "button", onclick: () => attempt(async () => {
    say();
    await post(`/v1/sessions/${run.id}/fit`, {});
    watch(run.id, true);
  }) }, "Fit again");
  view.append(parts.head, refit, parts.steps, h("div", { className: "columns" }, h("div", {}, parts.chart, parts.map), h("div", {}, parts.materials, parts.tried)));
  let fit = null;
  let why = "";
  let asked = null;     // session and revision that were last asked for
  let asking = false;
  let again = false;

  function show() {
    const { session } = run;
    refit.hidden = !session || !ended(session) || fit?.running === true;
    const name = session ? [session.name, " ", badge(session.state)] : "";
    const links = session ? h("p", { className: "verbs" }, h("a", { href: `#/results/${session.id}` }, "Result")) : "";
    if (!fit) {
      fill(parts.head, h("h2", {}, "Fit ", name), h("p", {}, session ? why && absent(session) || "Loading …" : current() ? "Loading …" : "No session yet."), links);
      return names.slice(1).forEach((part) => fill(parts[part]));
    }
    const standing = fit.running ? "goes on" : fit.error ? `failed: ${fit.error}` : session?.state === "fitting" ? "has ended, its result is being written" : "has ended";
    const weak = session && ended(session) && !fit.running ? weakness(session) : "";
    fill(parts.head, h("h2", {}, "Fit ", name), h("p", { role: "status" }, `The fit ${standing}.`), weak && h("p", {}, h("strong", { className: "weak-mark" }, `⚠ ${weak}`)), facts([["Points, samples", fit.points ? `${fit.points.toLocaleString("en")}, ${fit.samples.toLocaleString("en")}` : ""]]), links);
    fill(parts.steps, steps(fit));
    fill(parts.chart, h("h3", {}, "Error"), chart(fit));
    fill(parts.materials, h("h3", {}, "Parameters"), fit.materials.length ? h("div", { className: "tables", role: "region", tabIndex: 0, "aria-label": "Parameters" }, fit.materials.map(material)) : h("p", {}, "None yet."));
    fill(parts.map, h("h3", {}, "Where the error is"), fit.residual_map ? h("figure", {}, residuals(fit.residual_map), h("figcaption", {}, scaleBar(["0 %", "5 %", "10 %"], "Mean relative error, full colour from 10 % on.", "reds"))) : h("p", {}, "No map yet."));
    fill(parts.tried, tried(fit));
    // What is shown, for who measures how far behind it is.
    const stand = `${fit.revision} ${fit.time}`;
    if (view.dataset.fit !== stand) view.dataset.fit = stand;
  }

  async function look() {
    if (!run.id) return show();
    if (asking) {
      again = true;
      return;
    }
    [asking, again] = [true, false];
    const of = run.id;
    const take = (found, reason) => of === run.id && ([fit, why] = [found, reason]);
    await attempt(async () => take(await ask(`/v1/sessions/${of}/fit`), ""), (reason) => take(null, reason));
    asking = false;
    show();
    // A refit of a session that has ended begins a stream anew.
    if (fit?.running && run.over && run.session && ended(run.session)) watch(run.id, true);
    if (again) look();
  }

  const update = () => {
    watch(id ?? current()?.id ?? null);
    const now = `${run.id} ${run.fit}`;
    if (now === asked) return show();
    if (asked?.split(" ")[0] !== String(run.id)) [fit, why] = [null, ""];
    asked = now;
    look();
  };
  return { update, look, close: () => delete view.dataset.fit };
}
