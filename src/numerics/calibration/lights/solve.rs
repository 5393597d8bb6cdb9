//! From balls and highlights to light positions with their covariance, and what does not fit.

use super::arm::Circle;
use super::fitted::fit;
use super::joint::{Place, SeenBall, Sighting};
use super::mirror::{meeting_point, mirror_ray};
use crate::numerics::geometry::{Projection, Sphere, Vec3};
use nalgebra::Matrix3;

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
