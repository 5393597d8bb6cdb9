//! Arm and camera of the running session: opening them, and leaving them safe whatever happened.

use super::worker::message;
use crate::devices::Cancel;
use crate::devices::arm::{Arm, ArmError, ArmStatus};
use crate::devices::camera::{CALL_GRACE_S, Camera, CameraError, CameraHandle};
use rig_config::Rig;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Opens the arm; the composition root knows which.
pub type OpenArm = Box<dyn FnMut() -> Result<Box<dyn Arm>, ArmError> + Send>;
/// Opens the camera; the composition root knows which.
pub type OpenCamera = Box<dyn FnMut(&Cancel) -> Result<Box<dyn Camera>, CameraError> + Send>;

/// Applies a remedy, unless it is broken off; the error is a sentence.
pub type Apply = Box<dyn FnMut(&Cancel) -> Result<(), String> + Send>;

/// What may bring back a camera that a new driver does not.
pub struct Remedy {
    /// As the journal names it.
    pub name: &'static str,
    /// Does it; the error is a sentence.
    pub apply: Apply,
}

/// The devices of the rig, open only while a session needs them.
pub struct Bench {
    rig: Rig,
    open_arm: OpenArm,
    open_camera: OpenCamera,
    remedies: Vec<Remedy>,
    arm: Option<Box<dyn Arm>>,
    camera: Option<CameraHandle>,
    /// Flag of the moves of a clean-up, which nothing cancels.
    parking: Cancel,
    /// The lamp may be on or the arm away from its park position.
    unsafe_since_clean_up: bool,
}

impl Bench {
    /// Nothing is opened yet. `after_crash` makes the first clean-up look after a lamp that an earlier run left on; a clean-up's beats
    /// count with those of `cancel`.
    pub fn new(
        rig: Rig,
        open_arm: OpenArm,
        open_camera: OpenCamera,
        remedies: Vec<Remedy>,
        after_crash: bool,
        cancel: &Cancel,
    ) -> Self {
        let (parking, unsafe_since_clean_up) = (cancel.apart(), after_crash);
        Self { rig, open_arm, open_camera, remedies, arm: None, camera: None, parking, unsafe_since_clean_up }
    }

    /// Opens arm and camera; says who answered: firmware, model.
    pub fn open(&mut self, cancel: &Cancel) -> Result<(String, String), String> {
        self.reopen_camera(cancel).map_err(|e| e.to_string())?;
        self.unsafe_since_clean_up = true;
        self.open_arm().map_err(|e| e.to_string())?;
        let firmware = self.arm.as_ref().map(|a| a.identity().firmware).unwrap_or_default();
        let camera = self.camera.as_ref().map(|c| c.identity().model.clone()).unwrap_or_default();
        Ok((firmware, camera))
    }

    /// The open arm.
    pub fn arm(&mut self) -> Result<&mut dyn Arm, ArmError> {
        match &mut self.arm {
            Some(arm) => Ok(arm.as_mut()),
            None => Err(ArmError::Gone),
        }
    }

    /// The open camera.
    pub fn camera(&self) -> Result<&CameraHandle, CameraError> {
        self.camera.as_ref().ok_or_else(|| CameraError::Unusable { reason: "it is not open".into() })
    }

    /// Homes the arm and switches the lamp on.
    pub fn prepare(&mut self, cancel: &Cancel) -> Result<(), ArmError> {
        let level = self.rig.lamp.level_permille;
        let arm = self.arm()?;
        arm.home(cancel)?;
        arm.set_lamp(level)?;
        Ok(())
    }

    /// Leaves a camera that no longer answers behind and opens it anew.
    pub fn reopen_camera(&mut self, cancel: &Cancel) -> Result<(), CameraError> {
        if let Some(camera) = self.camera.take() {
            camera.release();
        }
        self.camera = Some(CameraHandle::new((self.open_camera)(cancel)?, CALL_GRACE_S)?);
        Ok(())
    }

    /// A new connection to the arm.
    pub fn open_arm(&mut self) -> Result<(), ArmError> {
        self.arm = Some((self.open_arm)()?);
        Ok(())
    }

    /// Lets go of an arm in trouble, with the lamp off if it still listens.
    pub fn drop_arm(&mut self) {
        if let Some(mut arm) = self.arm.take() {
            // An arm that does not listen switches its lamp off by itself: its dead-man time-out.
            let _ = arm.set_lamp(0);
        }
    }

