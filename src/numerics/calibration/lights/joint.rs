//! Joint least squares of ball centres and lamps, by the highlights' places in the image.
//!
//! Unknowns: three a ball, seven of the arm's circle (centre, rotation, radius), one a lamp on the arm (its angle's deviation
//! from the encoder), three a lamp that stands free. Residuals, all in standard deviations: highlights (x, y), ball centres
//! against their outlines, angles against the encoder.

use super::arm::Circle;
use super::mirror::highlight;
use crate::numerics::fit::levmar::{Bounds, Normal, Outcome, Problem, Stop, minimise};
use crate::numerics::geometry::{Projection, Vec3};
use nalgebra::{DMatrix, DVector, Matrix3};

/// A ball as its outline shows it.
#[derive(Clone, Debug)]
pub struct SeenBall {
    /// Centre, mm.
    pub center: Vec3,
    /// Covariance, mm^2.
    pub covariance: Matrix3<f64>,
    /// Radius, mm.
    pub radius: f64,
}

/// A highlight seen on a ball.
#[derive(Clone, Copy, Debug)]
pub struct Sighting {
    /// Index of the lamp.
    pub light: usize,
    /// Index of the ball.
    pub ball: usize,
    /// Pixel coordinates.
    pub at: [f64; 2],
    /// Standard deviation of each coordinate, pixels.
    pub sigma_px: f64,
}

/// Where a lamp is looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// On the arm's circle at this angle, radians.
    Arm(f64),
    /// Anywhere; the point the search starts from.
    Free(Vec3),
}

/// The problem of one calibration.
pub(super) struct Joint<'a> {
    pub projection: &'a Projection,
    pub balls: &'a [SeenBall],
    pub sightings: &'a [Sighting],
    pub places: &'a [Place],
    /// Where the search for the circle starts; needed when a lamp is on the arm.
    pub circle: Option<&'a Circle>,
    /// Standard deviation of the encoder, radians.
    pub angle_sigma: f64,
    /// Factor on the standard deviations of all highlights.
    pub scale: f64,
}

/// Residuals and their derivatives.
pub(super) struct Linear {
    pub residuals: DVector<f64>,
    pub jacobian: DMatrix<f64>,
}

/// The state that a vector of unknowns means.
pub(super) struct State {
    pub balls: Vec<Vec3>,
    pub lamps: Vec<Vec3>,
    pub circle: Option<Circle>,
}

