// What a session's journal tells that its snapshot does not: every cell of the plan, and all that went wrong and was put right. The
// events are the same that `curl -N .../events` prints, from the first on.
import { forPeople } from "/show.js";

export const journal = () => ({
  last: 0,            // sequence number of the last record
  cells: new Map(),   // "station/exposure": frame on disk, refusals, frames that no longer count
  left: new Map(),    // station: the exposures that sufficed (adaptive sessions)
  enough: null,       // stations that sufficed
  frame: null,        // the last frame that was committed
  notes: [],          // what somebody should know, oldest first
});

const NO_CELL = { frame: null, refusals: [], earlier: 0 };
export const cell = (told, station, exposure) => told.cells.get(`${station}/${exposure}`) ?? NO_CELL;

function own(told, { station, exposure }) {
  const key = `${station}/${exposure}`;
  if (!told.cells.has(key)) told.cells.set(key, { frame: null, refusals: [], earlier: 0 });
  return told.cells.get(key);
}

function drop(one) {
  one.frame = null;
  one.earlier += 1;
}

/// Frames that no longer count.
function lose(told, counts) {
  for (const one of told.cells.values()) if (one.frame && counts(one.frame)) drop(one);
}

function take(told, frame) {
  // A bracket that is shot again replaces the station's frames.
  lose(told, (old) => old.station === frame.station && (old.bracket !== frame.bracket || old.exposure === frame.exposure));
  if (told.left.get(frame.station)?.bracket !== frame.bracket) told.left.delete(frame.station);
  own(told, frame).frame = frame;
}

/// As the daemon writes it, numbered from 0; the note as a whole is put into people's numbers.
const place = (r) => `station ${r.station}${r.exposure == null ? "" : `, exposure ${r.exposure}`}`;

/// Words for a record that somebody should know of: kind and text.
const NOTES = {
  "frame.rejected": (r) => ["refused", `${place(r)} (${r.shutter} s): frame refused, attempt ${r.attempt}: ${r.reason}`],
  "bracket.rejected": (r) => ["refused", `${place(r)}: bracket refused: ${r.reason}`],
  "bracket.resumed": (r) => ["good", `${place(r)}: the broken bracket goes on, its light is the same`],
  "frame.lost": (r) => ["fault", `${r.file} is no longer what was committed: ${r.reason ?? "it does not count"}`],
  "fault.raised": (r) => ["fault", `${r.device}: ${r.reason}`],
  "fault.cleared": (r) => ["good", `${r.device}: back, the session goes on`],
  "camera.recovery": (r) => ["fault", `camera: ${r.rung}: ${r.reason}`],
  "lamp.drifted": (r) => ["lamp", `${place(r)}: the lamp changed by ${(100 * r.change).toFixed(1)} % within the bracket, by the ${r.by ?? "object"}`],
  "ambient.failed": (r) => ["lamp", `the room could not be looked at: ${r.reason}`],
  "metering.failed": (r) => ["lamp", `${place(r)}: could not be metered and is shot whole: ${r.reason}`],
  "session.state": (r) => (r.reason ? ["state", `${r.state}: ${r.reason}`] : null),
};

/// Takes one record into account; types it does not know are passed over.
export function apply(told, record) {
  if (record.seq <= told.last) return;
  told.last = record.seq;
  const note = NOTES[record.type]?.(record) ?? (record.warnings?.length ? ["lamp", record.warnings.join("; ")] : null);
  if (note) told.notes.push({ time: record.time, kind: note[0], text: forPeople(note[1]) });
  switch (record.type) {
    case "frame.committed":
      told.frame = record;
      take(told, record);
      break;
    case "frame.rejected": own(told, record).refusals.push(record); break;
    case "frame.lost": lose(told, (frame) => frame.file === record.file); break;
    case "bracket.rejected": if (record.whole) lose(told, (frame) => frame.station === record.station); break;
    case "exposures.enough": told.left.set(record.station, record); break;
    case "lights.judged": told.enough = record.enough ? record.stations : null; break;
  }
}

/// What became of a cell: `done`, `again` (on disk after more than one shot), `refused` (and to be shot again), `left` out, `todo`.
export function fate(told, station, exposure) {
  const { frame, refusals, earlier } = cell(told, station, exposure);
  if (frame) return refusals.length + earlier ? "again" : "done";
  const left = told.left.get(station);
  if ((left && !left.exposures.includes(exposure)) || (told.enough != null && station >= told.enough)) return "left";
  return refusals.length + earlier ? "refused" : "todo";
}
