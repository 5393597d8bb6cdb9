//! Where the lamp stands by the pictures, against where it stands in the simulated world: what is refused wrongly, what slips are found.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rand::rngs::SmallRng;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use rig_config::{Rig, Scene, Shutter};
use rigd::devices::Cancel;
use rigd::devices::camera::{Camera, Shot};
use rigd::numerics::image::Image;
use rigd::numerics::quality::Look;
use rigd::pipeline::decode::decode;
use rigd::session::shadow::Shadow;
use rigd::session::witness::part;
use rigd::sim::camera::{CameraFaults, SimulatedCamera};
use rigd::sim::pose::{Pose, SharedPose};
use std::collections::BTreeMap;

const EXPOSURES: [&str; 4] = ["1/40", "1/8", "0.6", "3.2"];
const SLIPS_DEG: [f64; 9] = [4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 40.0];
/// Where the lamp stands, degrees off the way from the object to the camera: up to the first, up to the second, beyond.
const ZONES_DEG: [f64; 2] = [30.0, 130.0];
const ZONES: [&str; 3] = ["front", "side", "behind"];

/// How the rig file states the rig.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stated {
    Exactly,
    /// As a tape measure would: to be calibrated.
    Roughly,
}

fn rig(stated: Stated, seed: u64) -> Rig {
    let name = if stated == Stated::Exactly { "simulated" } else { "simulated-calibration" };
    let (_, shipped) = rig_config::SHIPPED.iter().find(|(known, _)| *known == name).unwrap();
    let mut rig = Rig::from_toml(shipped, name).unwrap();
    let shrink = 2;
    rig.camera.width /= shrink;
    rig.camera.height /= shrink;
    rig.camera.focal_px = rig.camera.focal_px.map(|f| f / shrink as f64);
    rig.camera.principal_px = rig.camera.principal_px.map(|c| c / shrink as f64);
    let simulation = rig.simulation.as_mut().unwrap();
    (simulation.speed, simulation.seed) = (f64::INFINITY, seed);
    simulation.scene = if seed.is_multiple_of(2) { Scene::Marble } else { Scene::Wood };
    rig
}

/// A rig, its camera and what its session knows of the lamp.
struct Bench {
    rig: Rig,
    part: [usize; 4],
    pose: SharedPose,
    camera: SimulatedCamera,
    shadow: Shadow,
}

impl Bench {
    fn new(stated: Stated, seed: u64) -> Self {
        let rig = rig(stated, seed);
        let pose = SharedPose::default();
        let simulation = rig.simulation.as_ref().unwrap();
        let camera = SimulatedCamera::new(&rig, simulation, pose.clone(), CameraFaults::default());
        let (part, shadow) = (part(&rig, stated == Stated::Roughly), Shadow::new(&rig));
        Self { rig, part, pose, camera, shadow }
    }

    /// A bracket with the lamp at this angle.
    fn bracket(&mut self, angle_deg: f64) -> Vec<Look> {
        self.pose.set(Pose { angle_deg, lamp_permille: self.rig.lamp.level_permille });
        let mut look = |(exposure, label): (usize, &&str)| {
            let shutter = Shutter::from_label(label).unwrap();
            let shot =
                Shot { station: 0, exposure, shutter, f_number: self.rig.camera.f_number, iso: self.rig.camera.iso };
            let frame = self.camera.shoot(&shot, &Cancel::default()).unwrap();
            Look::new(&decode(&frame.bytes).unwrap(), self.part)
        };
        EXPOSURES.iter().enumerate().map(&mut look).collect()
    }
}

fn zone(angle_deg: f64) -> &'static str {
    ZONES[ZONES_DEG.iter().filter(|&&end| angle_deg.abs() > end).count()]
}

/// What became of sound brackets and of slips.
#[derive(Default)]
struct Tally {
    sound: usize,
    refused: Vec<String>,
    /// Errors and their standard errors by zone, degrees.
    errors: BTreeMap<&'static str, Vec<(f64, f64)>>,
    untold: BTreeMap<&'static str, usize>,
    /// By zone and degrees: found, all.
    slips: BTreeMap<(&'static str, i64), [usize; 2]>,
    nanoseconds: u128,
}

impl Tally {
    fn add(mut self, other: Self) -> Self {
        self.sound += other.sound;
        self.refused.extend(other.refused);
        self.nanoseconds += other.nanoseconds;
        for (zone, errors) in other.errors {
            self.errors.entry(zone).or_default().extend(errors);
        }
        for (zone, count) in other.untold {
            *self.untold.entry(zone).or_default() += count;
        }
        for (slip, [found, all]) in other.slips {
            let sum = self.slips.entry(slip).or_default();
            *sum = [sum[0] + found, sum[1] + all];
        }
        self
    }

