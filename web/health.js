// Whether the rig could work now, and what it is made of.
import { ask, attempt, token, useToken } from "/api.js";
import { busy, checks, table as checkTable } from "/checks.js";
import { rig } from "/rig.js";
import { badge, clockSeconds, facts, fill, forPeople, h, list, when } from "/show.js";

/// OpenMetrics text as rows: name with labels, value, meaning.
function metrics(text) {
  const help = Object.fromEntries([...text.matchAll(/^# HELP (\S+) (.*)$/gm)].map(([, name, words]) => [name, words]));
  return text.split("\n").filter((one) => one && !one.startsWith("#")).map((one) => {
    const [, name, value] = /^(\S+(?:\{.*\})?) (\S+)$/.exec(one) ?? [null, one, ""];
    const family = Object.keys(help).find((known) => name.startsWith(known));
    return [name, value, help[family] ?? ""];
  });
}

function table(rows) {
  return h("table", {}, h("thead", {}, h("tr", {}, ["metric", "value", "meaning"].map((title) => h("th", { scope: "col" }, title)))),
    h("tbody", {}, rows.map(([name, value, words]) => h("tr", {}, h("th", { scope: "row" }, h("code", {}, name)), h("td", {}, String(+(+value).toPrecision(6))), h("td", {}, words)))));
}

/// In one sentence: whether a session could start now.
function readiness({ ready, reasons }) {
  if (!ready) return list("Not ready", reasons.map(forPeople), "warnings");
  const held = busy();
  if (held) return h("p", { className: "banner" }, `The rig is ${held}. `, h("a", { href: "#/new/queue" }, "Put a session into the queue"));
  return h("p", { className: "banner good" }, "Ready: a session could start now.");
}

function access() {
  if (!token()) return h("p", {}, "No token is in use.");
  return h("p", { className: "verbs" }, "A token is in use; it is kept until this tab is closed. ",
    h("button", { type: "button", onclick: () => useToken(null) }, "Forget it"));
}

const LINES = 200;

/// Ids of sessions and calibrations as the names that people gave them, where those are known.
const withNames = (text) => text.replace(/[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}/g, (id) => {
  const known = [...rig.sessions, ...rig.calibrations].find((one) => one.id === id);
  return known ? `“${known.name}”` : id;
});

/// The daemon's last log lines, newest below; what is new is appended.
function log() {
  const lines = h("ol", { className: "log" });
  const box = h("div", { className: "scroll tail", role: "region", tabIndex: 0, "aria-label": "Log" }, lines);
  let last = 0;
  const look = async () => {
    const page = await ask(`/v1/log?lines=${LINES}&after=${last}`);
    if (!page.lines.length) return;
    last = page.lines.at(-1).seq;
    lines.append(...page.lines.map((one) => h("li", { className: one.level.toLowerCase() }, h("time", { dateTime: one.time }, clockSeconds(one.time)), ` ${one.level} ${withNames(one.text)} `, h("small", {}, one.target))));
    while (lines.children.length > LINES) lines.firstChild.remove();
    box.scrollTop = box.scrollHeight;
  };
  return { box, look };
}

export function health(view) {
  const tail = log();
  const parts = ["ready", "checked", "calibrations", "metrics"].map((name) => [name, h("div", {})]);
  const { ready, checked, calibrations, metrics: counted } = Object.fromEntries(parts);
  view.append(h("h2", {}, "Health"), ready, h("h3", {}, "Checks"), checked, calibrations, h("h3", {}, "Token"), access(), h("h3", {}, "Log"), tail.box, h("h3", {}, "Metrics"), h("div", { className: "scroll", role: "region", tabIndex: 0, "aria-label": "Metrics" }, counted));

  const update = () => {
    const { status } = rig;
    if (!status) return;
    fill(ready, readiness(status));
    fill(checked, checkTable(checks()), list("Warnings", status.own_plan?.warnings ?? [], "warnings"), facts([["Rig", status.name], ["Daemon", `rigd ${status.version}`]]));
    fill(calibrations, list("Calibrations", rig.calibrations.slice(0, 5).map((one) => h("span", {}, `${one.version} (${one.kind}) of ${when(one.started)} `, badge(one.state)))));
  };
  const look = () => attempt(async () => {
    fill(counted, table(metrics(await ask("/metrics"))));
    await tail.look();
  });
  look();
  return { update, look };
}
