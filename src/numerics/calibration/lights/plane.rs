//! The plane of a card from the places of its four corners in the image.

use crate::numerics::fit::levmar::{Bounds, Normal, Problem, Stop, minimise};
use crate::numerics::geometry::{Projection, Ray, Vec3};
use nalgebra::{DMatrix, DVector, Rotation3, SMatrix, SVector};

/// A plane.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    /// A point of it, camera frame, mm.
    pub point: Vec3,
    /// Unit normal, towards the camera.
    pub normal: Vec3,
}

impl Plane {
    /// Where a ray of sight meets the plane; none for a ray along it or a plane behind the camera.
    pub fn meets(&self, ray: &Ray) -> Option<Vec3> {
        let along = self.normal.dot(&ray.direction);
        let distance = self.normal.dot(&(self.point - ray.origin)) / along;
        (distance.is_finite() && distance > 0.0).then(|| ray.origin + ray.direction * distance)
    }
}

/// A card's plane, and the other one that its corners allow.
#[derive(Clone, Debug, PartialEq)]
pub struct CardPose {
    /// The plane that fits best.
    pub plane: Plane,
    /// Rms distance of the corners, pixels.
    pub rms_px: f64,
    /// The plane tilted the other way, and its rms distance: a long lens hardly tells the two apart.
    pub other: Option<(Plane, f64)>,
}

/// Finds the pose of a card of `size_mm` (width, height) whose corners lie at `corners_px`, in order around it, the first edge
/// being a width. None for corners that are no card's, and for parallel rays.
///
/// A homography gives the pose, Levenberg-Marquardt on the corners refines it; then again from the pose mirrored in the plane
/// across the line of sight (the second minimum of planar poses, Schweighofer & Pinz 2006).
pub fn pose(projection: &Projection, corners_px: &[[f64; 2]; 4], size_mm: [f64; 2]) -> Option<CardPose> {
    if matches!(projection, Projection::Orthographic { .. }) {
        return None;
    }
    let model = Model { projection, corners_px, size_mm };
    let first = model.refine(&model.homography()?)?;
    let turn = Rotation3::from_scaled_axis(Vec3::new(first[0], first[1], first[2]));
    let center = Vec3::new(first[3], first[4], first[5]);
    // Mirrored: the normal on the other side of the line of sight, the card's width kept as near as it goes.
    let sight = center.normalize();
    let normal = turn * Vec3::z();
    let mirrored = sight * (2.0 * sight.dot(&normal)) - normal;
    let between = Rotation3::rotation_between(&normal, &mirrored).unwrap_or_else(Rotation3::identity);
    let axis = (between * turn).scaled_axis();
    let second = model.refine(&DVector::from_column_slice(&[axis.x, axis.y, axis.z, center.x, center.y, center.z]));
    let (mut best, mut rest) = (model.plane(&first), second.map(|x| model.plane(&x)));
    if let Some(other) = rest.take() {
        let same = other.0.normal.dot(&best.0.normal) > 1.0 - 1e-6;
        rest = (!same).then_some(other);
        if let Some(other) = &mut rest
            && other.1 < best.1
        {
            std::mem::swap(&mut best, other);
        }
    }
    Some(CardPose { plane: best.0, rms_px: best.1, other: rest })
}

/// Unknowns: rotation vector and centre of the card.
struct Model<'a> {
    projection: &'a Projection,
    corners_px: &'a [[f64; 2]; 4],
    size_mm: [f64; 2],
}

