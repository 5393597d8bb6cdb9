//! Where the time of a run goes.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::time::Duration;
use utoipa::ToSchema;

/// What a run spends time on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Opening devices, homing, warming the lamp.
    Preparation,
    /// The arm moves, and is led to its switch.
    Motion,
    /// The arm stands, and is left to settle.
    Settling,
    /// The shutter is open.
    Shutter,
    /// A file comes from the camera.
    Transfer,
    /// The camera is set, releases, and gets ready again.
    Camera,
    /// A frame is proved, written and journalled.
    Storing,
    /// Shots that were refused, and devices that had to be brought back.
    Recovery,
    /// Held up by a user or a full disk.
    Held,
}

/// Time of a run by stage, seconds of the clock on the wall; a simulation that runs faster than real time opens its shutter and
/// moves its arm for that much less, and spends as long as ever on all else.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TimeBudget {
    /// Opening devices, homing, warming the lamp.
    pub preparation_s: f64,
    /// The arm moves, and is led to its switch to prove where it stands.
    pub motion_s: f64,
    /// The arm stands, and is left to settle.
    pub settling_s: f64,
    /// The shutter is open for frames that were kept.
    pub shutter_s: f64,
    /// Files come from the camera.
    pub transfer_s: f64,
    /// The camera is set, releases, and gets ready again.
    pub camera_s: f64,
    /// Frames are proved, written and journalled.
    pub storing_s: f64,
    /// Shots that were refused, and devices that had to be brought back.
    pub recovery_s: f64,
    /// Held up: paused, waiting for an operator, waiting for disk space.
    pub held_s: f64,
    /// All else.
    pub other_s: f64,
    /// Time of camera, storing, recovery and all else over that of motion, settling, shutter and transfer; null before
    /// there is any.
    pub overhead: Option<f64>,
}

impl TimeBudget {
    /// Adds time to a stage.
    pub fn spend(&mut self, stage: Stage, time: Duration) {
        let spent = match stage {
            Stage::Preparation => &mut self.preparation_s,
            Stage::Motion => &mut self.motion_s,
            Stage::Settling => &mut self.settling_s,
            Stage::Shutter => &mut self.shutter_s,
            Stage::Transfer => &mut self.transfer_s,
            Stage::Camera => &mut self.camera_s,
            Stage::Storing => &mut self.storing_s,
            Stage::Recovery => &mut self.recovery_s,
            Stage::Held => &mut self.held_s,
        };
        *spent += time.as_secs_f64();
    }

    /// All of it, seconds.
    pub fn total_s(&self) -> f64 {
        let stages =
            [self.preparation_s, self.motion_s, self.settling_s, self.shutter_s, self.transfer_s, self.camera_s];
        stages.iter().sum::<f64>() + self.storing_s + self.recovery_s + self.held_s + self.other_s
    }

    /// The budget of a run that has lasted for `whole_s` seconds: what no stage was given is all else.
    #[must_use]
    pub fn of_all(&self, whole_s: f64) -> Self {
        let needed = self.motion_s + self.settling_s + self.shutter_s + self.transfer_s;
        let lost = self.camera_s + self.storing_s + self.recovery_s;
        let other_s = whole_s - needed - lost - self.preparation_s - self.held_s;
        let overhead = (needed > 0.0).then(|| (lost + other_s) / needed);
        Self { other_s, overhead, ..self.clone() }
    }
}

impl fmt::Display for TimeBudget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let stages = [
            ("preparation", self.preparation_s),
            ("motion", self.motion_s),
            ("settling", self.settling_s),
            ("shutter", self.shutter_s),
            ("transfer", self.transfer_s),
            ("camera", self.camera_s),
            ("storing", self.storing_s),
            ("recovery", self.recovery_s),
            ("held", self.held_s),
            ("other", self.other_s),
        ];
        let spent: Vec<String> = stages
            .iter()
            .filter(|(_, seconds)| *seconds >= 0.05)
            .map(|(name, seconds)| format!("{name} {seconds:.1} s"))
            .collect();
        write!(f, "{}", spent.join(", "))?;
        match self.overhead {
            Some(overhead) => {
                write!(f, "; {:.1} % over motion, settling, shutter and transfer", 100.0 * overhead)
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_stage_was_given_is_all_else_and_overhead_is_what_a_perfect_rig_would_not_need() {
        let mut budget = TimeBudget::default();
        assert_eq!(budget.of_all(1.0).overhead, None);
        for (stage, seconds) in [
            (Stage::Preparation, 100.0),
            (Stage::Motion, 4.0),
            (Stage::Settling, 2.0),
            (Stage::Shutter, 30.0),
            (Stage::Shutter, 2.0),
            (Stage::Transfer, 2.0),
            (Stage::Camera, 1.0),
            (Stage::Storing, 0.5),
            (Stage::Recovery, 0.25),
            (Stage::Held, 50.0),
        ] {
            budget.spend(stage, Duration::from_secs_f64(seconds));
        }
        let whole = budget.of_all(192.0);
        assert_eq!(whole.total_s(), 192.0);
        assert_eq!((whole.shutter_s, whole.other_s, whole.overhead), (32.0, 0.25, Some(0.05)));
        assert!(
            whole.to_string().ends_with("held 50.0 s, other 0.2 s; 5.0 % over motion, settling, shutter and transfer")
        );
    }
}
