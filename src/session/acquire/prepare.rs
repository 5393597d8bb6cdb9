//! What comes before the first frame: what an earlier run of the session left is adopted, then devices are opened and made ready.

use super::{Acquisition, Ended, Trouble};
use crate::session::book::Entry;
use crate::session::ledger::FrameRecord;
use crate::session::preflight::{small_card, weak_battery};
use crate::session::worker::Job;
use crate::store::dataset::radiance_name;
use serde_json::json;

/// Waits for the devices of a session that is taken up, each before another try, seconds: after a power cut a body may take a while
/// until it is there.
const DEVICES_WAIT_S: [f64; 3] = [1.0, 5.0, 20.0];

impl Acquisition<'_> {
    /// The stations still to be shot. What an earlier run of the session committed is believed by its hashes, and whole brackets that
    /// are not developed go to the worker, after the first, whose response it needs for all; the last bracket may go on where it was.
    pub(super) fn adopt(&mut self) -> Result<Vec<usize>, Ended> {
        let committed: Vec<FrameRecord> =
            self.book.look(self.id, |entry| entry.ledger.frames().cloned().collect()).unwrap_or_default();
        for frame in committed {
            if let Err(reason) = self.writer.check(&frame.file, frame.bytes, &frame.blake3) {
                let fields =
                    json!({"station": frame.station, "exposure": frame.exposure, "file": frame.file, "reason": reason});
                self.record("frame.lost", fields)?;
            }
        }
        let all = 0..self.book.look(self.id, |entry| entry.ledger.stations()).unwrap_or_default();
        let (whole, todo): (Vec<_>, Vec<_>) = all.partition(|&station| self.is_whole(station));
        let waiting: Vec<_> =
            whole.into_iter().filter(|&station| station == 0 || !self.is_developed(station)).collect();
        if todo.is_empty() && waiting == [0] && self.is_developed(0) {
            return Ok(todo);
        }
        for station in waiting {
            self.hand_over(|session| Job::Develop { session, station })?;
        }
        let last = |entry: &mut Entry| entry.ledger.frames().find(|f| f.bracket == self.bracket).map(|f| f.station);
        self.broken = self.book.look(self.id, last).flatten().filter(|station| todo.contains(station));
        Ok(todo)
    }

    fn is_whole(&self, station: usize) -> bool {
        let look = |entry: &mut Entry| entry.ledger.bracket(station).is_some();
        self.work.capture().is_some() && self.book.look(self.id, look) == Some(true)
    }

    fn is_developed(&self, station: usize) -> bool {
        let look = |entry: &mut Entry| {
            entry.ledger.is_developed(station) && entry.directory.join(radiance_name(station)).is_file()
        };
        self.book.look(self.id, look) == Some(true)
    }

    /// Devices open, arm homed, lamp warm.
    pub(super) fn preflight(&mut self) -> Result<(), Ended> {
        self.safe_point()?;
        let mut opened = self.bench.open(&self.book.cancel);
        for wait_s in if self.resumed { &DEVICES_WAIT_S[..] } else { &[] } {
            if opened.is_err() {
                self.rest(*wait_s)?;
                opened = self.bench.open(&self.book.cancel);
            }
        }
        if self.book.cancel.is_cancelled() {
            return Err(self.asked_end());
        }
        self.book.lock().device_fault = opened.as_ref().err().cloned();
        let (arm, camera) = opened.map_err(|reason| self.unfit(reason))?;
        self.doubt_devices(&arm, &camera)?;
        let spare = self.check_supplies()?;
        self.book.identify(self.id, arm, camera).map_err(|e| Ended::Failed(e.to_string()))?;
        self.safe_point()?;
        self.see_room(spare)?;
        if let Err(error) = self.bench.prepare(&self.book.cancel) {
            return match self.arm_trouble(&error) {
                // In a session with frames an arm that falls silent is brought back here as it is between two frames.
                Trouble::Arm(reason) if self.resumed => self.recover(reason),
                _ => Err(self.arm_ended(&error)),
            };
        }
        self.book.switch_lamp(true);
        match self.warm_up() {
            Ok(()) => Ok(()),
            Err(Trouble::Arm(reason)) => self.recover(reason),
            Err(Trouble::Bracket(reason) | Trouble::Frame(reason)) => Err(self.unfit(reason)),
            Err(Trouble::End(ended)) => Err(ended),
        }
    }

    /// Refuses a card that will not do for the frames still to be shot; journals a battery that may not last. True if it takes one more.
    fn check_supplies(&mut self) -> Result<bool, Ended> {
        let supplies = self.bench.camera().map_err(|e| self.unfit(e.to_string()))?.supplies().clone();
        let (left, seconds) = self
            .book
            .look(self.id, |entry| {
                let (ledger, work) = (&entry.ledger, &entry.work);
                let todo = (0..work.stations()).filter(|&station| ledger.bracket(station).is_none());
                let left: usize = todo.map(|station| work.exposures(station).len()).sum();
                (left, work.estimated_s() * (1.0 - entry.share_done()))
            })
            .unwrap_or_default();
        if let Some(reason) = small_card(&supplies, left) {
            return Err(self.unfit(reason));
        }
        if let Some(warning) = weak_battery(&supplies, seconds) {
            self.record("session.doubted", json!({"warnings": [warning]}))?;
        }
        Ok(small_card(&supplies, left + 1).is_none())
    }

    /// Devices that are not fit for a session end a new one, and leave one with frames as it was.
    pub(super) fn unfit(&self, reason: String) -> Ended {
        if self.resumed { Ended::Interrupted(reason) } else { Ended::Failed(reason) }
    }
}
