//! The outline of a sphere: the cone of sight rays that touch it (pinhole), or a circle (orthographic).

use crate::numerics::geometry::{Projection, Vec3};
use nalgebra::{Matrix3, Vector2};

/// The outline of a ball in an image.
#[derive(Clone, Debug, PartialEq)]
pub enum Outline {
    /// Unit rays q on the outline obey q . w = 1; |w| = 1 / cos of the half opening angle.
    Cone {
        /// Axis, scaled.
        w: Vec3,
    },
    /// Parallel projection shows a sphere as a circle.
    Circle {
        /// Centre, pixels.
        center: [f64; 2],
        /// Radius, pixels.
        radius: f64,
    },
}

/// A point measured on an outline.
#[derive(Clone, Copy, Debug)]
pub struct EdgePoint {
    /// Pixel coordinates.
    pub at: [f64; 2],
    /// Standard deviation across the outline, pixels; only ratios matter.
    pub sigma: f64,
}

/// An outline fitted to edge points.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// The outline.
    pub outline: Outline,
    /// Covariance of its three unknowns: w, or centre and radius; from the scatter of the points.
    pub covariance: Matrix3<f64>,
    /// Weighted rms distance of the points that fit, pixels.
    pub rms_px: f64,
    /// Share of the points that fit: within three robust standard deviations.
    pub inliers: f64,
}

impl Outline {
    /// A nearly circular outline about `center` with `radius`, pixels.
    pub fn from_circle(projection: &Projection, center: [f64; 2], radius: f64) -> Self {
        match projection {
            Projection::Orthographic { .. } => Self::Circle { center, radius },
            Projection::Pinhole { .. } => {
                let axis = projection.ray(center[0], center[1]).direction;
                let edge = projection.ray(center[0] + radius, center[1]).direction;
                Self::Cone { w: axis / axis.dot(&edge) }
            }
        }
    }

    /// The sphere of this outline: of `radius_mm` in millimetres, or with its own radius in pixels at z = 0 where parallel
    /// rays tell no depth. None for a cone that opens nowhere.
    pub fn sphere_center(&self, radius_mm: f64) -> Option<Vec3> {
        match self {
            Self::Circle { center, .. } => Some(Vec3::new(center[0], center[1], 0.0)),
            Self::Cone { w } => {
                let spread = w.norm_squared() - 1.0;
                (spread > 0.0).then(|| w * (radius_mm / spread.sqrt()))
            }
        }
    }

    /// Derivative of [`Outline::sphere_center`] by w; zero for a circle.
    pub fn center_jacobian(&self, radius_mm: f64) -> Matrix3<f64> {
        match self {
            Self::Circle { .. } => Matrix3::zeros(),
            Self::Cone { w } => {
                let spread = w.norm_squared() - 1.0;
                (Matrix3::identity() - w * w.transpose() / spread) * (radius_mm / spread.sqrt())
            }
        }
    }

    /// The outline's point at angle `phi` (pixels) and the unit normal there, outwards.
    pub fn point(&self, projection: &Projection, phi: f64) -> ([f64; 2], [f64; 2]) {
        let (sin, cos) = phi.sin_cos();
        match self {
            Self::Circle { center, radius } => ([center[0] + radius * cos, center[1] + radius * sin], [cos, sin]),
            Self::Cone { w } => {
                let on = |grow: f64| projection.project(&cone_ray(w, sin, cos, grow));
                let (at, beyond, after) = (on(1.0), on(1.001), {
                    let (sin, cos) = (phi + 1e-3).sin_cos();
                    projection.project(&cone_ray(w, sin, cos, 1.0))
                });
                let tangent = Vector2::new(after[0] - at[0], after[1] - at[1]).normalize();
                let mut normal = Vector2::new(tangent.y, -tangent.x);
                if normal.dot(&Vector2::new(beyond[0] - at[0], beyond[1] - at[1])) < 0.0 {
                    normal = -normal;
                }
                (at, [normal.x, normal.y])
            }
        }
    }

    /// Mean radius, pixels.
    pub fn radius_px(&self, projection: &Projection) -> f64 {
        let distance = |phi: f64| {
            let ([a, b], [c, d]) =
                (self.point(projection, phi).0, self.point(projection, phi + std::f64::consts::PI).0);
            0.5 * (a - c).hypot(b - d)
        };
        0.5 * (distance(0.0) + distance(0.5 * std::f64::consts::PI))
    }

    /// Centre of the outline in the image, pixels.
    pub fn center_px(&self, projection: &Projection) -> [f64; 2] {
        match self {
            Self::Circle { center, .. } => *center,
            Self::Cone { .. } => {
                let ([a, b], [c, d]) = (self.point(projection, 0.0).0, self.point(projection, std::f64::consts::PI).0);
                [0.5 * (a + c), 0.5 * (b + d)]
            }
        }
    }

    /// Signed distance of a pixel from the outline, pixels, positive outside; exact near the outline.
    pub fn distance(&self, projection: &Projection, at: [f64; 2]) -> f64 {
        match self {
            Self::Circle { center, radius } => (at[0] - center[0]).hypot(at[1] - center[1]) - radius,
            Self::Cone { w } => {
                let q = projection.ray(at[0], at[1]).direction;
                let half_angle = (1.0 / w.norm()).min(1.0).acos();
                let angle = w.cross(&q).norm().atan2(w.dot(&q));
                // Pixels an angle spans along this radius: the outline's own scale.
                (angle - half_angle) * self.radius_px(projection) / half_angle.tan()
            }
        }
    }
}

