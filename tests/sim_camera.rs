//! The simulated camera's pictures against its world, and a bracket of them developed back to that world's radiance.
//! World and camera share no code with response and merge: agreement here is no agreement of the code with itself.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rig_config::{Rig, Shutter, Simulation};
use rigd::cli::merge::{Merged, merge_folder};
use rigd::cli::progress::Progress;
use rigd::cli::simulate::camera::shoot_plan;
use rigd::devices::Cancel;
use rigd::devices::camera::{Camera, CameraError, Shot};
use rigd::numerics::geometry::{Projection, Sphere, Vec3};
use rigd::numerics::image::Image;
use rigd::numerics::radiometry::merge::Estimator;
use rigd::numerics::radiometry::noise::SensorNoise;
use rigd::pipeline::decode::{FrameInfo, decode};
use rigd::pipeline::develop::{BracketFrame, Developed, develop};
use rigd::sim::camera::{CameraFaults, Fault, SimulatedCamera};
use rigd::sim::pose::{Pose, SharedPose};
use rigd::sim::world::World;

const SIMULATION: Simulation =
    Simulation { scene: rig_config::Scene::Marble, seed: 2008, speed: f64::INFINITY, hidden: false, ringing: false };

/// The simulated rig: a 30 mm sphere, 66 pixels in radius.
fn rig() -> Rig {
    let label = |(label, nominal_s, k): (&str, f64, i32)| Shutter {
        label: label.into(),
        nominal_s,
        true_s: (f64::from(k) / 3.0).exp2(),
    };
    let exposures = [
        ("1/100", 0.01, -20),
        ("1/40", 0.025, -16),
        ("1/20", 0.05, -13),
        ("1/8", 0.125, -9),
        ("1/4", 0.25, -6),
        ("0.6", 0.6, -2),
        ("1.3", 1.3, 1),
        ("3.2", 3.2, 5),
        ("6", 6.0, 8),
        ("15", 15.0, 12),
    ];
    Rig {
        name: "simulated".into(),
        arm: rig_config::Arm {
            driver: rig_config::ArmDriver::Simulated,
            baud: 115_200,
            speed_deg_s: 20.0,
            acceleration_deg_s2: 40.0,
            travel_deg: [-170.0, 170.0],
            tolerance_deg: 0.05,
            settle_s: 0.5,
            park_deg: 0.0,
            home_timeout_s: 60.0,
        },
        lamp: rig_config::Lamp {
            level_permille: 1000,
            soak_s: 1.0,
            steady_s: 0.0,
            rated_hours: None,
            circle_center_mm: [0.0, 0.0, 1500.0],
            circle_radius_mm: 600.0,
            intensity: [9.0e6, 8.0e6, 7.0e6],
        },
        camera: rig_config::Camera {
            driver: rig_config::CameraDriver::Simulated,
            width: 288,
            height: 192,
            focal_px: [3300.0, 3300.0],
            principal_px: [144.0, 96.0],
            distortion: [0.1, 0.0, 0.0, 0.0, 0.0],
            f_number: 5.6,
            iso: 100,
            full_well_e: 80_000.0,
            read_noise_e: 30.0,
        },
        object: rig_config::Sphere { center_mm: [0.0, 0.0, 1500.0], radius_mm: 30.0 },
        calibration: None,
        reference_patch: None,
        plan: rig_config::Plan {
            stations_deg: vec![-55.0, -20.0, 15.0, 50.0, 85.0, 115.0, 140.0],
            exposures: exposures.into_iter().map(label).collect(),
        },
        fit: rig_config::Fit {
            materials: Some(2),
            model: "ward".into(),
            lobe: "auto".into(),
            gains: "auto".into(),
            solver: "zheng2008".into(),
            objective: "noise".into(),
            cosine_cutoff: 0.15,
        },
        storage: rig_config::Storage { data: "data".into(), reserve_bytes: 0, resume_at_start: true, keep_days: None },
        server: rig_config::Server { listen: "127.0.0.1:0".parse().unwrap(), tokens: None, tls: None },
        notify: None,
        simulation: Some(SIMULATION),
    }
}

