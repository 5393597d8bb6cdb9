// Every frame of a session: a row a light station, a column an exposure.
import { attempt, blob } from "/api.js";
import { cell, fate } from "/journal.js";
import { current } from "/rig.js";
import { active, run, watch } from "/run.js";
import { badge, bytes, clock, degrees, facts, fill, forPeople, h, list, numbered } from "/show.js";

const SIGNS = { done: "●", again: "↻", refused: "✕", left: "–", todo: "·" };
const WORDS = { done: "on disk", again: "on disk, shot again", refused: "refused, to be shot again", left: "left out", todo: "to come" };

export function frames(view, id) {
  const head = h("div", {});
  const table = h("table", { className: "grid", role: "grid", "aria-label": "Frames, a row a light station, a column an exposure" });
  const chosen = h("section", { className: "chosen", "aria-live": "polite" });
  const legend = Object.entries(SIGNS).map(([kind, sign]) => h("span", {}, h("b", { className: kind, "aria-hidden": "true" }, sign), ` ${WORDS[kind]}`));
  view.append(head, h("p", { className: "legend" }, legend.flatMap((one) => [one, " "])), h("div", { className: "columns wide" }, h("div", { className: "scroll" }, table), chosen));
  let made = null;      // the session the table was made for
  let buttons = [];     // by station, then exposure
  let picked = null;    // the cell whose facts are shown, and how it stood
  let picture = null;

  /// Arrow keys go from cell to cell; one cell alone is in the order of the tab key.
  function move(event, station, exposure) {
    const step = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] }[event.key];
    const to = step && buttons[station + step[0]]?.[exposure + step[1]];
    if (!to) return;
    event.preventDefault();
    event.currentTarget.tabIndex = -1;
    to.tabIndex = 0;
    to.focus();
  }

  function make() {
    const { stations, exposures } = run.plan;
    made = run.id;
    buttons = stations.map((_, station) => exposures.map((_, exposure) => h("button", {
      type: "button", tabIndex: station + exposure ? -1 : 0,
      onclick: () => pick(station, exposure), onkeydown: (event) => move(event, station, exposure),
    })));
    table.replaceChildren(
      h("thead", {}, h("tr", { role: "row" }, h("th", { scope: "col", role: "columnheader" }, "Station"), exposures.map((e) => h("th", { scope: "col", role: "columnheader" }, e.label)))),
      h("tbody", {}, stations.map((s, i) => h("tr", { role: "row" }, h("th", { scope: "row", role: "rowheader" }, `${numbered(i)}: ${degrees(s.angle_deg)}`),
        buttons[i].map((button) => h("td", { role: "gridcell" }, button))))));
  }

  function pick(station, exposure) {
    picked = { station, exposure, shown: "" };
    showPicked();
  }

  function showPicked() {
    if (!picked) return fill(chosen, h("p", {}, "Choose a frame for what is known of it."));
    const { station, exposure } = picked;
    const { frame, refusals, earlier } = cell(run.told, station, exposure);
    const shown = `${frame?.file} ${refusals.length} ${earlier}`;
    if (picked.shown === shown) return;
    picked.shown = shown;
    const kind = fate(run.told, station, exposure);
    const { stations, exposures } = run.plan;
    const figure = h("figure", {});
    chosen.replaceChildren(h("h3", {}, `Station ${numbered(station)}, exposure ${numbered(exposure)} (${exposures[exposure].label} s): ${WORDS[kind]}`), facts([
      ["Angle planned", degrees(stations[station].angle_deg)],
      ["Angle by the arm", frame?.angle_deg == null ? "" : `${frame.angle_deg.toFixed(2)}°`],
      ["Shutter open", `${exposures[exposure].true_s.toPrecision(4)} s`],
      ["File", frame?.file],
      ["Size", frame && bytes(frame.bytes)],
      ["Attempt", frame && String(frame.attempt)],
      ["Earlier frames that no longer count", earlier ? String(earlier) : ""],
      ["Arrived after rest", frame?.since_rest_s && `${frame.since_rest_s[1].toFixed(1)} s`],
      ["Taken, by the camera", frame?.taken],
      ["Hash (BLAKE3)", frame?.blake3],
    ]), list("Refused", refusals.map((r) => `${clock(r.time)}: ${forPeople(r.reason)}`), "warnings"), figure);
    if (frame) attempt(() => show(figure, frame.file));
  }

  async function show(figure, file) {
    const image = await blob(`/v1/sessions/${run.id}/frames/${file}`);
    URL.revokeObjectURL(picture);
    picture = image;
    if (image) figure.replaceChildren(h("img", { src: image, alt: `Frame ${file} as the camera made it` }));
    else figure.replaceChildren("The picture cannot be had.");
  }

  const update = () => {
    watch(id ?? current()?.id ?? null);
    const { session, plan, told } = run;
    if (!session || !plan) return fill(head, h("h2", {}, "Frames"), h("p", {}, current() ? "Loading …" : "No session yet."));
    if (made !== run.id) {
      make();
      picked = null;
    }
    fill(head, h("h2", {}, `Frames: ${session.name} `, badge(session.state)), h("p", {}, `${session.frames_committed} of ${session.frames_planned} on disk`));
    const now = active();
    buttons.forEach((row, station) => row.forEach((button, exposure) => {
      const kind = fate(told, station, exposure);
      if (button.className === kind) return;
      button.className = kind;
      button.textContent = SIGNS[kind];
      const words = `station ${numbered(station)}, ${degrees(plan.stations[station].angle_deg)}, exposure ${numbered(exposure)} (${plan.exposures[exposure].label} s): ${WORDS[kind]}`;
      button.title = words;
      button.setAttribute("aria-label", words);
    }));
    table.querySelectorAll("tbody tr").forEach((row, station) => row.classList.toggle("now", station === now));
    showPicked();
  };
  return { update, close: () => URL.revokeObjectURL(picture) };
}
