//! Settle time from photographs of the simulated world: the arm swings in closed form, frames are shot at known times of it, and what
//! comes out is held against that form. No clock, no engine.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rig_config::{Rig, Shutter};
use rigd::devices::Cancel;
use rigd::devices::camera::{Camera, Shot};
use rigd::pipeline::settle::{Photograph, Series, SettleReport, Shots, settle_time};
use rigd::session::crop;
use rigd::sim::camera::{CameraFaults, SimulatedCamera};
use rigd::sim::pose::{Pose, SharedPose};
use rigd::sim::ringing::Ringing;
use std::collections::HashMap;

const STATION_DEG: f64 = -20.0;
const BESIDE_DEG: f64 = -22.0;
const FAR_DEG: f64 = -55.0;
const REPEATS: usize = 8;
const FRAMES: usize = 7;
/// A tethered camera's pace, seconds a frame, of which this much passes before the file is there.
const PERIOD_S: f64 = 1.2;
const TOOK_S: f64 = 0.9;
/// Between two of the staggered requests.
const GAP_S: f64 = PERIOD_S / REPEATS as f64;

struct Studio {
    rig: Rig,
    camera: SimulatedCamera,
    pose: SharedPose,
    files: HashMap<String, Vec<u8>>,
    exposure: Shutter,
    must_see_deg: f64,
}

impl Studio {
    fn new(seed: u64) -> Self {
        let (_, text) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated").unwrap();
        let rig = Rig::from_toml(text, "simulated").unwrap();
        let (pose, mut simulation) = (SharedPose::default(), rig.simulation.clone().unwrap());
        (simulation.seed, simulation.speed) = (seed, f64::INFINITY);
        let camera = SimulatedCamera::new(&rig, &simulation, pose.clone(), CameraFaults::default());
        Self {
            rig,
            camera,
            pose,
            files: HashMap::new(),
            exposure: Shutter::from_label("1/4").unwrap(),
            must_see_deg: 0.2,
        }
    }

    /// One photograph of an arm at this angle, the lamp at `lamp` of its level.
    fn shoot(&mut self, angle_deg: f64, lamp: f64, since_rest_s: f64) -> Photograph {
        let lamp_permille = (lamp * f64::from(self.rig.lamp.level_permille)).round() as u16;
        self.pose.set(Pose { angle_deg, lamp_permille });
        let shutter = self.exposure.clone();
        let bytes =
            self.camera.shoot(&Shot { station: 0, exposure: 0, shutter, f_number: 5.6, iso: 100 }, &Cancel::default());
        let name = format!("{}.jpg", self.files.len());
        self.files.insert(name.clone(), bytes.unwrap().bytes);
        Photograph { since_rest_s: [since_rest_s, since_rest_s + TOOK_S], name }
    }

    /// A whole measurement of an arm whose way off its station is `swing(move, seconds since rest)`, under a lamp `lamp(seconds)`.
    fn series(&mut self, swing: impl Fn(f64, f64) -> f64, lamp: impl Fn(f64) -> f64) -> Series {
        let beside = (0..FRAMES).map(|i| self.shoot(BESIDE_DEG, 1.0, i as f64 * PERIOD_S)).collect();
        let mut bursts = Vec::new();
        for from_deg in [FAR_DEG, BESIDE_DEG] {
            for repeat in 0..REPEATS {
                let times: Vec<f64> = (0..FRAMES).map(|i| i as f64 * PERIOD_S + repeat as f64 * GAP_S + 0.01).collect();
                let length = (STATION_DEG - from_deg).abs();
                let shot = times.into_iter().map(|t| self.shoot(STATION_DEG + swing(length, t), lamp(t), t));
                bursts.push(Shots { from_deg, photographs: shot.collect() });
            }
        }
        Series {
            station_deg: STATION_DEG,
            beside_deg: BESIDE_DEG,
            beside: Shots { from_deg: FAR_DEG, photographs: beside },
            bursts,
            exposure_s: self.exposure.true_s,
            crop: crop::of_object(&self.rig),
            must_see_deg: self.must_see_deg,
        }
    }

    fn measure(&mut self, swing: impl Fn(f64, f64) -> f64, lamp: impl Fn(f64) -> f64) -> Result<SettleReport, String> {
        let series = self.series(swing, lamp);
        settle_time(&series, &|name| self.files.get(name).cloned().ok_or_else(|| format!("{name} is not there")))
    }
}

/// A short move reaches a third of the speed of a long one.
fn ringing(ringing: Ringing) -> impl Fn(f64, f64) -> f64 {
    move |length, t| ringing.scaled(if length > 10.0 { 1.0 } else { 1.0 / 3.0 }).at(t)
}

fn steady(_: f64) -> f64 {
    1.0
}

