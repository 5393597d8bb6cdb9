//! The levels of one exposure against those of another of the same scene: what a response and two times come to, without either.

use super::look::{CLIPPED, Look};
use std::collections::BTreeMap;

/// Samples a point of the curve is made of, at least, and points of a curve at most.
const PER_POINT: usize = 24;
const POINTS: usize = 24;

/// A curve from levels of a first frame to levels of a second.
#[derive(Clone, Debug, PartialEq)]
pub struct Transfer {
    /// Level in the first frame, level in the second, levels a level; by the first, which increases.
    points: Vec<(f32, f32)>,
}

impl Transfer {
    /// Of two looks at one scene: medians of samples of neighbouring levels. None where too few are seen in both.
    pub fn of(first: &Look, second: &Look) -> Option<Self> {
        let mut pairs: Vec<(f32, f32)> = first
            .samples
            .iter()
            .zip(&second.samples)
            .filter(|(a, b)| a.smooth() && b.level < CLIPPED)
            .map(|(a, b)| (a.level, b.level))
            .collect();
        if pairs.len() < 2 * PER_POINT {
            return None;
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let size = pairs.len().div_ceil(POINTS).max(PER_POINT);
        let point = |some: &[(f32, f32)]| {
            let mut seconds: Vec<f32> = some.iter().map(|pair| pair.1).collect();
            seconds.sort_by(f32::total_cmp);
            // The mean of the middle half: levels are whole or quarter numbers.
            let middle = &seconds[seconds.len() / 4..(3 * seconds.len()).div_ceil(4)];
            let first = some.iter().map(|pair| pair.0).sum::<f32>() / some.len() as f32;
            (first, middle.iter().sum::<f32>() / middle.len() as f32)
        };
        let mut points: Vec<(f32, f32)> = pairs.chunks(size).filter(|c| c.len() >= PER_POINT).map(point).collect();
        points.dedup_by(|b, a| b.0 - a.0 < 0.5);
        (points.len() >= 2).then_some(Self { points })
    }

    /// The second frame's level where the first has `level`, and the slope there; none outside the levels that were seen.
    pub fn at(&self, level: f32) -> Option<(f32, f32)> {
        let next = self.points.partition_point(|point| point.0 < level).clamp(1, self.points.len() - 1);
        let ((a0, b0), (a1, b1)) = (self.points[next - 1], self.points[next]);
        let slope = (b1 - b0) / (a1 - a0);
        let reach = 0.5 * (a1 - a0).max(1.0);
        (level >= a0 - reach && level <= a1 + reach).then_some((b0 + slope * (level - a0), slope))
    }
}

/// Curves learned from the first good bracket of a run, by both exposures' third stops.
#[derive(Clone, Debug, Default)]
pub struct Transfers(BTreeMap<(i64, i64), Transfer>);

impl Transfers {
    /// The curve from exposure `first` to `second`.
    pub fn get(&self, first: i64, second: i64) -> Option<&Transfer> {
        self.0.get(&(first, second))
    }

    /// Learns from a good bracket, given as third stop and look, what is not known yet.
    pub fn learn(&mut self, bracket: &[(i64, &Look)]) {
        for (first, a) in bracket {
            for (second, b) in bracket.iter().filter(|(second, _)| second != first) {
                if !self.0.contains_key(&(*first, *second))
                    && let Some(curve) = Transfer::of(a, b)
                {
                    self.0.insert((*first, *second), curve);
                }
            }
        }
    }
}
