//! What the points of one vector add to the normal equations.

use super::quadratic::{Minimum, Quadratic};
use super::{Alpha, PER_MATERIAL, REWEIGHTINGS, Scratch, Sign, Totals, triangle};
use crate::numerics::brdf::Family;
use crate::numerics::fit::MAX_MATERIALS;
use crate::numerics::fit::prepared::ReadyRow;
use crate::numerics::simd::{Lane, Vector};
use std::f32::consts::FRAC_1_PI;

/// The points of one vector.
pub(super) struct Point<'a, const M: usize> {
    pub rows: &'a [ReadyRow],
    pub part: usize,
    pub alpha: &'a Alpha<M>,
    pub sign: Sign,
    /// Least weights under [`Sign::Slack`].
    pub floor: Option<&'a [Lane; MAX_MATERIALS]>,
}

impl<const M: usize> Point<'_, M> {
    /// The best weights.
    #[inline(always)]
    pub(super) fn minimise<V: Vector>(&self, quadratic: &Quadratic<V, M>) -> Minimum<V, M> {
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

    /// Evaluates every lobe at every row.
    #[inline(always)]
    pub(super) fn lobes<V: Vector, const B: usize, const T: usize>(
        &self,
        family: Family,
        scratch: &mut Scratch<V, B, T>,
    ) {
        let (one, two) = (V::splat(1.0), V::splat(2.0));
        for (row, (basis, products)) in self.rows.iter().zip(scratch.basis.iter_mut().zip(&mut scratch.products)) {
            let exponent = V::load(&row.exponent, self.part);
            let scale = V::load(&row.scale, self.part);
            for m in 0..M {
                let inverse = V::splat(self.alpha.inverse_beta2[m]);
                let x = exponent * inverse;
                let (value, slope) = match family {
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
                };
                basis[1 + m] = value;
                basis[1 + M + m] = slope;
            }
            for i in 0..B {
                for j in 0..=i {
                    products[triangle(i, j)] = basis[i] * basis[j];
                }
            }
        }
    }

    /// Products of channel `c` summed over the rows: basis with basis, and basis with radiance.
    #[inline(always)]
    fn gram<V: Vector, const B: usize, const T: usize>(
        &self,
        c: usize,
        scratch: &Scratch<V, B, T>,
    ) -> ([V; T], [V; B]) {
        let mut gram = [V::splat(0.0); T];
        let mut seen = [V::splat(0.0); B];
        let made = scratch.basis.iter().zip(&scratch.products).zip(&scratch.robust);
        for (row, ((basis, products), robust)) in self.rows.iter().zip(made) {
            let e = V::load(&row.irradiance[c], self.part);
            let y = V::load(&row.radiance[c], self.part);
            let weighted = robust[c] * e;
            let (ee, ey) = (weighted * e, weighted * y);
            for i in 0..B {
                seen[i] = ey.mul_add(basis[i], seen[i]);
            }
            for t in 0..T {
                gram[t] = ee.mul_add(products[t], gram[t]);
            }
        }
        (gram, seen)
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

    /// Adds what channel `c` says of the weights.
    #[inline(always)]
    fn add_channel<V: Vector, const B: usize, const T: usize>(
        &self,
        c: usize,
        gram: &[V; T],
        seen: &[V; B],
        q: &mut Quadratic<V, M>,
    ) {
        let with_one = self.with_units(c, 0, gram);
        for m in 0..M {
            let rho_d = V::splat(self.alpha.rho_d[m][c]);
            let rho_s = V::splat(self.alpha.rho_s[m][c]);
            let with_lobe = self.with_units(c, 1 + m, gram);
            q.b[m] = rho_d.mul_add(seen[0], rho_s.mul_add(seen[1 + m], q.b[m]));
            for k in 0..=m {
                q.g[m][k] = rho_d.mul_add(with_one[k], rho_s.mul_add(with_lobe[k], q.g[m][k]));
            }
        }
    }

    /// The quadratic in the weights.
    #[inline(always)]
    pub(super) fn quadratic<V: Vector, const B: usize, const T: usize>(
        &self,
        scratch: &Scratch<V, B, T>,
    ) -> Quadratic<V, M> {
        let mut q = Quadratic::zero();
        for c in 0..3 {
            let mut unit = [V::splat(0.0); M];
            for (row, (basis, robust)) in self.rows.iter().zip(scratch.basis.iter().zip(&scratch.robust)) {
                let e = V::load(&row.irradiance[c], self.part);
                let y = V::load(&row.radiance[c], self.part);
                for m in 0..M {
                    let rho_s = V::splat(self.alpha.rho_s[m][c]);
                    unit[m] = e * rho_s.mul_add(basis[1 + m], V::splat(self.alpha.rho_d[m][c]));
                }
                for m in 0..M {
                    let wu = robust[c] * unit[m];
                    q.b[m] = wu.mul_add(y, q.b[m]);
                    for k in 0..=m {
                        q.g[m][k] = wu.mul_add(unit[k], q.g[m][k]);
                    }
                }
            }
        }
        q
    }

    /// Radiance of channel `c` predicted for a row, over the irradiance.
    #[inline(always)]
    fn reflectance<V: Vector, const B: usize>(&self, c: usize, gamma: &[V; M], basis: &[V; B]) -> V {
        let mut sum = V::splat(0.0);
        for m in 0..M {
            let unit = V::splat(self.alpha.rho_s[m][c]).mul_add(basis[1 + m], V::splat(self.alpha.rho_d[m][c]));
            sum = gamma[m].mul_add(unit, sum);
        }
        sum
    }

    /// Weights of Cauchy's function for every row and channel, by reweighted least squares.
    #[inline(always)]
    pub(super) fn reweight<V: Vector, const B: usize, const T: usize>(
        &self,
        scale: f32,
        scratch: &mut Scratch<V, B, T>,
    ) {
        let one = V::splat(1.0);
        let inverse = V::splat(1.0 / (scale * scale));
        scratch.robust.iter_mut().for_each(|robust| *robust = [one; 3]);
        for _ in 0..REWEIGHTINGS {
            let gamma = self.minimise(&self.quadratic(scratch)).gamma;
            for (row, (basis, robust)) in self.rows.iter().zip(scratch.basis.iter().zip(&mut scratch.robust)) {
                for c in 0..3 {
                    let e = V::load(&row.irradiance[c], self.part);
                    let y = V::load(&row.radiance[c], self.part);
                    let residual = y - e * self.reflectance(c, &gamma, basis);
                    robust[c] = one / (residual * residual).mul_add(inverse, one);
                }
            }
        }
    }

    /// Adds cost, gradient and Schur complement of these points.
    #[inline(always)]
    pub(super) fn normal<V: Vector, const B: usize, const T: usize, const N: usize, const H: usize>(
        &self,
        cauchy: Option<f32>,
        scratch: &Scratch<V, B, T>,
        totals: &mut Totals<N, H>,
    ) {
        let zero = V::splat(0.0);
        let mut grams = [[zero; T]; 3];
        let mut q = Quadratic::zero();
        for c in 0..3 {
            let (gram, seen) = self.gram(c, scratch);
            self.add_channel(c, &gram, &seen, &mut q);
            grams[c] = gram;
        }
        let minimum = self.minimise(&q);
        self.add_residuals(cauchy, scratch, &minimum, totals);
        let coupling = self.coupling(&grams, &minimum);
        self.add_schur(&coupling, totals);
        for c in 0..3 {
            self.add_products(c, &grams[c], &minimum.gamma, totals);
        }
    }

    /// Cost of these points under some weights.
    #[inline(always)]
    pub(super) fn cost<V: Vector, const B: usize, const T: usize>(
        &self,
        cauchy: Option<f32>,
        scratch: &Scratch<V, B, T>,
        gamma: &[V; M],
    ) -> V {
        let mut cost = V::splat(0.0);
        for (row, basis) in self.rows.iter().zip(&scratch.basis) {
            for c in 0..3 {
                let e = V::load(&row.irradiance[c], self.part);
                let y = V::load(&row.radiance[c], self.part);
                let residual = y - e * self.reflectance(c, gamma, basis);
                cost = add_cost(cauchy, residual, cost);
            }
        }
        cost
    }

    /// Adds the cost and the gradient.
    #[inline(always)]
    fn add_residuals<V: Vector, const B: usize, const T: usize, const N: usize, const H: usize>(
        &self,
        cauchy: Option<f32>,
        scratch: &Scratch<V, B, T>,
        minimum: &Minimum<V, M>,
        totals: &mut Totals<N, H>,
    ) {
        let zero = V::splat(0.0);
        let mut cost = zero;
        let mut slope = [zero; M];
        for c in 0..3 {
            let mut along = [zero; B];
            for (row, (basis, robust)) in self.rows.iter().zip(scratch.basis.iter().zip(&scratch.robust)) {
                let e = V::load(&row.irradiance[c], self.part);
                let y = V::load(&row.radiance[c], self.part);
                let residual = y - e * self.reflectance(c, &minimum.gamma, basis);
                cost = add_cost(cauchy, residual, cost);
                let er = robust[c] * e * residual;
                for i in 0..B {
                    along[i] = er.mul_add(basis[i], along[i]);
                }
            }
            for m in 0..M {
                let gamma = -minimum.gamma[m];
                accumulate(
                    &mut totals.gradient[m * PER_MATERIAL + c],
                    self.part,
                    gamma * V::splat(FRAC_1_PI) * along[0],
                );
                accumulate(&mut totals.gradient[m * PER_MATERIAL + 3 + c], self.part, gamma * along[1 + m]);
                slope[m] = (gamma * V::splat(self.alpha.rho_s[m][c])).mul_add(along[1 + M + m], slope[m]);
            }
        }
        for m in 0..M {
            accumulate(&mut totals.gradient[m * PER_MATERIAL + 6], self.part, slope[m]);
        }
        accumulate(&mut totals.cost, self.part, cost);
    }

    /// Products of the derivatives by the BRDF parameters with those by the free weights, times the inverse transposed
    /// Cholesky factor: what has to be taken off the normal matrix is this times its transpose.
    #[inline(always)]
    fn coupling<V: Vector, const T: usize>(
        &self,
        grams: &[[V; T]; 3],
        minimum: &Minimum<V, M>,
    ) -> [[[V; M]; PER_MATERIAL]; M] {
        let mut coupling = [[[V::splat(0.0); M]; PER_MATERIAL]; M];
        for m in 0..M {
            let gamma = minimum.gamma[m];
            for c in 0..3 {
                let diffuse = self.with_units(c, 0, &grams[c]);
                let specular = self.with_units(c, 1 + m, &grams[c]);
                let slope = self.with_units(c, 1 + M + m, &grams[c]);
                let rho_s = V::splat(self.alpha.rho_s[m][c]);
                for k in 0..M {
                    coupling[m][c][k] = gamma * V::splat(FRAC_1_PI) * diffuse[k];
                    coupling[m][3 + c][k] = gamma * specular[k];
                    coupling[m][6][k] = (gamma * rho_s).mul_add(slope[k], coupling[m][6][k]);
                }
            }
            for row in &mut coupling[m] {
                for k in 0..M {
                    row[k] = row[k] * minimum.free[k];
                }
                minimum.factor.forward(row);
            }
        }
        coupling
    }

    /// Takes the weights' part off the normal matrix.
    #[inline(always)]
    fn add_schur<V: Vector, const N: usize, const H: usize>(
        &self,
        coupling: &[[[V; M]; PER_MATERIAL]; M],
        totals: &mut Totals<N, H>,
    ) {
        let all = coupling.as_flattened();
        let mut rest = totals.hessian.as_mut_slice();
        for (i, left) in all.iter().enumerate() {
            let row;
            (row, rest) = rest.split_at_mut(i + 1);
            for (total, right) in row.iter_mut().zip(all) {
                let mut product = left[0] * right[0];
                for k in 1..M {
                    product = left[k].mul_add(right[k], product);
                }
                accumulate(total, self.part, -product);
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
                            accumulate(&mut totals.hessian[triangle(p, q)], self.part, left * right * at(gram, a, b));
                        }
                    }
                }
            }
        }
    }

    /// Unknown, basis function and factor of the derivatives of channel `c` by rho_d, rho_s, ln(beta) of material `m`.
    #[inline(always)]
    fn derivative<V: Vector>(&self, c: usize, m: usize, k: usize, gamma: &[V; M]) -> (usize, usize, V) {
        match k {
            0 => (m * PER_MATERIAL + c, 0, gamma[m] * V::splat(FRAC_1_PI)),
            1 => (m * PER_MATERIAL + 3 + c, 1 + m, gamma[m]),
            _ => (m * PER_MATERIAL + 6, 1 + M + m, gamma[m] * V::splat(self.alpha.rho_s[m][c])),
        }
    }
}

/// Adds the cost of a residual: its square, or Cauchy's function of it.
#[inline(always)]
fn add_cost<V: Vector>(cauchy: Option<f32>, residual: V, cost: V) -> V {
    match cauchy {
        None => residual.mul_add(residual, cost),
        Some(scale) => {
            let ratio = (residual * residual).mul_add(V::splat(1.0 / (scale * scale)), V::splat(1.0));
            V::splat(scale * scale).mul_add(ratio.ln(), cost)
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
