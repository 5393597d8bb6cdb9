//! From balls and highlights to light positions with their covariance, and what does not fit.

use super::arm::Circle;
use super::joint::{Joint, Linear, Place, SeenBall, Sighting, State};
use super::mirror::{meeting_point, mirror_ray};
use super::outline::median;
use crate::numerics::geometry::{Projection, Sphere, Vec3};
use nalgebra::{DMatrix, DVector, Matrix3};

/// What is to be solved.
#[derive(Clone, Debug)]
pub struct Scene<'a> {
    /// The camera; a pinhole.
    pub projection: &'a Projection,
    /// Balls as their outlines show them.
    pub balls: Vec<SeenBall>,
    /// Highlights.
    pub sightings: Vec<Sighting>,
    /// The arm's angle for every light, radians, where it is known.
    pub angles: Vec<Option<f64>>,
    /// Standard deviation of the encoder's angles, radians.
    pub angle_sigma: f64,
}

/// Something that does not fit the rest, with its test: a mean-shift test against the scatter of everything else (Baarda's data
/// snooping, externally studentised: leaves the item out without a new fit). Greater than 15 by chance once in 10 000 times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Misfit {
    /// What.
    pub item: Item,
    /// F statistic.
    pub statistic: f64,
    /// True if it was left out: the highlight or ball is not used, the light was taken off the circle.
    pub left_out: bool,
}

/// What may not fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Item {
    /// A highlight: light and ball.
    Highlight(usize, usize),
    /// A light that is not on the arm's circle at its angle.
    Light(usize),
    /// A ball whose outline and highlights disagree.
    Ball(usize),
}

/// A light's position.
#[derive(Clone, Debug)]
pub struct Lamp {
    /// Camera frame, mm.
    pub position: Vec3,
    /// mm^2.
    pub covariance: Matrix3<f64>,
    /// Distance of the plain meeting point of the mirror rays from the circle, mm; none without a circle.
    pub circle_residual: Option<f64>,
    /// Highlights used.
    pub highlights: usize,
}

/// The arm's circle and its standard deviations.
#[derive(Clone, Debug)]
pub struct SolvedCircle {
    /// The circle.
    pub circle: Circle,
    /// Of the centre, mm.
    pub center_sigma: Vec3,
    /// Of the radius, mm.
    pub radius_sigma: f64,
    /// Of the axis' direction, radians (the larger of two).
    pub axis_sigma: f64,
}

/// What was solved.
#[derive(Clone, Debug)]
pub struct Solved {
    /// Every light.
    pub lamps: Vec<Lamp>,
    /// Centres and covariances of the balls.
    pub balls: Vec<(Vec3, Matrix3<f64>)>,
    /// The arm's circle; none without three known angles.
    pub circle: Option<SolvedCircle>,
    /// Rms of the highlights' residuals, pixels (both coordinates).
    pub rms_px: f64,
    /// Sum of squared residuals in the standard deviations given.
    pub chi2: f64,
    /// Residuals minus unknowns.
    pub freedom: usize,
    /// Factor on the highlights' standard deviations that their residuals ask for; at least 1. The covariances contain it.
    pub scale: f64,
    /// What did not fit, in the order found.
    pub misfits: Vec<Misfit>,
}

/// Why nothing could be solved; lights and balls by index.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SolveError {
    /// Too few highlights.
    #[error("light {light} has {highlights} usable highlights, at least 2 are needed")]
    TooFewHighlights {
        /// The light.
        light: usize,
        /// How many it has.
        highlights: usize,
    },
    /// Rays that meet nowhere in front of the balls.
    #[error("the mirror rays of light {light} do not meet in front of its balls")]
    NoMeetingPoint {
        /// The light.
        light: usize,
    },
    /// The normal matrix is singular.
    #[error("the highlights do not determine the light positions")]
    Undetermined,
}

/// Statistic beyond which something does not fit.
const MISFIT: f64 = 15.0;
/// Most misfits looked for.
const MOST_MISFITS: usize = 10;

