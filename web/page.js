// The page shows what the daemon says and remembers nothing: every figure comes from a snapshot, an event only says "look again".
const $ = (id) => document.getElementById(id);
const FINAL = ["completed", "stopped", "aborted", "halted", "failed", "interrupted"];
const SHOOTING = ["preflight", "running", "pausing", "paused", "suspended"];
const VERBS = {
  pause: ["running"],
  resume: ["pausing", "paused", "suspended", "interrupted"],
  stop: SHOOTING,
  abort: [...SHOOTING, "fitting", "stopping"],
};
const PAGE = 20;
let chosen = null;      // id of the session shown
let stream = null;      // ends the reading of its events
let heard = Date.now(); // when the daemon last answered or sent anything
let lost = false;
let older = [];         // sessions of later pages, asked for by the user
let next = null;        // token of the page after those

/// Thrown when the daemon cannot be reached.
class Unreachable extends Error {}

/// The token lives as long as the tab: in no file, no cookie, no address.
const token = () => sessionStorage.getItem("token");

/// Every request shows the token, if there is one; where it is missing or wrong, it is asked for.
async function load(path, { headers, ...options } = {}) {
  const shown = token() ? { Authorization: `Bearer ${token()}` } : {};
  const answer = await fetch(path, { ...options, headers: { ...headers, ...shown } });
  $("login").hidden = answer.status !== 401;
  return answer;
}

async function ask(path, options) {
  const unreachable = (error) => { throw new Unreachable(error.message); };
  const answer = await load(path, options).catch(unreachable);
  const body = await answer.json().catch(unreachable);
  heard = Date.now();
  lost = false;
  if (!answer.ok) throw Object.assign(new Error((body.reasons || [body.detail]).join("\n")), { problem: body });
  return body;
}

function say(text) {
  $("message").textContent = text || "";
  $("message").hidden = !text;
}

/// Runs work whose failure is either the daemon's refusal (shown) or a lost connection (shown by its age).
async function attempt(work, refused = say) {
  try {
    await work();
  } catch (error) {
    if (error.problem) refused(error.message);
    else if (error instanceof Unreachable) lost = true;
    else throw error;
  }
}

function element(tag, text, properties = {}) {
  return Object.assign(document.createElement(tag), { textContent: text ?? "", ...properties });
}

const percent = (x) => `${(100 * x).toFixed(2)} %`;
const overhead = (budget) => budget?.overhead == null ? "" : `; overhead ${percent(budget.overhead)}`;
/// What an adaptive session did not shoot, and what the noise model says it cost.
function leftOut(saved) {
  if (!saved?.exposures) return "";
  const cost = saved.sigma == null ? "" : `, standard error of a sample ${percent(saved.sigma)} instead of ${percent(saved.sigma_whole)}`;
  return `; left out ${count(saved.exposures, "exposure")} (${Math.round(saved.shutter_s)} s of shutter time${cost})`;
}
const clock = (s) => new Date(1000 * Math.round(s)).toISOString().slice(11, 19);
const when = (text) => (text ? new Date(text).toLocaleString() : "");

async function showRig() {
  const rig = await ask("/v1/rig");
  const rated = rig.lamp.rated_hours === null ? "" : ` of ${rig.lamp.rated_hours}`;
  $("rig").textContent = `${rig.name}, rigd ${rig.version}, lamp ${rig.lamp.hours.toFixed(1)}${rated} h`;
  $("simulated").hidden = !rig.simulated;
  $("not-ready").hidden = rig.ready;
  $("not-ready").textContent = `Not ready: ${rig.reasons.join("; ")}`;
}

async function showList() {
  const page = await ask(`/v1/sessions?max_page_size=${PAGE}`);
  if (!older.length) next = page.next_page_token;
  const shown = new Set(page.sessions.map((s) => s.id));
  const all = [...page.sessions, ...older.filter((s) => !shown.has(s.id))];
  $("more").hidden = !next;
  $("start").disabled = page.sessions.some((s) => !FINAL.includes(s.state));
  $("list").replaceChildren(...all.map((s) => {
    const button = element("button", s.name, { type: "button", onclick: () => choose(s.id) });
    button.setAttribute("aria-current", s.id === chosen);
    button.append(element("small", `${s.state}, ${s.frames_committed}/${s.frames_planned} frames, ${when(s.started)}`));
    const item = element("li");
    item.append(button);
    return item;
  }));
  if (!chosen && all.length) choose(all[0].id);
}

function choose(id) {
  chosen = id;
  stream?.abort();
  say();
  $("result").hidden = true;
  $("result").dataset.of = "";
  refresh();
  follow(id);
}

