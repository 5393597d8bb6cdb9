//! Exposure ratios from the images themselves (after Hanji & Mantiuk 2023): weighted least squares of log ratios.
//!
//! A group of pixels has the log radiance x; frame i sees it as the log exposure l_i = x + s_i with s_i the logarithm of its time.
//! With x eliminated the sum of squares is that of all pairs, sum_{i<j} w_i w_j / W (l_i - l_j - s_i + s_j)^2, which is the
//! maximum-likelihood weighting of overlapping pairs that share a frame. It is quadratic in s; an unknown response curve joins
//! it as 256 more unknowns and is eliminated as well.

use super::curve_system::CurveSystem;
use super::groups::Group;
use super::response::LEVELS;
use nalgebra::{DMatrix, DVector};

/// What images say of the logarithms s of their times: the quadratic form s'As - 2 b's + c. Sums over channels and brackets.
#[derive(Clone, Debug)]
pub struct Information {
    matrix: DMatrix<f64>,
    rhs: DVector<f64>,
    constant: f64,
    /// Residuals minus unknowns eliminated on the way.
    freedom: f64,
    /// Pixels by frame that another frame shows as well, counted once a channel.
    pub overlap: Vec<usize>,
}

/// Relative scatter that does not average out within a group: texture, vibration, stray light.
const FLOOR: f64 = 1e-3;

impl Information {
    /// Nothing known about `frames` frames.
    pub fn none(frames: usize) -> Self {
        Self {
            matrix: DMatrix::zeros(frames, frames),
            rhs: DVector::zeros(frames),
            constant: 0.0,
            freedom: 0.0,
            overlap: vec![0; frames],
        }
    }

    /// Adds a channel whose response is known: `log_exposure` and its standard error `sigma` of one sample, by signal.
    pub fn add_known(&mut self, groups: &[Group], log_exposure: &dyn Fn(f64) -> f64, sigma: &dyn Fn(f64) -> f64) {
        for seen in self.seen(groups, sigma) {
            let total: f64 = seen.iter().map(|s| s.weight).sum();
            let log = |s: &Seen| log_exposure(s.signal);
            let mean = seen.iter().map(|s| s.weight * log(s)).sum::<f64>() / total;
            for a in &seen {
                self.matrix[(a.frame, a.frame)] += a.weight;
                self.rhs[a.frame] += a.weight * (log(a) - mean);
                self.constant += a.weight * (log(a) - mean).powi(2);
                for b in &seen {
                    self.matrix[(a.frame, b.frame)] -= a.weight * b.weight / total;
                }
            }
            self.freedom += seen.len() as f64 - 1.0;
        }
    }

    /// Adds a channel of 8-bit levels whose curve is not known: it is eliminated. Returns its equations, to find the curve with.
    pub fn add_unknown(&mut self, groups: &[Group], rough: &[f64], sigma: &dyn Fn(f64) -> f64) -> Option<CurveSystem> {
        let seen = self.seen(groups, sigma);
        let system = CurveSystem::new(&seen, self.overlap.len(), rough);
        self.matrix += system.information()?;
        self.freedom += seen.iter().map(|seen| seen.len() as f64 - 1.0).sum::<f64>() - LEVELS as f64;
        Some(system)
    }

    /// What every group that two frames show says in which frame; counts the overlap.
    pub(super) fn seen(&mut self, groups: &[Group], sigma: &dyn Fn(f64) -> f64) -> Vec<Vec<Seen>> {
        let of_group = |group: &Group| -> Vec<Seen> {
            let in_frame = |(frame, mean): (usize, &Option<(f64, f64)>)| {
                let (signal, trust) = (*mean)?;
                let variance = sigma(signal).powi(2) / group.points as f64 + FLOOR * FLOOR;
                Some(Seen { frame, signal, weight: trust / variance })
            };
            group.means.iter().enumerate().filter_map(in_frame).collect()
        };
        let mut all = Vec::with_capacity(groups.len());
        for group in groups {
            let seen = of_group(group);
            if seen.len() >= 2 {
                seen.iter().for_each(|s| self.overlap[s.frame] += group.points);
                all.push(seen);
            }
        }
        all
    }

    /// The most likely log times of the frames `told`, which differ from `expected` by nothing along the directions `fixed`
    /// (columns) and are known to be within the relative `spread` of them along the others, with their covariance and the sum of
    /// squares a degree of freedom. Where that is above 1 the images are trusted less in proportion.
    pub(super) fn constrained(
        &self,
        told: &[usize],
        expected: &[f64],
        fixed: &DMatrix<f64>,
        spread: f64,
    ) -> Option<(Vec<f64>, DMatrix<f64>, f64)> {
        let n = told.len();
        let matrix = DMatrix::from_fn(n, n, |i, j| self.matrix[(told[i], told[j])]);
        let rhs = DVector::from_fn(n, |i, _| self.rhs[told[i]]);
        let expected = DVector::from_column_slice(expected);
        let basis = fixed.clone().qr().q();
        let projection = DMatrix::identity(n, n) - &basis * basis.transpose();
        let solve = |trust: f64| {
            // A large weight on the fixed directions takes them out without a change of basis.
            let held = &basis * basis.transpose() * (1e6 * matrix.trace().max(1.0));
            let factor = (&matrix * trust + DMatrix::identity(n, n) * spread.powi(-2) + held).cholesky()?;
            let pull = &projection * (&rhs - &matrix * &expected) * trust;
            let log_times = &expected + &projection * factor.solve(&pull);
            Some((log_times, &projection * factor.inverse() * &projection))
        };
        let (first, _) = solve(1.0)?;
        let squares = first.dot(&(&matrix * &first)) - 2.0 * rhs.dot(&first) + self.constant;
        let chi_squared = squares.max(0.0) / (self.freedom - n as f64).max(1.0);
        let (log_times, covariance) = solve(1.0 / chi_squared.max(1.0))?;
        Some((log_times.as_slice().to_vec(), covariance, chi_squared))
    }
}

/// What a frame shows of a group.
pub struct Seen {
    /// The frame.
    pub frame: usize,
    /// Mean signal.
    pub signal: f64,
    /// Inverse variance of its log exposure.
    pub weight: f64,
}
