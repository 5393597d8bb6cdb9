// The page shows what the daemon says and remembers nothing: every figure comes from a snapshot, an event only says "look again".
const $ = (id) => document.getElementById(id);
const FINAL = ["completed", "stopped", "aborted", "halted", "failed", "interrupted"];
const SHOOTING = ["preflight", "running", "pausing", "paused", "suspended"];
const VERBS = {
  pause: ["running"],
  resume: ["pausing", "paused", "suspended"],
  stop: SHOOTING,
  abort: [...SHOOTING, "fitting", "stopping"],
};
const PAGE = 20;
let chosen = null;      // id of the session shown
let stream = null;      // its event stream
let heard = Date.now(); // when the daemon last answered or sent anything
let lost = false;
let older = [];         // sessions of later pages, asked for by the user
let next = null;        // token of the page after those

async function ask(path, options) {
  const answer = await fetch(path, options);
  heard = Date.now();
  lost = false;
  const body = await answer.json();
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
    else lost = true;
  }
}

function element(tag, text, properties = {}) {
  return Object.assign(document.createElement(tag), { textContent: text ?? "", ...properties });
}

const percent = (x) => (x == null ? "none" : `${(100 * x).toFixed(2)} %`);
const clock = (s) => new Date(1000 * Math.round(s)).toISOString().slice(11, 19);
const when = (text) => (text ? new Date(text).toLocaleString() : "");

async function showRig() {
  const rig = await ask("/v1/rig");
  $("rig").textContent = `${rig.name}, rigd ${rig.version}`;
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
  stream?.close();
  say();
  $("result").hidden = true;
  $("result").dataset.of = "";
  refresh();
  follow(id);
}

/// EventSource reconnects by itself with Last-Event-ID; the daemon's 204 after the last event ends it.
function follow(id) {
  stream = new EventSource(`/v1/sessions/${id}/events`);
  const source = stream;
  const changed = () => { heard = Date.now(); lost = false; refresh(); };
  for (const type of ["message", "session.state", "arm.moved", "frame.committed", "frame.rejected", "station.developed", "fit.progress", "fit.finished"]) {
    source.addEventListener(type, changed);
  }
  source.onopen = changed;
  source.onerror = refresh;
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
  $("reason").textContent = s.reason || "";
  for (const button of $("verbs").children) button.disabled = !VERBS[button.dataset.verb].includes(s.state);
  $("progress").max = s.frames_planned || 1;
  $("progress").value = s.frames_committed;
  const left = s.remaining_s == null ? "" : `, ${clock(s.remaining_s)} left`;
  const station = ended ? `${s.stations} stations` : `station ${Math.min(s.station + 1, s.stations)} of ${s.stations}`;
  $("figures").textContent = `${s.frames_committed} of ${s.frames_planned} frames, ${station}, `
    + `${s.stations_developed} developed${left}; started ${when(s.started)}${s.ended ? `, ended ${when(s.ended)}` : ""}`;
  showGrid(s, frames);
  if (s.mean_relative_error != null && $("result").dataset.of !== `${id} ${s.last_seq}`) await showResult(s);
}

function showGrid(s, frames) {
  const cells = Array.from({ length: s.stations * s.exposures }, (_, i) =>
    element("i", "", { title: `station ${Math.floor(i / s.exposures) + 1}, exposure ${(i % s.exposures) + 1}` }));
  for (const frame of frames) {
    const cell = cells[frame.station * s.exposures + frame.exposure];
    if (cell && frame.state !== "superseded") cell.className = "done";
  }
  $("grid").style.gridTemplateColumns = `repeat(${s.exposures}, 1fr)`;
  $("grid").replaceChildren(...cells);
}

async function showResult(s) {
  const { material = {}, report = {} } = await ask(`/v1/sessions/${s.id}/material`);
  if (s.id !== chosen) return;
  $("result").hidden = false;
  $("result").dataset.of = `${s.id} ${s.last_seq}`;
  const figures = {
    "Mean relative error": percent(report.mean_relative_error),
    "On highlights": percent(report.highlight_relative_error),
    "On left-out lights": percent(report.left_out_relative_error),
    Points: report.pixels,
    Samples: report.samples,
    Model: report.model,
    Solver: report.solver,
    Objective: report.objective,
    "Ended because": report.termination,
  };
  const known = Object.entries(figures).filter(([, value]) => value != null);
  $("errors").replaceChildren(...known.flatMap(([key, value]) => [element("dt", key), element("dd", value)]));
  $("warnings").replaceChildren(...(report.warnings || []).map((w) => element("li", w)));
  $("parameters").replaceChildren(...(material.materials || []).map(parameterTable));
  $("preview").src = `/v1/sessions/${s.id}/result/preview.png?${s.last_seq}`;
  $("preview").hidden = false;
  const files = ["report.json", "material.json", "weights.exr", "valid.png", "residual.exr"];
  $("files").replaceChildren(...files.flatMap((f) => [element("a", f, { href: `/v1/sessions/${s.id}/result/${f}` }), " "]));
}

/// One material: a row a parameter, with its standard error and whether the data determine it.
function parameterTable(material, index) {
  const table = element("table");
  const share = typeof material.share === "number" ? `, ${percent(material.share)} of the surface` : "";
  table.append(element("caption", `Material ${index + 1}${share}`));
  const head = table.createTHead().insertRow();
  for (const title of ["parameter", "value", "standard error", ""]) head.append(element("th", title));
  const body = table.createTBody();
  for (const p of rows(material.parameters)) {
    const row = body.insertRow();
    const flag = p.flag ?? p.identified ?? "";
    if (flag !== "identified" && flag !== "") row.className = "unsure";
    for (const text of [p.name, number(p.value), number(p.standard_error), [flag, p.reason].filter(Boolean).join(": ")]) {
      row.append(element("td", text));
    }
  }
  return table;
}

/// Parameters come as a list of records, or as one record by name.
function rows(parameters) {
  if (Array.isArray(parameters)) return parameters;
  return Object.entries(parameters || {}).map(([name, p]) => ({ name, ...(typeof p === "object" ? p : { value: p }) }));
}

function number(x) {
  if (Array.isArray(x)) return x.map(number).join("  ");
  return typeof x === "number" ? x.toPrecision(4) : (x ?? "");
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
    refresh();
  });
}
$("more").onclick = () => attempt(async () => {
  const page = await ask(`/v1/sessions?max_page_size=${PAGE}&page_token=${next}`);
  older = [...older, ...page.sessions];
  next = page.next_page_token;
  await showList();
});

$("preview").onerror = () => { $("preview").hidden = true; };

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