    /// The arm's angle, or why the last frame cannot have been lit as planned; `angle_deg` is where the arm must stand.
    pub fn proof_of_light(&mut self, angle_deg: f64) -> Result<Result<f64, String>, ArmError> {
        let (level, tolerance) = (self.rig.lamp.level_permille, self.rig.arm.tolerance_deg);
        let status = self.arm()?.status()?;
        Ok(why_not_lit(&status, angle_deg, level, tolerance).map_or(Ok(status.angle_deg), Err))
    }

    /// How many remedies the rig has for a camera that does not open anew.
    pub fn remedies(&self) -> usize {
        self.remedies.len()
    }

    /// Applies a remedy to the camera, which is let go of before; its name, and what kept it from working.
    pub fn apply_remedy(&mut self, index: usize, cancel: &Cancel) -> Result<&'static str, (&'static str, String)> {
        if let Some(camera) = self.camera.take() {
            camera.release();
        }
        let remedy = self.remedies.get_mut(index).ok_or(("remedy", format!("there is no remedy {index}")))?;
        (remedy.apply)(cancel).map(|()| remedy.name).map_err(|why| (remedy.name, why))
    }

    /// Stops the arm, switches the lamp off, parks, lets go of both devices. Returns what could not be done.
    pub fn clean_up(&mut self) -> Vec<String> {
        let mut faults = Vec::new();
        if self.unsafe_since_clean_up
            && let Err(first) = self.make_safe()
        {
            self.arm = None;
            if let Err(second) = self.make_safe() {
                let why = if first == second { first } else { format!("{first}; then {second}") };
                faults.push(format!(
                    "the lamp may be on and the arm is not parked ({why}): switch the lamp's supply off"
                ));
            }
        }
        self.arm = None;
        self.unsafe_since_clean_up = !faults.is_empty();
        if self.camera.take().is_some_and(|camera| !camera.release()) {
            faults.push("the camera's driver does not come back: switch the camera off and on".into());
        }
        faults
    }

    /// True while the lamp may be on or the arm away from its park position, as far as is known.
    pub fn is_unsafe(&self) -> bool {
        self.unsafe_since_clean_up
    }

    /// One try; opens the arm if it is not open.
    fn make_safe(&mut self) -> Result<(), String> {
        let (arm, open, park, parking) = (&mut self.arm, &mut self.open_arm, self.rig.arm.park_deg, &self.parking);
        let work = move || {
            let arm = match arm {
                Some(arm) => arm,
                None => arm.insert(open()?),
            };
            switch_off_and_park(arm.as_mut(), park, parking)
        };
        match catch_unwind(AssertUnwindSafe(work)) {
            Ok(result) => result.map_err(|e| e.to_string()),
            Err(panic) => Err(format!("the arm's driver panicked: {}", message(&*panic))),
        }
    }
}

/// Stops, switches off, proves it by the status, parks if the arm knows where it is.
fn switch_off_and_park(arm: &mut dyn Arm, park_deg: f64, parking: &Cancel) -> Result<(), ArmError> {
    // The lamp goes off even when the stop fails.
    let stopped = arm.stop();
    arm.set_lamp(0)?;
    stopped?;
    let status = arm.status()?;
    if status.lamp_permille != 0 {
        let reason = format!("the status still says {} permille", status.lamp_permille);
        return Err(ArmError::Refused { what: "lamp off", reason });
    }
    if status.homed {
        // A cancelled session must still be parked: this move has a flag of its own.
        arm.move_to(park_deg, parking)?;
    }
    Ok(())
}

fn why_not_lit(status: &ArmStatus, angle_deg: f64, level: u16, tolerance_deg: f64) -> Option<String> {
    if status.lamp_permille != level {
        return Some(format!("the lamp is at {} permille, not at {level}", status.lamp_permille));
    }
    if status.faults != 0 {
        return Some(format!("the arm reports fault {:#06x}", status.faults));
    }
    if !status.homed || status.moving {
        return Some("the arm moves or has lost its home position".into());
    }
    let off = (status.angle_deg - angle_deg).abs();
    (off.is_nan() || off > tolerance_deg)
        .then(|| format!("the arm stands at {:.3} degrees, not at {angle_deg:.3}", status.angle_deg))
}
