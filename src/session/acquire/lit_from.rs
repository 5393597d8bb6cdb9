//! After a bracket: was it lit from where the arm says?

use super::{Acquisition, Ended, Trouble};
use serde_json::json;

/// Why a session ends whose lamp is not where the arm says, and what to do.
const ASTRAY: &str = "the lamp does not stand where the arm says, and homing does not mend it: tighten the lamp on the arm and the arm on its \
                      shaft, check the arm's zero and the rig file's lamp.circle_center_mm and object.center_mm, then resume the session";

impl Acquisition<'_> {
    /// Refuses a bracket whose pictures show the lamp elsewhere: the arm is homed and the station shot again; the second time in a row
    /// ends the session.
    pub(super) fn check_lit_from(&mut self, station: usize, angle_deg: f64) -> Result<(), Trouble> {
        if self.work.capture().is_none() {
            return Ok(());
        }
        let Err(reason) = self.shadow.judge(&self.witness.bracket(), angle_deg) else {
            self.arm_doubted = false;
            return match self.shadow.zero_warning() {
                Some(warning) => Ok(self.record("session.doubted", json!({"warnings": [warning]}))?),
                None => Ok(()),
            };
        };
        self.record("bracket.rejected", json!({"station": station, "whole": true, "reason": reason}))?;
        if std::mem::replace(&mut self.arm_doubted, true) {
            return Err(Ended::Interrupted(format!("{ASTRAY}; {reason}")).into());
        }
        Err(Trouble::Arm(reason))
    }
}
