//! What a calibration run's journal adds up to, and the run as anyone may see it.

use super::plan::Kind;
use super::step::Step;
use crate::session::state::SessionState;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

/// A calibration run: the body of `GET /v1/calibrations/{id}`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CalibrationSnapshot {
    /// Id, a UUID v7.
    pub id: String,
    /// Name of the run.
    pub name: String,
    /// What it calibrates.
    pub kind: Kind,
    /// Consecutive number of the run in this data directory.
    pub version: u64,
    /// Where the run stands; `awaiting`: what `instruction` says is to be done, then `shoot`.
    pub state: SessionState,
    /// Why it stands there, where that needs a reason (suspended, failed).
    pub reason: Option<String>,
    /// True when arm or camera is simulated.
    pub simulated: bool,
    /// Start, RFC 3339.
    pub started: String,
    /// End, RFC 3339; null while it runs.
    pub ended: Option<String>,
    /// The step in hand.
    pub step: Step,
    /// What is to be in place for it, in words; null when nothing is asked for.
    pub instruction: Option<String>,
    /// Steps in the plan.
    pub steps: usize,
    /// Steps accepted.
    pub steps_accepted: usize,
    /// What became of every step that was shot, oldest first.
    pub verdicts: Vec<Verdict>,
    /// Frames committed to disk and journalled, less those shot again.
    pub frames_committed: usize,
    /// Frames in the plan.
    pub frames_planned: usize,
    /// Sequence number of the last journal record.
    pub last_seq: u64,
}

/// What became of a step that was shot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Verdict {
    /// When, RFC 3339.
    pub time: String,
    /// The step.
    pub step: Step,
    /// Whether its frames are taken.
    pub accepted: bool,
    /// Why not, and what to do; null where they are.
    pub reason: Option<String>,
    /// What was measured on it, with its uncertainty.
    #[schema(value_type = Object)]
    pub found: Value,
}

/// The steps of a run as its journal tells them.
#[derive(Clone, Debug)]
pub struct Progress {
    /// The step in hand.
    pub step: Step,
    /// What was asked for.
    pub instruction: Option<String>,
    /// What became of those that were shot.
    pub verdicts: Vec<Verdict>,
}

impl Progress {
    /// Of a run of which nothing is journalled yet: its first step is in hand.
    pub fn new(first: Step) -> Self {
        Self { step: first, instruction: None, verdicts: Vec::new() }
    }

    /// Takes one journal record into account.
    pub fn apply(&mut self, record: &Value) {
        let text = |key: &str| record[key].as_str().map(str::to_owned);
        let step = || Step::deserialize(&record["step"]).ok();
        let accepted = match record["type"].as_str() {
            Some("step.asked") => {
                self.step = step().unwrap_or(self.step);
                self.instruction = text("instruction");
                return;
            }
            Some("step.accepted") => true,
            Some("step.refused") => false,
            Some("session.state") if record["state"] == "completed" => {
                self.step = Step::Done;
                return;
            }
            _ => return,
        };
        self.instruction = None;
        self.verdicts.push(Verdict {
            time: text("time").unwrap_or_default(),
            step: step().unwrap_or(self.step),
            accepted,
            reason: text("reason"),
            found: record["found"].clone(),
        });
    }

    /// Steps accepted so far.
    pub fn accepted(&self) -> usize {
        self.verdicts.iter().filter(|verdict| verdict.accepted).count()
    }
}
