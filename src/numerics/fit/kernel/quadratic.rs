//! The weights of a point: a quadratic in at most four unknowns, minimised exactly.

use super::{FAINT, PIVOT};
use crate::numerics::simd::Vector;

/// The quadratic in the weights: gamma' g gamma - 2 b' gamma. Of `g` the lower triangle is kept.
#[derive(Clone, Copy)]
pub(super) struct Quadratic<V, const M: usize> {
    pub g: [[V; M]; M],
    pub b: [V; M],
}

/// Its minimiser: weights, and the factor of the matrix of those that are free.
pub(super) struct Minimum<V, const M: usize> {
    pub gamma: [V; M],
    pub factor: Factor<V, M>,
}

/// The matrix of the free weights as L D L', L with a unit diagonal. A weight held at zero has the inverse pivot 0: no
/// solution moves it.
pub(super) struct Factor<V, const M: usize> {
    lower: [[V; M]; M],
    inverse_pivot: [V; M],
}

impl<V: Vector, const M: usize> Quadratic<V, M> {
    #[inline(always)]
    pub(super) fn zero() -> Self {
        Self { g: [[V::splat(0.0); M]; M], b: [V::splat(0.0); M] }
    }

    /// Factor of the matrix of the weights in `support`, without those the samples do not tell from the ones before.
    #[inline(always)]
    fn factor(&self, support: usize) -> Factor<V, M> {
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let mut factor = Factor { lower: [[zero; M]; M], inverse_pivot: [zero; M] };
        for m in 0..M {
            if support & (1 << m) == 0 {
                continue;
            }
            let mut pivot = self.g[m][m];
            let mut scaled = [zero; M];
            for k in 0..m {
                scaled[k] = self.g[m][k];
                for l in 0..k {
                    scaled[k] = scaled[k] - scaled[l] * factor.lower[k][l];
                }
                factor.lower[m][k] = scaled[k] * factor.inverse_pivot[k];
                pivot = pivot - scaled[k] * factor.lower[m][k];
            }
            let least = (self.g[m][m] * V::splat(PIVOT)).max(V::splat(FAINT));
            factor.inverse_pivot[m] = pivot.if_greater(least, one / pivot, zero);
        }
        factor
    }

    /// The stationary point over `support`, and by how much it lowers the quadratic.
    #[inline(always)]
    pub(super) fn stationary(&self, support: usize) -> (Minimum<V, M>, V) {
        let factor = self.factor(support);
        let mut z = self.b;
        factor.forward(&mut z);
        let mut gain = V::splat(0.0);
        for m in 0..M {
            let scaled = z[m] * factor.inverse_pivot[m];
            gain = scaled.mul_add(z[m], gain);
            z[m] = scaled;
        }
        let gamma = factor.backward(z);
        (Minimum { gamma, factor }, gain)
    }

    /// The minimiser with no weight below `least`.
    #[inline(always)]
    pub(super) fn minimise_above(&self, least: &[V; M]) -> Minimum<V, M> {
        let mut above = *self;
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
                old.inverse_pivot[m] = gain.if_greater(most, new.inverse_pivot[m], old.inverse_pivot[m]);
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
    /// Square roots of the diagonal of the inverse; 0 for a weight held at zero.
    #[inline(always)]
    pub(super) fn deviations(&self) -> [V; M] {
        let roots = self.factor.roots();
        let mut deviations = [V::splat(0.0); M];
        for m in 0..M {
            let mut column = [V::splat(0.0); M];
            column[m] = V::splat(1.0);
            self.factor.forward(&mut column);
            let mut square = V::splat(0.0);
            for k in 0..M {
                let value = column[k] * roots[k];
                square = value.mul_add(value, square);
            }
            deviations[m] = square.sqrt();
        }
        deviations
    }
}

impl<V: Vector, const M: usize> Factor<V, M> {
    /// Square roots of the inverse pivots.
    #[inline(always)]
    pub(super) fn roots(&self) -> [V; M] {
        let mut roots = self.inverse_pivot;
        for root in &mut roots {
            *root = root.sqrt();
        }
        roots
    }

    /// Solves L * x = right in place.
    #[inline(always)]
    pub(super) fn forward(&self, right: &mut [V; M]) {
        for m in 0..M {
            for k in 0..m {
                right[m] = right[m] - self.lower[m][k] * right[k];
            }
        }
    }

    /// Solves L' * x = right.
    #[inline(always)]
    fn backward(&self, mut right: [V; M]) -> [V; M] {
        for m in (0..M).rev() {
            for k in m + 1..M {
                right[m] = right[m] - self.lower[k][m] * right[k];
            }
        }
        right
    }
}
