//! Where the adjustment starts: a focal length in closed form, and poses from homographies.

use super::homography::homography;
use super::interior::Interior;
use super::pose::{Pose, pose};
use super::{Size, View};
use nalgebra::Matrix3;

/// Focal lengths tried where the closed form has no answer, in image diagonals: from a wide angle to a long lens.
const GUESSES: [f64; 4] = [0.8, 1.6, 4.0, 8.0];

/// The start with the smallest median error of a view.
pub(super) fn start(views: &[&View], size: Size) -> Option<(Interior, Vec<Pose>)> {
    let homographies: Vec<Matrix3<f64>> = views.iter().filter_map(|v| homography(&v.corners)).collect();
    let closed = focal_length(&homographies, size);
    let candidates = closed.map_or_else(|| GUESSES.map(|g| g * size.diagonal()).to_vec(), |focal| vec![focal]);
    let tried = candidates.into_iter().filter_map(|focal_px| {
        let interior = Interior::simple(focal_px, size.center());
        let posed: Option<Vec<_>> = views.iter().map(|v| pose(&v.corners, &interior)).collect();
        let posed = posed?;
        let mut costs: Vec<f64> = posed.iter().zip(views).map(|(p, view)| p.cost / view.corners.len() as f64).collect();
        // The median: one mislabelled view must not choose.
        costs.sort_by(f64::total_cmp);
        Some((costs[costs.len() / 2], interior, posed))
    });
    let (_, interior, posed) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
    Some((interior, posed.iter().map(|p| p.pose).collect()))
}

/// Zhang 2000, section 3.1 (Eq. 3-4) for square pixels and the principal point at the centre: both constraints of a homography
/// are then linear in 1 / f^2. The median over the views; None when no view has perspective enough.
fn focal_length(homographies: &[Matrix3<f64>], size: Size) -> Option<f64> {
    let ([cx, cy], unit) = (size.center(), size.diagonal());
    let centred = Matrix3::new(1.0 / unit, 0.0, -cx / unit, 0.0, 1.0 / unit, -cy / unit, 0.0, 0.0, 1.0);
    let of_view = |h: &Matrix3<f64>| {
        let h = centred * h;
        let (x, y) = (h.column(0), h.column(1));
        let scale = x.norm() * y.norm();
        let orthogonal = ((x[0] * y[0] + x[1] * y[1]) / scale, x[2] * y[2] / scale);
        let square = |c: usize| (x[c] * x[c] - y[c] * y[c]) / scale;
        let equal = (square(0) + square(1), square(2));
        let pairs = [orthogonal, equal];
        let inverse2 = -pairs.iter().map(|(a, b)| a * b).sum::<f64>() / pairs.iter().map(|(a, _)| a * a).sum::<f64>();
        (inverse2 > 0.0 && inverse2.is_finite()).then(|| unit / inverse2.sqrt())
    };
    let mut found: Vec<f64> = homographies.iter().filter_map(of_view).collect();
    found.sort_by(f64::total_cmp);
    found.get(found.len() / 2).copied()
}
