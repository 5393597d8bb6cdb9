// What a session needs, check by check, from what GET /v1/rig says: on Health, and before a session is started.
import { calibrating, rig, running } from "/rig.js";
import { bytes, clock, count, duration, forPeople, h, when } from "/show.js";

const CLOCK_S = 30;     // a clock that is farther from this device's is told
const WORDS = { good: "✓ fine", warn: "⚠ look at it", bad: "✕ wrong", open: "– not known", none: "– none" };

const said = (texts, pattern) => texts.filter((text) => pattern.test(text)).join("; ");

function disk({ computer }, needed) {
  const { disk_free_bytes: free, disk_reserve_bytes: reserve } = computer;
  if (free == null) return ["open", "the system does not tell"];
  const words = `${bytes(free)} free`;
  if (needed == null) return ["good", words];
  return [free >= needed + reserve ? "good" : "bad", `${words}, ${bytes(needed)} needed and ${bytes(reserve)} kept in reserve`];
}

function memory({ computer, own_plan: own }) {
  const has = computer.memory_bytes;
  if (has == null || !own) return ["open", "the system does not tell"];
  return [has >= own.memory_bytes ? "good" : "warn", `${bytes(has)} free, developing and fitting the rig file's plan take up to ${bytes(own.memory_bytes)}`];
}

function time({ computer }, warnings) {
  const wrong = said(warnings, /clock/);
  if (wrong) return ["warn", wrong];
  const apart = (Date.parse(computer.time) - rig.heard) / 1000;
  return Math.abs(apart) < CLOCK_S ? ["good", clock(computer.time)] : ["warn", `${clock(computer.time)}, ${duration(Math.abs(apart))} ${apart < 0 ? "behind" : "ahead of"} this device: set whichever is wrong`];
}

/// A device's fault, as the daemon last met it; without one it was fine then.
function device(pattern, reasons, fine) {
  const wrong = said(reasons, pattern);
  return wrong ? ["bad", forPeople(wrong)] : ["good", fine];
}

const SUPPLIES = /battery|card takes/;
function supplies(latest) {
  const wrong = latest && said([...latest.warnings, latest.reason ?? ""], SUPPLIES);
  if (wrong) return ["warn", `at the last session: ${wrong}`];
  return ["open", `the camera is asked when a session starts${latest ? `; nothing spoke against ${latest.name} (${when(latest.started)})` : ""}`];
}

function lamp({ lamp: { lit, hours, rated_hours: rated }, running: held }) {
  const words = `${lit ? "lit" : "off"}, ${hours.toFixed(1)}${rated == null ? "" : ` of ${rated}`} hours`;
  return [(rated != null && hours > rated) || (lit && !held) ? "warn" : "good", words];
}

/// A calibration that is used, with its age; and what speaks against it.
export function calibration(used, warnings = []) {
  if (!used) return ["none", "the rig file's geometry serves"];
  const age = (Date.now() - Date.parse(used.made)) / 1000;
  const stale = said(warnings, /calibrat/);
  return [stale ? "warn" : "good", `number ${used.version}, ${age < 172800 ? duration(age) : count(Math.floor(age / 86400), "day")} old${stale ? `: ${stale}` : ""}`];
}

/// Rows of name, state and figure. `plan`: a session's dry run, else the rig file's own.
export function checks(plan) {
  const { status } = rig;
  const own = status.own_plan;
  const { warnings = [], calibration: used } = plan ?? own ?? {};
  const reasons = status.reasons.filter((reason) => !/bytes are needed/.test(reason));
  return [
    ["Disk", ...disk(status, plan?.estimated_bytes ?? own?.disk_bytes)],
    ["Memory", ...memory(status)],
    ["Clock", ...time(status, warnings)],
    ["Arm", ...device(/\barm\b/i, reasons, `no fault known; ${status.arm.driver}, travels from ${status.arm.travel_deg[0]}° to ${status.arm.travel_deg[1]}°`)],
    ["Camera", ...device(/\bcamera\b/i, reasons, `no fault known; ${status.camera.driver}, ${status.camera.width} x ${status.camera.height} pixels`)],
    ["Battery, card", ...(status.camera.driver === "gphoto2" ? supplies(rig.sessions[0]) : ["none", "no camera is on a cable"])],
    ["Lamp", ...lamp(status)],
    ["Calibration", ...calibration(used, warnings)],
  ];
}

export function table(rows) {
  return h("table", { className: "checks" }, h("caption", { className: "unseen" }, "Checks"),
    h("thead", { className: "unseen" }, h("tr", {}, ["check", "state", "figure"].map((title) => h("th", { scope: "col" }, title)))),
    h("tbody", {}, rows.map(([name, kind, figure]) => h("tr", {}, h("th", { scope: "row" }, name), h("td", { className: `check ${kind}` }, WORDS[kind]), h("td", {}, figure)))));
}

/// Who has the rig and until when; nothing while it is free.
export function busy() {
  const session = running();
  if (session) {
    const end = session.remaining_s == null ? "" : ` until about ${clock(Date.now() + 1000 * session.remaining_s)}`;
    return `busy with ${session.name}${end}`;
  }
  const run = rig.status && calibrating();
  return run ? `busy with calibration ${run.version}, ${run.steps_accepted} of ${run.steps} steps done` : "";
}
