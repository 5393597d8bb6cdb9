//! The points of one vector: what the loops evaluate at their rows, and their best weights.

use super::quadratic::{Minimum, Quadratic};
use super::{Alpha, REWEIGHTINGS, SETTLED, Sign, triangle};
use crate::numerics::brdf::Family;
use crate::numerics::fit::MAX_MATERIALS;
use crate::numerics::fit::prepared::ReadyRow;
use crate::numerics::simd::{Lane, Vector};

/// The points of one vector.
pub(super) struct Point<'a, const M: usize> {
    pub rows: &'a [ReadyRow],
    pub part: usize,
    pub alpha: &'a Alpha<M>,
    pub sign: Sign,
    /// Cauchy's scale; none for plain squares.
    pub cauchy: Option<f32>,
    /// Square of the radiance, in deviations, from which on deviations follow the model; none where they do not.
    pub proportional: Option<f32>,
    /// Least weights under [`Sign::Slack`].
    pub floor: Option<&'a [Lane; MAX_MATERIALS]>,
}

/// What the loops keep of a row.
#[derive(Clone, Copy)]
pub(super) struct Evaluated<V, const M: usize, const T: usize> {
    /// Products of the basis functions without the irradiance (1, lobes, slopes); those with 1 are the functions.
    pub products: [V; T],
    /// Radiance of every material at unit weight, per channel.
    pub unit: [[V; M]; 3],
    /// What a residual of each channel counts: 0 where its sample is left out, less where Cauchy's function doubts it.
    pub weight: [V; 3],
    /// 1, or 0 where the sample is left out.
    pub kept: V,
}

impl<V: Vector, const M: usize, const T: usize> Evaluated<V, M, T> {
    #[inline(always)]
    pub(super) fn empty() -> Self {
        let one = V::splat(1.0);
        Self { products: [one; T], unit: [[one; M]; 3], weight: [one; 3], kept: one }
    }

    /// Leaves out the samples where `kept` is 0.
    #[inline(always)]
    pub(super) fn keep(&mut self, kept: V) {
        (self.kept, self.weight) = (kept, [kept; 3]);
    }

    /// Basis function `i`.
    #[inline(always)]
    pub(super) fn basis(&self, i: usize) -> V {
        self.products[triangle(i, 0)]
    }

    /// Residual of channel `c` under some weights.
    #[inline(always)]
    pub(super) fn residual(&self, c: usize, radiance: V, minus_gamma: &[V; M]) -> V {
        let mut residual = radiance;
        for m in 0..M {
            residual = minus_gamma[m].mul_add(self.unit[c][m], residual);
        }
        residual
    }

    /// Adds what the row says of the weights.
    #[inline(always)]
    fn add_to(&self, row: &ReadyRow, part: usize, q: &mut Quadratic<V, M>) {
        for c in 0..3 {
            let y = V::load(&row.radiance[c], part);
            for m in 0..M {
                let weighted = self.weight[c] * self.unit[c][m];
                q.b[m] = weighted.mul_add(y, q.b[m]);
                for k in 0..=m {
                    q.g[m][k] = weighted.mul_add(self.unit[c][k], q.g[m][k]);
                }
            }
        }
    }
}

#[inline(always)]
pub(super) fn minus<V: Vector, const M: usize>(values: &[V; M]) -> [V; M] {
    let mut minus = *values;
    for value in &mut minus {
        *value = -*value;
    }
    minus
}

/// 1 where weights have changed by more than [`SETTLED`] of their sum, else 0.
#[inline(always)]
fn moved<V: Vector, const M: usize>(gamma: &[V; M], minus_before: &[V; M]) -> V {
    let zero = V::splat(0.0);
    let (mut change, mut sum) = (zero, zero);
    for m in 0..M {
        let difference = gamma[m] + minus_before[m];
        change = change.max(difference.max(-difference));
        sum = sum + gamma[m].max(-gamma[m]);
    }
    change.if_greater(V::splat(SETTLED as f32) * sum, V::splat(1.0), zero)
}

