//! The rig of the fakes, described by hand.

use rig_config::{
    Arm as ArmConfig, ArmDriver, Camera as CameraConfig, CameraDriver, Fit, Lamp, Plan, Rig, Server, Shutter, Sphere,
    Storage,
};
use std::path::PathBuf;

pub const SIZE: (usize, usize) = (32, 24);
pub const LEVEL: u16 = 900;
pub const PARK: f64 = -60.0;

/// Three stations, two exposures.
pub fn rig() -> Rig {
    Rig {
        name: "fake rig".into(),
        arm: ArmConfig {
            driver: ArmDriver::Rigproto { port: "/dev/null".into() },
            baud: 115_200,
            speed_deg_s: 30.0,
            acceleration_deg_s2: 60.0,
            travel_deg: [-90.0, 170.0],
            tolerance_deg: 0.05,
            settle_s: 0.5,
            park_deg: PARK,
            home_timeout_s: 30.0,
        },
        lamp: Lamp {
            level_permille: LEVEL,
            soak_s: 60.0,
            steady_s: 0.0,
            rated_hours: None,
            circle_center_mm: [0.0, 0.0, 1500.0],
            circle_radius_mm: 600.0,
            intensity: [4e5; 3],
        },
        camera: CameraConfig {
            driver: CameraDriver::Gphoto2 { model: None, port: None, power_hook: None },
            width: SIZE.0,
            height: SIZE.1,
            focal_px: [300.0; 2],
            principal_px: [16.0, 12.0],
            distortion: [0.0; 5],
            f_number: 5.6,
            iso: 100,
            full_well_e: 50_000.0,
            read_noise_e: 10.0,
        },
        object: Sphere { center_mm: [0.0, 0.0, 1500.0], radius_mm: 30.0 },
        plan: Plan {
            stations_deg: vec![-20.0, 15.0, 50.0],
            exposures: ["1/100", "0.4"].map(|l| Shutter::from_label(l).unwrap()).to_vec(),
        },
        fit: Fit {
            materials: Some(2),
            model: "ward".into(),
            lobe: "auto".into(),
            gains: "auto".into(),
            solver: "zheng2008".into(),
            objective: "noise".into(),
            cosine_cutoff: 0.15,
        },
        storage: Storage { data: PathBuf::new(), reserve_bytes: 1000, resume_at_start: true, keep_days: None },
        server: Server { listen: "127.0.0.1:0".parse().unwrap(), tokens: None, tls: None },
        notify: None,
        simulation: None,
        reference_patch: None,
        calibration: None,
    }
}
