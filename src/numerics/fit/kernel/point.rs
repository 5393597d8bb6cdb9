//! What the points of one vector add to the sums.

use super::quadratic::{Minimum, Quadratic};
use super::{Alpha, PER_MATERIAL, REWEIGHTINGS, Sign, Totals, triangle};
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
    /// Least weights under [`Sign::Slack`].
    pub floor: Option<&'a [Lane; MAX_MATERIALS]>,
}

/// What the loops keep of a row.
#[derive(Clone, Copy)]
pub(super) struct Evaluated<V, const M: usize, const T: usize> {
    /// Products of the basis functions without the irradiance (1, lobes, slopes); those with 1 are the functions.
    products: [V; T],
    /// Radiance of every material at unit weight, per channel.
    unit: [[V; M]; 3],
    /// What a residual of each channel counts: 0 where its sample is left out, less where Cauchy's function doubts it.
    weight: [V; 3],
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
    fn basis(&self, i: usize) -> V {
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
        let Some(scale) = self.cauchy else { return self.within_sign(&q) };
        let (one, inverse) = (V::splat(1.0), V::splat(1.0 / (scale * scale)));
        for _ in 0..REWEIGHTINGS {
            let minus_gamma = minus(&self.within_sign(&q).gamma);
            q = Quadratic::zero();
            for (row, evaluated) in self.rows.iter().zip(evaluated.iter_mut()) {
                for c in 0..3 {
                    let residual = evaluated.residual(c, V::load(&row.radiance[c], self.part), &minus_gamma);
                    evaluated.weight[c] = evaluated.kept / (residual * residual).mul_add(inverse, one);
                }
                evaluated.add_to(row, self.part, &mut q);
            }
        }
        self.within_sign(&q)
    }

    /// Adds cost, gradient and Schur complement of these points.
    #[inline(always)]
    pub(super) fn normal<V: Vector, const B: usize, const T: usize, const N: usize, const H: usize>(
        &self,
        evaluated: &[Evaluated<V, M, T>],
        minimum: &Minimum<V, M>,
        totals: &mut Totals<N, H>,
    ) {
        let mut left = self.add_residuals::<V, B, T, N, H>(evaluated, minimum, totals);
        let mut coupling = [[[V::splat(0.0); M]; PER_MATERIAL]; M];
        for c in 0..3 {
            let gram = self.gram(c, evaluated);
            self.couple(c, &gram, &minimum.gamma, &mut coupling);
            self.add_products(c, &gram, &minimum.gamma, totals);
        }
        let roots = minimum.factor.roots();
        for row in coupling.as_flattened_mut() {
            minimum.factor.forward(row);
            for k in 0..M {
                row[k] = row[k] * roots[k];
            }
        }
        self.add_schur(&coupling, totals);
        // Rounding leaves the weights a little off their optimum: what the residuals still say of them is taken off the
        // gradient, or it would blur the directions the data hardly see.
        minimum.factor.forward(&mut left);
        for (i, row) in coupling.as_flattened().iter().enumerate() {
            let mut rest = V::splat(0.0);
            for k in 0..M {
                rest = row[k].mul_add(left[k] * roots[k], rest);
            }
            accumulate(&mut totals.gradient[i], self.part, rest);
        }
    }

