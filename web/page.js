// The page shows what the daemon says and remembers nothing: views by hash, what stands above all of them, and the looking again.
import { announce, attempt, line, say, useToken } from "/api.js";
import { showCalibration } from "/calibration.js";
import { compare } from "/compare.js";
import { dashboard } from "/dashboard.js";
import { frames } from "/frames.js";
import { health } from "/health.js";
import { history } from "/history.js";
import { live } from "/live.js";
import { plan } from "/plan.js";
import { queue } from "/queue.js";
import { results, viewer } from "/results.js";
import { ended, listen, look, rig, running } from "/rig.js";
import { run, watch } from "/run.js";
import { settings } from "/settings.js";
import { $, forPeople, h, state } from "/show.js";
import { armStop, showStop } from "/verbs.js";

const VIEWS = {
  "": ["Dashboard", dashboard], new: ["New session", plan], queue: ["Queue", queue],
  frames: ["Frames", frames], fit: ["Fit", live], results: ["Results", results], history: ["History", history], compare: ["Compare", compare],
  health: ["Health", health], settings: ["Settings", settings],
  viewer: ["Viewer", viewer, "Results"],      // the third: reached from there, not by a link of its own
};
/// An address that is none.
function unknown(view) {
  view.append(h("h2", {}, "No such view"), h("p", {}, `Nothing is at ${location.hash}. `, h("a", { href: "#/" }, "Go to the dashboard")));
  return {};
}

const LOOK_MS = 5000;
let view = {};
let shown = "";

$("views").append(...Object.entries(VIEWS).filter(([, [, , under]]) => !under).map(([key, [title]]) => h("li", {}, h("a", { href: `#/${key}` }, title))));

/// Opens the view that the address names.
function open() {
  const [, key = "", ...args] = location.hash.split("/");
  const [title, make, under = title] = Object.hasOwn(VIEWS, key) ? VIEWS[key] : ["No such view", unknown];
  view.close?.();
  say();
  $("view").replaceChildren();
  view = make($("view"), ...args.map((arg) => arg || undefined));
  for (const link of $("views").querySelectorAll("a")) {
    if (link.textContent === under) {
      link.setAttribute("aria-current", "page");
      link.scrollIntoView({ block: "nearest", inline: "center" });
    } else link.removeAttribute("aria-current");
  }
  shown = title;
  update();
}

function showRig() {
  const { status } = rig;
  if (!status) return;
  $("rig").textContent = status.name;
  $("simulated").hidden = !status.simulated;
  $("not-ready").hidden = status.ready;
  $("not-ready").textContent = `Not ready: ${status.reasons.map(forPeople).join("; ")}`;
}

/// What is worth saying aloud: the state and the last thing that went wrong or was put right, not every frame.
function tellAloud() {
  const { session, told } = run;
  if (!session) return;
  const note = told.notes.at(-1);
  announce(`${session.name}: ${state(session.state)}${note && session.id === running()?.id ? `; ${note.text}` : ""}`);
}

function showTitle() {
  const held = running();
  const part = held ? `${held.state === "running" ? `${Math.round((100 * held.frames_committed) / (held.frames_planned || 1))} %` : held.state}, ` : "";
  document.title = `${part}${shown} – rigd`;
}

function update() {
  showRig();
  showStop();
  if (rig.status) showCalibration(shown === "Dashboard");
  showTitle();
  view.update?.();
  tellAloud();
}

function showLine() {
  const age = Math.round((Date.now() - line.heard) / 1000);
  const words = line.lost ? "disconnected" : "connected";
  if ($("connection").textContent !== words) $("connection").textContent = words;
  $("age").textContent = line.lost ? `figures are ${age} s old` : "";
  $("connection").classList.toggle("stale", line.lost);
}

/// Readiness has no event; this also finds sessions that others start, and a daemon that is back.
async function poll() {
  await attempt(look);
  // The stream of an ended session is over; somebody may have taken the session up again.
  if (running()?.id === run.id && run.session && ended(run.session)) watch(run.id, true);
  view.look?.();
}

$("login").onsubmit = (event) => {
  event.preventDefault();
  useToken($("token").value.trim());
};
$("skip").onclick = (event) => {
  event.preventDefault();
  $("view").focus();
};

armStop();
listen(update);
addEventListener("hashchange", () => {
  open();
  $("view").focus({ preventScroll: true });
});
setInterval(showLine, 500);
setInterval(poll, LOOK_MS);
open();
poll();
