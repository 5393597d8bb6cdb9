//! What of a calibration run its snapshot shows.

use super::Entry;
use crate::session::calibration::progress::CalibrationSnapshot;
use crate::session::state::SessionState;

impl Entry {
    /// A calibration run as anyone may see it; none of a session.
    pub fn calibration(&self) -> Option<CalibrationSnapshot> {
        let (progress, plan) = (self.ledger.progress.as_ref()?, self.work.calibration()?);
        let run = self.ledger.snapshot.clone();
        Some(CalibrationSnapshot {
            id: run.id,
            name: run.name,
            kind: plan.kind(),
            version: self.manifest.version.unwrap_or_default(),
            state: run.state,
            reason: run.reason,
            simulated: run.simulated,
            started: run.started,
            ended: run.ended,
            step: progress.step,
            instruction: progress.instruction.clone().filter(|_| run.state == SessionState::Awaiting),
            steps: plan.steps.len(),
            steps_accepted: progress.accepted(),
            verdicts: progress.verdicts.clone(),
            frames_committed: run.frames_committed,
            frames_planned: run.frames_planned,
            last_seq: run.last_seq,
        })
    }
}
