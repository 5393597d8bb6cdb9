// The run that goes on, at one glance; the newest one when none does.
import { ask, attempt } from "/api.js";
import { dome, legend } from "/dome.js";
import { fate } from "/journal.js";
import { current, ended, rig } from "/rig.js";
import { active, run, watch } from "/run.js";
import { badge, clock, count, degrees, duration, facts, fill, h, leftOut, list, percent, when } from "/show.js";
import { verbs } from "/verbs.js";

const STAGES = {
  preparation_s: "getting ready", motion_s: "arm moves", settling_s: "arm settles", shutter_s: "shutter open", transfer_s: "transfer",
  camera_s: "camera", storing_s: "checking, storing", recovery_s: "shot again, brought back", held_s: "paused, waiting", other_s: "all else",
};
const NOTES_SHOWN = 30;

/// What is asked most at night.
function gist(s) {
  const frames = `${s.frames_committed} of ${s.frames_planned} frames`;
  if (ended(s) || s.remaining_s == null) return frames;
  return `${frames}, ends about ${clock(run.at + 1000 * s.remaining_s)}`;
}

/// Station and times.
function figures(s, plan) {
  const over = ended(s);
  const angle = plan?.stations[s.station]?.angle_deg;
  const at = angle == null ? "" : ` at ${degrees(angle)}`;
  const end = s.remaining_s == null ? "not known yet" : `${clock(run.at + 1000 * s.remaining_s)}, in ${duration(s.remaining_s)}`;
  return facts([
    ["Station", over ? count(s.stations, "station") : `${s.station}${at}, of ${s.stations} numbered from 0`],
    ["Developed", `${s.stations_developed} of ${s.stations} stations`],
    ["Started", clock(s.started)],
    [over ? "Ended" : "Ends about", over ? s.ended && clock(s.ended) : end],
    ["Refused, shot again", s.refused ? String(s.refused) : "none"],
    ["Calibration", s.calibration ? `${s.calibration.version} of ${when(s.calibration.made)}` : "none: the rig file's geometry"],
    ["Left out", s.saved?.exposures ? leftOut(s.saved) : ""],
    ["Mean relative error", s.mean_relative_error == null ? "" : percent(s.mean_relative_error)],
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
  const words = `Light dome: ${done} of ${angles.length} stations on disk${now == null ? "" : `, station ${now} at ${degrees(angles[now])} being shot`}`;
  const travel = rig.status?.arm?.travel_deg ?? [Math.min(...angles), Math.max(...angles)];
  return h("figure", {}, dome(angles, travel, now, (i) => marks[i], words), h("figcaption", {}, legend));
}

function lamp(s) {
  const { lamp } = rig.status;
  const drift = s?.lamp_drift;
  return h("section", {}, h("h3", {}, "Lamp"), facts([
    ["Lit", lamp.lit ? "yes" : "no"],
    ["Hours", lamp.hours.toFixed(1) + (lamp.rated_hours == null ? "" : ` of ${lamp.rated_hours}`)],
    ["Drift", drift ? `${percent(drift.change)} since the first station, at most ${percent(drift.step)} from one to the next` : "not told: no reference patch"],
  ]));
}

function time(budget) {
  if (!budget) return "";
  const parts = Object.entries(STAGES).map(([key, name]) => [name, budget[key]]).filter(([, s]) => s > 0).sort((a, b) => b[1] - a[1]);
  const whole = parts.reduce((sum, [, s]) => sum + s, 0) || 1;
  const rows = parts.map(([name, s]) => h("tr", {}, h("th", { scope: "row" }, name), h("td", {}, duration(s)),
    h("td", {}, h("meter", { value: s / whole, "aria-label": `${name}, share of the time` }))));
  const overhead = budget.overhead == null ? "" : h("p", {}, `Overhead beyond motion, settling, shutter and transfer: ${percent(budget.overhead)}`);
  return h("section", {}, h("h3", {}, "Where the time goes"), h("table", { className: "time" }, h("tbody", {}, rows)), overhead);
}

function notes(told) {
  const shown = told.notes.slice(-NOTES_SHOWN).reverse();
  const rest = told.notes.length - shown.length;
  const lines = shown.map((note) => h("span", { className: note.kind }, h("time", { dateTime: note.time }, clock(note.time)), ` ${note.text}`));
  return list("Refusals and recoveries", rest ? [...lines, `and ${rest} before them`] : lines, "notes");
}

function next(queue) {
  const entry = queue?.entries.find((one) => one.estimated_start);
  if (queue?.held) return h("p", {}, `The queue is held: ${queue.held}. `, h("a", { href: "#/queue" }, "Queue"));
  if (!entry) return "";
  return h("p", {}, `Next: ${entry.request.session.name ?? rig.status.name}, about ${clock(entry.estimated_start)}. `, h("a", { href: "#/queue" }, "Queue"));
}

export function dashboard(view) {
  let queue = null;
  const parts = Object.fromEntries(["head", "bar", "figures", "warnings", "dome", "notes", "lamp", "time", "next"].map((name) => [name, h("div", { className: name })]));
  const asked = verbs();
  const progress = h("progress", { max: 1, value: 0, "aria-label": "Frames on disk" });
  const big = h("p", { className: "big" });
  parts.bar.append(big, progress, asked.box);
  view.append(parts.head, h("div", { className: "columns watch" },
    h("div", {}, parts.bar, parts.warnings, parts.notes, parts.figures, parts.next),
    h("div", {}, parts.dome, parts.lamp, parts.time)));

  const update = () => {
    watch(current()?.id ?? null);
    const { session, plan, told } = run;
    parts.bar.hidden = !session;
    if (!current() && rig.status) {
      fill(parts.head, h("h2", {}, "No session yet"), h("p", {}, h("a", { href: "#/new", className: "action" }, "Plan the first one")));
    }
    if (rig.status) fill(parts.lamp, lamp(session));
    fill(parts.next, next(queue));
    if (!session) return;
    // What keeps the rig from working stands above already.
    const reason = rig.status?.reasons.includes(session.reason) ? "" : session.reason ?? "";
    const links = [h("a", { href: `#/frames/${session.id}` }, "Frames"), h("a", { href: `#/fit/${session.id}` }, "Fit"), h("a", { href: `#/results/${session.id}` }, "Result")];
    const advice = session.state === "interrupted" ? h("p", {}, "Put right what is wrong, then Resume goes on with the stations that are missing.") : "";
    fill(parts.head, h("h2", {}, session.name, " ", badge(session.state)), reason && h("p", { className: "reason" }, reason), advice,
      h("p", { className: "verbs" }, links, ended(session) ? [h("a", { href: "#/new", className: "action" }, "New session")] : []));
    progress.max = session.frames_planned || 1;
    progress.value = session.frames_committed;
    asked.update();
    big.textContent = gist(session);
    fill(parts.figures, figures(session, plan));
    fill(parts.warnings, list("Warnings", session.warnings, "warnings"));
    if (plan) fill(parts.dome, diagram());
    fill(parts.notes, notes(told));
    fill(parts.time, time(session.time_budget));
  };
  const look = () => attempt(async () => {
    queue = await ask("/v1/queue");
    update();
  });
  look();
  return { update, look };
}
