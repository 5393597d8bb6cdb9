// Every session: how it ended, how often it was taken up again, whether its frames are sound; and which two to compare.
import { ask, attempt, post } from "/api.js";
import { ended, lookBack, rig } from "/rig.js";
import { badge, errorOf, fill, forPeople, h, when } from "/show.js";

const AGAIN_MS = 500;
const WORDS = {
  unverified: "not verified", verifying: "being verified …", sound: "sound", outdated: "sound, journalled since: verify again", not_sound: "NOT what was committed",
};

function verdict(status) {
  if (!status) return "";
  const time = status.time ? `, ${when(status.time)}` : "";
  return [h("span", { className: status.soundness }, WORDS[status.soundness]), time, status.faults.length ? h("ul", { className: "warnings" }, status.faults.slice(0, 5).map((fault) => h("li", {}, fault))) : ""];
}

const TITLES = ["session", "started", "end", "taken up again", "error", "frames on disk"];

/// Two sessions to be compared.
export function chooser(first, second) {
  const [a, b] = ["First session", "Second session"].map((name) => h("select", { "aria-label": name }));
  const go = h("button", { type: "submit" }, "Compare");
  const form = h("form", { className: "verbs", onsubmit: (event) => {
    event.preventDefault();
    location.hash = `#/compare/${a.value}/${b.value}`;
  } }, "Compare ", a, " with ", b, go);
  const update = (fitted) => {
    form.hidden = fitted.length < 2;
    if (a.options.length === fitted.length) return;
    const chosen = [a.value || first || fitted[1]?.id, b.value || second || fitted[0]?.id];
    [a, b].forEach((select, i) => {
      select.replaceChildren(...fitted.map((s) => h("option", { value: s.id }, `${s.name}, ${when(s.started)}`)));
      select.value = chosen[i];
    });
  };
  return { form, update };
}

export function history(view) {
  const chosen = chooser();
  const body = h("tbody", {});
  const older = h("button", { type: "button", onclick: () => attempt(lookBack) }, "Older sessions");
  const head = TITLES.map((title) => h("th", { scope: "col" }, title));
  view.append(h("h2", {}, "History"), chosen.form, h("div", { className: "scroll", role: "region", tabIndex: 0, "aria-label": "Sessions" },
    h("table", { className: "history" }, h("thead", {}, h("tr", {}, head)), body)), older);
  const known = new Map();      // soundness by session
  let closed = false;

  async function soundness(id) {
    const status = await attempt(() => ask(`/v1/sessions/${id}/verify`), () => {});
    if (!status || closed) return;
    known.set(id, status);
    show();
    if (status.soundness === "verifying") setTimeout(() => closed || soundness(id), AGAIN_MS);
  }

  const verify = (id) => attempt(async () => {
    known.set(id, await post(`/v1/sessions/${id}/verify`));
    show();
    await soundness(id);
  });

  function line(s) {
    const status = known.get(s.id);
    const button = h("button", { type: "button", "aria-label": `Verify ${s.name}`, disabled: status?.soundness === "verifying", onclick: () => verify(s.id) }, "Verify");
    const cells = [when(s.started),
      [badge(s.state), s.reason ? h("div", { className: "reason" }, forPeople(s.reason)) : "", s.ended ? h("small", {}, when(s.ended)) : ""],
      s.interruptions ? `${s.interruptions} times` : "never", errorOf(s, "no fit"), [verdict(status), " ", ended(s) ? button : ""]];
    // On a phone a row is a card, and its cells tell what they are.
    return h("tr", {}, h("th", { scope: "row" }, h("a", { href: `#/results/${s.id}` }, s.name)), cells.map((cell, i) => h("td", { "data-title": TITLES[i + 1] }, ...[cell].flat())));
  }

  const shown = new Map();      // what a row was made of: rows that are as they were keep the focus
  function show() {
    const lines = rig.sessions.map((s) => {
      const key = JSON.stringify([s, known.get(s.id)]);
      if (shown.get(s.id)?.key !== key) shown.set(s.id, { key, row: line(s) });
      return shown.get(s.id).row;
    });
    if (lines.length !== body.children.length || lines.some((row, i) => body.children[i] !== row)) body.replaceChildren(...lines);
  }

  const update = () => {
    older.hidden = !rig.next;
    chosen.update(rig.sessions.filter((s) => s.mean_relative_error != null));
    show();
    for (const s of rig.sessions) if (!known.has(s.id) && ended(s)) {
      known.set(s.id, null);
      soundness(s.id);
    }
    if (!rig.sessions.length) fill(body, h("tr", {}, h("td", { colspan: 6 }, "No session yet.")));
  };
  return { update, close: () => { closed = true; } };
}
