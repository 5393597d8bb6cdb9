// What the daemon was started with. Nothing of it can be changed here: it says where it can.
import { ask, attempt } from "/api.js";
import { count, facts, fill, h, list } from "/show.js";

const shown = (value) => (value === null ? "–" : Array.isArray(value) ? value.join(", ") : String(value));

function retention({ settings }) {
  const days = settings.find((one) => one.key === "storage.keep_days")?.value;
  return days == null ? "sessions are kept for ever" : `completed sessions that were verified go after ${count(days, "day")}`;
}

function tokens(all) {
  if (!all.length) return h("p", {}, "No token is needed: only this machine can reach the daemon.");
  return h("table", {}, h("thead", {}, h("tr", {}, h("th", { scope: "col" }, "line of the file"), h("th", { scope: "col" }, "scope"))),
    h("tbody", {}, all.map(({ line, scope }) => h("tr", {}, h("th", { scope: "row" }, String(line)), h("td", {}, scope)))));
}

function told(all) {
  const lines = all.map(({ target, sent, failed }) => `${target}: ${count(sent, "message")} sent, ${failed} given up`);
  return lines.length ? h("ul", {}, lines.map((one) => h("li", {}, one))) : h("p", {}, "Nobody is told: the rig file has no [notify].");
}

export function settings(view) {
  const box = h("div", {});
  view.append(h("h2", {}, "Settings"), box);
  const look = () => attempt(async () => {
    const found = await ask("/v1/settings");
    const rows = found.settings.map(({ key, value }) => h("tr", {}, h("th", { scope: "row" }, h("code", {}, key)), h("td", {}, shown(value))));
    fill(box, facts([
      ["Daemon", `rigd ${found.version}${found.features.length ? `, with ${found.features.join(", ")}` : ""}`],
      ["Rig file", found.file ?? "brought along by the program"],
      ["Retention", retention(found)],
    ]), list("How to change them", found.changes), h("h3", {}, "Tokens"), tokens(found.tokens), h("h3", {}, "Notifications"), told(found.notifications), h("h3", {}, "In effect"),
    h("div", { className: "scroll", role: "region", tabIndex: 0, "aria-label": "Settings in effect" }, h("table", {}, h("thead", {}, h("tr", {}, h("th", { scope: "col" }, "key"), h("th", { scope: "col" }, "value"))), h("tbody", {}, rows))));
  });
  look();
  return { look };
}
