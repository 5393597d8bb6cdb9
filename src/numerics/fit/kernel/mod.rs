//! The inner loop of variable projection: for given BRDF parameters, the best weights of every point, the cost, and the
//! normal equations of the BRDF parameters with the weights eliminated (Golub & Pereyra 1973, in Kaufman's 1975 form).
//!
//! Within a channel every radiance and every derivative is a sum of few basis functions: the irradiance e, e times each
//! material's lobe, e times each lobe's slope. Their Gram matrix is gathered once a point; all else follows from it.
//! Sums over samples are f32, one lane a point; sums over points are f32 within a chunk and f64 across chunks.

mod equations;
mod left_out;
mod point;
mod quadratic;

use super::prepared::{BLOCKS, Prepared};
use super::{CHUNK, MAX_MATERIALS};
use crate::numerics::brdf::Material;
use crate::numerics::simd::{LANES, Lane, Level, Vector, Work};
pub use left_out::{Groups, left_out};
use point::{Evaluated, Point, accumulate};
use rayon::prelude::*;
use std::f64::consts::FRAC_1_PI;

/// Unknowns of a material: rho_d and rho_s per channel, ln(beta).
pub const PER_MATERIAL: usize = 7;

/// A direction of weights counts as seen when this part of its square is left after those before it.
const PIVOT: f32 = 1e-5;

/// Nor does one whose square is below this: its inverse would overflow.
const FAINT: f32 = 1e-36;

/// Most reweightings of Cauchy's function before the weights of a point stand. Sound points need two; where one sample in
/// twenty is an outlier, two leave a relighting error of 1.86 %, twelve 1.30 %.
pub(super) const REWEIGHTINGS: usize = 12;

/// Weights of a point stand when a reweighting changes none by more than this part of their sum.
pub(super) const SETTLED: f64 = 1e-2;

/// Constraint of the weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sign {
    /// gamma >= 0, exactly, by trying every set of positive weights.
    NonNegative,
    /// As far below zero as noise makes of zero ([`Prepared::loosen`]), exactly.
    Slack,
    /// No constraint: a weight may be negative.
    Free,
}

/// What comes out of a pass over all points.
#[derive(Clone, Debug)]
pub struct Sums {
    /// Cost of the objective, in the prepared units.
    pub cost: f64,
    /// Half the gradient of the cost, [`PER_MATERIAL`] a material: rho_d, rho_s, ln(beta).
    pub gradient: Vec<f64>,
    /// The Schur complement of the normal matrix, lower triangle by rows.
    pub hessian: Vec<f64>,
}

/// Index of (i, j), i >= j, in a lower triangle stored by rows.
#[inline(always)]
pub const fn triangle(i: usize, j: usize) -> usize {
    i * (i + 1) / 2 + j
}

/// Cost, gradient and Schur complement.
pub fn normal(prepared: &Prepared, materials: &[Material], sign: Sign) -> Sums {
    normal_at(Level::best(), prepared, materials, sign)
}

/// [`normal`] with a given instruction set; the bits do not depend on it.
pub fn normal_at(level: Level, prepared: &Prepared, materials: &[Material], sign: Sign) -> Sums {
    let n = PER_MATERIAL * materials.len();
    let chunks: Vec<Sums> = (0..prepared.blocks().div_ceil(BLOCKS))
        .into_par_iter()
        .map(|chunk| {
            let mut sums = Sums::zero(n);
            let blocks = chunk * BLOCKS..((chunk + 1) * BLOCKS).min(prepared.blocks());
            level.run(Pass { prepared, materials, sign, blocks, out: Out::Normal(&mut sums) });
            sums
        })
        .collect();
    let mut all = Sums::zero(n);
    for chunk in chunks {
        all.cost += chunk.cost;
        all.gradient.iter_mut().zip(chunk.gradient).for_each(|(sum, value)| *sum += value);
        all.hessian.iter_mut().zip(chunk.hessian).for_each(|(sum, value)| *sum += value);
    }
    all
}

/// Weights of all points, `gamma[point * materials + m]`, and the cost they leave, in prepared units.
pub fn weights(prepared: &Prepared, materials: &[Material], sign: Sign) -> (Vec<f64>, f64) {
    weights_at(Level::best(), prepared, materials, sign)
}