/// Looks again at every event, and takes a broken stream up where it broke; the daemon's 204 after the last event ends it.
/// (EventSource cannot show a token.)
async function follow(id) {
  const reading = stream = new AbortController();
  let last = 0;
  while (!reading.signal.aborted) {
    try {
      const headers = { "Last-Event-ID": String(last) };
      const answer = await load(`/v1/sessions/${id}/events`, { headers, signal: reading.signal });
      if (answer.status !== 200) return;
      const pieces = answer.body.pipeThrough(new TextDecoderStream()).getReader();
      let text = "";
      for (let piece = await pieces.read(); !piece.done; piece = await pieces.read()) {
        const events = (text + piece.value).split("\n\n");
        text = events.pop();
        for (const event of events) last = /^id: ?(\d+)$/m.exec(event)?.[1] ?? last;
        heard = Date.now();
        lost = false;
        refresh();
      }
    } catch {
      if (reading.signal.aborted) return;
      refresh();
    }
    await new Promise((later) => setTimeout(later, 1000));
  }
}

let refreshing = false;
let again = false;
/// At most one refresh at a time and five a second, and always one after the last event.
async function refresh() {
  if (refreshing) { again = true; return; }
  refreshing = true;
  again = false;
  await attempt(async () => {
    await showList();
    if (chosen) await showSession(chosen);
  });
  setTimeout(() => { refreshing = false; if (again) refresh(); }, 200);
}

async function showSession(id) {
  const [s, { frames }] = await Promise.all([ask(`/v1/sessions/${id}`), ask(`/v1/sessions/${id}/frames`)]);
  if (id !== chosen) return;
  const ended = FINAL.includes(s.state);
  $("session").hidden = false;
  $("name").textContent = s.name + (s.simulated ? " (simulated)" : "");
  $("state").textContent = s.state;
  $("reason").textContent = (s.reason || "")
    + (s.state === "interrupted" ? ". Put right what is wrong, then Resume goes on with the stations that are missing." : "");
  for (const button of $("verbs").children) button.disabled = !VERBS[button.dataset.verb].includes(s.state);
  $("progress").max = s.frames_planned || 1;
  $("progress").value = s.frames_committed;
  const left = s.remaining_s == null ? "" : `, ${clock(s.remaining_s)} left`;
  const station = ended ? `${s.stations} stations` : `station ${Math.min(s.station + 1, s.stations)} of ${s.stations}`;
  $("figures").textContent = `${s.frames_committed} of ${s.frames_planned} frames, ${station}, `
    + `${s.stations_developed} developed${left}; started ${when(s.started)}${s.ended ? `, ended ${when(s.ended)}` : ""}`;
  $("figures").textContent += overhead(s.time_budget) + leftOut(s.saved);
  $("refusals").textContent = s.refused ? `${s.refused} refused and shot again, the last: ${s.last_refusal}` : "";
  showGrid(s, frames);
  if (s.mean_relative_error != null && $("result").dataset.of !== `${id} ${s.last_seq}`) await showResult(s);
}

function showGrid(s, frames) {
  const cells = Array.from({ length: s.stations * s.exposures }, (_, i) =>
    element("i", "", { title: `station ${Math.floor(i / s.exposures) + 1}, exposure ${(i % s.exposures) + 1}` }));
  for (const frame of frames) {
    const cell = cells[frame.station * s.exposures + frame.exposure];
    if (!cell || frame.state === "superseded") continue;
    cell.className = "done";
    cell.title += `: ${frame.shutter} s`;
  }
  $("grid").style.gridTemplateColumns = `repeat(${s.exposures}, 1fr)`;
  $("grid").replaceChildren(...cells);
}

async function showResult(s) {
  const { material, report } = await ask(`/v1/sessions/${s.id}/material`);
  if (s.id !== chosen) return;
  $("result").hidden = false;
  $("result").dataset.of = `${s.id} ${s.last_seq}`;
  showErrors(report);
  $("warnings").replaceChildren(...report.warnings.map((warning) => element("li", warning)));
  $("candidates").replaceChildren(...report.candidates.map((candidate) => element("li",
    `${count(candidate.materials, "material")}: ${percent(candidate.left_out_relative_error)}${candidate.taken ? " (taken)" : ""}`)));
  $("tried").hidden = !report.candidates.length;
  $("parameters").replaceChildren(...material.materials.map(parameterTable));
  $("fit").textContent = `${material.model} model, ${report.solver} solver, ${report.weights} weights, ${report.objective} objective; `
    + `${report.termination} after ${count(report.iterations, "iteration")}; gauge: ${material.gauge}; cosines above ${report.cosine_cutoff}; `
    + `${material.provenance.software}${material.provenance.simulated ? ", simulated frames" : ""}.`;
  const stages = ["load", "observe", "initialise", "fit", "total"].map((stage) => `${stage} ${report.seconds[stage].toFixed(2)} s`);
  $("seconds").textContent = `Time: ${stages.join(", ")}; ${report.cpu_seconds.toFixed(2)} s of processor.`;
  await showPreview(`/v1/sessions/${s.id}/result/preview.png`);
  const files = ["report.json", "material.json", "weights.exr", "weights_sigma.exr", "valid.png", "residual.exr", "preview.png"];
  $("files").replaceChildren("Files: ", ...files.flatMap((f) => [link(f, `/v1/sessions/${s.id}/result/${f}`), " "]));
}

