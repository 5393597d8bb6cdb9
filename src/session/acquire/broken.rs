//! A bracket that an interruption broke. The lamp was off in between, so its halves may be lit by two lamps; it goes on where it was if
//! one of its exposures, shot again, shows the same light, and is shot again whole if not.

use super::{Acquisition, Ended, Stage, Trouble};
use crate::devices::camera::Shot;
use crate::numerics::quality::{Look, expected_error};
use crate::session::ledger::FrameRecord;
use crate::session::witness::{Lighting, agree, can_tell};
use serde_json::json;

/// A frame of the broken bracket.
struct Kept {
    shot: Shot,
    look: Look,
}

impl Acquisition<'_> {
    /// The exposures that the station's bracket goes on after; none where it begins anew.
    pub(super) fn keep_broken(&mut self, station: usize, angle_deg: f64) -> Result<Vec<usize>, Trouble> {
        if self.broken.take_if(|broken| *broken == station).is_none() {
            return Ok(Vec::new());
        }
        let begin = self.now();
        let kept = self.proven(station, angle_deg);
        self.spend(Stage::Recovery, begin);
        let kept = kept?;
        let exposures = kept.iter().map(|kept| kept.shot.exposure).collect();
        if !kept.is_empty() {
            self.witness.begin();
        }
        for Kept { shot, look } in kept {
            self.witness.accept(&shot, look, Lighting::of(self.rig, angle_deg));
        }
        Ok(exposures)
    }

    /// The frames of the broken bracket, if the one that tells most about the light shows it still when it is shot again.
    fn proven(&mut self, station: usize, angle_deg: f64) -> Result<Vec<Kept>, Trouble> {
        let kept = self.of_last_bracket(station)?;
        let Some(control) = kept.iter().filter(|kept| can_tell(&kept.look)).min_by(|a, b| {
            let [a, b] = [a, b].map(|kept| expected_error(&kept.look));
            a.total_cmp(&b)
        }) else {
            return Ok(Vec::new());
        };
        let Shot { exposure, shutter, .. } = &control.shot;
        let again = self.test_frame(&control.shot, Some(angle_deg))?;
        match again.and_then(|again| agree(&control.look, &again)) {
            Ok((change, sigma)) => {
                let exposures: Vec<usize> = kept.iter().map(|kept| kept.shot.exposure).collect();
                let fields = json!({
                    "station": station, "bracket": self.bracket, "kept": exposures, "exposure": exposure, "shutter": shutter.label,
                    "change": change, "sigma": sigma,
                });
                self.record("bracket.resumed", fields)?;
                Ok(kept)
            }
            Err(reason) => {
                let label = &shutter.label;
                let reason = format!(
                    "it was interrupted, and its exposure {exposure} ({label} s), shot again, does not prove that the light is the same: \
                     {reason}"
                );
                self.record("bracket.rejected", json!({"station": station, "reason": reason}))?;
                // What they showed, a lit lamp must show again.
                for Kept { shot, look } in &kept {
                    self.witness.lit(shot, look, Lighting::of(self.rig, angle_deg));
                }
                // A camera that plays a folder has but this file if this exposure comes next.
                self.last = None;
                Ok(Vec::new())
            }
        }
    }

    /// What is on disk of a station's bracket, if that is the last bracket that was begun.
    fn of_last_bracket(&mut self, station: usize) -> Result<Vec<Kept>, Ended> {
        let of_it = |frame: &&FrameRecord| frame.station == station && frame.bracket == self.bracket;
        let frames: Vec<FrameRecord> =
            self.book.look(self.id, |entry| entry.ledger.frames().filter(of_it).cloned().collect()).unwrap_or_default();
        let mut kept = Vec::new();
        for frame in frames {
            let shot = self.shot(station, frame.exposure)?;
            let look = self.writer.read(&frame.file, frame.bytes).and_then(|bytes| self.witness.look(&bytes));
            match look {
                Ok(look) => kept.push(Kept { shot, look }),
                Err(_) => return Ok(Vec::new()),
            }
        }
        Ok(kept)
    }
}