/// [`weights`] with a given instruction set; the bits do not depend on it.
pub fn weights_at(level: Level, prepared: &Prepared, materials: &[Material], sign: Sign) -> (Vec<f64>, f64) {
    let count = materials.len();
    let chunks: Vec<(Vec<f64>, f64)> = (0..prepared.blocks().div_ceil(BLOCKS))
        .into_par_iter()
        .map(|chunk| {
            let blocks = chunk * BLOCKS..((chunk + 1) * BLOCKS).min(prepared.blocks());
            let points = prepared.points.min(blocks.end * LANES) - blocks.start * LANES;
            let mut gamma = vec![0.0; CHUNK * count];
            let mut cost = [0.0; LANES];
            level.run(Pass { prepared, materials, sign, blocks, out: Out::Weights(&mut gamma, &mut cost) });
            gamma.truncate(points * count);
            (gamma, sum(&cost))
        })
        .collect();
    let cost = chunks.iter().map(|chunk| chunk.1).sum();
    (chunks.into_iter().flat_map(|chunk| chunk.0).collect(), cost)
}

/// Non-negative weights of the points of a part of at most a chunk, and the cost they leave, in prepared units.
pub fn part_weights(prepared: &Prepared, materials: &[Material], gamma: &mut [f64]) -> f64 {
    let mut cost = [0.0; LANES];
    let (sign, blocks) = (Sign::NonNegative, 0..prepared.blocks());
    Level::best().run(Pass { prepared, materials, sign, blocks, out: Out::Weights(gamma, &mut cost) });
    sum(&cost)
}

/// Standard deviations of the weights of all points for fixed BRDF parameters and residuals of unit variance; 0 for one that
/// is held at zero.
pub fn deviations(prepared: &Prepared, materials: &[Material], sign: Sign) -> Vec<f64> {
    let count = materials.len();
    let chunks: Vec<Vec<f64>> = (0..prepared.blocks().div_ceil(BLOCKS))
        .into_par_iter()
        .map(|chunk| {
            let blocks = chunk * BLOCKS..((chunk + 1) * BLOCKS).min(prepared.blocks());
            let points = prepared.points.min(blocks.end * LANES) - blocks.start * LANES;
            let mut sigma = vec![0.0; CHUNK * count];
            Level::best().run(Pass { prepared, materials, sign, blocks, out: Out::Deviations(&mut sigma) });
            sigma.truncate(points * count);
            sigma
        })
        .collect();
    chunks.concat()
}

/// Sums of a chunk, one lane a point: `N` unknowns with a triangle of `H` entries.
struct Totals<const N: usize, const H: usize> {
    cost: Lane,
    gradient: [Lane; N],
    hessian: [Lane; H],
}

impl<const N: usize, const H: usize> Totals<N, H> {
    const ZERO: Self = Self { cost: [0.0; LANES], gradient: [[0.0; LANES]; N], hessian: [[0.0; LANES]; H] };

    /// Adds the lanes; the loop's unknown is rho_d / pi.
    fn add_to(&self, sums: &mut Sums) {
        let factor = |i: usize| if i % PER_MATERIAL < 3 { FRAC_1_PI } else { 1.0 };
        sums.cost += sum(&self.cost);
        for i in 0..N {
            sums.gradient[i] += factor(i) * sum(&self.gradient[i]);
            for j in 0..=i {
                sums.hessian[triangle(i, j)] += factor(i) * factor(j) * sum(&self.hessian[triangle(i, j)]);
            }
        }
    }
}

impl Sums {
    fn zero(unknowns: usize) -> Self {
        Self { cost: 0.0, gradient: vec![0.0; unknowns], hessian: vec![0.0; triangle(unknowns, 0)] }
    }
}

fn sum(lane: &Lane) -> f64 {
    lane.iter().map(|&value| f64::from(value)).sum()
}

enum Out<'a> {
    Normal(&'a mut Sums),
    /// Weights and cost.
    Weights(&'a mut [f64], &'a mut Lane),
    Deviations(&'a mut [f64]),
}

/// A pass over the blocks of one chunk.
struct Pass<'a> {
    prepared: &'a Prepared,
    materials: &'a [Material],
    sign: Sign,
    blocks: std::ops::Range<usize>,
    out: Out<'a>,
}

