//! The steps of a calibration: ask the operator, shoot what is in place, have it judged, ask again where it does not serve.

use super::hold::LONG;
use super::{Acquisition, Ended, Stage};
use crate::session::calibration::plan::{CalibrationPlan, PlannedStep};
use crate::session::calibration::step::Step;
use crate::session::processing::Judged;
use crate::session::state::{Event, SessionState};
use crate::session::worker::{self, Job};
use serde_json::json;
use std::ops::Range;
use std::sync::mpsc::sync_channel;

impl Acquisition<'_> {
    /// Takes every step until it is accepted.
    pub(super) fn guided(&mut self, plan: &CalibrationPlan) -> Result<(), Ended> {
        for (index, step) in plan.steps.iter().enumerate() {
            if step.step == Step::Settle {
                self.unattended(plan, index, step)?;
                continue;
            }
            loop {
                self.ask_operator(index, step)?;
                match self.whole_step(plan.stations_of(index))? {
                    Err(reason) => self.refuse(index, step, &reason)?,
                    Ok(()) if self.serves(index, step)? => break,
                    Ok(()) => {}
                }
            }
        }
        Ok(())
    }

    /// A step that nobody can help with: what does not serve ends the run.
    fn unattended(&mut self, plan: &CalibrationPlan, index: usize, step: &PlannedStep) -> Result<(), Ended> {
        self.whole_step(plan.stations_of(index))?.map_err(Ended::Interrupted)?;
        if self.serves(index, step)? { Ok(()) } else { Err(Ended::Failed("the step does not serve".into())) }
    }

    /// Shoots every station of a step; the inner error says why a frame does not serve.
    fn whole_step(&mut self, stations: Range<usize>) -> Result<Result<(), String>, Ended> {
        for station in stations {
            if let Err(reason) = self.whole_station(station)? {
                return Ok(Err(reason));
            }
        }
        Ok(Ok(()))
    }

    fn refuse(&mut self, index: usize, step: &PlannedStep, reason: &str) -> Result<(), Ended> {
        self.record("step.refused", json!({"index": index, "step": step.step, "reason": reason}))
    }

    /// Says what is to be put in place and waits until someone says that it is.
    fn ask_operator(&mut self, index: usize, step: &PlannedStep) -> Result<(), Ended> {
        let instruction = self.rig.calibration.as_ref().map(|calibration| step.step.instruction(calibration));
        let fields = json!({"index": index, "step": step.step, "instruction": instruction});
        self.record("step.asked", fields)?;
        self.safe_point()?;
        // Refused only when a user ended the run meanwhile: the next safe point sees it.
        let _ = self.book.happen(self.id, Event::OperatorNeeded, None);
        let since = self.now();
        while self.state() == SessionState::Awaiting && !self.book.lock().shutdown {
            self.wait(LONG, |state| state != SessionState::Awaiting);
        }
        self.spend(Stage::Held, since);
        self.safe_point().map(|_| ())
    }

    /// Has the frames of a step judged and journals what became of it; true when they serve.
    fn serves(&mut self, index: usize, step: &PlannedStep) -> Result<bool, Ended> {
        loop {
            let (done, answer) = sync_channel(1);
            self.hand_over(|session| Job::Judge { session, step: index, done })?;
            match worker::answer(self.book, self.id, &answer)? {
                Ok(Judged::Accepted(found)) => {
                    self.record("step.accepted", json!({"index": index, "step": step.step, "found": found}))?;
                    return Ok(true);
                }
                Ok(Judged::Refused(reason)) => {
                    self.refuse(index, step, &reason)?;
                    return Ok(false);
                }
                Err(fault) => self.outlast(fault)?,
            }
        }
    }
}
