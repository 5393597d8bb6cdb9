// The run that goes on, at one glance; the newest one when none does.
import { ask, attempt, blob } from "/api.js";
import { calibrationCard } from "/calibration.js";
import { dome, legend } from "/dome.js";
import { fate } from "/journal.js";
import { lastFrame } from "/picture.js";
import { calibrating, current, ended, rig } from "/rig.js";
import { active, run, watch } from "/run.js";
import { badge, bytes, clock, clockSeconds, count, degrees, duration, errorOf, facts, fill, forPeople, h, leftOut, list, numbered, percent, when } from "/show.js";
import { ENDING, isEnding, verbs } from "/verbs.js";

const STAGES = {
  preparation_s: "getting ready", motion_s: "arm moves", settling_s: "arm settles", shutter_s: "shutter open", transfer_s: "transfer",
  camera_s: "camera", storing_s: "checking, storing", recovery_s: "shot again, brought back", held_s: "paused, waiting", other_s: "all else",
};
const NOTES_SHOWN = 30;

/// What is asked most at night.
function gist(s) {
  const frames = `${s.frames_committed} of ${s.frames_planned} frames`;
  if (isEnding(s)) return `${frames}. ${ENDING}.`;
  if (ended(s) || s.remaining_s == null) return frames;
  return `${frames}, ends about ${clock(run.at + 1000 * s.remaining_s)}`;
}

/// Station and times.
function figures(s, plan) {
  const over = ended(s);
  const angle = plan?.stations[s.station]?.angle_deg;
  const at = angle == null ? "" : ` at ${degrees(angle)}`;
  const end = isEnding(s) ? "once the frame in the camera is there" : s.remaining_s == null ? "not known yet" : `${clock(run.at + 1000 * s.remaining_s)}, in ${duration(s.remaining_s)}`;
  return facts([
    ["Station", over ? count(s.stations, "station") : `${numbered(s.station)} of ${s.stations}${at}`],
    ["Developed", `${s.stations_developed} of ${s.stations} stations`],
    ["Started", clock(s.started)],
    [over ? "Ended" : "Ends about", over ? s.ended && clock(s.ended) : end],
    ["Refused, shot again", s.refused ? String(s.refused) : "none"],
    ["Calibration", s.calibration ? `${s.calibration.version} of ${when(s.calibration.made)}` : "none: the rig file's geometry"],
    ["Left out", s.saved?.exposures ? leftOut(s.saved) : ""],
    ["Mean relative error", errorOf(s, "")],
  ]);
}

/// What became of a station's frames.
function mark(station) {
  const { told, plan } = run;
  const fates = plan.exposures.map((_, exposure) => fate(told, station, exposure));
  if (fates.includes("refused")) return "bad";
  return fates.includes("todo") || fates.every((one) => one === "left") ? "todo" : "done";
}

function diagram() {
  const angles = run.plan.stations.map((station) => station.angle_deg);
  const marks = angles.map((_, i) => mark(i));
  const now = active();
  const done = marks.filter((one) => one === "done").length;
  const words = `Light dome: ${done} of ${angles.length} stations on disk${now == null ? "" : `, station ${numbered(now)} at ${degrees(angles[now])} being shot`}`;
  const travel = rig.status?.arm?.travel_deg ?? [Math.min(...angles), Math.max(...angles)];
  return h("figure", {}, dome(angles, travel, now, (i) => marks[i], words), h("figcaption", {}, legend));
}

function lamp(s) {
  const { lamp } = rig.status;
  const drift = s?.lamp_drift;
  const ratio = drift?.brightness.map((x) => percent(x)).join(", ");
  return h("section", {}, h("h3", {}, "Lamp"), facts([
    ["Lit", `${lamp.lit ? "yes" : "no"}, ${lamp.hours.toFixed(1)}${lamp.rated_hours == null ? "" : ` of ${lamp.rated_hours}`} hours in all`],
    ["Brightness now", drift ? `${ratio} of the first station's (red, green, blue)` : "not known: no reference patch tells"],
    ["Drift", drift ? `${percent(drift.change)} at most since the first station, ${percent(drift.step)} from one to the next` : ""],
  ]));
}

/// Room on the disk, and what the session may still take of it: its estimate, less the frames that are there.
function disk(s, plan, told) {
  const { disk_free_bytes: free, disk_reserve_bytes: reserve } = rig.status.computer;
  const there = [...told.cells.values()].reduce((sum, { frame }) => sum + (frame?.bytes ?? 0), 0);
  const needs = s && plan && !ended(s) ? Math.max(0, plan.estimated_bytes - there) : null;
  const short = needs != null && free != null && free < needs + reserve;
  return h("section", {}, h("h3", {}, "Disk"), facts([
    ["Free", free == null ? "the system does not tell" : `${bytes(free)}, ${bytes(reserve)} of it kept in reserve`],
    ["This session", needs == null ? "" : `needs up to ${bytes(needs)} more`],
  ]), short ? h("p", { className: "reason" }, "⚠ That is too little: make room, the session waits for it.") : "");
}

function time({ time_budget: budget, simulated }) {
  if (!budget) return "";
  const parts = Object.entries(STAGES).map(([key, name]) => [name, budget[key]]).filter(([, s]) => s > 0).sort((a, b) => b[1] - a[1]);
  const whole = parts.reduce((sum, [, s]) => sum + s, 0) || 1;
  const rows = parts.map(([name, s]) => h("tr", {}, h("th", { scope: "row" }, name), h("td", {}, duration(s)),
    h("td", {}, h("meter", { value: s / whole, "aria-label": `${name}, share of the time` }))));
  // A simulated rig's clock runs fast, this computer's does not: their ratio says nothing.
  const overhead = budget.overhead == null || simulated ? "" : h("p", {}, `Overhead beyond motion, settling, shutter and transfer: ${percent(budget.overhead)}`);
  return h("section", {}, h("h3", {}, `Where the time goes${simulated ? ", by the simulated rig's clock" : ""}`), h("table", { className: "time" }, h("tbody", {}, rows)), overhead);
}

