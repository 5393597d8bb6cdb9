//! The simulated camera: exposes the world through a sensor, a tone curve of its own and a JPEG encoder.

mod damage;
mod exif;
mod faults;
mod sensor;

pub use faults::{CameraFaults, Fault};

use super::lamp::{Burning, SimulatedLamp};
use super::pose::{Pose, SharedPose};
use super::stage::{Placed, StageHandle};
use super::world::World;
use crate::devices::Cancel;
use crate::devices::camera::{Camera, CameraError, CameraIdentity, RawFrame, Shot};
use crate::numerics::image::Image;
use exif::ExifFacts;
use rig_config::{Rig, Shutter, Simulation};
use sensor::Sensor;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What the body calls itself, unless told otherwise.
const MODEL: &str = "Canon EOS 5D";
/// How often the pose is looked at during an exposure.
const LOOK_EVERY: Duration = Duration::from_millis(2);
/// Different poses rendered for one exposure, at most: enough to show that the arm moved.
const MAX_POSES: usize = 8;

/// What a picture depends on.
type Shown = (Placed, Pose);

/// A camera that photographs the simulated world as it is while the shutter is open.
pub struct SimulatedCamera {
    world: World,
    sensor: Sensor,
    pose: SharedPose,
    stage: StageHandle,
    faults: CameraFaults,
    lamp: SimulatedLamp,
    /// Shots that the lamp lit.
    lit_shots: u32,
    /// Radiance that the room adds everywhere.
    room: f64,
    speed: f64,
    model: &'static str,
    frame_number: u32,
    last_frame: Option<RawFrame>,
    /// Levels and time of the shot before.
    last_shot: Option<(Image<[f32; 3]>, f64)>,
    /// What was rendered last: a bracket renders once.
    rendered: Option<(Shown, Arc<Image<[f64; 3]>>)>,
}

impl SimulatedCamera {
    /// A camera before the simulated world. Exposures last `simulation.speed` times shorter than real; an infinite speed
    /// exposes at once. Noise depends on `simulation.seed` and the running number of the frame alone.
    pub fn new(rig: &Rig, simulation: &Simulation, pose: SharedPose, faults: CameraFaults) -> Self {
        let world = World::new(rig, simulation);
        Self {
            sensor: Sensor::new(&rig.camera, &world.truth().tones, simulation.seed),
            world,
            pose,
            stage: StageHandle::default(),
            faults,
            lamp: SimulatedLamp::default(),
            lit_shots: 0,
            room: 0.0,
            speed: simulation.speed,
            model: MODEL,
            frame_number: 0,
            last_frame: None,
            last_shot: None,
            rendered: None,
        }
    }

    /// The same camera with another name in its EXIF.
    #[must_use]
    pub fn calling_itself(mut self, model: &'static str) -> Self {
        self.model = model;
        self
    }

    /// The same camera before a stage on which somebody places things; otherwise the sample stands there.
    #[must_use]
    pub fn before(mut self, stage: StageHandle) -> Self {
        self.stage = stage;
        self
    }

    /// The same camera under a lamp that lives.
    #[must_use]
    pub fn lit_by(mut self, lamp: SimulatedLamp) -> Self {
        self.lamp = lamp;
        self
    }

    /// The same camera in a room that is not dark: every pixel sees this much more radiance.
    #[must_use]
    pub fn in_room(mut self, radiance: f64) -> Self {
        self.room = radiance;
        self
    }

    /// What the lamp gives at this shot, red green blue; one that is off does not age.
    fn lamp_light(&mut self) -> [f64; 3] {
        if self.pose.get().lamp_permille == 0 {
            return [1.0; 3];
        }
        let brightness = self.lamp.brightness(self.burning());
        self.lit_shots += 1;
        brightness
    }

    /// What the lamp has been through; of an endless speed, all that warms up is over.
    fn burning(&self) -> Burning {
        let lit_s = self.pose.lit().map_or(0.0, |lit| lit.elapsed().as_secs_f64());
        let lit_s = if self.speed.is_finite() { self.speed * lit_s } else { f64::INFINITY };
        Burning { lit_s, shots: self.lit_shots }
    }

    /// Waits for the exposure to end and returns the poses seen, each with its share of the time.
    fn expose(&self, true_s: f64, cancel: &Cancel) -> Result<Vec<(Pose, f64)>, CameraError> {
        let wait = Duration::from_secs_f64(true_s / self.speed);
        let start = Instant::now();
        let mut seen = vec![self.pose.get()];
        loop {
            if cancel.is_cancelled() {
                return Err(CameraError::Cancelled);
            }
            let left = wait.saturating_sub(start.elapsed());
            std::thread::sleep(left.min(LOOK_EVERY));
            seen.push(self.pose.get());
            if left.is_zero() {
                break;
            }
        }
        Ok(shares(&seen))
    }

    fn render(&mut self, pose: Pose) -> Arc<Image<[f64; 3]>> {
        let shown = (self.stage.get(), pose);
        match &self.rendered {
            Some((known, image)) if *known == shown => Arc::clone(image),
            _ => {
                let image = Arc::new(self.world.radiance_of(shown.0, pose));
                self.rendered = Some((shown, Arc::clone(&image)));
                image
            }
        }
    }