impl Joint<'_> {
    fn circle_at(&self) -> usize {
        3 * self.balls.len()
    }

    /// First unknown of every lamp, and the number of all.
    fn lamps_at(&self) -> (Vec<usize>, usize) {
        let mut next = self.circle_at() + if self.circle.is_some() { 7 } else { 0 };
        let mut starts = Vec::new();
        for place in self.places {
            starts.push(next);
            next += if matches!(place, Place::Arm(_)) { 1 } else { 3 };
        }
        (starts, next)
    }

    pub(super) fn unknowns(&self) -> usize {
        self.lamps_at().1
    }

    /// Row of the first prior of a ball.
    pub(super) fn prior_row(&self, ball: usize) -> usize {
        2 * self.sightings.len() + 3 * ball
    }

    pub(super) fn state(&self, x: &DVector<f64>) -> State {
        let balls = (0..self.balls.len()).map(|b| self.balls[b].center + x.fixed_rows::<3>(3 * b)).collect();
        let circle = self.circle.map(|c| c.moved(x.rows(self.circle_at(), 7).into_owned().as_slice()));
        let (starts, _) = self.lamps_at();
        let lamp = |i: usize| match (self.places[i], &circle) {
            (Place::Arm(angle), Some(circle)) => circle.lamp(angle + x[starts[i]]),
            (Place::Free(start), _) => start + x.fixed_rows::<3>(starts[i]),
            // A lamp on no circle is not made.
            (Place::Arm(_), None) => Vec3::zeros(),
        };
        State { lamps: (0..self.places.len()).map(lamp).collect(), balls, circle }
    }

    /// Derivative of a lamp's position by all unknowns.
    pub(super) fn lamp_jacobian(&self, x: &DVector<f64>, light: usize) -> DMatrix<f64> {
        let (starts, unknowns) = self.lamps_at();
        let mut jacobian = DMatrix::zeros(3, unknowns);
        let start = starts[light];
        match (self.places[light], self.circle) {
            (Place::Arm(angle), Some(circle)) => {
                let at = self.circle_at();
                let moved = circle.moved(x.rows(at, 7).into_owned().as_slice());
                let turned = angle + x[start];
                for k in 0..7 {
                    // Central differences: the rotation vector has no handy derivative away from zero.
                    let h = if (3..6).contains(&k) { 1e-5 } else { 1e-2 };
                    let lamp = |sign: f64| {
                        let mut by = x.rows(at, 7).into_owned();
                        by[k] += sign * h;
                        circle.moved(by.as_slice()).lamp(turned)
                    };
                    jacobian.set_column(at + k, &((lamp(1.0) - lamp(-1.0)) / (2.0 * h)));
                }
                let (sin, cos) = turned.sin_cos();
                jacobian.set_column(start, &(moved.frame * Vec3::new(-sin, cos, 0.0) * moved.radius));
            }
            _ => jacobian.view_mut((0, start), (3, 3)).copy_from(&Matrix3::identity()),
        }
        jacobian
    }

    /// Residual of a highlight (in standard deviations) and its derivatives by ball and lamp; none if it cannot be seen.
    fn sighting(&self, sighting: &Sighting, ball: &Vec3, lamp: &Vec3) -> Option<([f64; 2], DMatrix<f64>)> {
        let sigma = sighting.sigma_px * self.scale;
        let radius = self.balls[sighting.ball].radius;
        let seen = |ball: &Vec3, lamp: &Vec3| highlight(self.projection, ball, radius, lamp);
        let at = seen(ball, lamp)?;
        let mut jacobian = DMatrix::zeros(2, 6);
        for k in 0..6 {
            let h = if k < 3 { 1e-3 } else { 1e-1 };
            let moved = |sign: f64| {
                let (mut ball, mut lamp) = (*ball, *lamp);
                if k < 3 {
                    ball[k] += sign * h
                } else {
                    lamp[k - 3] += sign * h
                }
                seen(&ball, &lamp)
            };
            let (after, before) = (moved(1.0)?, moved(-1.0)?);
            for c in 0..2 {
                jacobian[(c, k)] = (after[c] - before[c]) / (2.0 * h * sigma);
            }
        }
        Some(([(at[0] - sighting.at[0]) / sigma, (at[1] - sighting.at[1]) / sigma], jacobian))
    }

    /// Residuals at x; none where a highlight could not be seen.
    pub(super) fn linear(&self, x: &DVector<f64>) -> Option<Linear> {
        let state = self.state(x);
        let (starts, unknowns) = self.lamps_at();
        let arms: Vec<usize> = (0..self.places.len()).filter(|&i| matches!(self.places[i], Place::Arm(_))).collect();
        let rows = 2 * self.sightings.len() + 3 * self.balls.len() + arms.len();
        let mut residuals = DVector::zeros(rows);
        let mut jacobian = DMatrix::zeros(rows, unknowns);
        let lamps: Vec<DMatrix<f64>> = (0..self.places.len()).map(|light| self.lamp_jacobian(x, light)).collect();
        for (i, sighting) in self.sightings.iter().enumerate() {
            let (own, by) = self.sighting(sighting, &state.balls[sighting.ball], &state.lamps[sighting.light])?;
            residuals[2 * i] = own[0];
            residuals[2 * i + 1] = own[1];
            let through_lamp = by.columns(3, 3) * &lamps[sighting.light];
            jacobian.rows_mut(2 * i, 2).copy_from(&through_lamp);
            let mut ball = jacobian.view_mut((2 * i, 3 * sighting.ball), (2, 3));
            ball += by.columns(0, 3);
        }
        for (b, ball) in self.balls.iter().enumerate() {
            let whiten = whitening(&ball.covariance)?;
            let row = self.prior_row(b);
            residuals.fixed_rows_mut::<3>(row).copy_from(&(whiten * (state.balls[b] - ball.center)));
            jacobian.view_mut((row, 3 * b), (3, 3)).copy_from(&whiten);
        }
        for (k, &light) in arms.iter().enumerate() {
            let row = self.prior_row(self.balls.len()) + k;
            residuals[row] = x[starts[light]] / self.angle_sigma;
            jacobian[(row, starts[light])] = 1.0 / self.angle_sigma;
        }
        Some(Linear { residuals, jacobian })
    }

    /// Minimises from x.
    pub(super) fn minimise(&self, x: &DVector<f64>) -> Outcome {
        let n = self.unknowns();
        let mut step = DVector::from_element(n, 300.0);
        if self.circle.is_some() {
            (3..6).for_each(|k| step[self.circle_at() + k] = 0.3);
        }
        let bounds = Bounds { lower: DVector::from_element(n, -1e6), upper: DVector::from_element(n, 1e6), step };
        minimise(self, x, &bounds, Stop { relative_decrease: 1e-10, iterations: 200 })
    }
}

/// A matrix that makes a variable of this covariance white.
fn whitening(covariance: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    covariance.cholesky()?.l().try_inverse()
}

impl Problem for Joint<'_> {
    fn normal(&self, x: &DVector<f64>) -> Normal {
        let n = self.unknowns();
        match self.linear(x) {
            Some(Linear { residuals, jacobian }) => Normal {
                cost: residuals.norm_squared(),
                gradient: jacobian.tr_mul(&residuals),
                hessian: jacobian.tr_mul(&jacobian),
            },
            None => Normal { cost: f64::INFINITY, gradient: DVector::zeros(n), hessian: DMatrix::identity(n, n) },
        }
    }

    fn noise(&self) -> f64 {
        1e-12
    }
}