/// The ray at angle phi of the cone whose half angle is opened by the factor `grow`.
fn cone_ray(w: &Vec3, sin: f64, cos: f64, grow: f64) -> Vec3 {
    let u = w.normalize();
    let e1 = Vec3::y().cross(&u).normalize();
    let e2 = u.cross(&e1);
    let (sin_a, cos_a) = ((1.0 / w.norm()).min(1.0).acos() * grow).sin_cos();
    u * cos_a + (e1 * cos + e2 * sin) * sin_a
}

/// Fits the outline to points by weighted linear least squares (q . w = 1, or Kasa's circle), iteratively reweighted against
/// outliers (Cauchy). None with fewer than 6 points or points that span no outline.
pub fn fit(projection: &Projection, points: &[EdgePoint]) -> Option<Fitted> {
    if points.len() < 6 {
        return None;
    }
    let rows: Vec<(Vec3, f64)> = points.iter().map(|p| row(projection, p.at)).collect();
    let mut weights: Vec<f64> = points.iter().map(|p| p.sigma.powi(-2)).collect();
    let mut solution = solve(&rows, &weights)?;
    let mut scale = 0.0;
    for _ in 0..20 {
        let outline = outline_of(projection, &solution)?;
        let residuals = distances(projection, &outline, points);
        let standardised = residuals.iter().zip(points).map(|(r, p)| (r / p.sigma).abs());
        scale = 1.4826 * median(standardised.collect()).max(1e-9);
        for (weight, (r, p)) in weights.iter_mut().zip(residuals.iter().zip(points)) {
            let t = r / (p.sigma * 2.385 * scale);
            *weight = p.sigma.powi(-2) / (1.0 + t * t);
        }
        solution = solve(&rows, &weights)?;
    }
    let outline = outline_of(projection, &solution)?;
    let residuals = distances(projection, &outline, points);
    let fits = |i: &usize| residuals[*i].abs() < 3.0 * scale * points[*i].sigma;
    let inside: Vec<usize> = (0..points.len()).filter(fits).collect();
    let total: f64 = inside.iter().map(|&i| points[i].sigma.powi(-2)).sum();
    let square: f64 = inside.iter().map(|&i| (residuals[i] / points[i].sigma).powi(2)).sum();
    if inside.len() < 6 {
        return None;
    }
    let variance = square / (inside.len() - 3) as f64;
    // In pixels a residual of the linear system is a distance times `slope`.
    let slope = slope(projection, &outline);
    let normal = inside
        .iter()
        .fold(Matrix3::zeros(), |sum, &i| sum + rows[i].0 * rows[i].0.transpose() * points[i].sigma.powi(-2));
    let linear = normal.try_inverse()? * (variance * slope * slope);
    let covariance = match &outline {
        Outline::Cone { .. } => linear,
        Outline::Circle { center, radius } => {
            // radius^2 = s2 + c . c for the unknowns (c, s2).
            let to = Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, center[0] / radius, center[1] / radius, 0.5 / radius);
            to * linear * to.transpose()
        }
    };
    let share = inside.len() as f64 / points.len() as f64;
    Some(Fitted { outline, covariance, rms_px: (square / total).sqrt(), inliers: share })
}

/// One equation row . x = right of the linear problem.
fn row(projection: &Projection, at: [f64; 2]) -> (Vec3, f64) {
    match projection {
        Projection::Pinhole { .. } => (projection.ray(at[0], at[1]).direction, 1.0),
        Projection::Orthographic { .. } => (Vec3::new(2.0 * at[0], 2.0 * at[1], 1.0), at[0] * at[0] + at[1] * at[1]),
    }
}

fn outline_of(projection: &Projection, x: &Vec3) -> Option<Outline> {
    match projection {
        Projection::Pinhole { .. } => (x.norm_squared() > 1.0).then_some(Outline::Cone { w: *x }),
        Projection::Orthographic { .. } => {
            let square = x.z + x.x * x.x + x.y * x.y;
            (square > 0.0).then(|| Outline::Circle { center: [x.x, x.y], radius: square.sqrt() })
        }
    }
}

/// Change of the linear residual per pixel across the outline.
fn slope(projection: &Projection, outline: &Outline) -> f64 {
    match outline {
        Outline::Circle { radius, .. } => 2.0 * radius,
        // d cos(angle) / cos(half) = -tan(half) d angle, and a pixel is an angle of tan(half) / radius.
        Outline::Cone { w } => (w.norm_squared() - 1.0) / outline.radius_px(projection),
    }
}

fn distances(projection: &Projection, outline: &Outline, points: &[EdgePoint]) -> Vec<f64> {
    let slope = slope(projection, outline);
    let of = |p: &EdgePoint| match outline {
        Outline::Circle { .. } => outline.distance(projection, p.at),
        Outline::Cone { w } => (1.0 - projection.ray(p.at[0], p.at[1]).direction.dot(w)) / slope,
    };
    points.iter().map(of).collect()
}

fn solve(rows: &[(Vec3, f64)], weights: &[f64]) -> Option<Vec3> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vec3::zeros());
    for ((row, b), weight) in rows.iter().zip(weights) {
        normal += row * row.transpose() * *weight;
        right += row * (*b * *weight);
    }
    // A unit diagonal keeps the digits: rays of a long lens are nearly parallel.
    let scale = Vec3::new(normal[(0, 0)], normal[(1, 1)], normal[(2, 2)]).map(|d| d.max(1e-300).sqrt().recip());
    let scaled = Matrix3::from_fn(|i, j| normal[(i, j)] * scale[i] * scale[j]);
    Some(scaled.cholesky()?.solve(&right.component_mul(&scale)).component_mul(&scale))
}

pub(super) fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return 0.0;
    }
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