struct Studio {
    rig: Rig,
    pose: SharedPose,
    faults: CameraFaults,
    camera: SimulatedCamera,
}

impl Studio {
    fn new(simulation: Simulation) -> Self {
        let (rig, pose, faults) = (rig(), SharedPose::default(), CameraFaults::default());
        let camera = SimulatedCamera::new(&rig, &simulation, pose.clone(), faults.clone());
        Self { rig, pose, faults, camera }
    }

    fn at(simulation: Simulation, angle_deg: f64, lamp_permille: u16) -> Self {
        let studio = Self::new(simulation);
        studio.pose.set(Pose { angle_deg, lamp_permille });
        studio
    }

    fn shot(&self, exposure: usize) -> Shot {
        let shutter = self.rig.plan.exposures[exposure].clone();
        Shot { station: 0, exposure, shutter, f_number: self.rig.camera.f_number, iso: self.rig.camera.iso }
    }

    fn file(&mut self, exposure: usize) -> Result<Vec<u8>, CameraError> {
        let shot = self.shot(exposure);
        self.camera.shoot(&shot, &Cancel::default()).map(|frame| frame.bytes)
    }

    fn picture(&mut self, exposure: usize) -> Image<[u8; 3]> {
        decode(&self.file(exposure).unwrap()).unwrap()
    }

    fn developed(&mut self) -> Developed {
        let files: Vec<Vec<u8>> = (0..10).map(|k| self.file(k).unwrap()).collect();
        let frames: Vec<BracketFrame<'_>> = files
            .iter()
            .zip(&self.rig.plan.exposures)
            .map(|(bytes, shutter)| BracketFrame { name: &shutter.label, bytes, time_s: shutter.true_s })
            .collect();
        develop(&frames, None, None, &noise(&self.rig)).unwrap()
    }
}

fn noise(rig: &Rig) -> SensorNoise {
    SensorNoise { full_well_e: rig.camera.full_well_e, read_noise_e: rig.camera.read_noise_e }
}

/// Mean level of a picture.
fn mean(picture: &Image<[u8; 3]>) -> f64 {
    let sum: f64 = picture.pixels.iter().flatten().map(|&level| f64::from(level)).sum();
    sum / (3 * picture.pixels.len()) as f64
}

/// Pixels whose centre sees the sphere with both cosines above the fit's cut-off.
fn fitted_pixels(rig: &Rig, angle_deg: f64) -> Vec<usize> {
    let projection = Projection::Pinhole {
        focal_px: rig.camera.focal_px,
        principal_px: rig.camera.principal_px,
        distortion: rig.camera.distortion,
    };
    let sphere = Sphere { center: Vec3::from(rig.object.center_mm), radius: rig.object.radius_mm };
    let lamp = Vec3::from(rig.lamp.position_mm(angle_deg));
    let sees = |i: &usize| {
        let centre = ((i % rig.camera.width) as f64 + 0.5, (i / rig.camera.width) as f64 + 0.5);
        sphere.intersect(&projection.ray(centre.0, centre.1)).is_some_and(|point| {
            let cutoff = rig.fit.cosine_cutoff;
            let cos_i = point.normal.dot(&(lamp - point.position).normalize());
            cos_i > cutoff && point.normal.dot(&point.view) > cutoff
        })
    };
    (0..rig.camera.width * rig.camera.height).filter(sees).collect()
}

#[test]
fn every_fitted_sample_is_well_exposed_at_least_three_times() {
    for scene in [rig_config::Scene::Marble, rig_config::Scene::Wood] {
        for angle_deg in [15.0, 140.0] {
            let mut studio = Studio::at(Simulation { scene, ..SIMULATION }, angle_deg, 1000);
            let pictures: Vec<_> = (0..10).map(|k| studio.picture(k)).collect();
            for i in fitted_pixels(&studio.rig, angle_deg) {
                for c in 0..3 {
                    let well = pictures.iter().filter(|p| (10..=245).contains(&p.pixels[i][c])).count();
                    assert!(well >= 3, "{scene:?} at {angle_deg}: pixel {i}, channel {c}: {well} exposures");
                }
            }
        }
    }
}

