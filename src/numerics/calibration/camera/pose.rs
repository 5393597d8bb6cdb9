//! Where a board lies: from its homography, and the second place from which a small board looks nearly the same.

use super::homography::homography;
use super::interior::Interior;
use super::{Corner, adjust};
use crate::numerics::geometry::Vec3;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

/// Board to camera frame: a board point (x, y, 0), mm, lies at `rotation * (x, y, 0) + translation_mm`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Board axes to camera axes.
    pub rotation: Rotation3<f64>,
    /// Where the board's first corner lies, mm.
    pub translation_mm: Vec3,
}

impl Pose {
    /// A board point in the camera frame, mm.
    pub fn place(&self, board_mm: [f64; 2]) -> Vec3 {
        self.rotation * Vec3::new(board_mm[0], board_mm[1], 0.0) + self.translation_mm
    }

    /// Unit normal of the board, away from the camera where the board's x, y axes are labelled as seen.
    pub fn normal(&self) -> Vec3 {
        self.rotation * Vec3::z()
    }

    /// Axis times angle, rad.
    pub fn rotation_vector(&self) -> Vec3 {
        // Not by the matrix's trace, whose arc cosine knows small angles poorly or, after rounding, not at all.
        UnitQuaternion::from_rotation_matrix(&self.rotation).scaled_axis()
    }

    /// Moved by a small rotation vector (camera axes, rad) and a translation (mm).
    pub(super) fn moved(&self, by: &nalgebra::Vector6<f64>) -> Self {
        let turn = Rotation3::from_scaled_axis(Vec3::new(by[0], by[1], by[2]));
        Self { rotation: turn * self.rotation, translation_mm: self.translation_mm + Vec3::new(by[3], by[4], by[5]) }
    }

    /// The board mirrored in the plane across the line of sight to `middle_mm`: under a parallel projection, which a long lens
    /// comes close to, it gives the same picture.
    pub(super) fn mirrored(&self, middle_mm: [f64; 2]) -> Self {
        let middle = self.place(middle_mm);
        let sight = middle.normalize();
        let mirror = Matrix3::identity() - 2.0 * sight * sight.transpose();
        let axis = |i: usize| mirror * self.rotation.matrix().column(i);
        let (x, y) = (axis(0), axis(1));
        let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)]));
        let arm = rotation * Vec3::new(middle_mm[0], middle_mm[1], 0.0);
        Self { rotation, translation_mm: middle - arm }
    }
}

/// Pose from a homography H = K [r1 r2 t] (Zhang 2000, section 3.1), distortion left out.
fn from_homography(h: &Matrix3<f64>, interior: &Interior) -> Option<Pose> {
    let [fx, fy, cx, cy, ..] = interior.values();
    let k = Matrix3::new(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0);
    let m = k.try_inverse()? * h;
    let scale = 2.0 / (m.column(0).norm() + m.column(1).norm());
    // The board lies in front of the camera.
    let m = m * scale.copysign(m[(2, 2)]);
    let (x, y): (Vec3, Vec3) = (m.column(0).into(), m.column(1).into());
    let svd = Matrix3::from_columns(&[x, y, x.cross(&y)]).try_svd(true, true, f64::EPSILON, 1000)?;
    let rotation = Rotation3::from_matrix_unchecked(svd.u? * svd.v_t?);
    let translation_mm: Vec3 = m.column(2).into();
    translation_mm.iter().all(|v| v.is_finite()).then_some(Pose { rotation, translation_mm })
}

/// A board's pose under a known interior.
#[derive(Clone, Copy, Debug)]
pub(super) struct Posed {
    /// The better pose.
    pub pose: Pose,
    /// Sum of squared residuals over sigma.
    pub cost: f64,
    /// The same for the mirrored pose: hardly larger means that the picture does not tell them apart.
    pub mirrored_cost: f64,
}

/// Finds a board's pose under a known interior; None unless its corners span a plane in front of the camera.
pub(super) fn pose(corners: &[Corner], interior: &Interior) -> Option<Posed> {
    let undistorted = straightened(corners, interior);
    let start = from_homography(&homography(&undistorted)?, interior)?;
    let one = adjust::pose(corners, interior, start)?;
    let other = adjust::pose(corners, interior, one.0.mirrored(middle(corners)));
    let mirrored_cost = other.map_or(f64::INFINITY, |o| o.1);
    match other {
        Some((pose, cost)) if cost < one.1 => Some(Posed { pose, cost, mirrored_cost: one.1 }),
        _ => Some(Posed { pose: one.0, cost: one.1, mirrored_cost }),
    }
}

/// Mean of the corners on the board, mm.
pub(super) fn middle(corners: &[Corner]) -> [f64; 2] {
    let n = corners.len().max(1) as f64;
    [0, 1].map(|i| corners.iter().map(|c| c.board_mm[i]).sum::<f64>() / n)
}

/// The corners where a camera without distortion would see them.
fn straightened(corners: &[Corner], interior: &Interior) -> Vec<Corner> {
    let projection = interior.projection();
    let [fx, fy, cx, cy, ..] = interior.values();
    let straight = |corner: &Corner| {
        let direction = projection.ray(corner.pixel[0], corner.pixel[1]).direction;
        let pixel = [fx * direction.x / direction.z + cx, fy * direction.y / direction.z + cy];
        Corner { pixel, ..*corner }
    };
    corners.iter().map(straight).collect()
}
