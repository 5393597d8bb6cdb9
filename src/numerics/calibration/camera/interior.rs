//! The camera's interior (focal lengths, principal point, distortion) as unknowns, and its projection with derivatives.

use crate::numerics::geometry::{Projection, Vec3};
use nalgebra::{SMatrix, SVector, Vector2};

/// Number of unknowns of the interior.
pub const UNKNOWNS: usize = 9;
/// Names of the unknowns as reports write them, in the order of covariances.
pub const NAMES: [&str; UNKNOWNS] = ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"];

/// Interior of a camera as the adjustment sees it: ln fx, ln (fy / fx), cx, cy, k1, k2, p1, p2, k3. Logarithms keep the focal
/// lengths positive, and the ratio is what is held when the pixels are taken as square.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interior(pub(super) SVector<f64, UNKNOWNS>);

/// A projected point with its derivatives.
pub(super) struct Projected {
    /// Pixel coordinates.
    pub pixel: Vector2<f64>,
    /// By the unknowns of the interior.
    pub by_interior: SMatrix<f64, 2, UNKNOWNS>,
    /// By the point in the camera frame, px / mm.
    pub by_point: SMatrix<f64, 2, 3>,
}

impl Interior {
    /// Square pixels, principal point given, no distortion.
    pub fn simple(focal_px: f64, principal_px: [f64; 2]) -> Self {
        let mut x = SVector::zeros();
        x[0] = focal_px.ln();
        x[2] = principal_px[0];
        x[3] = principal_px[1];
        Self(x)
    }

    /// The interior of a pinhole camera; none for an orthographic one.
    pub fn of(projection: &Projection) -> Option<Self> {
        let Projection::Pinhole { focal_px: [fx, fy], principal_px: [cx, cy], distortion: [k1, k2, p1, p2, k3] } =
            *projection
        else {
            return None;
        };
        Some(Self(SVector::from([fx.ln(), (fy / fx).ln(), cx, cy, k1, k2, p1, p2, k3])))
    }

    /// As the camera model of the other modules.
    pub fn projection(&self) -> Projection {
        let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = self.values();
        Projection::Pinhole { focal_px: [fx, fy], principal_px: [cx, cy], distortion: [k1, k2, p1, p2, k3] }
    }

    /// Values in the order of [`NAMES`]: pixels, and the dimensionless coefficients of Brown's distortion.
    pub fn values(&self) -> [f64; UNKNOWNS] {
        let mut values: [f64; UNKNOWNS] = self.0.into();
        values[1] = (self.0[0] + self.0[1]).exp();
        values[0] = self.0[0].exp();
        values
    }

    /// Derivatives of [`Interior::values`] by the unknowns.
    pub(super) fn values_by_unknowns(&self) -> SMatrix<f64, UNKNOWNS, UNKNOWNS> {
        let [fx, fy, ..] = self.values();
        let mut jacobian = SMatrix::identity();
        jacobian[(0, 0)] = fx;
        jacobian[(1, 0)] = fy;
        jacobian[(1, 1)] = fy;
        jacobian
    }

    /// Projects a point of the camera frame; none unless it lies in front of the camera.
    pub(super) fn project(&self, point: &Vec3) -> Option<Projected> {
        if point.z.is_nan() || point.z <= 0.0 {
            return None;
        }
        let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = self.values();
        let (u, v) = (point.x / point.z, point.y / point.z);
        let r2 = u * u + v * v;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let x = u * radial + 2.0 * p1 * u * v + p2 * (r2 + 2.0 * u * u);
        let y = v * radial + p1 * (r2 + 2.0 * v * v) + 2.0 * p2 * u * v;
        let mixed = 2.0 * (u * v * slope + p1 * u + p2 * v);
        let x_by_u = radial + 2.0 * u * u * slope + 2.0 * p1 * v + 6.0 * p2 * u;
        let y_by_v = radial + 2.0 * v * v * slope + 6.0 * p1 * v + 2.0 * p2 * u;
        #[rustfmt::skip]
        let by_interior = SMatrix::<f64, 2, UNKNOWNS>::from_row_slice(&[
            fx * x, 0.0,    1.0, 0.0, fx * u * r2, fx * u * r2 * r2, fx * 2.0 * u * v, fx * (r2 + 2.0 * u * u), fx * u * r2 * r2 * r2,
            fy * y, fy * y, 0.0, 1.0, fy * v * r2, fy * v * r2 * r2, fy * (r2 + 2.0 * v * v), fy * 2.0 * u * v, fy * v * r2 * r2 * r2,
        ]);
        let depth = 1.0 / point.z;
        #[rustfmt::skip]
        let by_point = SMatrix::<f64, 2, 3>::from_row_slice(&[
            fx * x_by_u * depth, fx * mixed * depth, -fx * (x_by_u * u + mixed * v) * depth,
            fy * mixed * depth, fy * y_by_v * depth, -fy * (mixed * u + y_by_v * v) * depth,
        ]);
        Some(Projected { pixel: Vector2::new(fx * x + cx, fy * y + cy), by_interior, by_point })
    }
}

