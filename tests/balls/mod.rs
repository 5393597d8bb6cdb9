//! Rendered frames of balls under lights, and their calibration.
#![allow(dead_code, clippy::unwrap_used, reason = "each test file uses its part")]

use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;
use rigd::numerics::calibration::lights::highlight::Spots;
use rigd::numerics::image::Image;
use rigd::pipeline::calibration::lights::{
    LightFrames, LightsCalibration, LightsCalibrationError, LightsSettings, calibrate_lights,
};
use rigd::study::lights::forward::Rig;
use rigd::study::lights::render::{Exposure, frame};
use std::collections::HashMap;
use std::sync::LazyLock;

/// Rendered frames of four lights at a quarter of the sensor's resolution, by name.
pub struct Stage {
    pub rig: Rig,
    pub frames: HashMap<String, Spots>,
}

pub const SCALE: f64 = 0.25;
/// Angles -55, 15, 50, 85 degrees.
pub const USED: [usize; 4] = [0, 2, 3, 4];

pub static STAGE: LazyLock<Stage> = LazyLock::new(|| {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(11);
    let rig = Rig::draw(SCALE, &mut random);
    let mut frames = HashMap::new();
    for lamp in USED {
        let still = [[0.0; 2]; 3];
        frames.insert(format!("s{lamp}"), spots(frame(&rig, lamp, &Exposure::SILHOUETTE, &still, &mut random)));
        frames.insert(format!("h{lamp}"), spots(frame(&rig, lamp, &Exposure::HIGHLIGHT, &still, &mut random)));
    }
    Stage { rig, frames }
});

pub fn spots(level: Image<f32>) -> Spots {
    let clipped = level.pixels.iter().map(|l| *l >= 0.99).collect();
    Spots { clipped: Image { width: level.width, height: level.height, pixels: clipped }, level }
}

pub fn list() -> Vec<LightFrames> {
    let of = |lamp: usize| LightFrames {
        angle_deg: Some(STAGE.rig.angles_deg[lamp]),
        silhouette: format!("s{lamp}"),
        highlight: format!("h{lamp}"),
    };
    USED.map(of).to_vec()
}

/// Calibrates with some frames replaced, and a number of balls.
pub fn calibrate(replaced: &[(&str, Spots)], balls: usize) -> Result<LightsCalibration, LightsCalibrationError> {
    let load = |name: &str| {
        let other = replaced.iter().find(|(known, _)| *known == name).map(|(_, spots)| spots.clone());
        other
            .or_else(|| STAGE.frames.get(name).cloned())
            .ok_or_else(|| "no such file: name one that is there".to_owned())
    };
    let rig = &STAGE.rig;
    let settings = LightsSettings {
        projection: rig.projection.clone(),
        size: rig.size,
        radius_mm: rig.radius,
        balls,
        angle_sigma_deg: 0.05,
    };
    calibrate_lights(&list(), &load, &settings)
}
