//! Samples left out in turn: each predicted with the weights that the others give its point.

use super::point::{Evaluated, Point, accumulate, minus};
use super::{Alpha, BLOCKS, MAX_MATERIALS, Sign, sum};
use crate::numerics::brdf::Material;
use crate::numerics::fit::prepared::Prepared;
use crate::numerics::simd::{LANES, Lane, Level, Vector, Work};
use rayon::prelude::*;
use std::ops::Range;

/// Which samples are left out together.
pub struct Groups {
    /// Per row, the group of each lane's sample.
    pub of: Vec<Lane>,
    /// Number of groups.
    pub count: usize,
    /// A point needs this many samples beside a group to be predicted.
    pub least: usize,
}

/// Mean of |I - model| / I over left-out samples and channels; none where no sample can be left out.
pub fn left_out(prepared: &Prepared, materials: &[Material], groups: &Groups) -> Option<f64> {
    let chunks: Vec<Errors> = (0..prepared.blocks().div_ceil(BLOCKS))
        .into_par_iter()
        .map(|chunk| {
            let blocks = chunk * BLOCKS..((chunk + 1) * BLOCKS).min(prepared.blocks());
            let mut errors = Errors { sum: [0.0; LANES], count: [0.0; LANES] };
            Level::best().run(LeaveOut { prepared, materials, groups, blocks, errors: &mut errors });
            errors
        })
        .collect();
    let total: f64 = chunks.iter().map(|errors| sum(&errors.sum)).sum();
    let count: f64 = chunks.iter().map(|errors| sum(&errors.count)).sum();
    (count > 0.0).then(|| total / (3.0 * count))
}

/// Relative errors, summed over the channels, and how many samples they are of; one lane a point.
struct Errors {
    sum: Lane,
    count: Lane,
}

/// A pass over the blocks of one chunk.
struct LeaveOut<'a> {
    prepared: &'a Prepared,
    materials: &'a [Material],
    groups: &'a Groups,
    blocks: Range<usize>,
    errors: &'a mut Errors,
}

impl Work for LeaveOut<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        match self.materials.len() {
            1 => self.go::<V, 1, 3, 6>(),
            2 => self.go::<V, 2, 5, 15>(),
            3 => self.go::<V, 3, 7, 28>(),
            _ => self.go::<V, MAX_MATERIALS, 9, 45>(),
        }
    }
}

impl LeaveOut<'_> {
    #[inline(always)]
    fn go<V: Vector, const M: usize, const B: usize, const T: usize>(self) {
        let alpha = Alpha::<M>::new(self.materials);
        let (prepared, groups) = (self.prepared, self.groups);
        let mut scratch: Vec<Evaluated<V, M, T>> = Vec::new();
        for block in self.blocks {
            let rows = prepared.block(block);
            let group_of = &groups.of[prepared.rows_of(block)];
            scratch.resize(rows.len(), Evaluated::empty());
            for part in 0..LANES / V::WIDTH {
                let (sign, cauchy) = (Sign::NonNegative, prepared.cauchy);
                let point = Point { rows, part, alpha: &alpha, sign, cauchy, proportional: None, floor: None };
                point.evaluate::<V, B, T, false>(prepared.family, &mut scratch);
                for group in 0..groups.count {
                    let group = group as f32;
                    // Neighbours see much the same lights: often none of them has a sample of the group.
                    if group_of.iter().flatten().any(|&of| of == group) {
                        point.predict(group_of, group, groups.least as f32, &mut scratch, self.errors);
                    }
                }
            }
        }
    }
}

impl<const M: usize> Point<'_, M> {
    /// Adds the errors of the samples of one group.
    #[inline(always)]
    fn predict<V: Vector, const T: usize>(
        &self,
        group_of: &[Lane],
        group: f32,
        least: f32,
        evaluated: &mut [Evaluated<V, M, T>],
        errors: &mut Errors,
    ) {
        let (zero, one, half) = (V::splat(0.0), V::splat(1.0), V::splat(0.5));
        let mut others = zero;
        for ((row, of), evaluated) in self.rows.iter().zip(group_of).zip(evaluated.iter_mut()) {
            let apart = V::load(of, self.part) - V::splat(group);
            let kept = apart.max(-apart).if_greater(half, one, zero);
            evaluated.keep(kept);
            others = others + V::load(&row.radiance[0], self.part).if_greater(zero, kept, zero);
        }
        let minus_gamma = minus(&self.minimise(evaluated).gamma);
        let enough = others.if_greater(V::splat(least - 0.5), one, zero);
        for (row, evaluated) in self.rows.iter().zip(evaluated.iter()) {
            let mut error = zero;
            for c in 0..3 {
                let y = V::load(&row.radiance[c], self.part);
                let residual = evaluated.residual(c, y, &minus_gamma);
                error = error + residual.max(-residual) / y;
            }
            let counts = V::load(&row.radiance[0], self.part).if_greater(zero, enough * (one - evaluated.kept), zero);
            accumulate(&mut errors.sum, self.part, counts.if_greater(half, error, zero));
            accumulate(&mut errors.count, self.part, counts);
        }
    }
}
