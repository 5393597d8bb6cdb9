//! One shot and what brings a camera back, rung by rung: only a busy camera is asked again as it is; anything
//! else costs a new driver, then a reset, then its power. Every rung is journalled; the last one ends the session as interrupted.

use super::{Acquisition, Ended};
use crate::devices::camera::{CameraError, RawFrame, Shot};
use crate::session::quality::{self, Fingerprint};
use serde_json::json;

/// How often a busy camera is asked again for one shot, and the wait before each, seconds.
const BUSY_TRIES: usize = 5;
const BUSY_WAIT_S: f64 = 0.5;
/// Waits before the camera is opened anew, seconds; the remedies of the rig follow, each with the last wait.
const REOPEN_WAIT_S: [f64; 3] = [1.0, 5.0, 20.0];

/// What came of one shot.
pub(super) enum Taken {
    /// A frame that is what was asked for; when it was asked for and when it was there, seconds after the arm reported rest.
    Good(RawFrame, Fingerprint, [f64; 2]),
    /// A frame that is not, or a camera that refused: the reason.
    Refused(String),
    /// The camera failed, for this reason, and was brought back.
    Recovered(String),
}

impl Acquisition<'_> {
    /// Shoots once; the error ends the acquisition.
    pub(super) fn shoot(&mut self, shot: &Shot) -> Result<Taken, Ended> {
        let mut busy = 0;
        let (frame, since_rest_s) = loop {
            let asked_s = self.since_rest_s();
            match self.bench.camera().and_then(|camera| camera.shoot(shot, &self.book.cancel)) {
                Ok(frame) => break (frame, [asked_s, self.since_rest_s()]),
                Err(CameraError::Cancelled) => return Err(self.asked_end()),
                Err(error @ CameraError::NoFrame { .. }) => return Err(Ended::Failed(error.to_string())),
                Err(CameraError::Refused { reason }) => return Ok(Taken::Refused(reason)),
                Err(CameraError::Busy { reason }) if busy < BUSY_TRIES => {
                    busy += 1;
                    self.journal_rung("wait", &reason)?;
                    self.rest(BUSY_WAIT_S)?;
                }
                Err(error) => return self.bring_back(&error.to_string()).map(Taken::Recovered),
            }
        };
        let fingerprint = Fingerprint::of(&frame);
        let size = (self.rig.camera.width, self.rig.camera.height);
        let verdict = quality::check(&frame, shot, size, &fingerprint, self.last.as_ref());
        self.last = Some(fingerprint.clone());
        Ok(match verdict {
            Ok(()) => {
                self.rung = 0;
                Taken::Good(frame, fingerprint, since_rest_s)
            }
            Err(reason) => Taken::Refused(reason),
        })
    }

    /// Time since the arm reported rest, in seconds of the rig.
    fn since_rest_s(&self) -> f64 {
        self.speed * self.since(self.rested).as_secs_f64()
    }

    /// Climbs the ladder until the camera opens; returns why it had to.
    fn bring_back(&mut self, reason: &str) -> Result<String, Ended> {
        let mut told = reason.to_owned();
        loop {
            let rung = self.rung;
            self.rung += 1;
            let Some(wait_s) = REOPEN_WAIT_S
                .get(rung)
                .or(REOPEN_WAIT_S.last())
                .filter(|_| rung < REOPEN_WAIT_S.len() + self.bench.remedies())
            else {
                return Err(Ended::Interrupted(format!("the camera does not come back: {told}")));
            };
            let applied = match rung.checked_sub(REOPEN_WAIT_S.len()) {
                None => Ok("reopen"),
                Some(remedy) => self.bench.apply_remedy(remedy, &self.book.cancel),
            };
            let (name, failed) = match applied {
                Ok(name) => (name, None),
                Err((name, why)) => (name, Some(why)),
            };
            self.journal_rung(name, failed.as_ref().unwrap_or(&told))?;
            // Also after a remedy that failed: whoever wants an end is heard here.
            self.rest(if failed.is_some() { 0.0 } else { *wait_s })?;
            if failed.is_some() {
                continue;
            }
            match self.bench.reopen_camera(&self.book.cancel) {
                Ok(()) => return Ok(told),
                Err(CameraError::Cancelled) => return Err(self.asked_end()),
                Err(again) => told = format!("{reason}; opened anew: {again}"),
            }
        }
    }

    fn journal_rung(&mut self, rung: &str, reason: &str) -> Result<(), Ended> {
        self.record("camera.recovery", json!({"rung": rung, "reason": reason}))
    }
}
