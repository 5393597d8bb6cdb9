// What holds for the whole rig, looked at again every few seconds: readiness, newest sessions, a calibration that has the rig.
import { ask } from "/api.js";

export const FINAL = ["completed", "stopped", "aborted", "halted", "failed", "interrupted"];
export const ended = (run) => FINAL.includes(run.state);
const PAGE = 20;

export const rig = { status: null, sessions: [], next: null, calibrations: [], running: null, heard: 0 };

const listeners = [];
let told = false;
/// Calls `listener` after every change, no more than ten times a second.
export const listen = (listener) => listeners.push(listener);
export function tell() {
  if (told) return;
  told = true;
  setTimeout(() => {
    told = false;
    listeners.forEach((listener) => listener());
  }, 100);
}

/// Asks for everything anew.
export async function look() {
  const status = await ask("/v1/rig");
  const heard = Date.now();
  const [page, { calibrations }] = await Promise.all([ask(`/v1/sessions?max_page_size=${PAGE}`), ask("/v1/calibrations")]);
  const shown = new Set(page.sessions.map((session) => session.id));
  const older = rig.sessions.filter((session) => !shown.has(session.id) && session.id < (page.sessions.at(-1)?.id ?? ""));
  // A session that is gone from the first page was removed; those of later pages were asked for by the user.
  if (!older.length) rig.next = page.next_page_token ?? null;
  rig.sessions = [...page.sessions, ...older];
  const holds = (one) => one.id === status.running;
  const session = status.running && !calibrations.some(holds);
  // An old session that was taken up again is on no first page.
  const held = session ? page.sessions.find(holds) ?? await ask(`/v1/sessions/${status.running}`) : null;
  Object.assign(rig, { status, calibrations, running: held, heard });
  tell();
}

/// One more page of older sessions.
export async function lookBack() {
  const page = await ask(`/v1/sessions?max_page_size=${PAGE}&page_token=${rig.next}`);
  rig.sessions = [...rig.sessions, ...page.sessions];
  rig.next = page.next_page_token ?? null;
  tell();
}

/// The session that has the rig; the calibration that has it.
export const running = () => rig.running;
export const calibrating = () => rig.calibrations.find((run) => run.id === rig.status.running);
/// The session to watch: the one that runs, else the newest.
export const current = () => running() ?? rig.sessions[0];
