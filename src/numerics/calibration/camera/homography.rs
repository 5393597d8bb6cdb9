//! The homography from a plane to its picture (Hartley & Zisserman, "Multiple View Geometry", 2nd ed., algorithm 4.2:
//! direct linear transformation with normalisation).

use super::Corner;
use nalgebra::{DMatrix, Matrix3, Vector3};

/// Ratio of singular values below which a homography flattens the board; a board seen at 75 degrees has about 0.1.
const SINGULAR: f64 = 1e-3;

/// Maps board coordinates (mm, 1) to pixels; None unless the corners span a plane on both sides.
pub(super) fn homography(corners: &[Corner]) -> Option<Matrix3<f64>> {
    let board = normaliser(corners.iter().map(|c| c.board_mm))?;
    let pixel = normaliser(corners.iter().map(|c| c.pixel))?;
    let mut rows = DMatrix::zeros((2 * corners.len()).max(9), 9);
    for (i, corner) in corners.iter().enumerate() {
        let a = board * Vector3::new(corner.board_mm[0], corner.board_mm[1], 1.0);
        let b = pixel * Vector3::new(corner.pixel[0], corner.pixel[1], 1.0);
        for k in 0..3 {
            rows[(2 * i, k)] = a[k];
            rows[(2 * i, 6 + k)] = -b.x * a[k];
            rows[(2 * i + 1, 3 + k)] = a[k];
            rows[(2 * i + 1, 6 + k)] = -b.y * a[k];
        }
    }
    // The decomposition does not sort, and may not end on hostile numbers.
    let svd = rows.try_svd(false, true, f64::EPSILON, 1000)?;
    let least = svd.singular_values.imin();
    let h = svd.v_t?.row(least).iter().copied().collect::<Vec<f64>>();
    let second = svd.singular_values.iter().enumerate().filter(|(i, _)| *i != least).map(|(_, s)| *s);
    // Collinear corners leave more than one solution.
    if second.fold(f64::INFINITY, f64::min) < 1e-6 * svd.singular_values.max() {
        return None;
    }
    let normalised = Matrix3::from_row_slice(&h);
    // ... and a picture that is a line has a singular one.
    let spread = normalised.singular_values();
    if spread.min() <= SINGULAR * spread.max() {
        return None;
    }
    let found = pixel.try_inverse()? * normalised * board;
    found.iter().all(|v| v.is_finite()).then_some(found)
}

/// The similarity that centres points and brings them to a mean distance of sqrt(2).
fn normaliser(points: impl Iterator<Item = [f64; 2]> + Clone) -> Option<Matrix3<f64>> {
    let n = points.clone().count() as f64;
    if n < 4.0 {
        return None;
    }
    let sum = points.clone().fold([0.0, 0.0], |s, p| [s[0] + p[0], s[1] + p[1]]);
    let center = [sum[0] / n, sum[1] / n];
    let distance = points.map(|p| (p[0] - center[0]).hypot(p[1] - center[1])).sum::<f64>() / n;
    let scale = std::f64::consts::SQRT_2 / distance;
    // False for NaN and for points that coincide.
    (scale > 0.0 && scale.is_finite())
        .then(|| Matrix3::new(scale, 0.0, -scale * center[0], 0.0, scale, -scale * center[1], 0.0, 0.0, 1.0))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn corners(map: impl Fn([f64; 2]) -> [f64; 2]) -> Vec<Corner> {
        let board = (0..20).map(|i| [(i % 5) as f64 * 25.0, (i / 5) as f64 * 25.0]);
        board.map(|p| Corner { board_mm: p, pixel: map(p), sigma_px: 0.1 }).collect()
    }

    #[test]
    fn a_known_homography_comes_back() {
        let truth = Matrix3::new(3.0, 0.2, 400.0, -0.3, 2.8, 300.0, 4e-4, -2e-4, 1.0);
        let map = |p: [f64; 2]| {
            let q = truth * Vector3::new(p[0], p[1], 1.0);
            [q.x / q.z, q.y / q.z]
        };
        let found = homography(&corners(map)).unwrap();
        assert!((found / found[(2, 2)] - truth).abs().max() < 1e-9, "{found}");
    }

    #[test]
    fn points_that_span_no_plane_have_none() {
        assert!(homography(&corners(|p| [p[0], 2.0 * p[0] + 1.0])).is_none(), "collinear");
        assert!(homography(&corners(|_| [3.0, 4.0])).is_none(), "one point");
        assert!(homography(&corners(|_| [f64::NAN, 4.0])).is_none(), "no numbers");
        assert!(homography(&corners(|p| p)[..3]).is_none(), "three points");
        assert!(homography(&[]).is_none());
    }
}
