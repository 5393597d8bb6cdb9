//! Least squares with non-negative unknowns, for the increments of a monotone curve.

use nalgebra::{DMatrix, DVector};

/// The minimiser of x'Gx/2 - r'x over x >= 0, for a symmetric positive definite `gram`; none if it is not.
///
/// Block principal pivoting (Portugal, Judice & Vicente 1994; Kim & Park 2011): starts from all unknowns free, exchanges every
/// infeasible unknown at once, and falls back to one at a time, which always ends, when that stops helping.
pub fn non_negative_least_squares(gram: &DMatrix<f64>, rhs: &DVector<f64>) -> Option<DVector<f64>> {
    const BLOCK_TRIES: usize = 3;
    let n = rhs.len();
    let mut free = vec![true; n];
    let mut fewest = n + 1;
    let mut tries = BLOCK_TRIES;
    for _ in 0..20 * n.max(1) {
        let x = solve_free(gram, rhs, &free)?;
        let gradient = gram * &x - rhs;
        let tolerance = 1e-10 * gradient.amax().max(rhs.amax());
        let infeasible: Vec<usize> =
            (0..n).filter(|&i| if free[i] { x[i] < 0.0 } else { gradient[i] < -tolerance }).collect();
        let Some(&last) = infeasible.last() else {
            return Some(x);
        };
        if infeasible.len() < fewest {
            fewest = infeasible.len();
            tries = BLOCK_TRIES;
        } else {
            tries = tries.saturating_sub(1);
        }
        let exchanged = if tries > 0 { infeasible.as_slice() } else { std::slice::from_ref(&last) };
        for &i in exchanged {
            free[i] = !free[i];
        }
    }
    None
}

/// Solves for the free unknowns with the others at zero.
fn solve_free(gram: &DMatrix<f64>, rhs: &DVector<f64>, free: &[bool]) -> Option<DVector<f64>> {
    let index: Vec<usize> = (0..free.len()).filter(|&i| free[i]).collect();
    let sub = DMatrix::from_fn(index.len(), index.len(), |i, j| gram[(index[i], index[j])]);
    let part = sub.cholesky()?.solve(&DVector::from_fn(index.len(), |i, _| rhs[index[i]]));
    let mut x = DVector::zeros(free.len());
    for (value, &i) in part.iter().zip(&index) {
        x[i] = *value;
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// Karush-Kuhn-Tucker conditions are necessary and sufficient for this convex problem: no oracle is needed.
    #[test]
    fn solution_meets_the_optimality_conditions() {
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let mut at_zero = 0;
        for n in [1, 2, 5, 30, 60] {
            let a = DMatrix::from_fn(n + 3, n, |_, _| random());
            let gram = a.transpose() * &a + DMatrix::identity(n, n) * 1e-6;
            let rhs = DVector::from_fn(n, |_, _| random());
            let x = non_negative_least_squares(&gram, &rhs).unwrap();
            let gradient = &gram * &x - &rhs;
            for i in 0..n {
                assert!(x[i] >= 0.0);
                assert!(gradient[i] > -1e-9, "gradient {i} is {}", gradient[i]);
                assert!((x[i] * gradient[i]).abs() < 1e-9);
                at_zero += usize::from(x[i] == 0.0);
            }
        }
        assert!(at_zero > 20, "the constraints were hardly exercised: {at_zero}");
    }

    #[test]
    fn an_indefinite_matrix_is_refused() {
        let gram = DMatrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, -1.0]);
        assert!(non_negative_least_squares(&gram, &DVector::from_element(2, 1.0)).is_none());
    }
}