    /// Mean radiance over the exposure.
    fn gather(&mut self, poses: &[(Pose, f64)]) -> Arc<Image<[f64; 3]>> {
        if let [(pose, _)] = poses {
            return self.render(*pose);
        }
        let mut sum = Image::filled(0, 0, [0.0; 3]);
        for (pose, share) in poses {
            let image = self.render(*pose);
            if sum.pixels.is_empty() {
                sum = Image::filled(image.width, image.height, [0.0; 3]);
            }
            for (total, pixel) in sum.pixels.iter_mut().zip(&image.pixels) {
                *total = std::array::from_fn(|c| total[c] + share * pixel[c]);
            }
        }
        Arc::new(sum)
    }

    fn take(
        &mut self,
        shot: &Shot,
        shutter: &Shutter,
        fault: Option<Fault>,
        cancel: &Cancel,
    ) -> Result<RawFrame, CameraError> {
        let poses = self.expose(shutter.true_s, cancel)?;
        let lamp = self.lamp_light();
        self.frame_number += 1;
        let radiance = self.gather(&poses);
        let open_s = match (fault, &self.last_shot) {
            (Some(Fault::OpenFor(permille)), _) => shutter.true_s * f64::from(permille) / 1000.0,
            (Some(Fault::LastShutter), Some((_, last_s))) => *last_s,
            _ => shutter.true_s,
        };
        let levels = match (fault, self.last_shot.take()) {
            (Some(Fault::StalePicture), Some((levels, _))) => levels,
            _ => {
                let radiance = damage::under(lamp, self.room, &radiance);
                let radiance = damage::radiance(fault, &radiance, self.world.patch_bounds());
                let mut levels = self.sensor.read_out(&radiance, open_s, self.frame_number);
                damage::levels(fault, &mut levels);
                levels
            }
        };
        let facts = ExifFacts {
            model: self.model,
            nominal_s: shutter.nominal_s,
            f_number: shot.f_number,
            iso: shot.iso,
            frame_number: self.frame_number,
        };
        let bytes = exif::jpeg(&levels, &facts).map_err(|reason| CameraError::Unusable { reason })?;
        self.last_shot = Some((levels, shutter.true_s));
        Ok(RawFrame { bytes, name: format!("IMG_{:04}.JPG", self.frame_number % 10_000), transfer: Duration::ZERO })
    }
}

/// Runs of equal poses as (pose, share of the exposure), thinned to [`MAX_POSES`] while the arm moves.
fn shares(seen: &[Pose]) -> Vec<(Pose, f64)> {
    let runs: Vec<&[Pose]> = seen.chunk_by(|a, b| a == b).collect();
    let runs: Vec<&[Pose]> =
        if runs.len() <= MAX_POSES { runs } else { seen.chunks(seen.len().div_ceil(MAX_POSES)).collect() };
    runs.iter().map(|run| (run[run.len() / 2], run.len() as f64 / seen.len() as f64)).collect()
}

impl Camera for SimulatedCamera {
    fn identity(&self) -> CameraIdentity {
        CameraIdentity { model: self.model.to_owned() }
    }

    fn shoot(&mut self, shot: &Shot, cancel: &Cancel) -> Result<RawFrame, CameraError> {
        let fault = self.faults.take();
        if let (Some(Fault::RepeatLastFrame), Some(last)) = (fault, &self.last_frame) {
            return Ok(last.clone());
        }
        if fault == Some(Fault::Hang) {
            self.faults.wait_for_release();
            return Err(CameraError::Unusable {
                reason: "the body stopped answering: switch it off and on".to_owned(),
            });
        }
        let shutter = if fault == Some(Fault::WrongExposure) { doubled(&shot.shutter) } else { shot.shutter.clone() };
        let mut frame = self.take(shot, &shutter, fault, cancel)?;
        if fault == Some(Fault::TruncatedFile) {
            frame.bytes.truncate(frame.bytes.len() / 2);
        }
        self.last_frame = Some(frame.clone());
        Ok(frame)
    }
}

/// One stop longer than asked: label and time both say so.
fn doubled(shutter: &Shutter) -> Shutter {
    Shutter { label: shutter.label.clone(), nominal_s: 2.0 * shutter.nominal_s, true_s: 2.0 * shutter.true_s }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_sum_to_one_and_show_every_phase_of_a_move() {
        let at = |angle_deg| Pose { angle_deg, lamp_permille: 1000 };
        assert_eq!(shares(&[at(1.0), at(1.0), at(1.0)]), vec![(at(1.0), 1.0)]);
        assert_eq!(shares(&[at(1.0), at(1.0), at(1.0), at(2.0)]), vec![(at(1.0), 0.75), (at(2.0), 0.25)]);
        let seen: Vec<Pose> = (0..100).map(|i| at(f64::from(i))).collect();
        let found = shares(&seen);
        assert_eq!(found.len(), MAX_POSES);
        assert!(found[0].0.angle_deg < 13.0 && found[MAX_POSES - 1].0.angle_deg > 87.0);
        assert!((found.iter().map(|(_, share)| share).sum::<f64>() - 1.0).abs() < 1e-12);
    }
}
