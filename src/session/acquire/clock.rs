//! Where the time of an acquisition goes.

use super::shooting::Taken;
use super::{Acquisition, Ended};
use crate::devices::camera::Shot;
use crate::session::budget::{Stage, TimeBudget};
use std::time::Duration;

/// What an acquisition knows of its time; moments are those of the book's clock.
pub(super) struct Clock {
    budget: TimeBudget,
    /// When this run began.
    begin: Duration,
    /// Time of the session's earlier runs, seconds.
    earlier_s: f64,
    /// When this run began to shoot, what it had been held up by then, seconds, and what was committed then, share of the plan.
    start: (Duration, f64, f64),
}

impl Clock {
    /// A run of a session that has `spent` this so far.
    pub fn new(spent: TimeBudget, now: Duration) -> Self {
        Self { earlier_s: spent.total_s(), start: (now, spent.held_s, 0.0), budget: spent, begin: now }
    }

    /// When this run began.
    pub fn begin(&self) -> Duration {
        self.begin
    }
}

impl Acquisition<'_> {
    pub(super) fn now(&self) -> Duration {
        self.book.clock.elapsed()
    }

    pub(super) fn since(&self, begin: Duration) -> Duration {
        self.now().saturating_sub(begin)
    }

    /// Time since `begin` went to this stage.
    pub(super) fn spend(&mut self, stage: Stage, begin: Duration) {
        let time = self.since(begin);
        self.clock.budget.spend(stage, time);
    }

    /// A shot took `time`: what its shutter needed and its file, and the camera's own share.
    pub(super) fn spend_shot(&mut self, shot: &Shot, taken: &Result<Taken, Ended>, time: Duration) {
        let budget = &mut self.clock.budget;
        let Ok(Taken::Good(frame, ..)) = taken else { return budget.spend(Stage::Recovery, time) };
        let transfer = frame.transfer.min(time);
        // A camera that plays stored frames opens no shutter.
        let open = Duration::try_from_secs_f64(shot.shutter.true_s / self.speed).unwrap_or(time);
        let open = open.min(time - transfer);
        budget.spend(Stage::Transfer, transfer);
        budget.spend(Stage::Shutter, open);
        budget.spend(Stage::Camera, time - transfer - open);
    }

    /// Journals where the time went so far.
    pub(super) fn tell_budget(&self) {
        let whole_s = self.clock.earlier_s + self.since(self.clock.begin).as_secs_f64();
        let fields = serde_json::to_value(self.clock.budget.of_all(whole_s)).unwrap_or_default();
        self.book.note(self.id, "time.budget", fields);
    }

    /// From now on frames are shot.
    pub(super) fn start_pace(&mut self) {
        let share = self.book.look(self.id, |entry| entry.share_done()).unwrap_or_default();
        self.clock.start = (self.now(), self.clock.budget.held_s, share);
    }

    /// Wall time for a planned second so far, without the time the session was held up.
    pub(super) fn measure_pace(&self) {
        let (start, held_s, share) = self.clock.start;
        let worked_s = self.since(start).as_secs_f64() - (self.clock.budget.held_s - held_s);
        self.book.look(self.id, |entry| {
            let planned_s = entry.work.estimated_s() * (entry.share_done() - share);
            if planned_s > 0.0 {
                entry.pace = worked_s / planned_s;
            }
        });
    }
}
