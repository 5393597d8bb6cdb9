// What is wrong with a planned session, in people's words and beside the field it is about.
import { numbered } from "/show.js";

/// Fields of the form by the daemon's names; `lights` lie within `adaptive`.
const FIELDS = ["name", "stations_deg", "exposures", "calibration", "adaptive"];
const NAMES = { stations_deg: "station", exposures: "exposure" };

/// The daemon names a mistake by its place in the request (`stations_deg[1]: …`, counted from 0).
export function sorted(reasons) {
  const found = {};
  for (const reason of reasons) {
    const [, field, index, text] = /^(\w+)(?:\.\w+)*(?:\[(\d+)\])?[: ]\s*(.*)$/s.exec(reason) ?? [null, "", undefined, reason];
    const known = FIELDS.includes(field);
    const place = known && index !== undefined ? `${NAMES[field] ?? field} ${numbered(+index)}: ` : "";
    const words = (known ? place + text : reason).replace(/\b(stations_deg|exposures)\[(\d+)\]/g, (_, name, at) => `${NAMES[name]} ${numbered(+at)}`);
    (found[known ? field : ""] ??= []).push(words);
  }
  return found;
}

/// What need not be asked of the daemon: words that are no numbers.
export function typed(angles, targets) {
  const found = {};
  const strange = angles.filter((angle) => !Number.isFinite(Number(angle)));
  if (!angles.length) found.stations_deg = ["no station: write at least one angle, such as -55"];
  if (strange.length) found.stations_deg = [`${strange.map((one) => `“${one}”`).join(", ")}: no number; write angles in degrees, such as -55`];
  if (targets.some((target) => !target.checkValidity() || target.value === "")) found.adaptive = ["a target is a percentage from 0.1 to 100"];
  return found;
}

/// Shows them: each field gets its own, told as its description.
export function mark(fields, found) {
  for (const [name, box] of Object.entries(fields)) {
    const [input, words] = [box.querySelector("input, select, textarea"), box.querySelector(".wrong")];
    words.textContent = (found[name] ?? []).join("; ");
    words.hidden = !words.textContent;
    input.setAttribute("aria-invalid", String(!words.hidden));
  }
}