impl Work for Pass<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        // M materials have B = 1 + 2 M basis functions with T = B (B + 1) / 2 products, and N = 7 M unknowns.
        match self.materials.len() {
            1 => self.go::<V, 1, 3, 6, 7, 28>(),
            2 => self.go::<V, 2, 5, 15, 14, 105>(),
            3 => self.go::<V, 3, 7, 28, 21, 231>(),
            _ => self.go::<V, MAX_MATERIALS, 9, 45, 28, 406>(),
        }
    }
}

impl Pass<'_> {
    #[inline(always)]
    fn go<V: Vector, const M: usize, const B: usize, const T: usize, const N: usize, const H: usize>(self) {
        let alpha = Alpha::<M>::new(self.materials);
        let mut totals = Totals::<N, H>::ZERO;
        let Pass { prepared, sign, blocks, mut out, .. } = self;
        let (mut full, mut lean) = (Vec::new(), Vec::new());
        for (index, block) in blocks.enumerate() {
            let rows = prepared.block(block);
            for part in 0..LANES / V::WIDTH {
                let Prepared { cauchy, proportional, .. } = *prepared;
                let floor = prepared.floor(block);
                let point = Point { rows, part, alpha: &alpha, sign, cauchy, proportional, floor };
                match &mut out {
                    Out::Normal(_) => {
                        let scratch = room::<V, M, T>(&mut full, rows.len());
                        point.evaluate::<V, B, T, true>(prepared.family, scratch);
                        let minimum = point.minimise(scratch);
                        point.normal::<V, B, T, N, H>(scratch, &minimum, &mut totals);
                    }
                    Out::Weights(gamma, cost) => {
                        let scratch = room::<V, M, NO_PRODUCTS>(&mut lean, rows.len());
                        point.evaluate::<V, B, NO_PRODUCTS, false>(prepared.family, scratch);
                        let found = point.minimise(scratch).gamma;
                        accumulate(cost, part, point.cost(scratch, &found));
                        scatter(&found, part, index, gamma);
                    }
                    Out::Deviations(sigma) => {
                        let scratch = room::<V, M, NO_PRODUCTS>(&mut lean, rows.len());
                        point.evaluate::<V, B, NO_PRODUCTS, false>(prepared.family, scratch);
                        scatter(&point.minimise(scratch).deviations(), part, index, sigma);
                    }
                }
            }
        }
        if let Out::Normal(sums) = out {
            totals.add_to(sums);
        }
    }
}

/// Products kept of a row where only weights are looked for: what is not kept needs no cache.
const NO_PRODUCTS: usize = 0;

/// Room for the rows of a block.
#[inline(always)]
fn room<V: Vector, const M: usize, const T: usize>(
    scratch: &mut Vec<Evaluated<V, M, T>>,
    rows: usize,
) -> &mut [Evaluated<V, M, T>] {
    if scratch.len() < rows {
        scratch.resize(rows, Evaluated::empty());
    }
    &mut scratch[..rows]
}

/// BRDF parameters as the loop wants them; rho_d over pi.
struct Alpha<const M: usize> {
    rho_d: [[f32; 3]; M],
    rho_s: [[f32; 3]; M],
    beta2: [f32; M],
    inverse_beta2: [f32; M],
}

impl<const M: usize> Alpha<M> {
    fn new(materials: &[Material]) -> Self {
        let of = |m: usize| &materials[m.min(materials.len() - 1)];
        Self {
            rho_d: std::array::from_fn(|m| of(m).rho_d.map(|v| (v * FRAC_1_PI) as f32)),
            rho_s: std::array::from_fn(|m| of(m).rho_s.map(|v| v as f32)),
            beta2: std::array::from_fn(|m| (of(m).beta * of(m).beta) as f32),
            inverse_beta2: std::array::from_fn(|m| (1.0 / (of(m).beta * of(m).beta)) as f32),
        }
    }
}

/// Writes what one vector of points found for every material.
#[inline(always)]
fn scatter<V: Vector, const M: usize>(values: &[V; M], part: usize, block: usize, out: &mut [f64]) {
    for m in 0..M {
        let mut lane = [0.0; LANES];
        values[m].store(&mut lane, part);
        for i in part * V::WIDTH..(part + 1) * V::WIDTH {
            // The last block may hold fewer points than lanes.
            if let Some(slot) = out.get_mut((block * LANES + i) * M + m) {
                *slot = f64::from(lane[i]);
            }
        }
    }
}

#[cfg(test)]
mod tests;