/// Solves for all lights.
///
/// # Errors
/// A light with fewer than two usable highlights or whose rays do not meet, or a singular problem.
pub fn solve(scene: &Scene<'_>) -> Result<Solved, SolveError> {
    let mut scene = scene.clone();
    let starts = scene.meeting_points()?;
    let mut places = scene.places(&starts);
    let mut misfits: Vec<Misfit> = Vec::new();
    loop {
        let circle = first_circle(&places, &starts);
        let fitted = fit(&scene, &places, circle.as_ref())?;
        let Some(mut misfit) = fitted.worst(&scene, &places).filter(|m| m.statistic > MISFIT) else {
            return Ok(fitted.solved(&scene, &places, &starts, misfits));
        };
        if misfits.iter().any(|known| known.item == misfit.item) || misfits.len() == MOST_MISFITS {
            return Ok(fitted.solved(&scene, &places, &starts, misfits));
        }
        misfit.left_out = scene.leave_out(misfit.item, &mut places, &starts);
        misfits.push(misfit);
        if !misfit.left_out {
            return Ok(fitted.solved(&scene, &places, &starts, misfits));
        }
    }
}

/// The circle through the lights on the arm, to start from.
fn first_circle(places: &[Place], starts: &[Vec3]) -> Option<Circle> {
    let on_arm = places.iter().zip(starts).filter_map(|(place, start)| match place {
        Place::Arm(angle) => Some((*angle, *start)),
        Place::Free(_) => None,
    });
    Circle::through(&on_arm.collect::<Vec<_>>())
}

impl Scene<'_> {
    /// Where the mirror rays of every light meet.
    fn meeting_points(&self) -> Result<Vec<Vec3>, SolveError> {
        (0..self.angles.len()).map(|light| self.meeting_point(light)).collect()
    }

    fn meeting_point(&self, light: usize) -> Result<Vec3, SolveError> {
        let own: Vec<&Sighting> = self.sightings.iter().filter(|s| s.light == light).collect();
        if own.len() < 2 {
            return Err(SolveError::TooFewHighlights { light, highlights: own.len() });
        }
        let ray = |s: &&Sighting| {
            let ball = &self.balls[s.ball];
            mirror_ray(self.projection, &Sphere { center: ball.center, radius: ball.radius }, s.at)
        };
        let rays = own.iter().map(ray).collect::<Option<Vec<_>>>();
        rays.and_then(|rays| meeting_point(&rays)).ok_or(SolveError::NoMeetingPoint { light })
    }

    /// Lights with an angle on the circle if three angles make one, the others free.
    fn places(&self, starts: &[Vec3]) -> Vec<Place> {
        let known: Vec<(f64, Vec3)> = self.angles.iter().zip(starts).filter_map(|(a, s)| a.map(|a| (a, *s))).collect();
        let circle = Circle::through(&known).is_some();
        let place = |(angle, start): (&Option<f64>, &Vec3)| match angle {
            Some(angle) if circle => Place::Arm(*angle),
            _ => Place::Free(*start),
        };
        self.angles.iter().zip(starts).map(place).collect()
    }

    /// Leaves something out; false where too little would remain.
    fn leave_out(&mut self, item: Item, places: &mut [Place], starts: &[Vec3]) -> bool {
        let count = |light: usize, of: &[Sighting]| of.iter().filter(|s| s.light == light).count();
        let without: Vec<Sighting> = match item {
            Item::Highlight(light, ball) => {
                self.sightings.iter().filter(|s| (s.light, s.ball) != (light, ball)).copied().collect()
            }
            Item::Ball(ball) => self.sightings.iter().filter(|s| s.ball != ball).copied().collect(),
            Item::Light(light) => {
                let mut freed = places.to_vec();
                freed[light] = Place::Free(starts[light]);
                let remains = first_circle(&freed, starts).is_some();
                if remains {
                    places.copy_from_slice(&freed);
                }
                return remains;
            }
        };
        let remains = (0..places.len()).all(|light| count(light, &without) >= 2);
        if remains {
            self.sightings = without;
        }
        remains
    }
}

/// A minimum and its linear model.
struct Fit {
    state: State,
    linear: Linear,
    /// Inverse of the normal matrix.
    inverse: DMatrix<f64>,
    /// Derivative of every lamp's position by the unknowns.
    lamps: Vec<DMatrix<f64>>,
    scale: f64,
}

/// Fits with the highlights' scale that the median of their residuals asks for, which outliers hardly move.
fn fit(scene: &Scene<'_>, places: &[Place], circle: Option<&Circle>) -> Result<Fit, SolveError> {
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
    fn worst(&self, scene: &Scene<'_>, places: &[Place]) -> Option<Misfit> {
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
                    super::mirror::highlight(scene.projection, ball, radius(s), &lamp)
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

    fn solved(&self, scene: &Scene<'_>, places: &[Place], starts: &[Vec3], misfits: Vec<Misfit>) -> Solved {
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