/// A group of unknowns that is freed or held together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freedom {
    /// One focal length for both directions.
    Focal,
    /// Principal point; held at the image's centre.
    PrincipalPoint,
    /// First radial term; held at 0.
    K1,
    /// Second radial term; held at 0.
    K2,
    /// Tangential terms p1 and p2; held at 0.
    Tangential,
    /// Third radial term; held at 0.
    K3,
    /// Ratio of the focal lengths; held at 1: square pixels.
    Aspect,
}

impl Freedom {
    /// Every freedom but the focal length, which is always free.
    pub const OPTIONAL: [Self; 6] =
        [Self::PrincipalPoint, Self::K1, Self::K2, Self::Tangential, Self::K3, Self::Aspect];

    /// Indices of its unknowns, also those of [`NAMES`].
    pub fn unknowns(self) -> &'static [usize] {
        match self {
            Self::Focal => &[0],
            Self::Aspect => &[1],
            Self::PrincipalPoint => &[2, 3],
            Self::K1 => &[4],
            Self::K2 => &[5],
            Self::Tangential => &[6, 7],
            Self::K3 => &[8],
        }
    }

    /// What must be free before: a higher radial term means nothing without the lower, and tangential terms would stand in for
    /// a principal point that is held in the wrong place.
    pub fn needs(self) -> Option<Self> {
        match self {
            Self::K2 => Some(Self::K1),
            Self::K3 => Some(Self::K2),
            Self::Tangential => Some(Self::PrincipalPoint),
            _ => None,
        }
    }

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Focal => "focal length",
            Self::PrincipalPoint => "principal point",
            Self::K1 => "radial distortion k1",
            Self::K2 => "radial distortion k2",
            Self::Tangential => "tangential distortion p1, p2",
            Self::K3 => "radial distortion k3",
            Self::Aspect => "ratio of the focal lengths fy / fx",
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn lens() -> Interior {
        Interior(SVector::from([800_f64.ln(), 0.02, 321.0, 243.0, -0.28, 0.11, 1.2e-3, -0.7e-3, -0.05]))
    }

    const POINT: [f64; 3] = [310.0, -170.0, 1000.0];

    #[test]
    fn projects_as_the_camera_model_of_the_other_modules() {
        let point = Vec3::from(POINT);
        let expected = lens().projection().project(&point);
        let found = lens().project(&point).unwrap().pixel;
        assert!((found.x - expected[0]).abs() < 1e-9 && (found.y - expected[1]).abs() < 1e-9);
        assert!((Interior::of(&lens().projection()).unwrap().0 - lens().0).norm() < 1e-12);
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        let (point, h) = (Vec3::from(POINT), 1e-6);
        let projected = lens().project(&point).unwrap();
        for i in 0..UNKNOWNS {
            let at = |step: f64| {
                let mut moved = lens();
                moved.0[i] += step;
                moved.project(&point).unwrap().pixel
            };
            let numeric = (at(h) - at(-h)) / (2.0 * h);
            assert!((numeric - projected.by_interior.column(i)).norm() < 1e-5, "{}: {numeric}", NAMES[i]);
        }
        for i in 0..3 {
            let at = |step: f64| lens().project(&(point + Vec3::ith(i, step))).unwrap().pixel;
            let numeric = (at(1e-3) - at(-1e-3)) / 2e-3;
            assert!((numeric - projected.by_point.column(i)).norm() < 1e-6, "{i}: {numeric}");
        }
    }

    #[test]
    fn a_point_behind_the_camera_has_no_picture() {
        for z in [-1.0, 0.0, f64::NAN] {
            assert!(lens().project(&Vec3::new(1.0, 2.0, z)).is_none());
        }
    }
}
