//! A matt, evenly lit patch in the frames of a bracket: held against what it showed in an earlier one.

use super::compare::assumed_slope;
use super::look::{CLIPPED, DARK, Look, Sample};
use nalgebra::{Matrix3, Vector3};

/// Levels that a patch's exposure is read from.
const READ: std::ops::Range<f64> = 18.0..225.0;
/// Share of its samples that must be neither dark nor clipped.
const SEEN: f64 = 0.95;
/// Samples of which one tells as much as all of them: of small patches they overlap.
const OVERLAP: f64 = 4.0;
/// Levels about the patch's own from which the object tells how levels of one exposure go with those of another, and samples needed.
const NEAR: f64 = 40.0;
const ENOUGH: f64 = 64.0;
/// What that leaves unknown, levels a level. Measured on simulated frames.
const SLOPE: f64 = 0.01;
/// A sample is part of a patch if its level is this near to the middle one's: relative, and levels.
const EVEN: (f32, f32) = (0.15, 6.0);

/// A patch in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatchLevel {
    /// Mean level.
    level: f64,
    /// Standard error of that.
    sigma: f64,
    /// Neither dark nor clipped.
    open: bool,
    /// Share that is not as bright as the middle level, where that is neither dark nor clipped.
    pub uneven: Option<f64>,
}

impl PatchLevel {
    /// Of the pixels of the patch.
    pub fn of(look: &Look) -> Self {
        let levels = || look.samples.iter().map(|sample| sample.level);
        let n = look.samples.len().max(1) as f64;
        let level = levels().map(f64::from).sum::<f64>() / n;
        let variance = levels().map(|l| (f64::from(l) - level).powi(2)).sum::<f64>() / n;
        let open = levels().filter(|l| (DARK..CLIPPED).contains(l)).count() as f64 >= SEEN * n;
        let middle = look.median();
        let apart = EVEN.0 * middle + EVEN.1;
        let uneven = levels().filter(|l| (l - middle).abs() > apart).count() as f64 / n;
        let readable = (2.0 * DARK..CLIPPED).contains(&middle);
        Self { level, sigma: (OVERLAP * variance / n).sqrt(), open, uneven: readable.then_some(uneven) }
    }

    /// How far it is from another in level.
    pub fn apart(&self, other: &Self) -> f64 {
        (self.level - other.level).abs()
    }
}

/// By how much the patch became brighter from one frame (`now`, first) to another (second) than it did between the same exposures of an
/// earlier bracket (`before`), natural logarithm of exposure and standard error. The object in both frames says how a difference between
/// the brackets goes from one exposure to the other. None where the patch cannot be read, or the object has too few such levels.
pub fn patch_change(object: [&Look; 2], before: [PatchLevel; 2], now: [PatchLevel; 2]) -> Option<(f64, f64)> {
    if !(before[0].open && before[1].open && now[0].open) {
        return None;
    }
    let more = now[0].level - before[0].level;
    let (slope, error) = local_slope(object, 0.5 * (now[0].level + before[0].level))?;
    let predicted = before[1].level + slope * more;
    if !READ.contains(&predicted) {
        return None;
    }
    let noise = [slope * now[0].sigma, slope * before[0].sigma, now[1].sigma, before[1].sigma];
    let variance =
        noise.iter().map(|sigma| sigma * sigma).sum::<f64>() + (error * more).powi(2) + (SLOPE * more).powi(2);
    let scale = assumed_slope(predicted);
    Some(((now[1].level - predicted) / scale, variance.sqrt() / scale))
}

/// Levels of the second frame a level of the first, where the first has `level`, and its standard error: of the parabola through what the
/// object shows about it.
fn local_slope([first, second]: [&Look; 2], level: f64) -> Option<(f64, f64)> {
    let useful =
        |(a, b): &(&Sample, &Sample)| a.smooth() && b.level < CLIPPED && (f64::from(a.level) - level).abs() <= NEAR;
    let (mut matrix, mut right, mut square) = (Matrix3::zeros(), Vector3::zeros(), 0.0);
    for (a, b) in first.samples.iter().zip(&second.samples).filter(useful) {
        let (x, y) = ((f64::from(a.level) - level) / NEAR, f64::from(b.level));
        let powers = Vector3::new(1.0, x, x * x);
        matrix += powers * powers.transpose();
        right += powers * y;
        square += y * y;
    }
    let n = matrix[(0, 0)];
    if n < ENOUGH {
        return None;
    }
    let inverse = matrix.try_inverse()?;
    let parabola = inverse * right;
    let rest = (square - parabola.dot(&right)).max(0.0) / n;
    Some((parabola[1] / NEAR, (rest * inverse[(1, 1)]).max(0.0).sqrt() / NEAR))
}
