//! The circle on which the arm carries the lamp: lamp = centre + frame * radius * (cos, sin, 0) of the arm's angle.

use crate::numerics::geometry::Vec3;
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3};

/// The arm's circle.
#[derive(Clone, Debug, PartialEq)]
pub struct Circle {
    /// Centre, mm.
    pub center: Vec3,
    /// Columns: the lamp's direction from the centre at angle 0, at 90 degrees, and the axis about which positive angles turn.
    pub frame: Matrix3<f64>,
    /// Radius, mm.
    pub radius: f64,
}

impl Circle {
    /// Where the lamp is with the arm at `angle` (radians).
    pub fn lamp(&self, angle: f64) -> Vec3 {
        let (sin, cos) = angle.sin_cos();
        self.center + self.frame * Vec3::new(cos, sin, 0.0) * self.radius
    }

    /// The circle through positions at known angles (radians), by linear least squares: the nearest turned and scaled frame to
    /// the best affine one. None for fewer than three angles that differ by a degree.
    pub fn through(lamps: &[(f64, Vec3)]) -> Option<Self> {
        let mut angles: Vec<f64> = lamps.iter().map(|(angle, _)| angle.to_degrees()).collect();
        angles.sort_by(f64::total_cmp);
        angles.dedup_by(|a, b| (*a - *b).abs() < 1.0);
        if angles.len() < 3 {
            return None;
        }
        let design = DMatrix::from_fn(lamps.len(), 3, |i, j| [1.0, lamps[i].0.cos(), lamps[i].0.sin()][j]);
        let decomposed = design.svd(true, true);
        let column = |axis: usize| {
            let right = DVector::from_fn(lamps.len(), |i, _| lamps[i].1[axis]);
            decomposed.solve(&right, 1e-9).ok()
        };
        let (x, y, z) = (column(0)?, column(1)?, column(2)?);
        let of = |k: usize| Vec3::new(x[k], y[k], z[k]);
        let affine = nalgebra::Matrix3x2::from_columns(&[of(1), of(2)]);
        let svd = affine.svd(true, true);
        let turned = svd.u? * svd.v_t?;
        let (u, v) = (turned.column(0).into_owned(), turned.column(1).into_owned());
        let radius = 0.5 * svd.singular_values.sum();
        (radius > 0.0).then(|| Self { center: of(0), frame: Matrix3::from_columns(&[u, v, u.cross(&v)]), radius })
    }

    /// The circle moved by small changes: centre, rotation vector, radius.
    pub(super) fn moved(&self, by: &[f64]) -> Self {
        let turn = Rotation3::from_scaled_axis(Vec3::new(by[3], by[4], by[5]));
        Self {
            center: self.center + Vec3::new(by[0], by[1], by[2]),
            frame: turn.matrix() * self.frame,
            radius: self.radius + by[6],
        }
    }

    /// Distance of a point from the circle, mm.
    pub fn distance(&self, point: &Vec3) -> f64 {
        let local = self.frame.transpose() * (point - self.center);
        (local.x.hypot(local.y) - self.radius).hypot(local.z)
    }
}
