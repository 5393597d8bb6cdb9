//! A lamp that drifts, told from a reference patch whose normal is not quite what is stated: both change what the patch shows, the one with
//! time, the other with where the lamp stands. A plan that goes out and comes back tells them apart, one that goes one way does not.

use nalgebra::{DMatrix, DVector};

/// Standard deviation of a patch's mean beyond its noise, relative: what an 8-bit response leaves. Measured on simulated frames.
const READING: f64 = 1e-3;
/// What a stated normal is off by before anything is known, rad: 3 degrees.
const STATED: f64 = 0.05;
/// Powers of time that a lamp's drift has, where there are enough readings for all of them.
const POWERS: usize = 2;
const MANY: usize = 8;
/// Rounds of the linearisation.
const ROUNDS: usize = 6;

/// What the patch showed once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// When, as its place in the order of the shots, 0 to 1.
    pub time: f64,
    /// How often the lamp was lit anew before.
    pub lighting: usize,
    /// Radiance over what is expected by the stated normal, red green blue.
    pub brightness: [f64; 3],
    /// Cosines of the lamp's direction with two directions in the patch, over its cosine with the stated normal.
    pub aside: [f64; 2],
}

/// The normal, as far as the readings tell it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lean {
    /// By how much it leans towards those two directions.
    pub by: [f64; 2],
    /// The largest relative standard error that this leaves in a brightness relative to the first.
    pub error: f64,
    /// What the readings scatter about drift and lean, relative, rms.
    pub scatter: f64,
    /// The lamp's drift: by powers of time from the first on, natural logarithm, red green blue.
    drift: [[f64; 3]; POWERS],
    /// Where it begins, natural logarithm of the brightness after the lighting of the first reading.
    begin: [f64; 3],
}

impl Lean {
    /// What the patch shows more for it, as a factor.
    pub fn factor(&self, aside: [f64; 2]) -> f64 {
        1.0 + self.by[0] * aside[0] + self.by[1] * aside[1]
    }

    /// By how much the smooth drift makes the lamp brighter from one time to another, as a factor, red green blue.
    pub fn drift(&self, from: f64, to: f64) -> [f64; 3] {
        std::array::from_fn(|c| (self.grown(c, to) - self.grown(c, from)).exp())
    }

    /// The brightness that it has at a time, if the lamp is not lit anew: all readings tell it, more surely than any one.
    pub fn smooth(&self, time: f64) -> [f64; 3] {
        std::array::from_fn(|c| (self.begin[c] + self.grown(c, time)).exp())
    }

    fn grown(&self, c: usize, time: f64) -> f64 {
        self.drift.iter().rev().fold(0.0, |sum, power| (sum + power[c]) * time)
    }
}

/// How the patch leans, under a lamp whose brightness changes smoothly in each channel and jumps when it is lit anew. None where there
/// are fewer readings than unknowns.
pub fn lean(seen: &[Seen]) -> Option<Lean> {
    let lightings = 1 + seen.iter().map(|s| s.lighting).max()?;
    let powers = if seen.len() >= MANY { POWERS } else { 1 };
    let unknowns = 2 + 3 * (powers + lightings);
    let freedom = (3 * seen.len()).checked_sub(unknowns).filter(|&left| left > 0)?;
    let mut lean =
        Lean { by: [0.0; 2], error: f64::INFINITY, scatter: f64::INFINITY, drift: [[0.0; 3]; POWERS], begin: [0.0; 3] };
    for _ in 0..ROUNDS {
        let (matrix, values) = equations(seen, &lean, powers, lightings);
        let mut normal = matrix.transpose() * &matrix / (READING * READING);
        let mut right = matrix.transpose() * &values / (READING * READING);
        for axis in 0..2 {
            normal[(axis, axis)] += 1.0 / (STATED * STATED);
            right[axis] -= lean.by[axis] / (STATED * STATED);
        }
        // A lighting without a reading has no brightness of its own.
        for unknown in 2..unknowns {
            normal[(unknown, unknown)] += 1e-6 / (READING * READING);
        }
        let solved = normal.cholesky()?;
        let step = solved.solve(&right);
        let rest = values - matrix * &step;
        lean.by = [lean.by[0] + step[0], lean.by[1] + step[1]];
        for power in 0..powers {
            lean.drift[power] = [0, 1, 2].map(|c| step[2 + 3 * power + c]);
        }
        lean.begin = [0, 1, 2].map(|c| step[2 + 3 * (powers + seen[0].lighting) + c]);
        lean.scatter = (rest.norm_squared() / freedom as f64).sqrt();
        let covariance = solved.inverse() * (lean.scatter / READING).max(1.0).powi(2);
        lean.error = largest_error(seen, &covariance);
    }
    (lean.by.iter().all(|by| by.is_finite()) && seen.iter().all(|s| lean.factor(s.aside) > 0.0)).then_some(lean)
}