    /// Products of the basis functions of channel `c` summed over the rows.
    #[inline(always)]
    fn gram<V: Vector, const T: usize>(&self, c: usize, evaluated: &[Evaluated<V, M, T>]) -> [V; T] {
        let mut gram = [V::splat(0.0); T];
        for (row, evaluated) in self.rows.iter().zip(evaluated) {
            let e = V::load(&row.irradiance[c], self.part);
            let ee = evaluated.weight[c] * e * e;
            gram[0] = gram[0] + ee;
            for t in 1..T {
                gram[t] = ee.mul_add(evaluated.products[t], gram[t]);
            }
        }
        gram
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

    /// Adds the cost and the gradient; returns the products of the residuals with the derivatives by the weights.
    #[inline(always)]
    fn add_residuals<V: Vector, const B: usize, const T: usize, const N: usize, const H: usize>(
        &self,
        evaluated: &[Evaluated<V, M, T>],
        minimum: &Minimum<V, M>,
        totals: &mut Totals<N, H>,
    ) -> [V; M] {
        let zero = V::splat(0.0);
        let mut left = [zero; M];
        let minus_gamma = minus(&minimum.gamma);
        let mut cost = Cost::new(self.cauchy);
        let mut slope = [zero; M];
        for c in 0..3 {
            let mut along = [zero; B];
            for (row, evaluated) in self.rows.iter().zip(evaluated) {
                let residual = evaluated.residual(c, V::load(&row.radiance[c], self.part), &minus_gamma);
                cost.add(residual);
                let er = evaluated.weight[c] * V::load(&row.irradiance[c], self.part) * residual;
                along[0] = along[0] + er;
                for i in 1..B {
                    along[i] = er.mul_add(evaluated.basis(i), along[i]);
                }
            }
            for m in 0..M {
                accumulate(&mut totals.gradient[m * PER_MATERIAL + c], self.part, minus_gamma[m] * along[0]);
                accumulate(&mut totals.gradient[m * PER_MATERIAL + 3 + c], self.part, minus_gamma[m] * along[1 + m]);
                let (rho_d, rho_s) = (V::splat(self.alpha.rho_d[m][c]), V::splat(self.alpha.rho_s[m][c]));
                slope[m] = rho_s.mul_add(along[1 + M + m], slope[m]);
                left[m] = rho_d.mul_add(along[0], rho_s.mul_add(along[1 + m], left[m]));
            }
        }
        for m in 0..M {
            accumulate(&mut totals.gradient[m * PER_MATERIAL + 6], self.part, minus_gamma[m] * slope[m]);
        }
        accumulate(&mut totals.cost, self.part, cost.total());
        left
    }

    /// Adds to the products of the derivatives by the BRDF parameters with those by the weights what channel `c` gives.
    #[inline(always)]
    fn couple<V: Vector, const T: usize>(
        &self,
        c: usize,
        gram: &[V; T],
        gamma: &[V; M],
        coupling: &mut [[[V; M]; PER_MATERIAL]; M],
    ) {
        let diffuse = self.with_units(c, 0, gram);
        for m in 0..M {
            let specular = self.with_units(c, 1 + m, gram);
            let slope = self.with_units(c, 1 + M + m, gram);
            let steep = gamma[m] * V::splat(self.alpha.rho_s[m][c]);
            for k in 0..M {
                coupling[m][c][k] = gamma[m] * diffuse[k];
                coupling[m][3 + c][k] = gamma[m] * specular[k];
                coupling[m][6][k] = steep.mul_add(slope[k], coupling[m][6][k]);
            }
        }
    }

    /// Products of basis function `i` with the radiance of every material at unit weight, channel `c`.
    #[inline(always)]
    fn with_units<V: Vector, const T: usize>(&self, c: usize, i: usize, gram: &[V; T]) -> [V; M] {
        let mut with = [V::splat(0.0); M];
        for m in 0..M {
            let diffuse = V::splat(self.alpha.rho_d[m][c]) * at(gram, i, 0);
            with[m] = V::splat(self.alpha.rho_s[m][c]).mul_add(at(gram, i, 1 + m), diffuse);
        }
        with
    }

    /// Takes the weights' part off the normal matrix: `coupling` times its transpose.
    #[inline(always)]
    fn add_schur<V: Vector, const N: usize, const H: usize>(
        &self,
        coupling: &[[[V; M]; PER_MATERIAL]; M],
        totals: &mut Totals<N, H>,
    ) {
        let all = coupling.as_flattened();
        let mut rest = totals.hessian.as_mut_slice();
        for (i, left) in all.iter().enumerate() {
            let left = minus(left);
            let row;
            (row, rest) = rest.split_at_mut(i + 1);
            for (total, right) in row.iter_mut().zip(all) {
                let mut sum = V::load(total, self.part);
                for k in 0..M {
                    sum = left[k].mul_add(right[k], sum);
                }
                sum.store(total, self.part);
            }
        }
    }

    /// Adds the products of the derivatives of channel `c`.
    #[inline(always)]
    fn add_products<V: Vector, const T: usize, const N: usize, const H: usize>(
        &self,
        c: usize,
        gram: &[V; T],
        gamma: &[V; M],
        totals: &mut Totals<N, H>,
    ) {
        for m in 0..M {
            for k in 0..3 {
                let (p, a, left) = self.derivative(c, m, k, gamma);
                for o in 0..=m {
                    for l in 0..3 {
                        let (q, b, right) = self.derivative(c, o, l, gamma);
                        if q <= p {
                            let total = &mut totals.hessian[triangle(p, q)];
                            (left * right).mul_add(at(gram, a, b), V::load(total, self.part)).store(total, self.part);
                        }
                    }
                }
            }
        }
    }

    /// Unknown, basis function and factor of the derivatives of channel `c` by rho_d / pi, rho_s, ln(beta) of material `m`.
    #[inline(always)]
    fn derivative<V: Vector>(&self, c: usize, m: usize, k: usize, gamma: &[V; M]) -> (usize, usize, V) {
        match k {
            0 => (m * PER_MATERIAL + c, 0, gamma[m]),
            1 => (m * PER_MATERIAL + 3 + c, 1 + m, gamma[m]),
            _ => (m * PER_MATERIAL + 6, 1 + M + m, gamma[m] * V::splat(self.alpha.rho_s[m][c])),
        }
    }
}

/// Sum of the costs of residuals: of their squares, or of Cauchy's function of them. The logarithm is that of a product,
/// whose exponent is kept apart so that it never overflows.
struct Cost<V> {
    cauchy: Option<f32>,
    sum: V,
    product: V,
}

impl<V: Vector> Cost<V> {
    #[inline(always)]
    fn new(cauchy: Option<f32>) -> Self {
        Self { cauchy, sum: V::splat(0.0), product: V::splat(1.0) }
    }

    #[inline(always)]
    fn add(&mut self, residual: V) {
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
    fn total(&self) -> V {
        match self.cauchy {
            None => self.sum,
            Some(scale) => {
                let logarithm = self.sum.mul_add(V::splat(std::f32::consts::LN_2), self.product.ln());
                V::splat(scale * scale) * logarithm
            }
        }
    }
}

/// Entry of a symmetric matrix kept as a lower triangle.
#[inline(always)]
fn at<V: Vector, const T: usize>(triangular: &[V; T], i: usize, j: usize) -> V {
    triangular[if i >= j { triangle(i, j) } else { triangle(j, i) }]
}

#[inline(always)]
pub(super) fn accumulate<V: Vector>(total: &mut Lane, part: usize, value: V) {
    (V::load(total, part) + value).store(total, part);
}