#[test]
fn developed_bracket_is_the_worlds_radiance() {
    for (scene, angle_deg) in [(rig_config::Scene::Marble, -20.0), (rig_config::Scene::Wood, 85.0)] {
        let simulation = Simulation { scene, ..SIMULATION };
        let mut studio = Studio::at(simulation.clone(), angle_deg, 1000);
        let developed = studio.developed();
        let truth = World::new(&studio.rig, &simulation).radiance(Pose { angle_deg, lamp_permille: 1000 });
        let variance = developed.image.variance.as_ref().unwrap();
        let pixels = fitted_pixels(&studio.rig, angle_deg);
        assert!(pixels.iter().all(|&i| developed.image.valid.pixels[i]), "a fitted pixel is not valid");
        for c in 0..3 {
            let error = |i: usize| f64::from(developed.image.radiance.pixels[i][c]) - truth.pixels[i][c];
            let mut relative: Vec<f64> = pixels.iter().map(|&i| (error(i) / truth.pixels[i][c]).abs()).collect();
            relative.sort_by(f64::total_cmp);
            let median = relative[relative.len() / 2];
            let pull2 = |i: usize| error(i).powi(2) / f64::from(variance.pixels[i][c]);
            let spread = pixels.iter().map(|&i| pull2(i)).sum::<f64>() / pixels.len() as f64;
            println!("{scene:?}, channel {c}: median error {:.2} %, mean squared pull {spread:.2}", 100.0 * median);
            assert!(median < 0.01, "{scene:?}, channel {c}: median error {median}");
            assert!((0.7..1.5).contains(&spread), "{scene:?}, channel {c}: mean squared pull {spread}");
        }
        let far = developed.image.valid.at(2, 2);
        assert!(!far, "the black surroundings are too dark to be valid");
    }
}

#[test]
fn a_folder_shot_by_command_merges_by_list_and_by_exif() {
    let (rig, folder) = (rig(), tempfile::tempdir().unwrap());
    let out = folder.path().join("bracket");
    assert_eq!(shoot_plan(&rig, SIMULATION, Some(2), &out, &Progress::unseen()).unwrap(), 10);
    assert!(out.join("002-00.jpg").is_file() && out.join("002-09.jpg").is_file());
    let by_list = merge_folder(&out).unwrap();
    std::fs::remove_file(out.join("exposures.toml")).unwrap();
    let by_exif = merge_folder(&out).unwrap();
    let radiance = |merged: &Merged| merged.image(Estimator::default()).unwrap().radiance;
    assert_eq!(radiance(&by_list), radiance(&by_exif), "third-stop labels mean the times listed");

    let message = shoot_plan(&rig, SIMULATION, Some(2), &out, &Progress::unseen()).unwrap_err().to_string();
    assert!(message.contains("not empty"), "{message}");
    let message =
        shoot_plan(&rig, SIMULATION, Some(7), &folder.path().join("new"), &Progress::unseen()).unwrap_err().to_string();
    assert!(message.contains("stations 0 to 6"), "{message}");
}

#[test]
fn picture_shows_where_the_arm_is_and_whether_the_lamp_is_on() {
    let mut left = Studio::at(SIMULATION, -55.0, 1000);
    let picture = left.picture(4);
    let half = |picture: &Image<[u8; 3]>, right: bool| -> f64 {
        let lit = |(i, _): &(usize, &[u8; 3])| (i % 288 >= 144) == right;
        picture.pixels.iter().enumerate().filter(lit).map(|(_, p)| f64::from(p[1])).sum()
    };
    assert!(half(&picture, false) > 2.0 * half(&picture, true));
    left.pose.set(Pose { angle_deg: 55.0, lamp_permille: 1000 });
    let picture = left.picture(4);
    assert!(half(&picture, true) > 2.0 * half(&picture, false));
    left.pose.set(Pose { angle_deg: 55.0, lamp_permille: 500 });
    let dimmed = left.picture(4);
    assert!(mean(&dimmed) < 0.95 * mean(&picture) && mean(&dimmed) > 0.3 * mean(&picture));
    left.pose.set(Pose { angle_deg: 55.0, lamp_permille: 0 });
    assert!(left.picture(9).pixels.iter().flatten().all(|&level| level < 20), "a dark frame shows read noise only");
}

