// A calibration that has the rig: what it asks for, and its two buttons.
import { attempt, post, say } from "/api.js";
import { calibrating, look } from "/rig.js";
import { abort } from "/verbs.js";
import { $, badge, clock, fill, h, list } from "/show.js";

const title = (run) => `Calibration ${run.version}`;

/// Tells of it above every view but the one that shows it whole.
export function showCalibration(whole) {
  const box = $("calibrating");
  const run = calibrating();
  box.hidden = !run || whole;
  if (!run) return;
  const asked = run.state === "awaiting" ? ` waits for you: ${run.instruction ?? ""}` : " has the rig";
  fill(box, `${title(run)} (${run.steps_accepted} of ${run.steps} steps)${asked} `, h("a", { href: "#/" }, "Go there"));
}

/// The whole of it, for the dashboard.
export function calibrationCard() {
  const [head, verdicts] = [h("div", {}), h("div", {})];
  const progress = h("progress", { max: 1, value: 0, "aria-label": "Steps accepted" });
  const path = (verb) => `/v1/calibrations/${calibrating().id}/${verb}`;
  const shoot = h("button", { type: "button", className: "primary", onclick: () => attempt(async () => {
    say();
    shoot.disabled = true;
    await post(path("shoot"));
    await look();
  }) }, "Shoot this step");
  const end = h("button", { type: "button", "data-verb": "abort", onclick: () => abort(path("abort"), `calibration ${calibrating().version}`) }, "Abort");
  const box = h("section", { className: "calibration", hidden: true }, head, progress, h("p", { className: "verbs" }, shoot, end), verdicts);
  const update = () => {
    const run = calibrating();
    box.hidden = !run;
    if (!run) return;
    const waits = run.state === "awaiting";
    fill(head, h("h2", {}, `${title(run)}: ${run.name} `, badge(run.state)),
      run.instruction ? h("p", { className: "big" }, run.instruction) : "", run.reason ? h("p", { className: "reason" }, run.reason) : "",
      h("p", {}, `${run.steps_accepted} of ${run.steps} steps accepted, ${run.frames_committed} of ${run.frames_planned} frames on disk; begun ${clock(run.started)}`));
    [progress.max, progress.value] = [run.steps, run.steps_accepted];
    [shoot.disabled, end.disabled] = [!waits, run.state === "aborting"];
    const lines = run.verdicts.slice(-8).reverse().map((one) => `${clock(one.time)}: ${one.accepted ? "accepted" : `refused: ${one.reason}`}`);
    fill(verdicts, list("Steps shot", lines));
  };
  return { box, update };
}
