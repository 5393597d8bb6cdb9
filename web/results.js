// Sessions that were, and what came out of them.
import { ask, attempt, link } from "/api.js";
import { material, pictured } from "/material.js";
import { ended, lookBack, rig } from "/rig.js";
import { badge, count, facts, fill, h, leftOut, list, percent, when } from "/show.js";

function told(s) {
  return facts([
    ["Frames", `${s.frames_committed} of ${s.frames_planned}, ${count(s.stations, "station")}`],
    ["Started", when(s.started)],
    ["Ended", when(s.ended)],
    ["Calibration", s.calibration ? `${s.calibration.version} of ${when(s.calibration.made)}` : "none: the rig file's geometry"],
    ["Refused, shot again", s.refused ? `${s.refused}, the last: ${s.last_refusal}` : "none"],
    ["Overhead", s.time_budget?.overhead == null ? "" : percent(s.time_budget.overhead)],
    ["Left out", s.saved?.exposures ? leftOut(s.saved) : ""],
  ]);
}

export function results(view, id) {
  const sessions = h("ul", { className: "sessions" });
  const older = h("button", { type: "button", onclick: () => attempt(lookBack) }, "Older sessions");
  const head = h("div", {});
  const picture = h("div", {});
  const rest = h("div", {});
  const result = h("div", {});
  view.append(h("h2", {}, "Results"), h("div", { className: `columns ${id ? "chosen-first" : "wide-right"}` },
    h("section", { className: "history", "aria-label": "Sessions" }, h("h3", {}, "Sessions"), sessions, older), h("div", { className: "of" }, head, picture, rest, result)));
  let of = "";          // what the result shown belongs to

  async function show(s) {
    const key = `${s.id} ${s.last_seq}`;
    if (of === key) return;
    of = key;
    const seen = pictured(s.id).then((made) => of === key && picture.replaceChildren(made));
    const made = await material(s.id);
    if (of === key) result.replaceChildren(made);
    await seen;
  }

  const look = () => id && attempt(async () => {
    const s = await ask(`/v1/sessions/${id}`);
    const without = ended(s) ? "No material was fitted." : "The material is there once the session has ended.";
    // Who comes here wants to see the material, and to relight it; figures are for who reads on.
    fill(head, h("h3", {}, s.name, " ", badge(s.state), s.simulated ? " (simulated)" : ""), s.reason ? h("p", { className: "reason" }, s.reason) : "",
      h("p", { className: "verbs" }, s.mean_relative_error == null ? "" : h("a", { href: `#/viewer/${s.id}`, className: "action primary" }, "Relight it"),
        h("a", { href: `#/frames/${s.id}` }, "Its frames"), link("report.html", `/v1/sessions/${s.id}/report`), link("report.pdf", `/v1/sessions/${s.id}/report.pdf`)),
      s.mean_relative_error == null ? h("p", {}, without) : "");
    fill(rest, told(s), list("Warnings", s.warnings, "warnings"));
    if (s.mean_relative_error != null) await show(s);
  }, (reason) => fill(head, h("p", { className: "warnings" }, reason)));

  const update = () => {
    older.hidden = !rig.next;
    fill(sessions, rig.sessions.length ? rig.sessions.map((s) => h("li", {},
      h("a", { href: `#/results/${s.id}`, "aria-current": s.id === id ? "page" : "false" }, h("span", {}, s.name), " ", badge(s.state),
        h("small", {}, `${s.frames_committed}/${s.frames_planned} frames, ${when(s.started)}${s.mean_relative_error == null ? "" : `, error ${percent(s.mean_relative_error)}`}`)))) : h("li", {}, "No session yet."));
  };
  if (!id) fill(head, h("p", {}, "Choose a session."));
  look();
  return { update, look };
}

/// The viewer of a session's material, loaded when it is opened: it weighs half as much as all the rest of the page.
export function viewer(view, id) {
  const place = h("div", {}, h("p", {}, "Loading …"));
  view.append(h("h2", {}, "Viewer"), h("p", {}, h("a", { href: `#/results/${id ?? ""}` }, "The result")), place);
  let close = null;
  let gone = false;
  const show = async () => {
    const made = await (await import("/viewer.js")).view(place, id);
    if (gone) made();
    else close = made;
  };
  if (id) show().catch((error) => place.replaceChildren(h("p", { className: "warnings" }, `The viewer cannot be shown: ${error.message}`)));
  else place.replaceChildren(h("p", {}, "Choose a session, then its result."));
  return {
    close() {
      gone = true;
      close?.();
    },
  };
}