    fn print(&self) {
        println!(
            "{} sound brackets, {} refused; {:.1} ms a bracket",
            self.sound,
            self.refused.len(),
            self.nanoseconds as f64 / 1e6 / self.sound as f64
        );
        for zone in ZONES {
            let mut errors: Vec<f64> = self.errors.get(zone).into_iter().flatten().map(|e| e.0.abs()).collect();
            let pulls: Vec<f64> =
                self.errors.get(zone).into_iter().flatten().map(|(error, sigma)| (error / sigma).powi(2)).collect();
            errors.sort_by(f64::total_cmp);
            let at = |share: f64| errors.get((share * (errors.len().max(1) - 1) as f64) as usize).copied();
            println!(
                "{zone}: {} read, {} not told; error median {:.2?}, 99 % {:.2?}, largest {:.2?}; in standard errors {:.2} rms, {:.1} at most",
                errors.len(),
                self.untold.get(zone).copied().unwrap_or_default(),
                at(0.5),
                at(0.99),
                at(1.0),
                (pulls.iter().sum::<f64>() / pulls.len().max(1) as f64).sqrt(),
                pulls.iter().copied().fold(0.0, f64::max).sqrt()
            );
            for ((_, slip_deg), [found, all]) in self.slips.iter().filter(|(slip, _)| slip.0 == zone) {
                println!("  slip of {slip_deg} degrees: {found} of {all} found");
            }
        }
    }

