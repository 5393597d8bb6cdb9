//! A lamp that was just lit: it soaks, then test frames of one exposure must show that it is steady. They are not kept.

use super::frames::LAMP_OUT;
use super::shooting::Taken;
use super::{Acquisition, Ended, Trouble};
use crate::devices::camera::Shot;
use crate::numerics::quality::{Look, brighter};
use crate::session::calibration::plan::frontality;
use crate::session::witness::Lighting;
use serde_json::json;

/// The lamp is steady when so many test frames in a row, evenly spread over `lamp.steady_s`, differ by less than this.
const READINGS: usize = 3;
const STEADY: f64 = 0.003;
/// Test frames after which a lamp that never becomes steady is put up with.
const MOST: usize = 30;
/// Tries for one test frame.
const TRIES: usize = 3;

impl Acquisition<'_> {
    /// Waits until the lamp, which was just lit, serves.
    pub(super) fn warm_up(&mut self) -> Result<(), Trouble> {
        self.rest(self.rig.lamp.soak_s)?;
        if self.rig.lamp.steady_s > 0.0 && self.work.capture().is_some() {
            self.await_steady()?;
        }
        Ok(())
    }

    /// At the plan's station that lights most of what the camera sees.
    fn await_steady(&mut self) -> Result<(), Trouble> {
        let front = |station: &usize| frontality(self.rig, self.work.angle_deg(*station));
        let station = (0..self.work.stations()).max_by(|a, b| front(a).total_cmp(&front(b))).unwrap_or_default();
        let angle_deg = self.work.angle_deg(station);
        self.turn(angle_deg)?;
        self.rest(self.rig.arm.settle_s)?;
        let Some((shot, first)) = self.test_exposure(station, angle_deg)? else {
            return self.put_up_with("no exposure of the bracket shows enough of the object to tell".into());
        };
        let mut looks = vec![first];
        while looks.len() < MOST {
            self.rest(self.rig.lamp.steady_s / (READINGS - 1) as f64)?;
            let look = match self.test_frame(&shot, Some(angle_deg))? {
                Ok(look) => look,
                Err(reason) => return self.put_up_with(format!("a test frame does not serve: {reason}")),
            };
            looks.push(look);
            let spread = spread(&looks);
            self.tell_test(&shot, looks.len(), spread)?;
            if spread.is_some_and(|spread| spread < STEADY) {
                self.record("lamp.steady", json!({"frames": looks.len(), "spread": spread}))?;
                return self.see_shorter(&shot, angle_deg);
            }
        }
        let last = spread(&looks).map(|spread| format!(", at last by {:.2} %", 100.0 * spread)).unwrap_or_default();
        self.put_up_with(format!(
            "{MOST} test frames {} s apart still differ{last}",
            self.rig.lamp.steady_s / (READINGS - 1) as f64
        ))
    }

    /// One frame of each shorter exposure: from now on a black frame is known for one even if it is the first of the first bracket.
    fn see_shorter(&mut self, than: &Shot, angle_deg: f64) -> Result<(), Trouble> {
        for exposure in 0..self.work.exposures(than.station).len() {
            let shot = self.shot(than.station, exposure)?;
            if shot.shutter.true_s < than.shutter.true_s
                && let Ok(look) = self.test_frame(&shot, Some(angle_deg))?
            {
                self.witness.lit(&shot, &look, Lighting::of(self.rig, angle_deg));
            }
        }
        Ok(())
    }

    /// Journals a test frame: its number, and by how much the last ones differ.
    fn tell_test(&mut self, shot: &Shot, frame: usize, spread: Option<f64>) -> Result<(), Ended> {
        self.record("lamp.tested", json!({"frame": frame, "shutter": shot.shutter.label, "spread": spread}))
    }

    /// A night is not given up for a lamp that never settles: the reference patch follows it, and whoever reads the result is warned.
    fn put_up_with(&mut self, reason: String) -> Result<(), Trouble> {
        let warning = format!(
            "the lamp is not known to be steady after {} s of warm-up: {reason}; let it warm up longer (lamp.soak_s), see to its supply",
            self.rig.lamp.soak_s
        );
        Ok(self.record("lamp.unsteady", json!({"warnings": [warning]}))?)
    }

    /// The exposure that test frames are shot with, from the middle of the bracket outwards, and its first frame; none if no exposure
    /// shows enough.
    fn test_exposure(&mut self, station: usize, angle_deg: f64) -> Result<Option<(Shot, Look)>, Trouble> {
        let exposures = self.work.exposures(station);
        let mut order: Vec<usize> = (0..exposures.len()).collect();
        order.sort_by(|&a, &b| exposures[a].true_s.total_cmp(&exposures[b].true_s));
        let middle = order.len() / 2;
        let mut outwards: Vec<(usize, usize)> = order.into_iter().enumerate().collect();
        outwards.sort_by_key(|(place, _)| place.abs_diff(middle));
        let (mut seen, mut showing) = (0, 0);
        for (_, exposure) in outwards {
            let shot = self.shot(station, exposure)?;
            let Ok(look) = self.test_frame(&shot, Some(angle_deg))? else { continue };
            seen += 1;
            showing += usize::from(look.shows());
            if brighter(&look, &look).is_some() {
                self.witness.lit(&shot, &look, Lighting::of(self.rig, angle_deg));
                self.tell_test(&shot, 1, None)?;
                return Ok(Some((shot, look)));
            }
        }
        if seen == 0 || showing > 0 {
            return Ok(None);
        }
        let reason = format!("no exposure of the bracket shows anything with the arm at {angle_deg} degrees");
        self.record("fault.raised", json!({"device": "lamp", "reason": reason}))?;
        Err(Ended::Interrupted(format!("{LAMP_OUT}: {reason}")).into())
    }

    /// A frame that does not count, lit from this angle or, without one, by no lamp; the inner error says why none serves.
    pub(super) fn test_frame(&mut self, shot: &Shot, lit_from: Option<f64>) -> Result<Result<Look, String>, Trouble> {
        let mut why = String::new();
        for _ in 0..TRIES {
            self.safe_point()?;
            match self.shoot(shot)? {
                Taken::Good(frame, ..) => {
                    if let Some(angle_deg) = lit_from {
                        self.check_light(angle_deg)?;
                    }
                    match self.witness.look(&frame.bytes) {
                        Ok(look) => return Ok(Ok(look)),
                        Err(reason) => why = reason,
                    }
                }
                Taken::Refused(reason) | Taken::Recovered(reason) => why = reason,
            }
        }
        Ok(Err(why))
    }
}

/// By how much the last test frames differ, relative; none before there are enough of them, or if they cannot be compared.
fn spread(looks: &[Look]) -> Option<f64> {
    let last = looks.len().checked_sub(READINGS).and_then(|from| looks.get(from..))?;
    let (first, later) = last.split_first()?;
    let (mut low, mut high) = (0.0_f64, 0.0_f64);
    for look in later {
        let (change, _) = brighter(first, look)?;
        (low, high) = (low.min(change), high.max(change));
    }
    Some(high - low)
}
