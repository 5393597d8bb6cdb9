// A new session: the rig file's plan as it stands or changed, tried dry, then started or queued.
import { ask, attempt, post, say } from "/api.js";
import { dome } from "/dome.js";
import { look, rig } from "/rig.js";
import { bytes, clock, count, duration, facts, fill, h, list, when } from "/show.js";

const QUIET_MS = 400;

/// A labelled field with a hint.
function field(text, input, hint = "") {
  const id = `field-${text.replace(/\W+/g, "-").toLowerCase()}`;
  input.id = id;
  if (hint) input.setAttribute("aria-describedby", `${id}-hint`);
  return h("div", { className: "field" }, h("label", { for: id }, text), input, hint && h("small", { id: `${id}-hint` }, hint));
}

function tick(text, input) {
  return h("label", { className: "tick" }, input, ` ${text}`);
}

const words = (text) => text.split(/[\s,;]+/).filter(Boolean);
const numeric = (input) => (input.value === "" ? undefined : Number(input.value));

export function plan(view, arg) {
  const number = (more) => h("input", { type: "number", ...more });
  const check = () => h("input", { type: "checkbox" });
  const name = h("input", { type: "text", maxLength: 200, autocomplete: "off" });
  const stations = h("textarea", { rows: 3, spellcheck: false });
  const exposures = h("textarea", { rows: 2, spellcheck: false });
  const calibration = h("select", {}, h("option", { value: "" }, "the newest that fits, else the rig file's geometry"), h("option", { value: "none" }, "none: the rig file's geometry"));
  const [fewer, judged] = [check(), check()];
  const leftOut = number({ min: 0.1, max: 100, step: "any", value: 4 });
  const parameter = number({ min: 0.1, max: 100, step: "any", value: 5 });
  const queued = check();
  const runs = number({ min: 1, max: 10000, value: 1 });
  const every = number({ min: 0, max: 527040, step: "any" });
  const notBefore = h("input", { type: "datetime-local" });
  const hold = check();
  queued.checked = arg === "queue";

  const targets = h("div", { className: "inset" }, field("Error on left-out lights, at most, %", leftOut), field("Standard error of every parameter, at most, %", parameter));
  const order = h("div", { className: "inset" }, field("Runs", runs), field("Minutes from start to start", every, "Empty: one after another."),
    field("Not before", notBefore), tick("a run that fails holds the queue", hold));
  const dry = h("div", { className: "dry", "aria-live": "polite" });
  const go = h("button", { type: "submit", className: "primary", disabled: true });
  const form = h("form", { className: "columns" },
    h("div", {},
      field("Name of the sample", name, "Empty: the rig's name."),
      field("Light stations, degrees", stations, "In shooting order, between blanks or commas."),
      field("Exposures", exposures, "Shutter labels as the camera writes them, in shooting order."),
      field("Calibration", calibration),
      h("fieldset", {}, h("legend", {}, "Adaptive capture"),
        tick("leave out exposures that would add nothing", fewer),
        tick("leave out light stations once these targets are met", judged), targets),
      h("fieldset", {}, h("legend", {}, "When"), tick("put it into the queue", queued), order)),
    h("div", {}, h("h3", {}, "Dry run"), dry, go));
  view.append(h("h2", {}, "New session"), form);

  let own = null;       // the rig file's plan, so that what is not changed is not sent
  function request() {
    const asked = {};
    const [angles, labels] = [words(stations.value), words(exposures.value)];
    if (name.value.trim()) asked.name = name.value.trim();
    // What is no number is sent as it is: the daemon says what is wrong with it.
    if (own && angles.join() !== own.stations.map((s) => s.angle_deg).join()) asked.stations_deg = angles.map((a) => (Number.isNaN(+a) ? a : +a));
    if (own && labels.join() !== own.exposures.map((e) => e.label).join()) asked.exposures = labels;
    if (calibration.value) asked.calibration = calibration.value;
    if (fewer.checked || judged.checked) {
      asked.adaptive = { exposures: fewer.checked };
      if (judged.checked) asked.adaptive.lights = { left_out_error: leftOut.value / 100, parameter_error: parameter.value / 100 };
    }
    return asked;
  }

  function entry() {
    const asked = { session: request(), runs: numeric(runs) ?? 1, hold_on_failure: hold.checked };
    if (numeric(every) !== undefined) asked.every_s = 60 * numeric(every);
    if (notBefore.value) asked.not_before = new Date(notBefore.value).toISOString();
    return asked;
  }

  function show(made) {
    const angles = made.stations.map((s) => s.angle_deg);
    const travel = rig.status?.arm?.travel_deg ?? [Math.min(...angles), Math.max(...angles)];
    const paced = rig.status?.simulated ? " of the simulated rig's own time" : `, until about ${clock(Date.now() + 1000 * made.estimated_s)}`;
    fill(dry, facts([
      ["Frames", `${count(made.frames, "frame")}: ${count(angles.length, "station")}, ${count(made.exposures.length, "exposure")} each`],
      ["Takes", duration(made.estimated_s) + paced + (made.adaptive ? ", less what is left out" : "")],
      ["Disk space", bytes(made.estimated_bytes)],
      ["Calibration", made.calibration ? `${made.calibration.version} of ${when(made.calibration.made)}` : "the rig file's geometry"],
    ]), list("Warnings", made.warnings, "warnings"), dome(angles, travel, null, () => "todo", `Light dome: ${count(angles.length, "station")}`));
  }

  let latest = null;    // the last dry run that was no refusal
  let asked = 0;
  async function tryDry() {
    const turn = ++asked;
    go.disabled = true;
    go.textContent = queued.checked ? "Put into the queue" : "Start";
    targets.hidden = !judged.checked;
    order.hidden = !queued.checked;
    await attempt(async () => {
      const made = await post("/v1/sessions?dry_run=true", request());
      if (turn !== asked) return;
      if (!own) adopt(made);
      latest = made;
      show(made);
      go.disabled = false;
    }, (reasons) => {
      if (turn !== asked) return;
      latest = null;
      fill(dry, list("Refused", reasons.split("\n"), "warnings"));
    });
  }

  /// The first dry run is of the rig file's own plan.
  function adopt(made) {
    own = made;
    stations.value = made.stations.map((s) => s.angle_deg).join(", ");
    exposures.value = made.exposures.map((e) => e.label).join(", ");
  }

  let waiting = null;
  form.oninput = () => {
    go.disabled = true;
    clearTimeout(waiting);
    waiting = setTimeout(tryDry, QUIET_MS);
  };
  form.onsubmit = (event) => {
    event.preventDefault();
    go.disabled = true;
    attempt(async () => {
      say();
      if (queued.checked) await post("/v1/queue", entry());
      else await post("/v1/sessions", request(), { "Idempotency-Key": crypto.randomUUID() });
      await look();
      location.hash = queued.checked ? "#/queue" : "#/";
    }).finally(() => { go.disabled = false; });
  };

  attempt(async () => {
    const { calibrations } = await ask("/v1/calibrations");
    const whole = calibrations.filter((one) => one.state === "completed" && one.kind === "rig");
    calibration.append(...whole.map((one) => h("option", { value: one.id }, `${one.version} of ${when(one.ended)}`)));
  });
  tryDry();
  return { update: () => latest && show(latest) };
}