function notes(told) {
  const shown = told.notes.slice(-NOTES_SHOWN).reverse();
  const rest = told.notes.length - shown.length;
  const lines = shown.map((note) => h("span", { className: note.kind }, h("time", { dateTime: note.time }, clockSeconds(note.time)), ` ${note.text}`));
  return list("Refusals and recoveries", rest ? [...lines, `and ${rest} before them`] : lines, "notes");
}

function next(queue) {
  const entry = queue?.entries.find((one) => one.estimated_start);
  if (queue?.held) return h("p", {}, `The queue is held: ${queue.held}. `, h("a", { href: "#/queue" }, "Queue"));
  if (!entry) return "";
  return h("p", {}, `Next: ${entry.request.session.name ?? rig.status.name}, about ${clock(entry.estimated_start)}. `, h("a", { href: "#/queue" }, "Queue"));
}

/// What came of a session that is over, as its result shows it.
function outcome() {
  const box = h("section", { className: "outcome", hidden: true });
  let shown = null;
  const update = async (s) => {
    const wanted = ended(s) && s.mean_relative_error != null ? `${s.id} ${s.last_seq}` : null;
    if (wanted === shown) return;
    shown = wanted;
    box.hidden = !wanted;
    if (!wanted) return;
    const file = await attempt(() => blob(`/v1/sessions/${s.id}/result/preview.png`));
    if (wanted !== shown || !file) return;
    box.replaceChildren(h("h3", {}, "Result"), h("a", { href: `#/results/${s.id}` },
      h("img", { src: file, onload: () => URL.revokeObjectURL(file), alt: `Result of ${s.name}: measured, fitted, and weight maps, a row each` })));
  };
  return { box, update };
}

/// Words for the last frame.
function named(frame) {
  const angle = run.plan?.stations[frame.station]?.angle_deg;
  return `Station ${numbered(frame.station)}${angle == null ? "" : ` at ${degrees(angle)}`}, ${frame.shutter} s, ${clockSeconds(frame.time)}`;
}

export function dashboard(view) {
  let queue = null;
  const parts = Object.fromEntries(["head", "bar", "figures", "warnings", "dome", "notes", "lamp", "disk", "time", "next"].map((name) => [name, h("div", { className: name })]));
  const [asked, calibration, picture, result] = [verbs(), calibrationCard(), lastFrame(), outcome()];
  const progress = h("progress", { max: 1, value: 0, "aria-label": "Frames on disk" });
  const big = h("p", { className: "big" });
  parts.bar.append(big, progress, asked.box);
  const watched = h("div", { className: "columns watch" },
    h("div", {}, parts.bar, parts.warnings, result.box, picture.box, parts.figures, parts.disk, parts.next),
    h("div", {}, parts.dome, parts.lamp, parts.notes, parts.time));
  view.append(calibration.box, parts.head, watched);

  /// No session at all: what is there to be told stands, the rest does not.
  function empty() {
    if (current() || !rig.status) return;
    if (calibrating()) fill(parts.head);
    else fill(parts.head, h("h2", {}, "No session yet"), h("p", {}, h("a", { href: "#/new", className: "action" }, "Plan the first one")));
  }

  function head(session) {
    // What keeps the rig from working stands above already.
    const reason = rig.status?.reasons.includes(session.reason) ? "" : forPeople(session.reason ?? "");
    const links = [h("a", { href: `#/frames/${session.id}` }, "Frames"), h("a", { href: `#/fit/${session.id}` }, "Fit"), h("a", { href: `#/results/${session.id}` }, "Result")];
    const advice = session.state === "interrupted" ? h("p", {}, "Put right what is wrong, then Resume goes on with the stations that are missing.") : "";
    const before = calibrating() ? "Before it: " : "";
    fill(parts.head, h("h2", {}, before, session.name, " ", badge(session.state)), reason && h("p", { className: "reason" }, reason), advice,
      h("p", { className: "verbs" }, links, ended(session) && !calibrating() ? [h("a", { href: "#/new", className: "action" }, "New session")] : []));
  }

  const update = () => {
    watch(current()?.id ?? null);
    const { session, plan, told } = run;
    parts.bar.hidden = !session;
    calibration.update();
    empty();
    if (rig.status) fill(parts.lamp, lamp(session));
    if (rig.status) fill(parts.disk, disk(session, plan, told));
    fill(parts.next, next(queue));
    if (!session) return;
    head(session);
    progress.max = session.frames_planned || 1;
    progress.value = session.frames_committed;
    asked.update();
    big.textContent = gist(session);
    fill(parts.figures, figures(session, plan));
    fill(parts.warnings, list("Warnings", session.warnings.map(forPeople), "warnings"));
    if (plan) fill(parts.dome, diagram());
    fill(parts.notes, notes(told));
    fill(parts.time, time(session));
    result.update(session);
    if (told.frame && rig.status) picture.update(session.id, told.frame, named(told.frame), rig.status.camera.width);
  };
  const look = () => attempt(async () => {
    queue = await ask("/v1/queue");
    update();
  });
  look();
  return { update, look };
}