impl Model<'_> {
    /// Corners in the card's own frame, mm.
    fn corners(&self) -> [[f64; 2]; 4] {
        let [w, h] = self.size_mm.map(|s| 0.5 * s);
        [[-w, -h], [w, -h], [w, h], [-w, h]]
    }

    fn homography(&self) -> Option<DVector<f64>> {
        let mut system = SMatrix::<f64, 8, 8>::zeros();
        let mut right = SVector::<f64, 8>::zeros();
        // In units of the card and of its picture the system is well conditioned.
        let unit = self.size_mm[0].max(self.size_mm[1]);
        for (i, (corner, at)) in self.corners().iter().zip(self.corners_px).enumerate() {
            let [x, y] = corner.map(|c| c / unit);
            let d = self.projection.ray(at[0], at[1]).direction;
            let (u, v) = (d.x / d.z, d.y / d.z);
            system.set_row(2 * i, &SVector::<f64, 8>::from([x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y]).transpose());
            system.set_row(2 * i + 1, &SVector::<f64, 8>::from([0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y]).transpose());
            right[2 * i] = u;
            right[2 * i + 1] = v;
        }
        let h = system.lu().solve(&right)?;
        let (a, b, t) = (Vec3::new(h[0], h[3], h[6]), Vec3::new(h[1], h[4], h[7]), Vec3::new(h[2], h[5], 1.0));
        let scale = unit * 2.0 / (a.norm() + b.norm());
        let x_axis = a.normalize();
        let y_axis = (b - x_axis * x_axis.dot(&b)).normalize();
        let turn = Rotation3::from_basis_unchecked(&[x_axis, y_axis, x_axis.cross(&y_axis)]);
        let (axis, center) = (turn.scaled_axis(), t * scale);
        let all = DVector::from_column_slice(&[axis.x, axis.y, axis.z, center.x, center.y, center.z]);
        all.iter().all(|v| v.is_finite()).then_some(all)
    }

    fn residuals(&self, x: &DVector<f64>) -> DVector<f64> {
        let turn = Rotation3::from_scaled_axis(Vec3::new(x[0], x[1], x[2]));
        let mut residuals = DVector::zeros(8);
        for (i, (corner, at)) in self.corners().iter().zip(self.corners_px).enumerate() {
            let point = turn * Vec3::new(corner[0], corner[1], 0.0) + Vec3::new(x[3], x[4], x[5]);
            let seen = self.projection.project(&point);
            residuals[2 * i] = seen[0] - at[0];
            residuals[2 * i + 1] = seen[1] - at[1];
        }
        residuals
    }

    fn refine(&self, start: &DVector<f64>) -> Option<DVector<f64>> {
        let far = DVector::from_element(6, 1e9);
        let bounds = Bounds {
            lower: -&far,
            upper: far,
            step: DVector::from_column_slice(&[0.3, 0.3, 0.3, 300.0, 300.0, 300.0]),
        };
        let found = minimise(self, start, &bounds, Stop { relative_decrease: 1e-10, iterations: 300 });
        (found.cost.is_finite() && found.x[5] > 0.0).then_some(found.x)
    }

    fn plane(&self, x: &DVector<f64>) -> (Plane, f64) {
        let normal = Rotation3::from_scaled_axis(Vec3::new(x[0], x[1], x[2])) * Vec3::z();
        let point = Vec3::new(x[3], x[4], x[5]);
        let towards = if normal.dot(&point) > 0.0 { -normal } else { normal };
        (Plane { point, normal: towards }, (self.residuals(x).norm_squared() / 4.0).sqrt())
    }
}

impl Problem for Model<'_> {
    fn normal(&self, x: &DVector<f64>) -> Normal {
        let residuals = self.residuals(x);
        let mut jacobian = DMatrix::zeros(8, 6);
        for k in 0..6 {
            let h = if k < 3 { 1e-6 } else { 1e-3 };
            let (mut after, mut before) = (x.clone(), x.clone());
            after[k] += h;
            before[k] -= h;
            jacobian.set_column(k, &((self.residuals(&after) - self.residuals(&before)) / (2.0 * h)));
        }
        Normal {
            cost: residuals.norm_squared(),
            gradient: jacobian.tr_mul(&residuals),
            hessian: jacobian.tr_mul(&jacobian),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn the_pose_of_a_tilted_card_comes_back() {
        for focal in [2_000.0, 24_390.0] {
            let projection =
                Projection::Pinhole { focal_px: [focal; 2], principal_px: [2184.0, 1456.0], distortion: [0.0; 5] };
            let turn = Rotation3::from_euler_angles(0.3, -0.5, 0.2);
            let center = Vec3::new(20.0, -10.0, 2000.0);
            let corners = [[-60.0, -40.0], [60.0, -40.0], [60.0, 40.0], [-60.0, 40.0]]
                .map(|[x, y]| projection.project(&(turn * Vec3::new(x, y, 0.0) + center)));
            let found = pose(&projection, &corners, [120.0, 80.0]).unwrap();
            assert!(found.rms_px < 1e-6, "{found:?}");
            assert!((found.plane.normal + turn * Vec3::z()).norm() < 1e-6, "{found:?}");
            assert!((found.plane.point - center).norm() < 1e-3, "{found:?}");
            let (other, rms) = found.other.unwrap();
            // The mirrored pose: a wide lens tells it apart by tens of pixels, a long one by less.
            assert!(other.normal.dot(&found.plane.normal) < 0.9 && rms > 0.5, "{other:?} {rms}");
        }
    }

    #[test]
    fn a_point_is_no_card() {
        let projection = Projection::Pinhole { focal_px: [1000.0; 2], principal_px: [0.0; 2], distortion: [0.0; 5] };
        assert!(pose(&projection, &[[5.0, 5.0]; 4], [100.0, 100.0]).is_none());
    }
}