#[test]
fn a_picture_taken_while_the_arm_moves_shows_it() {
    let slow = Simulation { speed: 20.0, ..SIMULATION };
    let mut still = Studio::at(SIMULATION, 0.0, 1000);
    let sharp = still.picture(7);
    let mut studio = Studio::at(slow, 0.0, 1000);
    let (pose, stop) = (studio.pose.clone(), Cancel::default());
    let stopped = stop.clone();
    let mover = std::thread::spawn(move || {
        let mut angle_deg = 0.0;
        while !stopped.is_cancelled() {
            angle_deg += 1.0;
            pose.set(Pose { angle_deg, lamp_permille: 1000 });
            std::thread::yield_now();
        }
    });
    while studio.pose.get().angle_deg == 0.0 {
        std::thread::yield_now();
    }
    let blurred = studio.picture(7);
    stop.cancel();
    mover.join().unwrap();
    let differing = sharp.pixels.iter().zip(&blurred.pixels).filter(|(a, b)| a[1].abs_diff(b[1]) > 20).count();
    assert!(differing > 1000, "{differing} pixels differ");
}

#[test]
fn exif_says_what_the_body_was_set_to() {
    let mut studio = Studio::at(SIMULATION, 0.0, 1000);
    for (k, shutter) in studio.rig.plan.exposures.clone().iter().enumerate() {
        let info = FrameInfo::read(&studio.file(k).unwrap());
        assert!((info.exposure_time_s.unwrap() / shutter.nominal_s - 1.0).abs() < 1e-9, "{}", shutter.label);
        assert!((info.true_time_s().unwrap() / shutter.true_s - 1.0).abs() < 1e-9, "{}", shutter.label);
        assert_eq!((info.f_number, info.iso), (Some(5.6), Some(100)));
        assert_eq!(info.time.unwrap().len(), 19);
    }
}

#[test]
fn noise_depends_on_the_frame_number_alone() {
    let frames = |count: usize| {
        let mut studio = Studio::at(SIMULATION, 30.0, 1000);
        (0..count).map(|_| studio.picture(5)).collect::<Vec<_>>()
    };
    let (first, again) = (frames(2), frames(2));
    assert_eq!(first, again);
    assert_ne!(first[0], first[1]);
}

#[test]
fn faults_show_as_they_would_on_a_real_body() {
    let mut studio = Studio::at(SIMULATION, 0.0, 1000);
    let sound = studio.file(3).unwrap();
    studio.faults.inject(Fault::RepeatLastFrame);
    assert_eq!(studio.file(4).unwrap(), sound);

    studio.faults.inject(Fault::WrongExposure);
    let wrong = studio.file(4).unwrap();
    assert_eq!(FrameInfo::read(&wrong).exposure_time_s, Some(0.5));
    assert!(mean(&decode(&wrong).unwrap()) > 1.1 * mean(&studio.picture(4)));

    studio.faults.inject(Fault::TruncatedFile);
    assert!(decode(&studio.file(4).unwrap()).is_err());

    studio.faults.inject(Fault::Hang);
    let faults = studio.faults.clone();
    let (done, waiting) = std::sync::mpsc::channel();
    let hanging = std::thread::spawn(move || {
        let result = studio.file(4);
        done.send(()).unwrap();
        result
    });
    assert!(waiting.recv_timeout(std::time::Duration::from_millis(100)).is_err(), "the call returned");
    // The call may not have begun yet when it is first released.
    while waiting.try_recv().is_err() {
        faults.release();
        std::thread::yield_now();
    }
    assert!(matches!(hanging.join().unwrap(), Err(CameraError::Unusable { .. })));
}

#[test]
fn a_cancelled_exposure_ends_without_a_frame() {
    let mut studio = Studio::at(Simulation { speed: 1.0, ..SIMULATION }, 0.0, 1000);
    let (shot, cancel) = (studio.shot(9), Cancel::default());
    cancel.cancel();
    assert!(matches!(studio.camera.shoot(&shot, &cancel), Err(CameraError::Cancelled)));
}
