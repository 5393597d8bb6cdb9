//! Ramps against the closed forms of constant acceleration, and against their limits.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use arm_logic::{Pace, Ramp};
use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};

fn runner(cases: u32) -> TestRunner {
    let config = ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() };
    TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha))
}

fn intervals(mut ramp: Ramp) -> Vec<u32> {
    std::iter::from_fn(|| ramp.next_us()).collect()
}

/// Steps to a turn, speed (steps/s) and acceleration (steps/s^2) in reals, and the pace in integers.
#[derive(Clone, Copy, Debug)]
struct Case {
    pace: Pace,
    speed: f64,
    acceleration: f64,
}

impl Case {
    fn new(steps_per_turn: u32, speed_mdeg_s: u32, acceleration_mdeg_s2: u32) -> Self {
        let steps_a_mdeg = f64::from(steps_per_turn) / 360_000.0;
        Self {
            pace: Pace::new(steps_per_turn, speed_mdeg_s, acceleration_mdeg_s2).unwrap(),
            speed: f64::from(speed_mdeg_s) * steps_a_mdeg,
            acceleration: f64::from(acceleration_mdeg_s2) * steps_a_mdeg,
        }
    }

    /// From rest to rest over `steps`, seconds.
    fn closed_form_s(&self, steps: u32) -> f64 {
        let (steps, ramps) = (f64::from(steps), self.speed * self.speed / self.acceleration);
        if steps < ramps {
            2.0 * (steps / self.acceleration).sqrt()
        } else {
            (steps - ramps) / self.speed + 2.0 * self.speed / self.acceleration
        }
    }

    /// No step comes sooner than the greatest speed allows, and mean speeds of neighbouring steps differ by no more than the
    /// acceleration allows between their middles; whole microseconds blur each interval by one.
    fn check_limits(&self, intervals: &[u32]) -> Result<(), TestCaseError> {
        for &interval in intervals {
            prop_assert!(f64::from(interval) * 1e-6 * self.speed >= 1.0 - 1e-12, "{} us is too soon", interval);
        }
        for pair in intervals.windows(2) {
            let (a, b) = (f64::from(pair[0]) * 1e-6, f64::from(pair[1]) * 1e-6);
            let allowed = self.acceleration * (a + b) / 2.0;
            let blur = 1e-6 / (a * a) + 1e-6 / (b * b);
            prop_assert!((1.0 / a - 1.0 / b).abs() <= allowed + 1.01 * blur + 1e-9, "{:?} us at {:?}", pair, self);
        }
        Ok(())
    }
}

fn any_case() -> impl Strategy<Value = Case> {
    (400..100_000u32, 100..90_000u32, 1000..500_000u32).prop_map(|(steps, speed, acc)| Case::new(steps, speed, acc))
}

#[test]
fn a_move_of_40_degrees_takes_the_ideal_time() {
    // 16000 steps a turn, 30 deg/s, 100 deg/s^2: 40 / 30 + 30 / 100 s.
    let case = Case::new(16_000, 30_000, 100_000);
    let time_us: u32 = intervals(Ramp::new(case.pace, 1778)).iter().sum();
    let ideal_us = (1778.0 * 0.0225 / 30.0 + 30.0 / 100.0) * 1e6;
    assert!((f64::from(time_us) - ideal_us).abs() < 1000.0, "{time_us} us, ideal {ideal_us} us");
}

#[test]
fn moves_take_the_time_of_the_closed_form_and_all_their_steps() {
    runner(3000)
        .run(&(any_case(), 1..5000u32), |(case, steps)| {
            let intervals = intervals(Ramp::new(case.pace, steps));
            prop_assert_eq!(intervals.len(), steps as usize);
            let time_s: f64 = intervals.iter().map(|us| f64::from(*us) * 1e-6).sum();
            let (ideal_s, first_s) = (case.closed_form_s(steps), f64::from(intervals[0]) * 1e-6);
            // A microsecond a step from rounding; one step more of each ramp, which is rounded up to whole steps.
            let slack_s = 1e-6 * f64::from(steps) + first_s;
            prop_assert!((time_s - ideal_s).abs() <= slack_s, "{} s, ideal {} s, first {}", time_s, ideal_s, first_s);
            Ok(())
        })
        .unwrap();
}

#[test]
fn speed_and_acceleration_are_never_exceeded() {
    runner(1000)
        .run(&(any_case(), 1..5000u32), |(case, steps)| case.check_limits(&intervals(Ramp::new(case.pace, steps))))
        .unwrap();
}

#[test]
fn braking_at_any_moment_ends_within_the_braking_distance() {
    runner(3000)
        .run(&(any_case(), 1..5000u32, 0..5000u32), |(case, steps, made)| {
            let mut ramp = Ramp::new(case.pace, steps);
            let mut all: Vec<u32> = (0..made).map_while(|_| ramp.next_us()).collect();
            ramp.end_within(0);
            let braking = intervals(ramp);
            // The speed after the last step is at most half an interval's acceleration above its mean; the interval itself is
            // rounded by less than a microsecond.
            let speed = all.last().map_or(0.0, |us| {
                let last_s = (f64::from(*us) - 1.0) * 1e-6;
                (1.0 / last_s + case.acceleration * last_s / 2.0).min(case.speed)
            });
            let distance = speed * speed / (2.0 * case.acceleration);
            prop_assert!(braking.len() as f64 <= distance.ceil() + 1.0, "{} steps for {}", braking.len(), distance);
            prop_assert!(braking.len() <= case.pace.braking_steps() as usize);
            prop_assert!(all.len() + braking.len() <= steps as usize);
            all.extend(braking);
            case.check_limits(&all)
        })
        .unwrap();
}

#[test]
fn impossible_paces_are_refused() {
    for (steps, speed, acceleration) in [(0, 1, 1), (1, 0, 1), (1, 1, 0), (1, 1, 1), (10_000_000, 4_000_000_000, 1)] {
        assert_eq!(Pace::new(steps, speed, acceleration), None, "{steps} {speed} {acceleration}");
    }
}
