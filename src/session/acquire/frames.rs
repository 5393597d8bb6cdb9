//! One frame of a bracket: shot until it is good, then committed.

use super::shooting::Taken;
use super::{Acquisition, Ended, Stage, Trouble};
use crate::devices::camera::{RawFrame, Shot};
use crate::numerics::quality::Look;
use crate::session::quality::Fingerprint;
use crate::session::witness::{Lighting, Verdict};
use crate::store::{StoreError, frames};
use rig_config::Shutter;
use serde_json::json;

/// Why a session ends whose lamp gives no light, and what to do.
pub(super) const LAMP_OUT: &str = "the lamp is out: replace it, or take the cap off the lens, then resume the session";
/// Retakes of a frame before its bracket, or the session, is given up.
const RETAKES: usize = 2;

impl Acquisition<'_> {
    /// Shoots until a frame is good and committed.
    pub(super) fn take_frame(&mut self, station: usize, exposure: usize, angle_deg: f64) -> Result<(), Trouble> {
        let mut rejected = Vec::new();
        loop {
            let attempt = self.attempts.entry((station, exposure)).or_default();
            *attempt += 1;
            let attempt = *attempt;
            let shot = self.shot(station, exposure)?;
            let begin = self.now();
            let taken = self.shoot(&shot);
            self.spend_shot(&shot, &taken, self.since(begin));
            match taken? {
                Taken::Good(frame, fingerprint, since_rest_s) => {
                    let begin = self.now();
                    let stood_deg = self.check_light(angle_deg)?;
                    let looked = self.look(&frame, &shot, angle_deg);
                    let look = match looked {
                        Ok(look) => look,
                        Err(verdict) => {
                            self.spend(Stage::Recovery, begin);
                            self.refuse_frame(&shot, attempt, &mut rejected, verdict)?;
                            self.safe_point()?;
                            continue;
                        }
                    };
                    self.lamp_shows()?;
                    let committed = self.commit(&shot, attempt, (stood_deg, since_rest_s), &frame, &fingerprint);
                    self.spend(Stage::Storing, begin);
                    match committed {
                        Ok(()) => {
                            if let Some(look) = look {
                                self.witness.accept(&shot, look, Lighting::of(self.rig, angle_deg));
                            }
                            return Ok(self.doubt_optics(&frame)?);
                        }
                        Err(error @ StoreError::NoSpace { .. }) => {
                            self.suspend(&error, frame.bytes.len() as u64)?;
                            self.check_light(angle_deg)?;
                        }
                        Err(error) => return Err(Ended::Failed(error.to_string()).into()),
                    }
                }
                Taken::Recovered(reason) => self.reject(&shot, attempt, &reason)?,
                Taken::Refused(reason) => {
                    self.refuse_frame(&shot, attempt, &mut rejected, Verdict::Damaged(reason))?;
                }
            }
            self.safe_point()?;
        }
    }

    /// What the picture of a session shows, held against the rest of the bracket. The steps of a calibration show different things and
    /// are judged by the worker.
    fn look(&mut self, frame: &RawFrame, shot: &Shot, angle_deg: f64) -> Result<Option<Look>, Verdict> {
        if self.work.capture().is_none() {
            return Ok(None);
        }
        self.witness.judge(&frame.bytes, shot, Lighting::of(self.rig, angle_deg)).map(Some)
    }

    /// Journals a frame that does not serve; the error ends its bracket when it was retaken often enough.
    fn refuse_frame(
        &mut self,
        shot: &Shot,
        attempt: usize,
        rejected: &mut Vec<String>,
        verdict: Verdict,
    ) -> Result<(), Trouble> {
        self.reject(shot, attempt, verdict.reason())?;
        if let Verdict::Black(reason) = &verdict {
            self.doubt_lamp(reason)?;
        }
        rejected.push(verdict.reason().to_owned());
        if rejected.len() <= RETAKES {
            return Ok(());
        }
        let Shot { station, exposure, shutter: Shutter { label, .. }, .. } = shot;
        let told = format!(
            "station {station}, exposure {exposure} ({label} s): refused {} times, {}",
            rejected.len(),
            why(rejected)
        );
        Err(match verdict {
            Verdict::Contradicts(_) | Verdict::Black(_) => Trouble::Bracket(told),
            Verdict::Damaged(_) => Trouble::Frame(told),
        })
    }

    /// A black frame of a session is shot once more: a shutter may stay closed once. Black again, it is the lamp. In a calibration the
    /// stage may be empty.
    fn doubt_lamp(&mut self, reason: &str) -> Result<(), Ended> {
        if self.work.capture().is_none() {
            return Ok(());
        }
        if self.lamp_doubted {
            return Err(Ended::Interrupted(format!(
                "{LAMP_OUT}: a frame was black, and black again when it was shot once more; {reason}"
            )));
        }
        self.lamp_doubted = true;
        self.record("fault.raised", json!({"device": "lamp", "reason": reason}))
    }

    /// A frame shows something: the lamp is not out.
    fn lamp_shows(&mut self) -> Result<(), Ended> {
        if std::mem::take(&mut self.lamp_doubted) {
            self.record("fault.cleared", json!({"device": "lamp"}))?;
        }
        Ok(())
    }

    fn reject(&mut self, shot: &Shot, attempt: usize, reason: &str) -> Result<(), Ended> {
        let fields = json!({
            "station": shot.station, "exposure": shot.exposure, "attempt": attempt, "shutter": shot.shutter.label, "reason": reason
        });
        self.record("frame.rejected", fields)
    }

    pub(super) fn shot(&self, station: usize, exposure: usize) -> Result<Shot, Ended> {
        let planned = self.work.exposures(station).get(exposure);
        let shutter = planned.and_then(|planned| Shutter::from_label(&planned.label).ok());
        let shutter =
            shutter.ok_or_else(|| Ended::Failed(format!("exposure {exposure} of the plan has no shutter")))?;
        Ok(Shot { station, exposure, shutter, f_number: self.rig.camera.f_number, iso: self.rig.camera.iso })
    }

    /// Frame durable on disk, then its journal line: the acknowledgement.
    fn commit(
        &mut self,
        shot: &Shot,
        attempt: usize,
        (angle_deg, since_rest_s): (f64, [f64; 2]),
        frame: &RawFrame,
        fingerprint: &Fingerprint,
    ) -> Result<(), StoreError> {
        let file = frames::file_name(shot.station, shot.exposure, attempt);
        self.writer.write(&file, &frame.bytes)?;
        let fields = json!({
            "station": shot.station, "exposure": shot.exposure, "attempt": attempt, "bracket": self.bracket, "angle_deg": angle_deg,
            "file": file, "bytes": frame.bytes.len(), "blake3": fingerprint.blake3,
            "shutter": shot.shutter.label, "true_s": shot.shutter.true_s,
            "since_rest_s": since_rest_s, "taken": fingerprint.taken, "camera_file": frame.name,
        });
        self.book.record(self.id, "frame.committed", fields).inspect_err(|_| {
            // Not acknowledged, so not kept; what cannot be removed now is removed at the next start.
            let _ = self.writer.take_back(&file);
        })
    }
}

/// The first reason and, if it is another, the last: what is wrong with a frame often shows in the first alone.
fn why(reasons: &[String]) -> String {
    match (reasons.first(), reasons.last()) {
        (Some(first), Some(last)) if first != last => format!("first because {first}, at last because {last}"),
        (_, last) => format!("at last because {}", last.map_or("", String::as_str)),
    }
}