#[test]
fn the_settle_time_is_where_the_closed_form_falls_below_what_can_be_seen() {
    for (seed, decay_s) in [(1, 0.25), (2, 0.5), (3, 1.0)] {
        let truth = Ringing { amplitude_deg: 1.5, frequency_hz: 2.3, decay_s };
        let found = Studio::new(seed).measure(ringing(truth), steady).unwrap();
        println!(
            "decay {decay_s}: settles in {:.3} s (+0 -{:.3}), smallest {:.4} degrees, {} cells, moves {:?}",
            found.settle_s, found.uncertainty_s, found.smallest_seen_deg, found.cells, found.moves
        );
        for (of, amplitude_deg) in found.moves.iter().zip([1.5, 0.5]) {
            // The envelope falls below the smallest visible displacement at `end_s`; noise may bring the last visible swing above
            // or below it by the fourth part of that displacement, and a swing shows in full only once in half an oscillation.
            let end_s = |smallest: f64| decay_s * (amplitude_deg / smallest).ln();
            let (early, late) = (end_s(1.35 * found.smallest_seen_deg), end_s(0.65 * found.smallest_seen_deg));
            let half_s = 0.5 / truth.frequency_hz;
            assert!(of.settle_s <= late + GAP_S + 1e-9, "decay {decay_s}: {} s after {late} s", of.settle_s);
            assert!(of.settle_s >= early - half_s - GAP_S, "decay {decay_s}: {} s before {early} s", of.settle_s);
            let above = of.last_above_s.unwrap();
            assert!(above < of.settle_s && of.settle_s - above <= GAP_S + 1e-9);
        }
        assert_eq!(found.settle_s, found.moves[0].settle_s, "the long move takes longest");
        assert!((found.recommended_s - 2.0 * found.settle_s).abs() <= 0.01 && found.warnings.is_empty());
        assert!((found.shutter_lag_at_most_s - (TOOK_S - 0.25)).abs() < 0.01);
    }
}

#[test]
fn displacements_are_those_of_the_closed_form() {
    let truth = Ringing { amplitude_deg: 1.5, frequency_hz: 0.4, decay_s: 1.5 };
    let found = Studio::new(4).measure(ringing(truth), steady).unwrap();
    let swing = ringing(truth);
    let early: Vec<_> = found.table.iter().filter(|row| !row.last).collect();
    assert!(early.len() == 2 * REPEATS * (FRAMES - 3));
    for row in early {
        let off = row.displacement_deg - swing(row.move_deg, row.delay_s);
        // One pattern, measured over two degrees, serves for all: a tenth of the way where highlights move.
        let may = found.smallest_seen_deg + 0.1 * swing(row.move_deg, row.delay_s).abs();
        assert!(off.abs() < may, "{} s: off by {off} degrees, {may} allowed", row.delay_s);
    }
}

#[test]
fn an_arm_that_does_not_ring_settles_at_once_and_the_bound_is_said() {
    for seed in 1..=4 {
        let found = Studio::new(seed).measure(|_, _| 0.0, steady).unwrap();
        assert!(found.moves.iter().all(|of| of.last_above_s.is_none() && of.greatest_deg == 0.0));
        assert_eq!((found.settle_s, found.uncertainty_s, found.recommended_s), (0.01, 0.01, 0.02));
        assert!(found.smallest_seen_deg < 0.2, "{}", found.smallest_seen_deg);
    }
}

#[test]
fn what_cannot_be_measured_is_refused_in_words() {
    let refusal = |prepare: fn(&mut Studio), swing: fn(f64, f64) -> f64, lamp: fn(f64) -> f64| {
        let mut studio = Studio::new(5);
        prepare(&mut studio);
        studio.measure(swing, lamp).unwrap_err()
    };
    let never = |_: f64, t: f64| Ringing { amplitude_deg: 0.6, frequency_hz: 1.7, decay_s: f64::INFINITY }.at(t);
    let said = refusal(|_| (), never, steady);
    assert!(said.contains("never settles") && said.contains("would not be seen"), "{said}");
    let said = refusal(|_| (), |_, t| Ringing { amplitude_deg: 1.0, frequency_hz: 1.7, decay_s: 4.0 }.at(t), steady);
    assert!(said.contains("never settles"), "{said}");
    let said = refusal(|_| (), |_, _| 0.0, |_| 0.0);
    assert!(said.contains("no light on the object at -20 degrees"), "{said}");
    let said = refusal(|_| (), |_, _| 0.0, |t| 1.0 - 0.004 * t);
    assert!(said.contains("the lamp changes by"), "{said}");
    let said = refusal(|studio| studio.must_see_deg = 0.01, |_, _| 0.0, steady);
    assert!(said.contains("too much noise") && said.contains("longer exposure"), "{said}");
}
