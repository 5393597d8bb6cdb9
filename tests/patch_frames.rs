//! What the reference patch tells within brackets of the simulated camera: of the lamp, and of itself.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod lamp;

use rig_config::{Rig, Scene, Shutter};
use rigd::devices::Cancel;
use rigd::devices::camera::{Camera, Shot};
use rigd::session::plan::Station;
use rigd::session::witness::{Drift, Lighting, Witness, part, patch_part};
use rigd::sim::camera::{CameraFaults, Fault, SimulatedCamera};
use rigd::sim::pose::{Pose, SharedPose};

const EXPOSURES: [&str; 7] = ["1/40", "1/20", "1/8", "1/4", "0.6", "1.3", "3.2"];
const ANGLES_DEG: [f64; 4] = [15.0, -20.0, 0.0, 30.0];

/// A camera before the simulated world, and what a session makes of its frames.
struct Bench {
    rig: Rig,
    camera: SimulatedCamera,
    faults: CameraFaults,
    pose: SharedPose,
    witness: Witness,
}

impl Bench {
    /// `moved_mm`: the patch really stands so much further to the right than the rig file says.
    fn new(seed: u64, moved_mm: f64) -> Self {
        let mut rig = lamp::rig();
        let simulation = rig.simulation.as_mut().unwrap();
        (simulation.speed, simulation.seed) = (f64::INFINITY, seed);
        simulation.scene = if seed.is_multiple_of(2) { Scene::Marble } else { Scene::Wood };
        let mut true_rig = rig.clone();
        true_rig.reference_patch.as_mut().unwrap().center_mm[0] += moved_mm;
        let (pose, faults) = (SharedPose::default(), CameraFaults::default());
        let simulation = true_rig.simulation.as_ref().unwrap();
        let camera = SimulatedCamera::new(&true_rig, simulation, pose.clone(), faults.clone());
        let witness = Witness::new(part(&rig, false));
        Self { rig, camera, faults, pose, witness }
    }

    /// A bracket with this wrong with its frames from the fourth on; every one of them must be accepted. What object and patch say.
    fn bracket(
        &mut self,
        station: usize,
        from_fourth: Option<Fault>,
    ) -> (Option<Drift>, Option<Drift>, Option<String>) {
        let angle_deg = ANGLES_DEG[station];
        self.pose.set(Pose { angle_deg, lamp_permille: self.rig.lamp.level_permille });
        let light_position_mm = self.rig.lamp.position_mm(angle_deg);
        let planned = Station { angle_deg, light_position_mm, light_intensity: None };
        self.witness.begin();
        self.witness.watch_patch(patch_part(&self.rig, &planned).unwrap());
        for (exposure, label) in EXPOSURES.iter().enumerate() {
            let (f_number, iso) = (self.rig.camera.f_number, self.rig.camera.iso);
            let shot = Shot { station, exposure, shutter: Shutter::from_label(label).unwrap(), f_number, iso };
            if let Some(fault) = from_fourth.filter(|_| exposure >= 3) {
                self.faults.inject(fault);
            }
            let frame = self.camera.shoot(&shot, &Cancel::default()).unwrap();
            let look = self.witness.judge(&frame.bytes, &shot, Lighting::Front).unwrap();
            self.witness.accept(&shot, look, Lighting::Front);
        }
        let of_object = self.witness.finish();
        let (of_patch, doubt) = self.witness.patch();
        (of_object, of_patch, doubt)
    }
}

#[test]
fn the_patch_sees_a_percent_of_the_lamp_within_a_bracket() {
    let (mut found, mut steady) = (0, 0);
    for seed in 1..=20 {
        let mut bench = Bench::new(seed, 0.0);
        for (station, permille) in [1000_u16, 1000, 1010, 990].into_iter().enumerate() {
            let (of_object, of_patch, doubt) = bench.bracket(station, Some(Fault::LampAt(permille)));
            let expected = f64::from(permille) / 1000.0 - 1.0;
            println!("seed {seed}, lamp {expected:+.3}: {of_patch:?}, object {of_object:?}");
            assert_eq!(doubt, None);
            match of_patch {
                Some(Drift { change, .. }) if expected != 0.0 => {
                    found += usize::from((0.5..2.0).contains(&(change / expected)));
                }
                None if expected == 0.0 => steady += 1,
                _ => {}
            }
        }
    }
    assert!(found == 40 && steady == 40, "{found} of 40 changes seen, {steady} of 40 steady lamps taken for steady");
}

#[test]
fn a_patch_that_is_shadowed_or_covered_within_a_bracket_is_doubted_and_tells_nothing_of_the_lamp() {
    for seed in 1..=2 {
        let mut bench = Bench::new(seed, 0.0);
        let faults = [None, Some(Fault::PatchAt(0)), Some(Fault::PatchAt(700)), Some(Fault::PatchAt(1300))];
        for (station, fault) in faults.into_iter().enumerate() {
            let (of_object, _, doubt) = bench.bracket(station, fault);
            assert_eq!(of_object, None);
            assert_eq!(doubt.is_some(), fault.is_some(), "seed {seed}, {fault:?}: {doubt:?}");
            if let Some(words) = doubt {
                assert!(words.contains("reference patch") && words.contains("moved"), "{words}");
            }
        }
    }
}

/// Half of where the patch is looked for shows the dark beside it.
#[test]
fn a_patch_that_stands_elsewhere_is_doubted() {
    for seed in 1..=2 {
        let mut bench = Bench::new(seed, 11.0);
        let (_, of_patch, doubt) = bench.bracket(0, None);
        assert!(doubt.is_some_and(|words| words.contains("not as bright as the rest")) && of_patch.is_none());
    }
}
