// The one session that is watched: its snapshot, its plan, and what its journal tells.
import { ask, attempt, follow } from "/api.js";
import { apply, journal } from "/journal.js";
import { ended, look, tell } from "/rig.js";

export const run = { id: null, session: null, plan: null, told: journal(), at: 0, fit: 0, over: false };
let stream = null;

/// Watches another session, or the same one anew: the stream of an ended one is over.
export function watch(id, anew = false) {
  if (id === run.id && !anew) return;
  stream?.abort();
  stream = new AbortController();
  Object.assign(run, { id, session: null, plan: null, told: journal(), fit: 0, over: false });
  tell();
  if (!id) return;
  const { signal } = stream;
  attempt(async () => {
    const plan = await ask(`/v1/sessions/${id}/plan`);
    if (id === run.id) run.plan = plan;
    refresh();
  });
  const take = (record) => {
    // No record of the journal: the fit has moved on.
    if (record.type === "fit.live") {
      run.fit = record.revision;
      return tell();
    }
    apply(run.told, record);
    refresh();
  };
  follow(`/v1/sessions/${id}/events`, signal, take).then(() => { run.over ||= !signal.aborted; });
}

let refreshing = false;
let again = false;
/// At most one snapshot a second, and always one after the last event.
async function refresh() {
  tell();
  if (refreshing) {
    again = true;
    return;
  }
  refreshing = true;
  again = false;
  const id = run.id;
  await attempt(async () => {
    const session = await ask(`/v1/sessions/${id}`);
    if (id !== run.id) return;
    const turned = run.session?.state !== session.state;
    Object.assign(run, { session, at: Date.now() });
    tell();
    if (turned) await look();
  });
  setTimeout(() => {
    refreshing = false;
    if (again) refresh();
  }, 1000);
}

/// The station being shot, if one is.
export const active = () => (run.session && !ended(run.session) && run.session.state !== "fitting" ? run.session.station : null);
