//! Adaptive sessions: exposures that would add nothing are left out, and light stations once those before them suffice.

use super::{Acquisition, Ended, Trouble};
use crate::numerics::radiometry::metering::Worth;
use crate::session::adaptive::{LightTargets, Weighed};
use crate::session::processing::Next;
use crate::session::worker::{self, Job};
use serde_json::json;
use std::sync::mpsc::sync_channel;

impl Acquisition<'_> {
    /// The exposures of a bracket, one after the other; some may be `shot` already.
    pub(super) fn expose(&mut self, station: usize, angle_deg: f64, mut shot: Vec<usize>) -> Result<(), Trouble> {
        // The first station shows the response and which ratios the exposures have: it is shot whole.
        let mut metered =
            station > 0 && self.work.capture().is_some_and(|p| p.adaptive.as_ref().is_some_and(|a| a.exposures));
        let all = self.work.exposures(station).len();
        loop {
            let next = if metered { self.meter(station, &shot)? } else { None };
            let exposure = match next {
                Some(Next::Shoot(exposure)) => exposure,
                Some(Next::Enough(worth)) => return Ok(self.tell_enough(station, &shot, worth)?),
                None => {
                    metered = false;
                    let Some(exposure) = (0..all).find(|exposure| !shot.contains(exposure)) else { return Ok(()) };
                    exposure
                }
            };
            if self.safe_point()? {
                self.check_light(angle_deg)?;
            }
            self.take_frame(station, exposure, angle_deg)?;
            shot.push(exposure);
            self.measure_pace();
        }
    }

    /// What the worker says of the bracket so far; nothing where it cannot tell.
    fn meter(&mut self, station: usize, shot: &[usize]) -> Result<Option<Next>, Ended> {
        let (done, answer) = sync_channel(1);
        let shot = shot.to_vec();
        self.hand_over(|session| Job::Meter { session, station, shot, done })?;
        match worker::answer(self.book, self.id, &answer)? {
            Ok(next) => Ok(Some(next)),
            Err(reason) => {
                self.record("metering.failed", json!({"station": station, "reason": reason}))?;
                Ok(None)
            }
        }
    }

    fn tell_enough(&mut self, station: usize, shot: &[usize], worth: Worth) -> Result<(), Ended> {
        let planned = self.work.exposures(station).iter().enumerate();
        let left_out: Vec<&str> = planned.filter(|(i, _)| !shot.contains(i)).map(|(_, e)| &e.label[..]).collect();
        let fields = json!({
            "station": station, "bracket": self.bracket, "exposures": shot, "left_out": left_out,
            "sigma": worth.sigma, "sigma_whole": worth.sigma_whole,
        });
        self.record("exposures.enough", fields)
    }

    /// True when the stations before this one meet the session's targets: a fit says so.
    pub(super) fn lights_suffice(&mut self, station: usize) -> Result<bool, Ended> {
        let adaptive = self.work.capture().and_then(|plan| plan.adaptive.as_ref());
        let Some(targets) = adaptive.filter(|a| a.judges_before(station)).and_then(|a| a.lights) else {
            return Ok(false);
        };
        let whole = self.book.look(self.id, |entry| (0..station).all(|s| entry.ledger.bracket(s).is_some()));
        if whole != Some(true) {
            return Ok(false);
        }
        let (weighed, reason) = self.weigh()?;
        let enough = weighed.meets(&targets);
        self.tell_lights(station, &weighed, &targets, reason)?;
        Ok(enough)
    }

    /// How good a fit of the stations so far is; the reason where there is none.
    fn weigh(&mut self) -> Result<(Weighed, Option<String>), Ended> {
        loop {
            self.safe_point()?;
            let (done, answer) = sync_channel(1);
            self.hand_over(|session| Job::Weigh { session, done })?;
            match worker::answer(self.book, self.id, &answer)? {
                Ok(weighed) => return Ok((weighed, None)),
                Err(fault) if fault.lack.is_some() => self.outlast(fault)?,
                Err(fault) => return Ok((Weighed::default(), Some(fault.reason))),
            }
        }
    }

    fn tell_lights(
        &mut self,
        stations: usize,
        weighed: &Weighed,
        targets: &LightTargets,
        reason: Option<String>,
    ) -> Result<(), Ended> {
        let fields = json!({
            "stations": stations, "left_out_error": weighed.left_out_error, "left_out_highlight_error": weighed.left_out_highlight_error,
            "parameter_error": weighed.parameter_error, "targets": targets, "enough": weighed.meets(targets), "reason": reason,
        });
        self.record("lights.judged", fields)
    }
}
