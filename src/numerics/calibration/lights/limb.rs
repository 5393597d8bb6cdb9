//! The blurred profile across a ball's limb, and where in it the limb is.
//!
//! At depth d inside the outline the normal leans towards the eye by sqrt(2 d / R), so radiance near any smooth limb is
//! a + b sqrt(d) + c d. A limb lit from the front (b > 0) has its steepest place inside the outline, up to half a pixel for
//! one pixel of blur: a gradient maximum alone is biased, and 0.1 px of a 244 px ball are 0.8 mm of depth at 2 m.

use nalgebra::{Matrix4, Vector4};

/// Blurred powers x^0, x^(1/2), x^1 of the positive axis, by distance in standard deviations of the blur.
pub(super) struct LimbTable {
    values: Vec<[f64; 3]>,
}

const FIRST: f64 = -5.0;
const LAST: f64 = 30.0;
const STEPS_PER_UNIT: f64 = 50.0;

impl LimbTable {
    /// Integrates the table.
    pub(super) fn new() -> Self {
        let count = ((LAST - FIRST) * STEPS_PER_UNIT) as usize + 2;
        Self { values: (0..count).map(|i| powers(FIRST + i as f64 / STEPS_PER_UNIT)).collect() }
    }

    fn at(&self, s: f64) -> [f64; 3] {
        if s <= FIRST {
            return [0.0; 3];
        }
        if s >= LAST {
            return [1.0, s.sqrt(), s];
        }
        let place = (s - FIRST) * STEPS_PER_UNIT;
        let (cell, part) = (place as usize, place.fract());
        std::array::from_fn(|k| self.values[cell][k] * (1.0 - part) + self.values[cell + 1][k] * part)
    }
}

/// Integrals of x^(k/2) against a unit Gaussian about s, over x > 0; with x = u^2 the integrand is smooth.
fn powers(s: f64) -> [f64; 3] {
    const CELLS: usize = 200;
    let (low, high) = ((s - 6.0).max(0.0).sqrt(), (s + 6.0).max(0.1).sqrt());
    let step = (high - low) / CELLS as f64;
    let mut sums = [0.0; 3];
    for i in 0..=CELLS {
        let u = low + i as f64 * step;
        let simpson = if i == 0 || i == CELLS { 1.0 } else { 2.0 + 2.0 * (i % 2) as f64 };
        let gauss = (-0.5 * (s - u * u) * (s - u * u)).exp() * 0.398_942_280_401_432_7;
        let mut power = u;
        for sum in &mut sums {
            *sum += simpson * step / 3.0 * 2.0 * power * gauss;
            power *= u;
        }
    }
    sums
}

/// Levels across a limb at even distances, from outside (negative offsets are outside) to inside.
#[derive(Clone, Debug)]
pub(super) struct Profile {
    /// Offset of every sample inwards from the expected outline, pixels.
    pub offsets: Vec<f64>,
    /// Level of every sample.
    pub levels: Vec<f64>,
}

/// A limb found in a profile.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limb {
    /// Offset of the limb inwards, pixels.
    pub offset: f64,
    /// Its standard deviation from the profile's own scatter, pixels.
    pub sigma: f64,
    /// Residual sum of squares.
    pub rss: f64,
}

impl Profile {
    /// Residual sum of squares of the best a, b, c and background for a limb at `offset` under a blur of `sigma` pixels.
    fn rss(&self, table: &LimbTable, offset: f64, sigma: f64) -> f64 {
        let (mut normal, mut right, mut square) = (Matrix4::<f64>::zeros(), Vector4::<f64>::zeros(), 0.0);
        for (at, level) in self.offsets.iter().zip(&self.levels) {
            let [step, root, ramp] = table.at((at - offset) / sigma);
            let row = Vector4::new(1.0, step, root, ramp);
            normal += row * row.transpose();
            right += row * *level;
            square += level * level;
        }
        // A ridge far below any level: outside the window the columns vanish.
        let solved = (normal + Matrix4::identity() * 1e-9 * self.offsets.len() as f64).cholesky();
        solved.map_or(square, |c| {
            let x = c.solve(&right);
            (square - 2.0 * x.dot(&right) + (normal * x).dot(&x)).max(0.0)
        })
    }

    /// The limb within `reach` pixels of the expected outline. None where the profile's end is as good as any place in it, or
    /// where no place explains the levels better than noise.
    pub(super) fn limb(&self, table: &LimbTable, sigma: f64, reach: f64) -> Option<Limb> {
        let steps = (reach / 0.25).ceil();
        let step = reach / steps;
        let at = |i: usize| i as f64 * step - reach;
        let scanned: Vec<f64> = (0..=2 * steps as usize).map(|i| self.rss(table, at(i), sigma)).collect();
        let best = (0..scanned.len()).min_by(|a, b| scanned[*a].total_cmp(&scanned[*b]))?;
        if best == 0 || best + 1 == scanned.len() {
            return None;
        }
        let offset = golden(|x| self.rss(table, x, sigma), at(best) - step, at(best) + step);
        let rss = self.rss(table, offset, sigma);
        const H: f64 = 0.1;
        let curvature =
            (self.rss(table, offset + H, sigma) - 2.0 * rss + self.rss(table, offset - H, sigma)) / (2.0 * H * H);
        let noise = rss / (self.levels.len() as f64 - 5.0).max(1.0);
        (curvature > 0.0).then(|| Limb { offset, sigma: (noise / curvature).sqrt(), rss })
    }
}

/// Minimum of a function with one valley between `a` and `b`, to a thousandth of a pixel.
fn golden(of: impl Fn(f64) -> f64, mut a: f64, mut b: f64) -> f64 {
    const RATIO: f64 = 0.618_033_988_749_894_9;
    let (mut c, mut d) = (b - RATIO * (b - a), a + RATIO * (b - a));
    let (mut at_c, mut at_d) = (of(c), of(d));
    while b - a > 1e-3 {
        if at_c < at_d {
            (b, d, at_d) = (d, c, at_c);
            c = b - RATIO * (b - a);
            at_c = of(c);
        } else {
            (a, c, at_c) = (c, d, at_d);
            d = a + RATIO * (b - a);
            at_d = of(d);
        }
    }
    0.5 * (a + b)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// A limb at +0.37 px, blurred by brute force: 400 Gaussian-weighted shifts of the sharp profile.
    fn blurred(step: f64, root: f64, sigma: f64) -> Profile {
        let sharp = |d: f64| if d > 0.0 { step + root * d.sqrt() + 0.01 * d } else { 0.0 };
        let offsets: Vec<f64> = (-16..=16).map(|i| 0.5 * f64::from(i)).collect();
        let level = |at: f64| {
            let (mut sum, mut total) = (0.0, 0.0);
            for i in -2000..=2000 {
                let t = f64::from(i) / 400.0;
                let weight = (-0.5 * t * t).exp();
                sum += weight * sharp(at - 0.37 + sigma * t);
                total += weight;
            }
            0.2 + sum / total
        };
        Profile { levels: offsets.iter().map(|&at| level(at)).collect(), offsets }
    }

    #[test]
    fn finds_limbs_whose_steepest_place_lies_elsewhere() {
        let table = LimbTable::new();
        for (step, root) in [(1.0, 0.0), (0.5, 0.3), (0.1, 0.3), (-0.6, -0.1), (0.5, -0.1)] {
            let limb = blurred(step, root, 1.1).limb(&table, 1.1, 3.0).unwrap();
            assert!((limb.offset - 0.37).abs() < 0.02, "step {step}, root {root}: {limb:?}");
        }
    }
}
