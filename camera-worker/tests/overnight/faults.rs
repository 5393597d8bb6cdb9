//! Faults of camera and arm, one after another as a seed draws them; all of them a night can be lived through with.

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rigd::sim::arm::ArmFaults;
use simulated_eos::{Fault, Moment};
use std::time::Duration;

const MOMENTS: [Moment; 4] = [Moment::Setting, Moment::Release, Moment::Transfer, Moment::Polling];

pub struct Faults {
    random: StdRng,
    every: f64,
    /// Frames at which the next one comes.
    next: f64,
    camera: simulated_eos::Faults,
    arm: ArmFaults,
}

impl Faults {
    pub fn new(seed: u64, every: f64, camera: simulated_eos::Faults, arm: ArmFaults) -> Self {
        let mut faults = Self { random: StdRng::seed_from_u64(seed), every, next: 0.0, camera, arm };
        faults.draw_next();
        faults
    }

    /// Strikes once there are enough frames.
    pub fn strike(&mut self, frames: u64, told: &mut Vec<String>) {
        if frames as f64 >= self.next {
            told.push(self.inject());
            self.draw_next();
        }
    }

    /// Times between faults as chance has them: exponential.
    fn draw_next(&mut self) {
        self.next -= self.every * (1.0 - self.random.random::<f64>()).ln();
    }

    fn inject(&mut self) -> String {
        let moment = MOMENTS[self.random.random_range(0..MOMENTS.len())];
        let fault = match self.random.random_range(0..12) {
            0 => Fault::Busy(moment),
            1 => Fault::Slow(moment, Duration::from_millis(2600)),
            2 => Fault::LinkDrop(moment),
            3 => Fault::IgnoredSetting,
            4 => Fault::WrongFile,
            5 => Fault::LateFile(Duration::from_millis(700)),
            6 => Fault::Duplicate,
            7 => Fault::TruncatedTransfer,
            8 => return self.of_arm("noise on the line", |arm| arm.noise(300)),
            9 => return self.of_arm("lost answers", |arm| arm.drop_answers(2)),
            10 => return self.of_arm("garbled answers", |arm| arm.garble_answers(2)),
            _ => return self.of_arm("arm rebooted", ArmFaults::reboot),
        };
        self.camera.inject(fault, 1);
        format!("{fault:?}")
    }

    fn of_arm(&self, name: &str, strike: impl FnOnce(&ArmFaults)) -> String {
        strike(&self.arm);
        name.to_owned()
    }
}
