// What waits for the rig, in order, with the times to be expected.
import { ask, attempt, post, say } from "/api.js";
import { rig } from "/rig.js";
import { bytes, clock, count, duration, facts, fill, h } from "/show.js";
import { confirmed } from "/verbs.js";

function asked({ session }) {
  const parts = [];
  if (session.stations_deg) parts.push(count(session.stations_deg.length, "station"));
  if (session.exposures) parts.push(count(session.exposures.length, "exposure"));
  if (session.adaptive) parts.push("adaptive");
  if (session.calibration) parts.push(`calibration ${session.calibration}`);
  return parts.join(", ") || "the rig file's plan";
}

export function queue(view) {
  const held = h("p", { className: "banner" });
  const entries = h("ol", { className: "cards" });
  const turn = h("button", { type: "button" });
  let standing = { held: null, entries: [] };
  view.append(h("h2", {}, "Queue"), held, entries, h("p", { className: "verbs" }, h("a", { href: "#/new/queue", className: "action" }, "Add a session"), turn));

  const change = (work) => attempt(async () => {
    say();
    await work();
    await look();
  });
  turn.onclick = () => change(() => post(`/v1/queue/${standing.held ? "release" : "hold"}`));

  function card(entry, i) {
    const { request } = entry;
    const name = request.session.name ?? rig.status?.name ?? "the rig file's plan";
    const remove = async () => {
      if (await confirmed(`Take ${name} out of the queue? A run of it that goes on is not ended.`, "Take it out")) {
        change(() => ask(`/v1/queue/${entry.id}`, { method: "DELETE" }));
      }
    };
    const button = (text, onclick, disabled = false) => h("button", { type: "button", onclick, disabled, "aria-label": `${text}: ${name}` }, text);
    const last = entry.last ? `${entry.last.ended ?? "running"}` : "";
    return h("li", {}, h("h3", {}, name), entry.refused ? h("p", { className: "warnings" }, `Passed over: ${entry.refused}`) : "", facts([
      ["Plan", asked(request)],
      ["Starts about", entry.estimated_start ? clock(entry.estimated_start) : "not known"],
      ["Ends about", entry.estimated_end && clock(entry.estimated_end)],
      ["Runs", request.runs > 1 ? `${entry.started} of ${request.runs} started${request.every_s ? `, every ${duration(request.every_s)}` : ""}` : ""],
      ["Not before", request.not_before && clock(request.not_before)],
      ["Last run", entry.last && h("a", { href: `#/results/${entry.last.session}` }, last)],
      ["Disk space", entry.estimated_bytes && bytes(entry.estimated_bytes)],
      ["If a run fails", request.hold_on_failure ? "the queue is held" : "the next one starts"],
    ]), h("p", { className: "verbs" }, button(entry.refused ? "Try again, first" : "Make it the next", () => change(() => post(`/v1/queue/${entry.id}/first`)), i === 0 && !entry.refused), button("Take it out", remove)));
  }

  const look = () => attempt(async () => {
    standing = await ask("/v1/queue");
    held.hidden = !standing.held;
    held.textContent = standing.held ? `Nothing of it is started: ${standing.held}` : "";
    turn.textContent = standing.held ? "Let it go on" : "Hold the queue";
    if (standing.entries.length) fill(entries, standing.entries.map(card));
    else fill(entries, h("li", {}, "Nothing waits."));
  });
  look();
  return { look };
}