impl<const M: usize> Point<'_, M> {
    /// Evaluates every row; the slopes of the lobes and the products only for `NORMAL` equations.
    #[inline(always)]
    pub(super) fn evaluate<V: Vector, const B: usize, const T: usize, const NORMAL: bool>(
        &self,
        family: Family,
        evaluated: &mut [Evaluated<V, M, T>],
    ) {
        let one = V::splat(1.0);
        for (row, evaluated) in self.rows.iter().zip(evaluated) {
            let mut basis = [one; B];
            for m in 0..M {
                (basis[1 + m], basis[1 + M + m]) = self.lobe(family, m, row);
            }
            for c in 0..3 {
                let e = V::load(&row.irradiance[c], self.part);
                for m in 0..M {
                    let rho_s = V::splat(self.alpha.rho_s[m][c]);
                    evaluated.unit[c][m] = e * rho_s.mul_add(basis[1 + m], V::splat(self.alpha.rho_d[m][c]));
                }
            }
            evaluated.keep(one);
            if NORMAL {
                for i in 1..B {
                    evaluated.products[triangle(i, 0)] = basis[i];
                    for j in 1..=i {
                        evaluated.products[triangle(i, j)] = basis[i] * basis[j];
                    }
                }
            }
        }
    }

    /// Value and slope of the lobe of a material at a row.
    #[inline(always)]
    fn lobe<V: Vector>(&self, family: Family, m: usize, row: &ReadyRow) -> (V, V) {
        let (one, two) = (V::splat(1.0), V::splat(2.0));
        let exponent = V::load(&row.exponent, self.part);
        let scale = V::load(&row.scale, self.part);
        let inverse = V::splat(self.alpha.inverse_beta2[m]);
        let x = exponent * inverse;
        match family {
            Family::None => (V::splat(0.0), V::splat(0.0)),
            Family::Exponential => {
                let value = scale * (-x).exp() * inverse;
                (value, value * two.mul_add(x, V::splat(-2.0)))
            }
            Family::Ggx => {
                let beta2 = V::splat(self.alpha.beta2[m]);
                let i = beta2.mul_add(V::load(&row.tan2[0], self.part), one).sqrt();
                let r = beta2.mul_add(V::load(&row.tan2[1], self.part), one).sqrt();
                let wide = one + x;
                let value = scale * inverse * V::splat(4.0) / (wide * wide * (one + i) * (one + r));
                let slope = V::splat(4.0) * x / wide - two - (i - one) / i - (r - one) / r;
                (value, value * slope)
            }
        }
    }

    /// The best weights the sign allows.
    #[inline(always)]
    fn within_sign<V: Vector>(&self, quadratic: &Quadratic<V, M>) -> Minimum<V, M> {
        match (self.sign, self.floor) {
            (Sign::Free, _) => quadratic.stationary((1 << M) - 1).0,
            (Sign::Slack, Some(floor)) => {
                let mut least = [V::splat(0.0); M];
                for m in 0..M {
                    least[m] = V::load(&floor[m], self.part);
                }
                quadratic.minimise_above(&least)
            }
            (Sign::NonNegative, _) | (Sign::Slack, None) => quadratic.minimise(),
        }
    }

    /// The best weights of the points, and for Cauchy's function what it weighs each residual with.
    #[inline(always)]
    pub(super) fn minimise<V: Vector, const T: usize>(&self, evaluated: &mut [Evaluated<V, M, T>]) -> Minimum<V, M> {
        let mut q = Quadratic::zero();
        for (row, evaluated) in self.rows.iter().zip(evaluated.iter()) {
            evaluated.add_to(row, self.part, &mut q);
        }
        let mut minimum = self.within_sign(&q);
        let Some(scale) = self.cauchy else { return minimum };
        let (half, inverse) = (V::splat(0.5), V::splat(1.0 / (scale * scale)));
        let mut moving = V::splat(1.0);
        for _ in 0..REWEIGHTINGS {
            let minus_gamma = minus(&minimum.gamma);
            q = Quadratic::zero();
            for (row, evaluated) in self.rows.iter().zip(evaluated.iter_mut()) {
                for c in 0..3 {
                    let y = V::load(&row.radiance[c], self.part);
                    let residual = evaluated.residual(c, y, &minus_gamma);
                    let weight = evaluated.kept * self.trust(y, residual, inverse);
                    // Points that stand keep what they have: their lanes must not depend on their neighbours'.
                    evaluated.weight[c] = moving.if_greater(half, weight, evaluated.weight[c]);
                }
                evaluated.add_to(row, self.part, &mut q);
            }
            minimum = self.within_sign(&q);
            moving = moved(&minimum.gamma, &minus_gamma);
            if !moving.any_greater(half) {
                break;
            }
        }
        minimum
    }

    /// What Cauchy's function weighs a residual with, over the inverse variance: 1 / (1 + r^2 / s^2). Where deviations follow
    /// the model y - r, its square in place of y^2 makes that 1 / ((y - r)^2 / y^2 + r^2 / s^2).
    #[inline(always)]
    fn trust<V: Vector>(&self, y: V, residual: V, inverse: V) -> V {
        let doubt = (residual * residual).mul_add(inverse, V::splat(1.0));
        match self.proportional {
            None => V::splat(1.0) / doubt,
            Some(least) => {
                let square = (y * y).max(V::splat(least));
                let change = residual * (residual - y - y);
                square / square.mul_add(doubt, change)
            }
        }
    }

    /// Cost of these points under some weights.
    #[inline(always)]
    pub(super) fn cost<V: Vector, const T: usize>(&self, evaluated: &[Evaluated<V, M, T>], gamma: &[V; M]) -> V {
        let minus_gamma = minus(gamma);
        let mut cost = Cost::new(self.cauchy);
        for (row, evaluated) in self.rows.iter().zip(evaluated) {
            for c in 0..3 {
                cost.add(evaluated.residual(c, V::load(&row.radiance[c], self.part), &minus_gamma));
            }
        }
        cost.total()
    }
}

/// Sum of the costs of residuals: of their squares, or of Cauchy's function of them. The logarithm is that of a product,
/// whose exponent is kept apart so that it never overflows.
pub(super) struct Cost<V> {
    cauchy: Option<f32>,
    sum: V,
    product: V,
}

impl<V: Vector> Cost<V> {
    #[inline(always)]
    pub(super) fn new(cauchy: Option<f32>) -> Self {
        Self { cauchy, sum: V::splat(0.0), product: V::splat(1.0) }
    }

    #[inline(always)]
    pub(super) fn add(&mut self, residual: V) {
        match self.cauchy {
            None => self.sum = residual.mul_add(residual, self.sum),
            Some(scale) => {
                let ratio = (residual * residual).mul_add(V::splat(1.0 / (scale * scale)), V::splat(1.0));
                let (exponent, mantissa) = (self.product * ratio).split();
                self.sum = self.sum + exponent;
                self.product = mantissa;
            }
        }
    }

    #[inline(always)]
    pub(super) fn total(&self) -> V {
        match self.cauchy {
            None => self.sum,
            Some(scale) => {
                let logarithm = self.sum.mul_add(V::splat(std::f32::consts::LN_2), self.product.ln());
                V::splat(scale * scale) * logarithm
            }
        }
    }
}

#[inline(always)]
pub(super) fn accumulate<V: Vector>(total: &mut Lane, part: usize, value: V) {
    (V::load(total, part) + value).store(total, part);
}