async function blob(path) {
  const answer = await load(path);
  return answer.ok ? URL.createObjectURL(await answer.blob()) : null;
}

async function showPreview(path) {
  const image = await blob(path);
  URL.revokeObjectURL($("preview").src);
  $("figure").hidden = !image;
  if (image) $("preview").src = image;
}

/// A link's own request shows no token: where one is needed, the file is loaded first.
function link(name, path) {
  const save = async (event) => {
    event.preventDefault();
    const file = await blob(path);
    if (!file) return say(`${name} cannot be had now`);
    element("a", "", { href: file, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(file), 60000);
  };
  return element("a", name, token() ? { href: path, onclick: save } : { href: path });
}

/// How well the material explains the measurements; a figure that does not exist says why.
function showErrors(report) {
  const leftOut = report.left_out.length ? ` (${report.left_out.join(", ")}; numbered from 0)` : "";
  const figures = [
    ["Mean relative error", percent(report.mean_relative_error)],
    ["On highlights", orNot(report.highlight_relative_error, "no highlight was sampled")],
    [`On left-out lights${leftOut}`, orNot(report.left_out_relative_error, "no light was left out")],
    ["Chi² per degree of freedom", report.reduced_chi2.toPrecision(3)],
    ["Points, samples", `${report.pixels.toLocaleString("en")}, ${report.samples.toLocaleString("en")}`],
  ];
  if (report.left_out_highlight_relative_error != null) {
    figures.splice(3, 0, ["On their highlights", percent(report.left_out_highlight_relative_error)]);
  }
  $("errors").replaceChildren(...figures.flatMap(([key, value]) => [element("dt", key), element("dd", value)]));
}

const orNot = (x, why) => (x == null ? `none: ${why}` : percent(x));
const count = (n, what) => `${n} ${what}${n === 1 ? "" : "s"}`;

/// One material: a row a parameter, with its standard error and whether the data determine it.
function parameterTable(material, index) {
  const table = element("table");
  table.append(element("caption", `Material ${index + 1}: ${percent(material.share)} of the surface`));
  const head = table.createTHead().insertRow();
  for (const title of ["", "value ± standard error", ""]) head.append(element("th", title));
  const body = table.createTBody();
  for (const [name, parameter] of rows(material)) {
    const row = body.insertRow();
    row.className = parameter.identified;
    for (const text of [name, ...shown(parameter)]) row.append(element("td", text));
  }
  return table;
}

function rows(material) {
  const channels = (name, list) => list.map((p, i) => [`${name} ${["red", "green", "blue"][i]}`, p]);
  const roughness = material.beta ? [["roughness β", material.beta]] : [];
  return [...channels("diffuse ρd", material.rho_d), ...channels("specular ρs", material.rho_s), ...roughness];
}

/// Value with its standard error, and a note; the value of a parameter that the data do not determine would pass for a measurement.
function shown({ value, standard_error, identified, reason }) {
  if (identified === "unidentified") return ["not determined", reason ?? ""];
  const note = identified === "weak" ? `weak: ${reason ?? ""}` : "";
  if (standard_error == null) return [value.toPrecision(4), note];
  // Two digits of the standard error, and as many decimals of the value.
  const decimals = Math.min(9, Math.max(4, 1 - Math.floor(Math.log10(standard_error || 1))));
  return [`${value.toFixed(decimals)} ± ${standard_error.toFixed(decimals)}`, note];
}

const JSON_BODY = { "Content-Type": "application/json" };
$("start").onclick = () => attempt(async () => {
  say();
  const headers = { ...JSON_BODY, "Idempotency-Key": crypto.randomUUID() };
  const started = await ask("/v1/sessions", { method: "POST", headers, body: "{}" });
  choose(started.id);
});
for (const button of $("verbs").children) {
  button.onclick = () => attempt(async () => {
    say();
    await ask(`/v1/sessions/${chosen}/${button.dataset.verb}`, { method: "POST" });
    // The stream of an interrupted session had ended.
    choose(chosen);
  });
}
$("more").onclick = () => attempt(async () => {
  const page = await ask(`/v1/sessions?max_page_size=${PAGE}&page_token=${next}`);
  older = [...older, ...page.sessions];
  next = page.next_page_token;
  await showList();
});

$("login").onsubmit = (event) => {
  event.preventDefault();
  sessionStorage.setItem("token", $("token").value.trim());
  $("token").value = "";
  say();
  if (chosen) choose(chosen);
  poll();
};

$("preview").onerror = () => { $("figure").hidden = true; };

/// Says how old the figures are once the daemon cannot be reached.
setInterval(() => {
  const age = Math.round((Date.now() - heard) / 1000);
  $("connection").textContent = lost ? `disconnected: figures are ${age} s old` : "connected";
  $("connection").classList.toggle("stale", lost);
}, 500);
/// Readiness has no event; this also finds sessions that others start, and a daemon that is back.
const poll = () => attempt(async () => { await showRig(); refresh(); });
setInterval(poll, 5000);
poll();
