// What can be asked of a run: pause, resume, stop, abort. Stop is on every view, and goes on trying until it has reached the daemon.
import { Unreachable, ask, attempt, post, say } from "/api.js";
import { calibrating, ended, look, running } from "/rig.js";
import { run, watch } from "/run.js";
import { $, h } from "/show.js";

const SHOOTING = ["preflight", "running", "pausing", "paused", "suspended"];
const POSSIBLE = {
  pause: ["running"],
  resume: ["pausing", "paused", "suspended", "interrupted"],
  abort: [...SHOOTING, "fitting", "stopping"],
};

/// Asks once whether that is meant.
export function confirmed(question, yes) {
  $("question").textContent = question;
  $("yes").textContent = yes;
  $("confirm").returnValue = "no";
  $("confirm").showModal();
  return new Promise((answer) => { $("confirm").onclose = () => answer($("confirm").returnValue === "yes"); });
}

const command = (path) => attempt(async () => {
  say();
  await post(path);
  await look();
});

export async function abort(path, name) {
  if (await confirmed(`Abort ${name}? It ends now, and nothing of it is fitted. Frames stay on disk.`, "Abort")) await command(path);
}

/// Pause, resume and abort of the session that is watched.
export function verbs() {
  const button = (verb, text, act) => h("button", { type: "button", onclick: act, "data-verb": verb }, text);
  const path = (verb) => `/v1/sessions/${run.id}/${verb}`;
  const buttons = [
    button("pause", "Pause", () => command(path("pause"))),
    button("resume", "Resume", async () => {
      await command(path("resume"));
      watch(run.id, true);
    }),
    button("abort", "Abort", () => abort(path("abort"), run.session.name)),
  ];
  const update = () => buttons.forEach((one) => {
    one.disabled = !run.session || !POSSIBLE[one.dataset.verb].includes(run.session.state);
    // What a session that is over cannot be asked is not there.
    one.hidden = one.disabled && run.session != null && ended(run.session);
  });
  return { box: h("p", { className: "verbs" }, buttons), update };
}

let stopping = false;

/// It was asked to stop or to abort, and the rig has not ended yet.
export const isEnding = (session) => ["stopping", "aborting"].includes(session?.state);
export const ENDING = "Stopping: waits for the frame in the camera";


/// Stops whatever has the rig, by what the daemon says now and not by what the page knows.
async function stopNow() {
  const { running: id } = await ask("/v1/rig");
  if (!id) return say("Nothing is running: there is nothing to stop.");
  const { calibrations } = await ask("/v1/calibrations");
  const calibration = calibrations.find((one) => one.id === id);
  if (calibration) return abort(`/v1/calibrations/${id}/abort`, `calibration ${calibration.version}`);
  // Asked already: a second press changes nothing.
  if (isEnding(await ask(`/v1/sessions/${id}`))) return null;
  return post(`/v1/sessions/${id}/stop`);
}

async function stop() {
  if (stopping) return;
  stopping = true;
  say();
  showStop();
  for (let tries = 1; stopping; tries++) {
    try {
      await stopNow();
      stopping = false;
      if (tries > 1) say("Stop has reached the rig.");
    } catch (error) {
      if (!(error instanceof Unreachable)) {
        stopping = false;
        say(error.message);
      } else {
        say(`Stop has NOT reached the rig yet: the daemon does not answer. Tried ${tries} times, again every second; lamp and motor have a switch of their own.`);
        await new Promise((later) => setTimeout(later, 1000));
      }
    }
  }
  showStop();
  await attempt(look);
}

/// Stop can be pressed always; what it would stop stands beside it.
export function showStop() {
  const held = running() ?? calibrating();
  const ends = isEnding(held);
  $("stop").textContent = stopping || ends ? "Stopping …" : "Stop";
  $("stop").classList.toggle("idle", !held && !stopping);
  $("running").textContent = !held ? "nothing runs" : ends ? "waits for the frame in the camera" : held.name;
}

export const armStop = () => { $("stop").onclick = stop; };
