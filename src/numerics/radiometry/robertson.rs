//! Response by Robertson, Borman & Stevenson (2003), "Estimation-theoretic approach to dynamic range enhancement using multiple
//! exposures", section 4: radiances and curve in turn, each the maximum-likelihood estimate given the other; kept monotone.

use super::bracket::{Bracket, BracketError};
use super::level_samples::LevelSamples;
use super::response::{LEVELS, REFERENCE_LEVEL, Recovered, Response, check};

/// Pixels looked at, at most: every round passes over all of them.
const MAX_PIXELS: usize = 40_000;
/// Rounds at most, and the greatest relative change of the curve that ends them.
const MAX_ROUNDS: usize = 500;
const SETTLED: f64 = 1e-5;
/// The curve at the ends says nothing of its levels: black and clipped samples are all there.
const ENDS: (usize, usize) = (1, LEVELS - 2);

/// The response of every channel from one bracket and its times, refused for the same reasons as
/// [`recover`](super::response::recover) refuses.
pub fn robertson(bracket: &Bracket) -> Result<Recovered, BracketError> {
    check(bracket)?;
    let samples = LevelSamples::new(bracket, MAX_PIXELS);
    let times: Vec<f64> = bracket.exposures().iter().map(|frame| frame.time_s).collect();
    let solved = [0, 1, 2].map(|channel| solve(&samples.points_of(channel), &times));
    let response = Response { log_exposure: solved.each_ref().map(|(curve, _)| curve.clone()) };
    Ok(Recovered { response, active_constraints: solved.map(|(_, active)| active), pixels: samples.points() })
}

/// Robertson's weight, Eq. 12: a Gaussian over the levels, none at the ends.
fn weight(level: u8) -> f64 {
    let level = usize::from(level);
    if level < ENDS.0 || level > ENDS.1 {
        0.0
    } else {
        (-4.0 * (level as f64 - 127.5).powi(2) / 127.5_f64.powi(2)).exp()
    }
}

fn solve(points: &[Vec<u8>], times: &[f64]) -> (Vec<f64>, usize) {
    let weights: [f64; LEVELS] = std::array::from_fn(|level| weight(level as u8));
    let mut curve: Vec<f64> = (0..LEVELS).map(|level| level as f64 / REFERENCE_LEVEL as f64).collect();
    let mut active = 0;
    for _ in 0..MAX_ROUNDS {
        // Eq. 8: the radiance of every point.
        let (mut sums, mut counts) = (vec![0.0; LEVELS], vec![0.0; LEVELS]);
        for point in points {
            let (mut charge, mut time) = (0.0, 0.0);
            for (&level, &t) in point.iter().zip(times) {
                let w = weights[usize::from(level)];
                charge += w * t * curve[usize::from(level)];
                time += w * t * t;
            }
            if time > 0.0 {
                // Eq. 10: a level stands for the mean exposure of the samples that show it.
                for (&level, &t) in point.iter().zip(times) {
                    sums[usize::from(level)] += t * charge / time;
                    counts[usize::from(level)] += 1.0;
                }
            }
        }
        let next = monotone_means(&sums, &counts, &curve, &mut active);
        let change =
            (ENDS.0..=ENDS.1).map(|z| (next[z] / curve[z].max(f64::MIN_POSITIVE) - 1.0).abs()).fold(0.0, f64::max);
        curve = next;
        if change < SETTLED {
            break;
        }
    }
    let log: Vec<f64> = curve.iter().map(|e| e.max(1e-9).ln()).collect();
    let shift = log[REFERENCE_LEVEL];
    (log.into_iter().map(|g| g - shift).collect(), active)
}

/// Means by level, 1 at the reference level, the nearest non-decreasing ones (pooled adjacent violators). Levels without samples
/// lie on a straight line between their neighbours.
fn monotone_means(sums: &[f64], counts: &[f64], last: &[f64], active: &mut usize) -> Vec<f64> {
    let mut pools: Vec<(f64, f64, usize, usize)> = Vec::new();
    *active = 0;
    for level in ENDS.0..=ENDS.1 {
        if counts[level] == 0.0 {
            continue;
        }
        let mut pool = (sums[level], counts[level], level, 1);
        while let Some(below) = pools.last().filter(|below| below.0 / below.1 >= pool.0 / pool.1) {
            pool = (below.0 + pool.0, below.1 + pool.1, below.2, below.3 + pool.3);
            pools.pop();
            *active += 1;
        }
        pools.push(pool);
    }
    let mut known: Vec<(usize, f64)> = Vec::new();
    for (i, (sum, count, first, _)) in pools.iter().enumerate() {
        known.push((*first, sum / count));
        let end = pools.get(i + 1).map_or(ENDS.1 + 1, |next| next.2);
        let highest = (*first..end).rev().find(|&z| counts[z] > 0.0).unwrap_or(*first);
        if highest > *first {
            known.push((highest, sum / count));
        }
    }
    if known.len() < 2 {
        return last.to_vec();
    }
    let curve: Vec<f64> = (0..LEVELS).map(|z| interpolate(&known, z)).collect();
    let unit = curve[REFERENCE_LEVEL];
    curve.into_iter().map(|e| e / unit).collect()
}

/// On the straight line through the known levels around `level`; beyond the ends proportional to the nearest.
fn interpolate(known: &[(usize, f64)], level: usize) -> f64 {
    let above = known.partition_point(|(z, _)| *z < level).clamp(1, known.len() - 1);
    let ((low, a), (high, b)) = (known[above - 1], known[above]);
    let share = (level as f64 - low as f64) / (high as f64 - low as f64);
    (a + share * (b - a)).max(a * level as f64 / low.max(1) as f64 * 0.5)
}
