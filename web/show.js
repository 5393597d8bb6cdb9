// How things are shown: elements, and numbers and times in words.

export const $ = (id) => document.getElementById(id);

/// An element; properties with a dash, `role` and `for` are attributes. Children are elements or text.
export function h(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(properties)) {
    if (/-|^(role|for|colspan|scope)$/.test(key)) made.setAttribute(key, value);
    else made[key] = value;
  }
  made.append(...children.flat().filter((child) => child != null && child !== ""));
  return made;
}

/// An element of a drawing: everything is an attribute.
export function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children.flat());
  return made;
}

/// A list of facts; pairs without a value are left out.
export function facts(pairs) {
  const told = pairs.filter(([, value]) => value != null && value !== "");
  return h("dl", {}, told.flatMap(([key, value]) => [h("dt", {}, key), h("dd", {}, value)]));
}

/// A list of sentences under a heading; nothing at all if there are none.
export function list(title, items, className = "") {
  if (!items.length) return "";
  return h("section", { className }, h("h3", {}, title), h("ul", {}, items.map((item) => h("li", {}, item))));
}

/// Replaces what a box shows, but only where that differs: whoever reads or has the focus there is left alone.
export function fill(box, ...children) {
  const fresh = h("div", {}, ...children);
  if (box.innerHTML !== fresh.innerHTML) box.replaceChildren(...fresh.childNodes);
}

export const percent = (x) => `${(100 * x).toFixed(2)}\u00a0%`;
export const count = (n, what) => `${n.toLocaleString("en")} ${what}${n === 1 ? "" : "s"}`;
export const degrees = (x) => `${+x.toFixed(1)}°`;

const UNITS = ["B", "kB", "MB", "GB", "TB"];
export function bytes(n) {
  const power = Math.min(UNITS.length - 1, Math.floor(Math.log10(Math.max(n, 1)) / 3));
  return `${+(n / 1000 ** power).toPrecision(3)}\u00a0${UNITS[power]}`;
}

/// Seconds as people say them.
export function duration(s) {
  if (s < 10) return `${+s.toPrecision(2)}\u00a0s`;
  const seconds = Math.round(s);
  if (seconds < 120) return `${seconds}\u00a0s`;
  const minutes = Math.round(seconds / 60);
  return minutes < 60 ? `${minutes}\u00a0min` : `${Math.floor(minutes / 60)} h ${minutes % 60}\u00a0min`;
}

/// Time of day, with seconds where those matter; with the day where it is not today.
export function clock(time, seconds = {}) {
  const date = new Date(time);
  const now = new Date();
  const year = date.getFullYear() === now.getFullYear() ? {} : { year: "numeric" };
  const day = date.toDateString() === now.toDateString() ? {} : { day: "numeric", month: "short", ...year };
  return date.toLocaleString([], { ...day, hour: "2-digit", minute: "2-digit", ...seconds });
}

/// With the seconds: for a log.
export const clockSeconds = (time) => clock(time, { second: "2-digit" });

/// Stations and exposures are numbered from 1 for people, from 0 in files, in the journal and in the daemon's own words.
export const numbered = (index) => String(index + 1);
export const forPeople = (text) => text.replace(/\b(station|exposure) (\d+)\b/g, (_, what, index) => `${what} ${numbered(+index)}`)
  .replace(/\bstations (\d+) to (\d+)\b/g, (_, first, last) => `stations ${numbered(+first)} to ${numbered(+last)}`);

/// Why a session's material is weaker than its error looks; nothing if it is not. A few lights are explained by anything.
export function weakness(s) {
  const lights = s.state === "completed" || s.stations_developed >= s.stations ? [] : [`from ${s.stations_developed} of ${count(s.stations, "light")}`];
  const parameters = s.weak_parameters ? [`${count(s.weak_parameters, "parameter")} not well determined`] : [];
  return [...lights, ...parameters].join("; ");
}

/// A session's error, never without what weakens it; `none` where there is no fit.
export function errorOf(s, none) {
  if (s.mean_relative_error == null) return none;
  const why = weakness(s);
  return why ? h("span", {}, percent(s.mean_relative_error), " ", h("strong", { className: "weak-mark" }, `⚠ ${why}`)) : percent(s.mean_relative_error);
}

export const when = (text) => (text ? new Date(text).toLocaleString() : "");

/// What a state means to somebody who only looks.
const WORDS = {
  preflight: "getting ready", running: "shooting", pausing: "will pause before the next frame", paused: "paused, lamp on",
  suspended: "waits for disk space", awaiting: "waits for you", fitting: "fitting the material", stopping: "stopping",
  aborting: "aborting",
};
export const state = (name) => WORDS[name] ?? name;

export function badge(name) {
  const kind = name === "completed" ? "good" : ["failed", "interrupted", "aborted", "suspended"].includes(name) ? "bad" : "busy";
  return h("strong", { className: `badge ${kind}` }, state(name));
}

/// What an adaptive session did not shoot, and what the noise model says it cost.
export function leftOut(saved) {
  const cost = saved.sigma == null ? "" : `, standard error of a sample ${percent(saved.sigma)} instead of ${percent(saved.sigma_whole)}`;
  return `${count(saved.exposures, "exposure")}, ${duration(saved.shutter_s)} of shutter time${cost}`;
}

/// A labelled control with what it stands at beside it.
export function field(text, control, told = "") {
  return h("div", { className: "field" }, h("label", { for: control.id }, text, " ", told), control);
}

/// A choice among the keys of `options`, in their words.
export function select(id, options, change) {
  const made = h("select", { id, onchange: () => change(made.value) }, Object.entries(options).map(([value, text]) => h("option", { value }, text)));
  return made;
}

/// A slider over powers of two.
export function slider(id, least, most, value, change) {
  const told = h("output", { for: id });
  const control = h("input", { id, type: "range", min: least, max: most, step: 0.05, value, oninput: () => change(2 ** control.value) });
  return { control, told };
}
