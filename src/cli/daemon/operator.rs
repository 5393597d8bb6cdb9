//! The simulated rig's operator: whoever calibrates it by REST finds on the stage what the step asks for.

use crate::devices::Cancel;
use crate::devices::camera::{Camera, CameraError, CameraIdentity, RawFrame, Shot};
use crate::session::handle::{EngineHandle, Step};
use crate::sim::camera::SimulatedCamera;
use crate::sim::stage::{Placed, StageHandle};
use std::sync::{Arc, Mutex, PoisonError};

/// Puts things on the stage as a calibration asks for them. The engine tells what that is, and is there only after its camera.
#[derive(Clone, Default)]
pub(super) struct Operator {
    engine: Arc<Mutex<Option<EngineHandle>>>,
    stage: StageHandle,
}

impl Operator {
    /// From now on this engine is asked.
    pub(super) fn serve(&self, engine: EngineHandle) {
        *self.engine.lock().unwrap_or_else(PoisonError::into_inner) = Some(engine);
    }

    /// A camera before which everything is in place when it shoots.
    pub(super) fn attend(&self, camera: SimulatedCamera) -> impl Camera + use<> {
        Attended { camera: camera.before(self.stage.clone()), operator: self.clone() }
    }

    fn place(&self) {
        let engine = self.engine.lock().unwrap_or_else(PoisonError::into_inner).clone();
        self.stage.place(engine.as_ref().map_or(Placed::Sample, asked_for));
    }
}

/// What is asked for; a board that was refused is held another way, but for the last view, on which the card will lie.
fn asked_for(engine: &EngineHandle) -> Placed {
    match engine.calibration_step() {
        Some((_, Step::Board { view, of })) if view == of => Placed::Board { view: 0 },
        Some((id, step @ Step::Board { view, of })) => {
            let verdicts = engine.calibration(&id).map(|run| run.verdicts).unwrap_or_default();
            let refused = verdicts.iter().filter(|verdict| verdict.step == step && !verdict.accepted).count();
            Placed::Board { view: view + refused * of }
        }
        Some((_, Step::Card)) => Placed::Card { on: 0 },
        Some((_, Step::Balls)) => Placed::Balls,
        Some((_, Step::Settle | Step::Done)) | None => Placed::Sample,
    }
}

struct Attended {
    camera: SimulatedCamera,
    operator: Operator,
}

impl Camera for Attended {
    fn identity(&self) -> CameraIdentity {
        self.camera.identity()
    }

    fn shoot(&mut self, shot: &Shot, cancel: &Cancel) -> Result<RawFrame, CameraError> {
        self.operator.place();
        self.camera.shoot(shot, cancel)
    }
}
