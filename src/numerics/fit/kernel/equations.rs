//! What the points of one vector add to the normal equations.

use super::point::{Cost, Evaluated, Point, accumulate, minus};
use super::quadratic::Minimum;
use super::{PER_MATERIAL, Totals, triangle};
use crate::numerics::simd::Vector;

impl<const M: usize> Point<'_, M> {
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

/// Entry of a symmetric matrix kept as a lower triangle.
#[inline(always)]
fn at<V: Vector, const T: usize>(triangular: &[V; T], i: usize, j: usize) -> V {
    triangular[if i >= j { triangle(i, j) } else { triangle(j, i) }]
}
