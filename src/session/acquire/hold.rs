//! What holds an acquisition up and what ends it: pauses, a full disk, an arm in trouble, the verbs of users.

use super::{Acquisition, Ended, Stage, Trouble};
use crate::session::book::{Entry, Inner};
use crate::session::room::{self, Lack};
use crate::session::state::{Event, SessionState};
use crate::session::worker::Fault;
use crate::store::StoreError;
use serde_json::json;
use std::time::Duration;

/// Recoveries of the arm without a whole station in between.
const RECOVERIES: usize = 3;
/// Longest absence of the arm in each, seconds, and the time between two looks for it.
const OUTAGE_S: f64 = 26.0;
const LOOK_S: f64 = 0.25;
/// How often a worker that has enough to do is asked again.
const WORKER: Duration = Duration::from_millis(100);
/// A wait without an end of its own is renewed this often.
pub(super) const LONG: Duration = Duration::from_secs(3600);

impl Acquisition<'_> {
    /// Waits for room on the disk; the frame in hand is shot again afterwards.
    pub(super) fn suspend(&mut self, error: &StoreError, frame_bytes: u64) -> Result<(), Ended> {
        let left = self.book.look(self.id, |e| e.ledger.snapshot.frames_planned - e.ledger.snapshot.frames_committed);
        let rest = frame_bytes.saturating_mul(left.unwrap_or(1) as u64);
        self.wait_for_room(&format!("{error}; the frames still to come need about {rest} bytes"), frame_bytes)
    }

    /// Work that failed ends the run, unless the disk was full: then it is made again once there is room.
    pub(super) fn outlast(&mut self, Fault { reason, lack }: Fault) -> Result<(), Ended> {
        match lack {
            Some(Lack { error, bytes }) => self.wait_for_room(&format!("{reason}; {error}"), bytes),
            None => Err(Ended::Failed(reason)),
        }
    }

    fn wait_for_room(&mut self, reason: &str, bytes: u64) -> Result<(), Ended> {
        let since = self.now();
        room::wait_for(self.book, self.id, &self.writer, bytes, reason, self.speed);
        self.spend(Stage::Held, since);
        self.last = None;
        self.safe_point().map(|_| ())
    }

    /// Opens, homes and lights the arm anew, as often as a session may; the caller shoots the station again.
    pub(super) fn recover(&mut self, mut reason: String) -> Result<(), Ended> {
        loop {
            let fields = json!({"device": "arm", "reason": reason, "recovery": self.recoveries + 1});
            self.book.note(self.id, "fault.raised", fields);
            if self.recoveries == RECOVERIES {
                return Err(Ended::Interrupted(format!("the arm failed {} times: {reason}", self.recoveries + 1)));
            }
            self.recoveries += 1;
            self.bench.drop_arm();
            self.find_arm()?;
            let Err(error) = self.bench.prepare(&self.book.cancel) else { break };
            match self.arm_trouble(&error) {
                Trouble::Arm(again) | Trouble::Bracket(again) | Trouble::Frame(again) => reason = again,
                Trouble::End(ended) => return Err(ended),
            }
        }
        self.rest(self.rig.lamp.soak_s)?;
        self.last = None;
        self.book.note(self.id, "fault.cleared", json!({"device": "arm"}));
        Ok(())
    }

    /// Tries to open the arm every quarter second: it is found soon after it is plugged in again.
    fn find_arm(&mut self) -> Result<(), Ended> {
        let since = self.now();
        loop {
            let Err(error) = self.bench.open_arm() else { return Ok(()) };
            match self.arm_trouble(&error) {
                Trouble::End(ended) => return Err(ended),
                _ if self.since(since).as_secs_f64() * self.speed >= OUTAGE_S => {
                    return Err(Ended::Interrupted(format!("the arm did not come back within {OUTAGE_S} s: {error}")));
                }
                _ => self.rest(LOOK_S)?,
            }
        }
    }

    /// Between two frames: here a session pauses and ends. True when it was held up.
    pub(super) fn safe_point(&mut self) -> Result<bool, Ended> {
        let mut held = false;
        loop {
            let fault = self.book.look(self.id, |entry| entry.worker_fault.take()).flatten();
            if let Some(fault) = fault {
                self.outlast(fault)?;
                held = true;
            }
            if self.book.lock().shutdown {
                return Err(Ended::ShutDown);
            }
            match self.state() {
                SessionState::Preflight | SessionState::Running => return Ok(held),
                SessionState::Pausing => {
                    // Refused when a resume came in between: then there is nothing to wait for.
                    held |= self.book.happen(self.id, Event::SafePoint, None).is_ok();
                }
                SessionState::Paused => {
                    let since = self.now();
                    self.wait(LONG, |state| state != SessionState::Paused);
                    self.spend(Stage::Held, since);
                }
                _ => return Err(self.asked_end()),
            }
        }
    }

    /// Waits a time of the rig's, unless the session is to end.
    pub(super) fn rest(&self, seconds: f64) -> Result<(), Ended> {
        let time = Duration::try_from_secs_f64(seconds / self.speed).unwrap_or(LONG);
        self.unless_ended(self.book.clock.rest(time))
    }

    /// Gives the worker time to take a job.
    pub(super) fn wait_for_worker(&self) -> Result<(), Ended> {
        self.unless_ended(WORKER)
    }

    fn unless_ended(&self, time: Duration) -> Result<(), Ended> {
        let ending = |state| matches!(state, SessionState::Stopping | SessionState::Aborting);
        if self.wait(time, ending) { Err(self.asked_end()) } else { Ok(()) }
    }

    /// Waits for a state, or for the daemon's end; false when the time is over first.
    pub(super) fn wait(&self, time: Duration, until: impl Fn(SessionState) -> bool) -> bool {
        let look = |inner: &mut Inner| {
            let state = inner.entry(self.id).map_or(SessionState::Failed, Entry::state);
            (inner.shutdown || until(state)).then_some(())
        };
        self.book.wait(time, look).is_some()
    }

    pub(super) fn state(&self) -> SessionState {
        self.book.look(self.id, |entry| entry.state()).unwrap_or(SessionState::Failed)
    }

    /// Why a cancelled call was cancelled.
    pub(super) fn asked_end(&self) -> Ended {
        if self.book.lock().shutdown {
            return Ended::ShutDown;
        }
        match self.state() {
            SessionState::Stopping => Ended::Stopped,
            SessionState::Aborting => Ended::Aborted,
            state => Ended::Failed(format!("a device call was cancelled while the session was {state}")),
        }
    }

    /// Journals a record, however long the disk is full.
    pub(super) fn record(&mut self, kind: &str, fields: serde_json::Value) -> Result<(), Ended> {
        loop {
            match self.book.record(self.id, kind, fields.clone()) {
                Ok(()) => return Ok(()),
                Err(error @ StoreError::NoSpace { .. }) => self.suspend(&error, 0)?,
                Err(error) => return Err(Ended::Failed(error.to_string())),
            }
        }
    }
}
