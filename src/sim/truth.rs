//! What the simulated rig is really like. The rig file says the same, or, with `simulation.hidden`, only roughly so: then it has to
//! be measured.

use super::tone::{NOMINAL, Tone};
use crate::numerics::geometry::{Projection, Sphere, Vec3};
use nalgebra::Rotation3;
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use rig_config::{Rig, Simulation};

/// A rig as it is, not as its file says.
#[derive(Clone, Debug)]
pub struct Truth {
    /// The camera's optics.
    pub projection: Projection,
    /// Standard deviation of the lens' blur, pixels; 0 draws every pixel by itself.
    pub blur_px: f64,
    /// Tone curves, red green blue.
    pub tones: [Tone; 3],
    /// The lamp.
    pub lamp: Lamp,
    /// The sampled sphere.
    pub object: Sphere,
}

/// The lamp and its way.
#[derive(Clone, Debug)]
pub struct Lamp {
    /// Centre of its circle, camera frame, mm.
    pub center: Vec3,
    /// Radius of the circle, mm.
    pub radius_mm: f64,
    /// How the arm's axis is turned away from the vertical: axis times angle, rad.
    pub lean: Vec3,
    /// Arm angle at which the lamp stands between axis and camera, rad.
    pub zero: f64,
    /// The encoder is not quite round: amplitude and phase of its error over a turn, rad.
    pub encoder: (f64, f64),
    /// Radiant intensity at the rig file's level, red green blue, radiance units x mm^2.
    pub intensity: [f64; 3],
}

/// Separates the draw of the truth from scene and noise, which use the same seed.
const STREAM: u64 = 0x7275_7468;

impl Truth {
    /// The truth of a simulated rig.
    pub fn new(rig: &Rig, simulation: &Simulation) -> Self {
        let nominal = Self::nominal(rig);
        if simulation.hidden { nominal.hidden(simulation.seed) } else { nominal }
    }

    /// What the file says.
    fn nominal(rig: &Rig) -> Self {
        let (camera, lamp) = (&rig.camera, &rig.lamp);
        Self {
            projection: Projection::Pinhole {
                focal_px: camera.focal_px,
                principal_px: camera.principal_px,
                distortion: camera.distortion,
            },
            blur_px: 0.0,
            tones: NOMINAL,
            lamp: Lamp {
                center: Vec3::from(lamp.circle_center_mm),
                radius_mm: lamp.circle_radius_mm,
                lean: Vec3::zeros(),
                zero: 0.0,
                encoder: (0.0, 0.0),
                intensity: lamp.intensity,
            },
            object: Sphere { center: Vec3::from(rig.object.center_mm), radius: rig.object.radius_mm },
        }
    }

    /// Departures as large as tape measure, protractor and data sheets leave; every one uniform about what the file says.
    fn hidden(mut self, seed: u64) -> Self {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed ^ STREAM);
        let mut within = |most: f64| random.random_range(-most..=most);
        if let Projection::Pinhole { focal_px, principal_px, distortion } = &mut self.projection {
            // Square pixels, as sensors have; a barrel or cushion of up to 0.4 % of the picture's half diagonal.
            let zoom = 1.0 + within(0.015);
            *focal_px = focal_px.map(|f| f * zoom);
            *principal_px = principal_px.map(|c| c + within(6.0));
            distortion[0] += within(0.08);
        }
        self.blur_px = 0.6;
        for tone in &mut self.tones {
            tone.power += within(0.10);
            tone.toe += within(0.006);
            tone.contrast += within(0.04);
        }
        let lamp = &mut self.lamp;
        lamp.center += Vec3::new(within(10.0), within(10.0), within(10.0));
        lamp.radius_mm += within(8.0);
        lamp.lean = Vec3::new(within(0.02), 0.0, within(0.02));
        lamp.zero = within(0.01);
        lamp.encoder = (within(0.05_f64.to_radians()), within(std::f64::consts::PI));
        lamp.intensity = lamp.intensity.map(|i| i * (1.0 + within(0.15)));
        self.object.center += Vec3::new(within(2.0), within(2.0), within(2.0));
        self
    }
}

impl Lamp {
    /// Where it really stands with the arm at `angle_deg` of its encoder, camera frame, mm.
    pub fn position(&self, angle_deg: f64) -> Vec3 {
        let told = angle_deg.to_radians();
        let (amplitude, phase) = self.encoder;
        let (sin, cos) = (told + self.zero + amplitude * (told + phase).sin()).sin_cos();
        let flat = Vec3::new(self.radius_mm * sin, 0.0, -self.radius_mm * cos);
        self.center + Rotation3::from_scaled_axis(self.lean) * flat
    }
}
