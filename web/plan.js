// A new session: the rig file's plan as it stands or changed, tried dry, then started or queued.
import { ask, attempt, post, say } from "/api.js";
import { busy, calibration as told, checks, table } from "/checks.js";
import { dome } from "/dome.js";
import { mark, sorted, typed } from "/mistakes.js";
import { look, rig } from "/rig.js";
import { bytes, clock, count, duration, facts, fill, forPeople, h, list, when } from "/show.js";

const QUIET_MS = 400;

/// A labelled field with a hint.
function field(text, input, hint = "") {
  const id = `field-${text.replace(/\W+/g, "-").toLowerCase()}`;
  input.id = id;
  input.setAttribute("aria-describedby", `${id}-hint ${id}-wrong`);
  return h("div", { className: "field" }, h("label", { for: id }, text), input, h("small", { id: `${id}-wrong`, className: "wrong", hidden: true }),
    h("small", { id: `${id}-hint` }, hint));
}

function tick(text, input) {
  return h("label", { className: "tick" }, input, ` ${text}`);
}

/// Names one start, so that it is made once; `randomUUID` is only there where the page came over TLS or from this machine.
const key = () => [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
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
  const fields = {
    name: field("Name of the sample", name, "Empty: the rig's name."),
    stations_deg: field("Light stations, degrees", stations, "In shooting order, between blanks or commas."),
    exposures: field("Exposures", exposures, "Shutter labels as the camera writes them, in shooting order."),
    adaptive: h("fieldset", {}, h("legend", {}, "Adaptive capture"),
      tick("leave out exposures that would add nothing", fewer),
      tick("leave out light stations once these targets are met", judged), h("small", { className: "wrong", hidden: true }), targets),
    calibration: field("Calibration", calibration),
  };
  const [used, preflight, held] = [h("p", { className: "small" }), h("div", { className: "preflight" }), h("p", { className: "banner", hidden: true })];
  const form = h("form", { className: "columns" },
    h("div", {},
      h("h3", {}, "1. Sample and plan"), fields.name, fields.stations_deg, fields.exposures, fields.adaptive,
      h("h3", {}, "2. Calibration"), fields.calibration, used,
      h("h3", {}, "3. When"), h("fieldset", {}, h("legend", {}, "Queue"), tick("put it into the queue", queued), order)),
    h("div", {}, h("h3", {}, "4. What it takes"), dry, h("h3", {}, "5. Before it starts"), preflight, go));
  view.append(h("h2", {}, "New session"), held, form);

  let own = null;       // the rig file's plan, so that what is not changed is not sent
  function request() {
    const asked = {};
    const [angles, labels] = [words(stations.value), words(exposures.value)];
    if (name.value.trim()) asked.name = name.value.trim();
    if (own && angles.join() !== own.stations.map((s) => s.angle_deg).join()) asked.stations_deg = angles.map(Number);
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

  let speed = 1;        // how many times faster than real a simulated rig's time runs
  function takes({ estimated_s: s, adaptive }) {
    const less = adaptive ? ", less what is left out" : "";
    const real = s / speed;
    const fast = speed === 1 ? "" : ` by the simulated rig's clock, which runs ${speed} times as fast`;
    return [["Takes", duration(s) + fast + less], ["Ends about", queued.checked ? `${duration(real)} after it starts` : clock(Date.now() + 1000 * real)]];
  }

  function show(made) {
    const angles = made.stations.map((s) => s.angle_deg);
    const { arm, computer } = rig.status ?? {};
    const travel = arm?.travel_deg ?? [Math.min(...angles), Math.max(...angles)];
    const free = computer?.disk_free_bytes == null ? "" : `, ${bytes(computer.disk_free_bytes)} free`;
    fill(dry, facts([
      ["Frames", `${count(made.frames, "frame")}: ${count(angles.length, "station")}, ${count(made.exposures.length, "exposure")} each`],
      ...takes(made),
      ["Disk space", `${bytes(made.estimated_bytes)} needed${free}`],
    ]), dome(angles, travel, null, () => "todo", `Light dome: ${count(angles.length, "station")}`));
    const [, words] = told(made.calibration, made.warnings);
    used.textContent = `It would use ${made.calibration ? `${words} (${when(made.calibration.made)})` : "the rig file's geometry: nothing was calibrated"}`;
    if (rig.status) fill(preflight, table(checks(made)), list("Warnings", made.warnings.map(forPeople), "warnings"));
  }

  /// While something has the rig, a session can only wait for it.
  let took = false;     // the queue was offered, once
  function offer() {
    const words = busy();
    held.hidden = !words;
    held.textContent = words && `The rig is ${words}. This session can wait for it in the queue.`;
    if (words && !took && !queued.checked) {
      queued.checked = true;
      order.hidden = false;
    }
    took ||= Boolean(words);
    go.textContent = queued.checked ? "Put into the queue" : "Start";
    go.disabled = !latest || (Boolean(words) && !queued.checked);
  }

  function refuse(found) {
    latest = null;
    mark(fields, found);
    const beside = Object.keys(found).some((name) => name);
    fill(dry, beside ? h("p", { className: "wrong" }, "Not possible yet: see what stands in red beside the fields.") : "", list("Refused", found[""] ?? [], "warnings"));
    offer();
  }

  let latest = null;    // the last dry run that was no refusal
  let asked = 0;
  async function tryDry() {
    const turn = ++asked;
    go.disabled = true;
    targets.hidden = !judged.checked;
    order.hidden = !queued.checked;
    const wrong = own ? typed(words(stations.value), judged.checked ? [leftOut, parameter] : []) : {};
    if (Object.keys(wrong).length) return refuse(wrong);
    await attempt(async () => {
      const made = await post("/v1/sessions?dry_run=true", request());
      if (turn !== asked) return;
      if (!own) adopt(made);
      latest = made;
      mark(fields, {});
      show(made);
      offer();
    }, (reasons) => turn === asked && refuse(sorted(reasons.split("\n"))));
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
      else await post("/v1/sessions", request(), { "Idempotency-Key": key() });
      await look();
      location.hash = queued.checked ? "#/queue" : "#/";
    }).finally(offer);
  };

  attempt(async () => {
    const { calibrations } = await ask("/v1/calibrations");
    const whole = calibrations.filter((one) => one.state === "completed" && one.kind === "rig");
    calibration.append(...whole.map((one) => h("option", { value: one.id }, `${one.version} of ${when(one.ended)}`)));
  });
  attempt(async () => {
    const { settings } = await ask("/v1/settings");
    speed = settings.find((one) => one.key === "simulation.speed")?.value ?? 1;
    if (latest) show(latest);
  });
  tryDry();
  return { update: () => {
    if (!rig.status) return;
    offer();
    if (latest) show(latest);
  } };
}
