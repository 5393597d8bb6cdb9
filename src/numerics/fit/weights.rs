//! Material weights of a point for fixed BRDF parameters (paper Eq. 10): a convex quadratic programme in at most
//! [`MAX_MATERIALS`] unknowns, solved exactly by trying every set of active constraints.

use super::objective::Objective;
use super::observations::{Observations, Sample};
use super::{CHUNK, MAX_MATERIALS, unit_radiance};
use crate::numerics::brdf::{Lobe, Material};
use rayon::prelude::*;

/// Which constraints hold for the weights of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WeightRule {
    /// Paper Eq. 10 as printed: gamma >= 0 and sum gamma <= 1.
    Paper,
    /// gamma >= 0 only: the sum is a gauge that is fixed after the solve.
    Exact,
}

impl WeightRule {
    /// The rule of this name.
    pub fn by_name(name: &str) -> Option<Self> {
        match name {
            "paper" => Some(Self::Paper),
            "exact" => Some(Self::Exact),
            _ => None,
        }
    }
}

/// The quadratic of one point: cost = gamma' G gamma - 2 b' gamma + const.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PointQuadratic {
    pub count: usize,
    pub g: [[f64; MAX_MATERIALS]; MAX_MATERIALS],
    pub b: [f64; MAX_MATERIALS],
}

impl PointQuadratic {
    pub(crate) fn new(
        lobe: &dyn Lobe,
        materials: &[Material],
        objective: Objective,
        samples: impl Iterator<Item = Sample>,
    ) -> Self {
        let count = materials.len();
        let mut q = Self { count, g: [[0.0; MAX_MATERIALS]; MAX_MATERIALS], b: [0.0; MAX_MATERIALS] };
        for sample in samples {
            let w = objective.weights(&sample);
            let mut unit = [[0.0; 3]; MAX_MATERIALS];
            for (slot, material) in unit.iter_mut().zip(materials) {
                *slot = unit_radiance(lobe, material, &sample);
            }
            for m in 0..count {
                for c in 0..3 {
                    q.b[m] += w[c] * unit[m][c] * sample.radiance[c];
                    for k in 0..=m {
                        q.g[m][k] += w[c] * unit[m][c] * unit[k][c];
                    }
                }
            }
        }
        for m in 0..count {
            for k in 0..m {
                q.g[k][m] = q.g[m][k];
            }
        }
        q
    }

    fn cost(&self, gamma: &[f64; MAX_MATERIALS]) -> f64 {
        let mut cost = 0.0;
        for m in 0..self.count {
            let row: f64 = (0..self.count).map(|k| self.g[m][k] * gamma[k]).sum();
            cost += gamma[m] * (row - 2.0 * self.b[m]);
        }
        cost
    }

    /// The minimiser under `rule`. Among equal costs the smallest support wins, so that the answer is unique.
    pub(crate) fn minimise(&self, rule: WeightRule) -> [f64; MAX_MATERIALS] {
        let mut best = [0.0; MAX_MATERIALS];
        let mut best_cost = 0.0;
        for support in 1_u32..(1 << self.count) {
            for on_sum in [false, true] {
                if on_sum && rule == WeightRule::Exact {
                    continue;
                }
                let Some(gamma) = self.stationary(support, on_sum) else { continue };
                let feasible = gamma.iter().all(|&g| g >= 0.0)
                    && (rule == WeightRule::Exact || gamma.iter().sum::<f64>() <= 1.0 + 1e-12);
                let cost = self.cost(&gamma);
                if feasible && cost < best_cost {
                    best = gamma;
                    best_cost = cost;
                }
            }
        }
        best
    }

    /// Stationary point on the face where only `support` is non-zero and, with `on_sum`, the weights sum to one.
    fn stationary(&self, support: u32, on_sum: bool) -> Option<[f64; MAX_MATERIALS]> {
        const SIZE: usize = MAX_MATERIALS + 1;
        let members: Vec4 = (0..self.count).filter(|m| support & (1 << m) != 0).collect();
        let n = members.len + usize::from(on_sum);
        let mut a = [[0.0; SIZE + 1]; SIZE];
        for (i, &m) in members.as_slice().iter().enumerate() {
            for (j, &k) in members.as_slice().iter().enumerate() {
                a[i][j] = self.g[m][k];
            }
            a[i][n] = self.b[m];
            if on_sum {
                a[i][members.len] = 1.0;
                a[members.len][i] = 1.0;
            }
        }
        if on_sum {
            a[members.len][n] = 1.0;
        }
        let solution = gauss(&mut a, n)?;
        let mut gamma = [0.0; MAX_MATERIALS];
        for (i, &m) in members.as_slice().iter().enumerate() {
            gamma[m] = solution[i];
        }
        Some(gamma)
    }
}

/// Up to four indices on the stack.
#[derive(Default)]
struct Vec4 {
    items: [usize; MAX_MATERIALS],
    len: usize,
}

