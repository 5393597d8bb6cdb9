//! The troubles of a night: a camera that is busy, dies, disobeys or repeats itself, an arm that falls silent, reboots, is knocked or
//! loses its lamp, a disk that is full for a while.

use crate::support::{Act, Fakes, LEVEL, World};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rigd::devices::arm::ArmError;
use rigd::devices::camera::{CameraError, Shot};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// Of three faults, two are the camera's; the arm is asked about as often as there are shots.
const CAMERA_SHARE: f64 = 0.66;
const ARM_SHARE: f64 = 0.24;
const DISK_SHARE: f64 = 0.1;

/// Faults so far, by name.
pub type Counts = Arc<Mutex<BTreeMap<&'static str, u64>>>;

/// Chance decides where a fault comes; the same seed decides the same.
#[derive(Debug)]
pub struct Chance {
    random: Mutex<StdRng>,
    every: Option<u32>,
    counts: Counts,
}

impl Chance {
    /// A fault in `every` shots on average; none: never.
    pub fn new(seed: u64, every: Option<u32>, counts: Counts) -> Self {
        Self { random: Mutex::new(StdRng::seed_from_u64(seed)), every, counts }
    }

    /// One of `names`, now and then.
    fn draw(&self, share: f64, names: &[&'static str]) -> Option<&'static str> {
        let mut random = self.random.lock().unwrap();
        if !random.random_bool(share / f64::from(self.every?)) {
            return None;
        }
        let name = names[random.random_range(0..names.len())];
        *self.counts.lock().unwrap().entry(name).or_default() += 1;
        Some(name)
    }

    /// True when the disk is full for so many looks.
    pub fn disk(&self) -> Option<u32> {
        self.draw(DISK_SHARE, &["disk full"])?;
        Some(self.random.lock().unwrap().random_range(1..40))
    }
}

/// Lets the fakes fail.
pub fn install(fakes: &Fakes, chance: &Arc<Chance>) {
    let camera = chance.clone();
    fakes.on_shot(move |shot, _, _| camera_act(&camera, shot));
    let arm = chance.clone();
    fakes.on_arm(move |call, world| arm_act(&arm, call, world));
}

fn camera_act(chance: &Chance, shot: &Shot) -> Act {
    let names =
        ["busy", "refused", "dead", "late", "wrong exposure", "wrong aperture", "repeated", "cut off", "no picture"];
    let reason = || "so says the night".to_owned();
    match chance.draw(CAMERA_SHARE, &names) {
        Some("busy") => Act::Fail(CameraError::Busy { reason: reason() }),
        Some("refused") => Act::Fail(CameraError::Refused { reason: reason() }),
        Some("dead") => Act::Fail(CameraError::Unusable { reason: reason() }),
        Some("late") => Act::Fail(CameraError::Deadline { what: "a shot", deadline_s: 60.0 }),
        Some("wrong exposure") => {
            let stops = if shot.exposure == 0 { 2 } else { 1 };
            Act::Jpeg(Box::new(move |exif| exif.exposure.0 <<= stops))
        }
        Some("wrong aperture") => Act::Jpeg(Box::new(|exif| exif.f_number.0 += 15)),
        Some("repeated") => Act::Repeat,
        Some("cut off") => Act::Bytes(b"\xff\xd8\xff\xe0 cut".to_vec()),
        Some("no picture") => Act::Bytes(Vec::new()),
        _ => Act::Good,
    }
}

/// Only while frames are shot: what a clean-up does about a silent arm is proved elsewhere.
fn arm_act(chance: &Chance, call: &'static str, world: &mut World) -> Option<ArmError> {
    if world.lamp != LEVEL || call != "status" {
        return None;
    }
    match chance.draw(ARM_SHARE, &["silent", "rebooted", "knocked", "lamp out"])? {
        "silent" => Some(ArmError::NoAnswer { what: "status", waited_s: 1.0 }),
        "rebooted" => {
            (world.lamp, world.homed) = (0, false);
            Some(ArmError::Rebooted { was: 7, now: 8 })
        }
        "knocked" => {
            world.angle_deg += 2.0;
            None
        }
        _ => {
            world.lamp = 0;
            None
        }
    }
}
