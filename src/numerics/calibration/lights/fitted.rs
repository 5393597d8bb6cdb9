//! A fit of lights and balls: tests of what does not fit, covariance, and what it says.

use super::arm::Circle;
use super::joint::{Joint, Linear, Place, Sighting, State};
use super::mirror::highlight;
use super::outline::median;
use super::solve::{Item, Lamp, Misfit, Scene, SolveError, Solved, SolvedCircle};
use crate::numerics::geometry::Vec3;
use nalgebra::{DMatrix, DVector, Matrix3};

/// A minimum and its linear model.
pub(super) struct Fit {
    state: State,
    linear: Linear,
    /// Inverse of the normal matrix.
    inverse: DMatrix<f64>,
    /// Derivative of every lamp's position by the unknowns.
    lamps: Vec<DMatrix<f64>>,
    scale: f64,
}

/// Fits with the highlights' scale that the median of their residuals asks for, which outliers hardly move.
pub(super) fn fit(scene: &Scene<'_>, places: &[Place], circle: Option<&Circle>) -> Result<Fit, SolveError> {
    let mut scale = 1.0;
    let mut x: Option<DVector<f64>> = None;
    for round in 0..4 {
        let joint = joint(scene, places, circle, scale);
        let start = x.unwrap_or_else(|| DVector::zeros(joint.unknowns()));
        let found = joint.minimise(&start).x;
        let linear = joint.linear(&found).ok_or(SolveError::Undetermined)?;
        let inverse = invert(&linear.jacobian.tr_mul(&linear.jacobian)).ok_or(SolveError::Undetermined)?;
        let fit = Fit {
            state: joint.state(&found),
            lamps: (0..places.len()).map(|light| joint.lamp_jacobian(&found, light)).collect(),
            inverse,
            linear,
            scale,
        };
        let wanted = (scale * fit.robust_scale(2 * scene.sightings.len())).max(1.0);
        if round == 3 || (wanted / scale - 1.0).abs() < 0.02 {
            return Ok(fit);
        }
        scale = wanted;
        x = Some(found);
    }
    Err(SolveError::Undetermined)
}

fn joint<'a>(scene: &'a Scene<'_>, places: &'a [Place], circle: Option<&'a Circle>, scale: f64) -> Joint<'a> {
    Joint {
        projection: scene.projection,
        balls: &scene.balls,
        sightings: &scene.sightings,
        places,
        circle: circle.filter(|_| places.iter().any(|p| matches!(p, Place::Arm(_)))),
        angle_sigma: scene.angle_sigma,
        scale,
    }
}

/// Inverse of a positive definite matrix of mixed units: scaled to a unit diagonal first.
fn invert(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale = matrix.diagonal().map(|d| d.sqrt().recip());
    if !scale.iter().all(|s| s.is_finite()) {
        return None;
    }
    let scaled = DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] * scale[i] * scale[j]);
    let inverse = scaled.cholesky()?.inverse();
    Some(DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| inverse[(i, j)] * scale[i] * scale[j]))
}

impl Fit {
    /// Share of every residual's variance that the fit leaves.
    fn redundancy(&self, row: usize) -> f64 {
        let own = self.linear.jacobian.row(row);
        (1.0 - (own * &self.inverse * own.transpose())[(0, 0)]).max(0.0)
    }

    fn robust_scale(&self, highlight_rows: usize) -> f64 {
        let standardised = (0..highlight_rows).filter_map(|row| {
            let left = self.redundancy(row);
            (left > 1e-3).then(|| self.linear.residuals[row].abs() / left.sqrt())
        });
        1.4826 * median(standardised.collect())
    }

    fn freedom(&self) -> usize {
        self.linear.residuals.len() - self.linear.jacobian.ncols().min(self.linear.residuals.len())
    }

