//! The inner loop of variable projection: for given BRDF parameters, the best weights of every point, the cost, and the
//! normal equations of the BRDF parameters with the weights eliminated (Golub & Pereyra 1973, in Kaufman's 1975 form).
//!
//! Within a channel every radiance and every derivative is a sum of few basis functions: the irradiance e, e times each
//! material's lobe, e times each lobe's slope. Their Gram matrix is gathered once a point; all else follows from it.
//! Sums over samples are f32, one lane a point; sums over points are f32 within a chunk and f64 across chunks.

use super::prepared::{BLOCKS, Prepared, ReadyRow};
use super::{CHUNK, MAX_MATERIALS};
use crate::numerics::brdf::{Family, Material};
use crate::numerics::simd::{LANES, Lane, Level, Vector, Work};
use rayon::prelude::*;
use std::f32::consts::FRAC_1_PI;

/// Unknowns of a material: rho_d and rho_s per channel, ln(beta).
pub const PER_MATERIAL: usize = 7;

/// A direction of weights counts as seen when this part of its square is left after those before it.
const PIVOT: f32 = 1e-5;

/// Reweightings of Cauchy's function before the weights of a point stand.
const REWEIGHTINGS: usize = 2;

/// Constraint of the weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sign {
    /// gamma >= 0, exactly, by trying every set of positive weights.
    NonNegative,
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

    fn add_to(&self, sums: &mut Sums) {
        sums.cost += sum(&self.cost);
        sums.gradient.iter_mut().zip(&self.gradient).for_each(|(total, lane)| *total += sum(lane));
        sums.hessian.iter_mut().zip(&self.hessian).for_each(|(total, lane)| *total += sum(lane));
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
        let mut scratch = Scratch::<V, B, T>::default();
        for (index, block) in blocks.enumerate() {
            let rows = prepared.block(block);
            scratch.resize(rows.len());
            for part in 0..LANES / V::WIDTH {
                let point = Point { rows, part, alpha: &alpha, sign };
                point.lobes(prepared.family, &mut scratch);
                if let Some(scale) = prepared.cauchy {
                    point.reweight(scale, &mut scratch);
                }
                match &mut out {
                    Out::Normal(_) => point.normal(prepared.cauchy, &scratch, &mut totals),
                    Out::Weights(gamma, cost) => {
                        let found = point.quadratic(&scratch).minimise(sign).gamma;
                        accumulate(cost, part, point.cost(prepared.cauchy, &scratch, &found));
                        scatter(&found, part, index, gamma);
                    }
                    Out::Deviations(sigma) => {
                        let minimum = point.quadratic(&scratch).minimise(sign);
                        scatter(&minimum.deviations(), part, index, sigma);
                    }
                }
            }
        }
        if let Out::Normal(sums) = out {
            totals.add_to(sums);
        }
    }
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
            rho_d: std::array::from_fn(|m| of(m).rho_d.map(|v| (v * std::f64::consts::FRAC_1_PI) as f32)),
            rho_s: std::array::from_fn(|m| of(m).rho_s.map(|v| v as f32)),
            beta2: std::array::from_fn(|m| (of(m).beta * of(m).beta) as f32),
            inverse_beta2: std::array::from_fn(|m| (1.0 / (of(m).beta * of(m).beta)) as f32),
        }
    }
}

/// Per row: basis functions without the irradiance (1, lobes, slopes), their products, weights of Cauchy's function.
struct Scratch<V, const B: usize, const T: usize> {
    basis: Vec<[V; B]>,
    products: Vec<[V; T]>,
    robust: Vec<[V; 3]>,
}

impl<V, const B: usize, const T: usize> Default for Scratch<V, B, T> {
    fn default() -> Self {
        Self { basis: Vec::new(), products: Vec::new(), robust: Vec::new() }
    }
}

