//! The room without the lamp: one frame before it is lit, of the longest exposure, tells how bright the room is. It is not kept.

use super::{Acquisition, Ended, Trouble};
use crate::numerics::quality::relative_exposure;
use serde_json::json;

/// Room light matters where it gives a pixel of the object this part of the light that level `DIM` takes: what the fit takes a model to be
/// off by, of a pixel as dim as its longest exposure still shows well. Noise that is cut off at black comes to a fifth of it.
const MATTERS: f64 = 0.02;
const DIM: f64 = 64.0;

impl Acquisition<'_> {
    /// Looks at the room; `spare`: the card takes a frame more than the session needs. What keeps it from being seen is journalled, and
    /// costs nothing else.
    pub(super) fn see_room(&mut self, spare: bool) -> Result<(), Ended> {
        let live = self.bench.camera().is_ok_and(|camera| camera.is_live());
        if self.work.capture().is_none() || !live {
            return Ok(());
        }
        let seen = if spare { self.room() } else { Ok(Err("the card takes the session's own frames alone".into())) };
        match seen {
            Ok(Ok(fields)) => self.record("ambient.measured", fields),
            Ok(Err(reason)) => self.record("ambient.failed", json!({"reason": reason})),
            Err(Trouble::End(ended)) => Err(ended),
            // An arm in trouble is met again by whatever comes next, which knows what to do.
            Err(Trouble::Arm(reason) | Trouble::Bracket(reason) | Trouble::Frame(reason)) => {
                self.record("ambient.failed", json!({"reason": reason}))
            }
        }
    }

    /// What it shows; the inner error says why nothing.
    fn room(&mut self) -> Result<Result<serde_json::Value, String>, Trouble> {
        let lamp = self.bench.arm().and_then(|arm| arm.status()).map_err(|error| Trouble::Arm(error.to_string()))?;
        if lamp.lamp_permille != 0 {
            return Ok(Err(format!("the lamp is at {} permille before it was lit", lamp.lamp_permille)));
        }
        let exposures = self.work.exposures(0).iter().enumerate();
        let Some((longest, _)) = exposures.max_by(|a, b| a.1.true_s.total_cmp(&b.1.true_s)) else {
            return Ok(Err("the plan has no exposure".into()));
        };
        let shot = self.shot(0, longest)?;
        Ok(self.test_frame(&shot, None)?.map(|look| {
            let (level, label) = (f64::from(look.median()), &shot.shutter.label);
            let share = relative_exposure(level, DIM);
            let warnings = (share > MATTERS).then(|| [warning(level, share, label)]);
            json!({"shutter": label, "level": level, "bright": look.bright, "share": share, "warnings": warnings})
        }))
    }
}

fn warning(level: f64, share: f64, label: &str) -> String {
    format!(
        "the room is not dark: with the lamp off the object has level {level:.1} at {label} s, {:.0} % of the light of a pixel at level \
         {DIM:.0}, and as much is added to every frame of this exposure: close the enclosure, switch room lights and displays off",
        100.0 * share
    )
}
