//! The equations of an unknown response curve and unknown log times: Debevec & Malik 1997, Eq. 3, on groups of pixels.

use super::exposure_ratios::Seen;
use super::monotone::non_negative_least_squares;
use super::response::{LEVELS, REFERENCE_LEVEL, slope};
use nalgebra::{DMatrix, DVector};

/// g(level) - x - s_i for every group and frame of one channel as a quadratic form of g (256 unknowns) and s, the log
/// radiances x of the groups eliminated.
pub struct CurveSystem {
    curve: DMatrix<f64>,
    cross: DMatrix<f64>,
    times: DMatrix<f64>,
}

/// Second difference of a curve that costs as much as one standard error of a log ratio, in units of slope / distance to the
/// nearer end of the levels: that of a power law is 1 near black, that of a shoulder near white. Enough to bridge levels without
/// samples.
const ROUGHNESS: f64 = 0.3;
/// Least distance to an end: a power law bends without bound at 0.
const TOE: f64 = 8.0;

impl CurveSystem {
    /// The equations of `groups`: what each group shows in which frame, with weights. `rough` serves to scale the smoothness.
    pub fn new(groups: &[Vec<Seen>], frames: usize, rough: &[f64]) -> Self {
        let mut normal = DMatrix::<f64>::zeros(LEVELS + frames, LEVELS + frames);
        for seen in groups {
            add_group(&mut normal, seen);
        }
        add_smoothness(&mut normal, rough);
        // The objective does not see a constant of the curve.
        normal[(REFERENCE_LEVEL, REFERENCE_LEVEL)] += 1.0;
        Self {
            curve: normal.view((0, 0), (LEVELS, LEVELS)).into_owned(),
            cross: normal.view((0, LEVELS), (LEVELS, frames)).into_owned(),
            times: normal.view((LEVELS, LEVELS), (frames, frames)).into_owned(),
        }
    }

    /// The quadratic form of the log times that is left when the curve is eliminated as well.
    pub fn information(&self) -> Option<DMatrix<f64>> {
        let factor = self.curve.clone().cholesky()?;
        Some(&self.times - self.cross.transpose() * factor.solve(&self.cross))
    }

    /// The non-decreasing curve of these log times, 0 at the reference level: the unknowns are the increments from level to
    /// level, none negative.
    pub fn curve(&self, log_times: &[f64]) -> Option<Vec<f64>> {
        // The mean log time is a constant of the curve, which the objective must not see.
        let mean = log_times.iter().sum::<f64>() / log_times.len() as f64;
        let centred = DVector::from_iterator(log_times.len(), log_times.iter().map(|s| s - mean));
        let mut matrix = self.curve.clone();
        let mut rhs = -(&self.cross * centred);
        matrix[(REFERENCE_LEVEL, REFERENCE_LEVEL)] -= 1.0;
        // Increment k raises every level from k on: sum rows and columns from the end.
        for level in (0..LEVELS - 1).rev() {
            rhs[level] += rhs[level + 1];
            for other in 0..LEVELS {
                matrix[(level, other)] += matrix[(level + 1, other)];
            }
        }
        for level in (0..LEVELS - 1).rev() {
            for other in 0..LEVELS {
                matrix[(other, level)] += matrix[(other, level + 1)];
            }
        }
        let gram = matrix.view((1, 1), (LEVELS - 1, LEVELS - 1)).into_owned();
        let increments = non_negative_least_squares(&gram, &rhs.rows(1, LEVELS - 1).into_owned())?;
        let mut curve = vec![0.0; LEVELS];
        for level in 1..LEVELS {
            curve[level] = curve[level - 1] + increments[level - 1];
        }
        let shift = curve[REFERENCE_LEVEL];
        Some(curve.into_iter().map(|g| g - shift).collect())
    }
}

fn add_group(normal: &mut DMatrix<f64>, seen: &[Seen]) {
    let total: f64 = seen.iter().map(|s| s.weight).sum();
    let row = |s: &Seen| {
        let below = (s.signal as usize).min(LEVELS - 2);
        let part = s.signal - below as f64;
        [(below, 1.0 - part), (below + 1, part), (LEVELS + s.frame, -1.0)]
    };
    for a in seen {
        for b in seen {
            let weight = if a.frame == b.frame { a.weight } else { 0.0 } - a.weight * b.weight / total;
            for (i, share) in row(a) {
                for (j, other) in row(b) {
                    normal[(i, j)] += weight * share * other;
                }
            }
        }
    }
}

/// Squared second differences, in units of what the curve's own bend may be.
fn add_smoothness(normal: &mut DMatrix<f64>, rough: &[f64]) {
    const STENCIL: [f64; 3] = [1.0, -2.0, 1.0];
    for middle in 1..LEVELS - 1 {
        let bend = ROUGHNESS * slope(rough, middle as f64).max(1e-4) / (middle.min(LEVELS - middle) as f64).max(TOE);
        for (i, a) in STENCIL.iter().enumerate() {
            for (j, b) in STENCIL.iter().enumerate() {
                normal[(middle + i - 1, middle + j - 1)] += a * b / (bend * bend);
            }
        }
    }
}