    /// By how much chi^2 falls if the residuals may shift along `columns`, and how many shifts that are; the statistic of it.
    fn test(&self, columns: &DMatrix<f64>) -> f64 {
        let projected = self.linear.jacobian.tr_mul(columns);
        let matrix = columns.tr_mul(columns) - projected.transpose() * &self.inverse * &projected;
        let right = columns.tr_mul(&self.linear.residuals);
        // Directions that the fit follows anyway cannot be tested.
        let eigen = matrix.symmetric_eigen();
        let least = 1e-6 * columns.norm_squared();
        let (mut gain, mut shifts) = (0.0, 0);
        for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value > least {
                gain += vector.dot(&right).powi(2) / value;
                shifts += 1;
            }
        }
        let chi2 = self.linear.residuals.norm_squared();
        if shifts == 0 || self.freedom() <= shifts {
            return 0.0;
        }
        let rest = ((chi2 - gain) / (self.freedom() - shifts) as f64).max(1.0);
        gain / shifts as f64 / rest
    }

    /// What fits worst.
    pub(super) fn worst(&self, scene: &Scene<'_>, places: &[Place]) -> Option<Misfit> {
        let rows = self.linear.residuals.len();
        let unit =
            |first: usize, count: usize| DMatrix::from_fn(rows, count, |i, j| if i == first + j { 1.0 } else { 0.0 });
        let mut tests = Vec::new();
        for (i, s) in scene.sightings.iter().enumerate() {
            tests.push((Item::Highlight(s.light, s.ball), self.test(&unit(2 * i, 2))));
        }
        let priors = 2 * scene.sightings.len();
        for ball in 0..scene.balls.len() {
            tests.push((Item::Ball(ball), self.test(&unit(priors + 3 * ball, 3))));
        }
        for (light, place) in places.iter().enumerate() {
            if matches!(place, Place::Arm(_)) {
                tests.push((Item::Light(light), self.test(&self.off_circle(scene, light))));
            }
        }
        let worst = tests.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(Misfit { item: worst.0, statistic: worst.1, left_out: false })
    }

    /// How the residuals change if a light moves off the circle: by its position, from the lamp's own derivatives.
    fn off_circle(&self, scene: &Scene<'_>, light: usize) -> DMatrix<f64> {
        let mut columns = DMatrix::zeros(self.linear.residuals.len(), 3);
        let radius = |s: &Sighting| scene.balls[s.ball].radius;
        for (i, s) in scene.sightings.iter().enumerate().filter(|(_, s)| s.light == light) {
            let ball = &self.state.balls[s.ball];
            for k in 0..3 {
                let seen = |sign: f64| {
                    let mut lamp = self.state.lamps[light];
                    lamp[k] += sign * 0.1;
                    highlight(scene.projection, ball, radius(s), &lamp)
                };
                if let (Some(after), Some(before)) = (seen(1.0), seen(-1.0)) {
                    for c in 0..2 {
                        columns[(2 * i + c, k)] = (after[c] - before[c]) / (0.2 * s.sigma_px * self.scale);
                    }
                }
            }
        }
        columns
    }

    /// Factor by which the covariance must grow so that the highlights' residuals are as large as they are, at least 1; the mean
    /// over what the variance may be after so few residuals.
    fn spread(&self, highlight_rows: usize) -> f64 {
        let left: f64 = (0..highlight_rows).map(|row| self.redundancy(row)).sum();
        let square = self.linear.residuals.rows(0, highlight_rows).norm_squared();
        if left > 3.0 { (square / left * left / (left - 2.0)).max(1.0 / (self.scale * self.scale)) } else { 1.0 }
    }

    pub(super) fn solved(&self, scene: &Scene<'_>, places: &[Place], starts: &[Vec3], misfits: Vec<Misfit>) -> Solved {
        let rows = 2 * scene.sightings.len();
        let spread = self.spread(rows);
        let inverse = &self.inverse * spread;
        let circle = self.state.circle.as_ref().map(|circle| self.solved_circle(scene, circle, &inverse));
        let lamp = |light: usize| {
            let d = &self.lamps[light];
            let covariance = d * &inverse * d.transpose();
            Lamp {
                position: self.state.lamps[light],
                covariance: Matrix3::from_fn(|i, j| 0.5 * (covariance[(i, j)] + covariance[(j, i)])),
                circle_residual: circle.as_ref().map(|c| c.circle.distance(&starts[light])),
                highlights: scene.sightings.iter().filter(|s| s.light == light).count(),
            }
        };
        let pixels: f64 = (0..rows)
            .map(|row| (self.linear.residuals[row] * self.scale * scene.sightings[row / 2].sigma_px).powi(2))
            .sum();
        let given = self.linear.residuals.rows(0, rows).norm_squared() * self.scale * self.scale
            + self.linear.residuals.rows(rows, self.linear.residuals.len() - rows).norm_squared();
        Solved {
            lamps: (0..places.len()).map(lamp).collect(),
            balls: (0..scene.balls.len())
                .map(|b| (self.state.balls[b], inverse.fixed_view::<3, 3>(3 * b, 3 * b).into_owned()))
                .collect(),
            circle,
            rms_px: (pixels / rows.max(1) as f64).sqrt(),
            chi2: given,
            freedom: self.freedom(),
            scale: self.scale * spread.sqrt(),
            misfits,
        }
    }

    fn solved_circle(&self, scene: &Scene<'_>, circle: &Circle, inverse: &DMatrix<f64>) -> SolvedCircle {
        let at = 3 * scene.balls.len();
        let own = inverse.view((at, at), (7, 7));
        let turn = own.fixed_view::<3, 3>(3, 3).into_owned();
        // Turns about the axis itself do not tilt it.
        let axis = circle.frame.column(2).into_owned();
        let across = Matrix3::identity() - axis * axis.transpose();
        let tilt = (across * turn * across).symmetric_eigenvalues().max();
        SolvedCircle {
            circle: circle.clone(),
            center_sigma: Vec3::from_fn(|k, _| own[(k, k)].max(0.0).sqrt()),
            radius_sigma: own[(6, 6)].max(0.0).sqrt(),
            axis_sigma: tilt.max(0.0).sqrt(),
        }
    }
}