/// One line a reading and channel: lean, drift, lightings; and what is left of the logarithm of the brightness.
fn equations(seen: &[Seen], lean: &Lean, powers: usize, lightings: usize) -> (DMatrix<f64>, DVector<f64>) {
    let mut matrix = DMatrix::zeros(3 * seen.len(), 2 + 3 * (powers + lightings));
    let mut values = DVector::zeros(3 * seen.len());
    for (i, s) in seen.iter().enumerate() {
        let factor = lean.factor(s.aside).max(f64::MIN_POSITIVE);
        for c in 0..3 {
            let row = 3 * i + c;
            for axis in 0..2 {
                matrix[(row, axis)] = s.aside[axis] / factor;
            }
            let mut time = 1.0;
            for power in 0..powers {
                time *= s.time;
                matrix[(row, 2 + 3 * power + c)] = time;
            }
            matrix[(row, 2 + 3 * (powers + s.lighting) + c)] = 1.0;
            values[row] = (s.brightness[c] / factor).max(f64::MIN_POSITIVE).ln();
        }
    }
    (matrix, values)
}

fn largest_error(seen: &[Seen], covariance: &DMatrix<f64>) -> f64 {
    let Some(first) = seen.first() else { return f64::INFINITY };
    let error = |s: &Seen| {
        let more: [f64; 2] = std::array::from_fn(|axis| s.aside[axis] - first.aside[axis]);
        let sum = |a: usize| more[a] * (covariance[(a, 0)] * more[0] + covariance[(a, 1)] * more[1]);
        (sum(0) + sum(1)).max(0.0).sqrt()
    };
    seen.iter().map(error).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// Readings at these angles off the patch's normal, degrees, which really leans by `lean` to the side and a little upwards.
    fn seen(angles: &[f64], lean: [f64; 2], life: impl Fn(f64) -> f64) -> Vec<Seen> {
        let one = |(i, angle): (usize, &f64)| {
            let time = i as f64 / (angles.len() - 1) as f64;
            let cos = angle.to_radians().cos();
            let aside = [angle.to_radians().tan(), 0.05 / cos];
            let shown = (1.0 + lean[0] * aside[0] + lean[1] * aside[1]) * life(time);
            // No noise, but what a response leaves: a thousandth, fixed.
            let left = |c: usize| 1.0 + 1e-3 * (7.0 * cos + c as f64).sin();
            Seen { time, lighting: 0, brightness: [0, 1, 2].map(|c| 0.4 * shown * left(c)), aside }
        };
        angles.iter().enumerate().map(one).collect()
    }

    /// Every third station on the way out, the next ones on the way back, the rest on the way out again.
    const THREE_WAYS: [f64; 9] = [-55.0, -13.75, 27.5, 41.25, 0.0, -41.25, -27.5, 13.75, 55.0];

    #[test]
    fn three_ways_tell_drift_from_lean() {
        for by in [0.0, 0.0175, -0.07] {
            for drift in [0.0, -0.05, 0.03] {
                let found = lean(&seen(&THREE_WAYS, [by, 0.0], |time| 1.0 + drift * time)).unwrap();
                assert!((found.by[0] - by).abs() < 1e-3 && found.error < 1e-3, "{by} {drift}: {found:?}");
                let later = found.drift(0.0, 1.25)[1] / (1.0 + 1.25 * drift) - 1.0;
                assert!(later.abs() < 2e-3, "{by} {drift}: {later}, a quarter of the session after its end");
            }
        }
    }

    #[test]
    fn one_way_does_not_and_says_so() {
        let mut angles = THREE_WAYS;
        angles.sort_by(f64::total_cmp);
        let found = lean(&seen(&angles, [0.0175, 0.0], |time| 1.0 - 0.05 * time)).unwrap();
        assert!(found.error > 4e-3, "{found:?}");
        assert_eq!(lean(&seen(&angles[..2], [0.0; 2], |_| 1.0)), None);
    }

    #[test]
    fn a_lamp_lit_anew_may_jump() {
        let mut readings = seen(&THREE_WAYS, [0.0175, 0.0], |time| 1.0 - 0.02 * time);
        for reading in &mut readings[4..] {
            reading.lighting = 1;
            reading.brightness = reading.brightness.map(|b| 1.1 * b);
        }
        let found = lean(&readings).unwrap();
        assert!((found.by[0] - 0.0175).abs() < 2e-3 && found.scatter < 2e-3, "{found:?}");
    }

    #[test]
    fn a_lamp_that_flickers_scatters() {
        let found = lean(&seen(&THREE_WAYS, [0.0; 2], |time| 1.0 + 0.02 * (40.0 * time).sin())).unwrap();
        assert!(found.scatter > 8e-3, "{found:?}");
    }
}