impl<V: Vector, const B: usize, const T: usize> Scratch<V, B, T> {
    #[inline(always)]
    fn resize(&mut self, rows: usize) {
        let one = V::splat(1.0);
        self.basis.resize(rows, [one; B]);
        self.products.resize(rows, [one; T]);
        self.robust.clear();
        self.robust.resize(rows, [one; 3]);
    }
}

/// The points of one vector.
struct Point<'a, const M: usize> {
    rows: &'a [ReadyRow],
    part: usize,
    alpha: &'a Alpha<M>,
    sign: Sign,
}

/// The quadratic in the weights: gamma' g gamma - 2 b' gamma.
struct Quadratic<V, const M: usize> {
    g: [[V; M]; M],
    b: [V; M],
}

/// Its minimiser: weights, 1 for those that are free and 0 for those held at zero, and the inverse Cholesky factor of the
/// matrix of the free ones (a unit matrix elsewhere).
struct Minimum<V, const M: usize> {
    gamma: [V; M],
    free: [V; M],
    factor: Factor<V, M>,
}

/// Lower Cholesky factor; `inverse_diagonal` holds one over its diagonal.
struct Factor<V, const M: usize> {
    lower: [[V; M]; M],
    inverse_diagonal: [V; M],
}

impl<const M: usize> Point<'_, M> {
    /// Evaluates every lobe at every row.
    #[inline(always)]
    fn lobes<V: Vector, const B: usize, const T: usize>(&self, family: Family, scratch: &mut Scratch<V, B, T>) {
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
    fn quadratic<V: Vector, const B: usize, const T: usize>(&self, scratch: &Scratch<V, B, T>) -> Quadratic<V, M> {
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
    fn reweight<V: Vector, const B: usize, const T: usize>(&self, scale: f32, scratch: &mut Scratch<V, B, T>) {
        let one = V::splat(1.0);
        let inverse = V::splat(1.0 / (scale * scale));
        scratch.robust.iter_mut().for_each(|robust| *robust = [one; 3]);
        for _ in 0..REWEIGHTINGS {
            let gamma = self.quadratic(scratch).minimise(self.sign).gamma;
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
    fn normal<V: Vector, const B: usize, const T: usize, const N: usize, const H: usize>(
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
        let minimum = q.minimise(self.sign);
        self.add_residuals(cauchy, scratch, &minimum, totals);
        let coupling = self.coupling(&grams, &minimum);
        self.add_schur(&coupling, totals);
        for c in 0..3 {
            self.add_products(c, &grams[c], &minimum.gamma, totals);
        }
    }

    /// Cost of these points under some weights.
    #[inline(always)]
    fn cost<V: Vector, const B: usize, const T: usize>(
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

/// Writes what one vector of points found for every material.
#[inline(always)]
fn scatter<V: Vector, const M: usize>(values: &[V; M], part: usize, block: usize, out: &mut [f64]) {
    for m in 0..M {
        let mut lane = [0.0; LANES];
        values[m].store(&mut lane, part);
        for i in part * V::WIDTH..(part + 1) * V::WIDTH {
            out[(block * LANES + i) * M + m] = f64::from(lane[i]);
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
fn accumulate<V: Vector>(total: &mut Lane, part: usize, value: V) {
    (V::load(total, part) + value).store(total, part);
}

impl<V: Vector, const M: usize> Quadratic<V, M> {
    #[inline(always)]
    fn zero() -> Self {
        Self { g: [[V::splat(0.0); M]; M], b: [V::splat(0.0); M] }
    }

    /// Cholesky factor of the matrix of the weights in `support`; a weight the samples do not tell from those before it is
    /// taken out of `free` (1 in, 0 out).
    #[inline(always)]
    fn factor(&self, support: usize) -> (Factor<V, M>, [V; M]) {
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let mut factor = Factor { lower: [[zero; M]; M], inverse_diagonal: [one; M] };
        let mut free = [zero; M];
        for m in 0..M {
            if support & (1 << m) == 0 {
                continue;
            }
            let mut pivot = self.g[m][m];
            for k in 0..m {
                let mut sum = self.g[m][k];
                for l in 0..k {
                    sum = sum - factor.lower[m][l] * factor.lower[k][l];
                }
                let value = sum * factor.inverse_diagonal[k] * free[k];
                factor.lower[m][k] = value;
                pivot = pivot - value * value;
            }
            let least = self.g[m][m] * V::splat(PIVOT);
            let seen = pivot.if_greater(least, one, zero);
            let root = pivot.if_greater(least, pivot, one).sqrt();
            free[m] = seen;
            factor.inverse_diagonal[m] = one / root;
            for k in 0..m {
                factor.lower[m][k] = factor.lower[m][k] * seen;
            }
        }
        (factor, free)
    }

    /// The stationary point over `support`, and by how much it lowers the quadratic.
    #[inline(always)]
    fn stationary(&self, support: usize) -> (Minimum<V, M>, V) {
        let (factor, free) = self.factor(support);
        let mut z = self.b;
        for m in 0..M {
            z[m] = z[m] * free[m];
        }
        factor.forward(&mut z);
        let mut gain = V::splat(0.0);
        for m in 0..M {
            gain = z[m].mul_add(z[m], gain);
        }
        let gamma = factor.backward(z);
        (Minimum { gamma, free, factor }, gain)
    }

    /// The minimiser under `sign`.
    #[inline(always)]
    fn minimise(&self, sign: Sign) -> Minimum<V, M> {
        let all = (1 << M) - 1;
        if sign == Sign::Free {
            return self.stationary(all).0;
        }
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let mut best = self.stationary(0).0;
        let mut most = zero;
        for support in 1..=all {
            let (found, gain) = self.stationary(support);
            // -1 where a weight of the support is negative: never better than no weight at all.
            let mut gain = gain;
            for m in 0..M {
                gain = zero.if_greater(found.gamma[m], -one, gain);
            }
            for m in 0..M {
                let (new, old) = (&found.factor, &mut best.factor);
                best.gamma[m] = gain.if_greater(most, found.gamma[m], best.gamma[m]);
                best.free[m] = gain.if_greater(most, found.free[m], best.free[m]);
                old.inverse_diagonal[m] = gain.if_greater(most, new.inverse_diagonal[m], old.inverse_diagonal[m]);
                for k in 0..m {
                    old.lower[m][k] = gain.if_greater(most, new.lower[m][k], old.lower[m][k]);
                }
            }
            most = gain.max(most);
        }
        best
    }
}

impl<V: Vector, const M: usize> Minimum<V, M> {
    /// Square roots of the diagonal of the inverse.
    #[inline(always)]
    fn deviations(&self) -> [V; M] {
        let mut deviations = [V::splat(0.0); M];
        for m in 0..M {
            let mut column = [V::splat(0.0); M];
            column[m] = self.free[m];
            self.factor.forward(&mut column);
            let mut square = V::splat(0.0);
            for value in column {
                square = value.mul_add(value, square);
            }
            deviations[m] = square.sqrt();
        }
        deviations
    }
}

impl<V: Vector, const M: usize> Factor<V, M> {
    /// Solves lower * x = right in place.
    #[inline(always)]
    fn forward(&self, right: &mut [V; M]) {
        for m in 0..M {
            let mut sum = right[m];
            for k in 0..m {
                sum = sum - self.lower[m][k] * right[k];
            }
            right[m] = sum * self.inverse_diagonal[m];
        }
    }

    /// Solves lower' * x = right.
    #[inline(always)]
    fn backward(&self, mut right: [V; M]) -> [V; M] {
        for m in (0..M).rev() {
            let mut sum = right[m];
            for k in m + 1..M {
                sum = sum - self.lower[k][m] * right[k];
            }
            right[m] = sum * self.inverse_diagonal[m];
        }
        right
    }
}
