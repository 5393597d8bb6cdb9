//! The weights of a point: a quadratic in at most four unknowns, minimised exactly.

use super::PIVOT;
use crate::numerics::simd::Vector;

/// The quadratic in the weights: gamma' g gamma - 2 b' gamma.
pub(super) struct Quadratic<V, const M: usize> {
    pub g: [[V; M]; M],
    pub b: [V; M],
}

/// Its minimiser: weights, 1 for those that are free and 0 for those held at zero, and the inverse Cholesky factor of the
/// matrix of the free ones (a unit matrix elsewhere).
pub(super) struct Minimum<V, const M: usize> {
    pub gamma: [V; M],
    pub free: [V; M],
    pub factor: Factor<V, M>,
}

/// Lower Cholesky factor; `inverse_diagonal` holds one over its diagonal.
pub(super) struct Factor<V, const M: usize> {
    lower: [[V; M]; M],
    inverse_diagonal: [V; M],
}

impl<V: Vector, const M: usize> Quadratic<V, M> {
    #[inline(always)]
    pub(super) fn zero() -> Self {
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
    pub(super) fn stationary(&self, support: usize) -> (Minimum<V, M>, V) {
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

    /// The minimiser with no weight below `least`.
    #[inline(always)]
    pub(super) fn minimise_above(&self, least: &[V; M]) -> Minimum<V, M> {
        let mut above = Self { g: self.g, b: self.b };
        for m in 0..M {
            for k in 0..M {
                above.b[m] = above.b[m] - self.g[m.max(k)][m.min(k)] * least[k];
            }
        }
        let mut found = above.minimise();
        for m in 0..M {
            found.gamma[m] = found.gamma[m] + least[m];
        }
        found
    }

    /// The minimiser with no weight below zero.
    #[inline(always)]
    pub(super) fn minimise(&self) -> Minimum<V, M> {
        let all = (1 << M) - 1;
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
    pub(super) fn deviations(&self) -> [V; M] {
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
    pub(super) fn forward(&self, right: &mut [V; M]) {
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