    fn found(&self, zone: &'static str, slip_deg: i64) -> f64 {
        let [found, all] = self.slips.get(&(zone, slip_deg)).copied().unwrap_or_default();
        found as f64 / all.max(1) as f64
    }
}

/// A session of these stations; each bracket is judged as it is, and read once more for every slip the arm may have made before it.
fn session(stated: Stated, seed: u64, angles_deg: &[f64], slips_deg: &[f64]) -> Tally {
    let (mut bench, mut tally) = (Bench::new(stated, seed), Tally::default());
    for (station, &angle_deg) in angles_deg.iter().enumerate() {
        let bracket = bench.bracket(angle_deg);
        let looks: Vec<&Look> = bracket.iter().collect();
        let zone = zone(angle_deg);
        for slip_deg in slips_deg.iter().flat_map(|slip| [-slip, *slip]).filter(|_| station >= 3) {
            let read = bench.shadow.read(&looks, angle_deg - slip_deg);
            let count = tally.slips.entry((zone, slip_deg.abs() as i64)).or_default();
            count[0] += usize::from(read.is_some_and(|(read, _)| read.off_deg().abs() > read.most_deg));
            count[1] += 1;
        }
        match bench.shadow.read(&looks, angle_deg) {
            Some((read, _)) => {
                tally.errors.entry(zone).or_default().push((read.off_deg(), read.sigma_deg));
            }
            None => *tally.untold.entry(zone).or_default() += 1,
        }
        tally.sound += 1;
        let begin = std::time::Instant::now();
        let judged = bench.shadow.judge(&looks, angle_deg);
        tally.nanoseconds += begin.elapsed().as_nanos();
        tally.refused.extend(judged.err().map(|why| format!("{stated:?}, seed {seed}: {why}")));
    }
    tally
}

/// Stations as sessions have them: those of the shipped rigs, moved a little, in any order; or an even row.
fn stations(seed: u64, count: usize) -> Vec<f64> {
    let mut random = SmallRng::seed_from_u64(seed);
    if count != 7 {
        return (0..count).map(|i| -90.0 + 260.0 * i as f64 / (count - 1) as f64).collect();
    }
    let mut angles: Vec<f64> =
        [-55.0, -20.0, 15.0, 50.0, 85.0, 115.0, 140.0].map(|a| a + random.random_range(-17.5..17.5)).to_vec();
    if seed.is_multiple_of(3) {
        angles.shuffle(&mut random);
    }
    angles
}

fn measure(stated: Stated, seeds: std::ops::Range<u64>, count: usize, slips_deg: &[f64]) -> Tally {
    let run = |seed| session(stated, seed, &stations(seed, count), slips_deg);
    let tally = seeds.into_par_iter().map(run).reduce(Tally::default, Tally::add);
    println!("{stated:?}, {count} stations:");
    tally.print();
    tally
}

/// The least slip that is found in 999 of 1 000 brackets lit from the side, degrees.
fn least_slip_deg(stated: Stated) -> i64 {
    if stated == Stated::Exactly { 10 } else { 15 }
}

#[test]
fn the_lamp_is_seen_where_it_stands_and_slips_are_found() {
    for (stated, seeds) in [(Stated::Exactly, 1..7), (Stated::Roughly, 1..5)] {
        let least = least_slip_deg(stated);
        let tally = measure(stated, seeds, 7, &[least as f64]);
        assert!(tally.refused.is_empty(), "{:#?}", tally.refused);
        assert!(tally.found("side", least) >= 0.999, "{stated:?}");
    }
}

/// `cargo test --test shadow -- --ignored --nocapture` prints the table of docs/quality.md.
#[test]
#[ignore = "minutes: cargo test --test shadow -- --ignored --nocapture"]
fn ten_thousand_sound_brackets_are_not_refused() {
    for (stated, nights, sessions, slipping) in
        [(Stated::Exactly, 2001..2009, 1001..2201, 3001..3101), (Stated::Roughly, 2001..2003, 1001..1201, 3001..3041)]
    {
        let slips = measure(stated, slipping, 7, &SLIPS_DEG);
        assert!(slips.found("side", least_slip_deg(stated)) >= 0.999, "{stated:?}");
        for tally in [measure(stated, nights, 181, &[]), measure(stated, sessions, 7, &[]), slips] {
            assert!(tally.refused.len() * 10_000 <= tally.sound, "{:#?}", tally.refused);
        }
    }
}

/// The rig file's zero is wrong by seven degrees: told once, and no bracket is refused. A slip of twelve on top of that is.
#[test]
fn a_zero_that_is_wrong_for_the_whole_session_is_told_and_put_up_with() {
    let mut bench = Bench::new(Stated::Exactly, 4);
    let mut told = Vec::new();
    for angle_deg in [-55.0, -20.0, 15.0, 50.0, 85.0, 115.0] {
        let bracket = bench.bracket(angle_deg + 7.0);
        bench.shadow.judge(&bracket.iter().collect::<Vec<_>>(), angle_deg).unwrap();
        told.extend(bench.shadow.zero_warning());
    }
    assert_eq!(told.len(), 1, "{told:?}");
    let degrees: f64 = told[0].split("stands +").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    // Single readings of a side are up to 2.7 degrees off on frames as small as these.
    assert!((degrees - 7.0).abs() < 2.5, "{told:?}");
    let bracket = bench.bracket(60.0 + 7.0 - 12.0);
    let reason = bench.shadow.judge(&bracket.iter().collect::<Vec<_>>(), 60.0).unwrap_err();
    assert!(reason.contains("by the pictures"), "{reason}");
}

/// A first bracket far from where the arm says is refused: nothing was seen before that it could be held against.
#[test]
fn a_first_bracket_that_is_lit_from_elsewhere_is_refused() {
    let mut bench = Bench::new(Stated::Exactly, 5);
    let bracket = bench.bracket(75.0);
    let reason = bench.shadow.judge(&bracket.iter().collect::<Vec<_>>(), 50.0).unwrap_err();
    assert!(reason.contains("at about 7") && reason.contains("at 50.0 was expected"), "{reason}");
}

/// Pictures of other things say nothing: one grey, noise, a card, a bright disc that is too large, nothing at all.
#[test]
fn pictures_of_other_things_are_not_judged() {
    let bench = Bench::new(Stated::Exactly, 1);
    let (width, height) = (bench.rig.camera.width, bench.rig.camera.height);
    let mut random = SmallRng::seed_from_u64(1);
    let pictures: Vec<Box<dyn FnMut(usize, usize) -> u8>> = vec![
        Box::new(|_, _| 128),
        Box::new(move |_, _| random.random_range(0..=255)),
        Box::new(|x, y| if x > 40 && x < 100 && y > 30 && y < 70 { 200 } else { 2 }),
        Box::new(|x, y| if (x as f64 - 72.0).hypot(y as f64 - 48.0) < 43.0 { 150 } else { 2 }),
        Box::new(|_, _| 0),
    ];
    for (which, mut level) in pictures.into_iter().enumerate() {
        let pixels = (0..width * height).map(|i| [level(i % width, i / width); 3]).collect();
        let look = Look::new(&Image { width, height, pixels }, bench.part);
        for angle_deg in [-90.0, 0.0, 60.0, 150.0] {
            let read = Shadow::new(&bench.rig).read(&[&look], angle_deg);
            assert_eq!(read.map(|(read, _)| read), None, "picture {which}, {angle_deg} degrees");
        }
    }
}
