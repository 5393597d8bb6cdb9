//! What lamp and reference patch did within a bracket, in the journal.

use super::{Acquisition, Ended, Trouble};
use crate::session::witness::{Drift, patch_part};
use serde_json::json;

impl Acquisition<'_> {
    /// The frames of this station show the reference patch, where its lamp lights it.
    pub(super) fn watch_patch(&mut self, station: usize) {
        let planned = self.work.capture().and_then(|plan| plan.stations.get(station));
        if let Some(part) = planned.and_then(|planned| patch_part(self.rig, planned)) {
            self.witness.watch_patch(part);
        }
    }

    /// Journals what object and patch say of the lamp, and once a session a patch that is not what it was.
    pub(super) fn tell_drift(&mut self, station: usize, of_object: Option<Drift>) -> Result<(), Trouble> {
        let (of_patch, doubt) = self.witness.patch();
        for (by, drift) in [("object", of_object), ("patch", of_patch)] {
            if let Some(Drift { exposure, change, sigma }) = drift {
                let fields =
                    json!({"station": station, "by": by, "exposure": exposure, "change": change, "sigma": sigma});
                self.record("lamp.drifted", fields)?;
            }
        }
        if let Some(why) = doubt {
            self.doubt_patch(station, &why)?;
        }
        Ok(())
    }

    fn doubt_patch(&mut self, station: usize, why: &str) -> Result<(), Ended> {
        if self.book.look(self.id, |entry| entry.ledger.doubts_patch()) == Some(true) {
            return Ok(());
        }
        let warning = format!("station {station}: {why}");
        self.record("patch.doubted", json!({"station": station, "warnings": [warning]}))
    }
}