impl Vec4 {
    fn as_slice(&self) -> &[usize] {
        &self.items[..self.len]
    }
}

impl FromIterator<usize> for Vec4 {
    fn from_iter<I: IntoIterator<Item = usize>>(iter: I) -> Self {
        let mut list = Self::default();
        for item in iter.into_iter().take(MAX_MATERIALS) {
            list.items[list.len] = item;
            list.len += 1;
        }
        list
    }
}

/// Gaussian elimination with partial pivoting of the first `n` rows; column `n` is the right-hand side.
fn gauss<const R: usize, const C: usize>(a: &mut [[f64; C]; R], n: usize) -> Option<[f64; R]> {
    for col in 0..n {
        let pivot = (col..n).max_by(|&i, &j| a[i][col].abs().total_cmp(&a[j][col].abs()))?;
        let scale = (0..n).map(|j| a[pivot][j].abs()).fold(0.0, f64::max);
        if a[pivot][col].abs() <= 1e-13 * scale || a[pivot][col] == 0.0 {
            return None;
        }
        a.swap(pivot, col);
        for row in 0..n {
            if row != col {
                let factor = a[row][col] / a[col][col];
                for k in col..=n {
                    a[row][k] -= factor * a[col][k];
                }
            }
        }
    }
    Some(std::array::from_fn(|i| if i < n { a[i][n] / a[i][i] } else { 0.0 }))
}

/// Optimal weights of every point for fixed materials.
pub fn solve_weights(
    lobe: &dyn Lobe,
    materials: &[Material],
    objective: Objective,
    rule: WeightRule,
    observations: &Observations,
) -> Vec<f64> {
    let count = materials.len();
    let points: Vec<usize> = (0..observations.points()).collect();
    let chunks: Vec<Vec<f64>> = points
        .par_chunks(CHUNK)
        .map(|chunk| {
            let mut gamma = Vec::with_capacity(chunk.len() * count);
            for &point in chunk {
                let q = PointQuadratic::new(lobe, materials, objective, observations.of(point));
                gamma.extend_from_slice(&q.minimise(rule)[..count]);
            }
            gamma
        })
        .collect();
    chunks.concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng, rngs::StdRng};

    fn random_quadratic(rng: &mut StdRng, count: usize) -> PointQuadratic {
        let rows: Vec<[f64; MAX_MATERIALS]> =
            (0..9).map(|_| std::array::from_fn(|_| rng.random_range(0.1..1.0))).collect();
        let target: Vec<f64> = (0..9).map(|_| rng.random_range(-0.5..1.5)).collect();
        let mut q = PointQuadratic { count, g: [[0.0; MAX_MATERIALS]; MAX_MATERIALS], b: [0.0; MAX_MATERIALS] };
        for (row, t) in rows.iter().zip(&target) {
            for m in 0..count {
                q.b[m] += row[m] * t;
                for k in 0..count {
                    q.g[m][k] += row[m] * row[k];
                }
            }
        }
        q
    }

    /// Karush-Kuhn-Tucker: at the minimiser no feasible direction lowers the cost.
    #[test]
    fn minimiser_fulfils_the_optimality_conditions() {
        let mut rng = StdRng::seed_from_u64(7);
        for trial in 0..2000 {
            let count = 1 + trial % MAX_MATERIALS;
            let q = random_quadratic(&mut rng, count);
            let gamma = q.minimise(WeightRule::Exact);
            for m in 0..count {
                let gradient: f64 = (0..count).map(|k| q.g[m][k] * gamma[k]).sum::<f64>() - q.b[m];
                let scale = q.g[m][m] + q.b[m].abs();
                assert!(gamma[m] >= 0.0);
                assert!(gradient >= -1e-9 * scale, "a zero weight wants to grow");
                assert!(gamma[m] == 0.0 || gradient.abs() <= 1e-9 * scale, "a free weight is not stationary");
            }
        }
    }

    #[test]
    fn the_paper_rule_never_exceeds_a_sum_of_one_and_no_feasible_point_is_better() {
        let mut rng = StdRng::seed_from_u64(8);
        for trial in 0..500 {
            let count = 1 + trial % 3;
            let q = random_quadratic(&mut rng, count);
            let gamma = q.minimise(WeightRule::Paper);
            assert!(gamma.iter().sum::<f64>() <= 1.0 + 1e-9);
            for _ in 0..200 {
                let mut other: [f64; MAX_MATERIALS] =
                    std::array::from_fn(|m| if m < count { rng.random_range(0.0..1.0) } else { 0.0 });
                let sum: f64 = other.iter().sum();
                if sum > 1.0 {
                    other = other.map(|g| g / sum);
                }
                assert!(q.cost(&gamma) <= q.cost(&other) + 1e-12);
            }
        }
    }
}
