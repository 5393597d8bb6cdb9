//! Where the light stands, by the part of a ball that it lights. Its edge, where the light grazes the surface, depends on neither texture
//! nor gloss nor response; the outline tells where in the frame the ball stands.

use super::look::{CLIPPED, DARK, Look};
use crate::numerics::geometry::{Projection, Sphere, Vec3};
use nalgebra::{Matrix3, Vector3};

/// What is looked at, radii of the ball about its middle, and samples of that, at most.
const REACH: f64 = 1.35;
const SAMPLES: f64 = 3000.0;
/// A ball of fewer samples from its middle to its edge is too small.
const LEAST_RADIUS: f64 = 12.0;
/// Levels above the background from which a sample is lit. Light that comes over walls and lens is less than that in an exposure of
/// which at most `DROWNED` of the lit samples are clipped.
const ABOVE: f32 = 8.0;
const DROWNED: f64 = 0.5;
/// Level of the brightest hundredth, at least: where it is lower, surface that the light only grazes stays dark for want of exposure.
const EXPOSED: f32 = 150.0;
/// Share of the ball that must be lit.
const LEAST_LIT: f64 = 0.03;
/// What the ball's place in the frame is known to before anything is seen, in radii.
const PLACED: f64 = 0.15;
/// Part of the ball's disc on which the picture may differ from the best light: more is no picture of the ball. Sound ones: 0.006 to 0.015.
const UNLIKE: f64 = 0.04;
/// Width of the edges of what is lit, in radii, from the first guess to the last; but never narrower than samples are apart.
const EDGES: [f64; 3] = [0.3, 0.1, 0.05];
const NARROWEST: f64 = 1.5;
/// Steps of the search at one width, and steps that end it: parts of the distance of two samples, degrees.
const ROUNDS: usize = 5;
const SMALL: (f64, f64) = (0.05, 0.2);
/// The longest step: radii and degrees; the steps of differences: parts of the distance of two samples, degrees.
const LONGEST: (f64, f64) = (0.2, 12.0);
const DIFFERENCE: (f64, f64) = (0.2, 0.5);
/// Angles from which a light far from where it is expected is looked for, degrees apart.
const APART: usize = 12;
/// Mean square by which samples on an edge miss it, and at least: they are lit or not.
const ON_EDGE: f64 = 0.09;
const ON_EDGE_LEAST: f64 = 0.05;
/// Part of the ball's disc by which a light at a wrong angle may explain a picture better than the true one, one standard error: where
/// edges lie on their samples, and roughly stated geometry.
const NOISE: f64 = 0.0004;
/// How well the edge's place on the ball is known at best, radii: with the light before the ball it lies on the outline, and hardly moves.
const EDGE_ERROR: f64 = 0.008;
/// The picture is held against lights so many degrees away.
const AWAY: f64 = 4.0;
/// Errors of the place are larger than the edges say, and never less than this part of the radius.
const PLACE_ERROR: (f64, f64) = (2.0, 0.005);

/// How far the ball stands from where it is said to stand, mm right and down, and how well that is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    shift_mm: [f64; 2],
    sigma_mm: [f64; 2],
}

/// Where the light stands by the pictures of a bracket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Angle on its circle, degrees.
    pub angle_deg: f64,
    /// Standard error of that.
    pub sigma_deg: f64,
    /// What is known by now of the ball's place.
    pub place: Place,
}

/// A ball before the camera, and the samples of a look that show it and what is beside it.
#[derive(Clone, Debug)]
pub struct Ball {
    sphere: Sphere,
    /// Index and direction of sight.
    samples: Vec<(usize, Vec3)>,
    /// Size of a pixel, and distance of two samples, mm at the ball.
    pixel_mm: f64,
    apart_mm: f64,
}

/// A light as it was fitted.
struct Fit {
    /// Shift right and down, mm, and angle, degrees.
    at: Vector3<f64>,
    variance_mm2: [f64; 2],
    /// Part of the disc on which the picture differs.
    misfit: f64,
}

/// A fit's circumstances.
struct Task<'a> {
    /// 1 where a sample is lit.
    seen: Vec<f64>,
    place: &'a Place,
    lamp: &'a dyn Fn(f64) -> Vec3,
}

impl Ball {
    /// The ball as a look shows it; none where it is too small or not in front of the camera.
    pub fn new(sphere: Sphere, projection: &Projection, look: &Look) -> Option<Self> {
        let side = sphere.center + Vec3::x() * sphere.radius;
        let [middle, beside] = [sphere.center, side].map(|point| projection.project(&point));
        let pixel_mm = sphere.radius / (beside[0] - middle[0]).abs();
        let in_front = sphere.center.z > sphere.radius && pixel_mm.is_finite();
        let disc = std::f64::consts::PI * (REACH * sphere.radius / (pixel_mm * look.step as f64)).powi(2);
        let every = (disc / SAMPLES).sqrt().ceil().max(1.0);
        let apart_mm = every * look.step as f64 * pixel_mm;
        if !in_front || sphere.radius < LEAST_RADIUS * apart_mm {
            return None;
        }
        let every = every as usize;
        let mut samples = Vec::new();
        for index in 0..look.samples.len() {
            let [x, y] = look.pixel(index);
            let [column, row] = [index % look.columns, index / look.columns];
            let near = (x - middle[0]).hypot(y - middle[1]) * pixel_mm <= REACH * sphere.radius;
            if near && column % every == 0 && row % every == 0 {
                samples.push((index, projection.ray(x, y).direction));
            }
        }
        Some(Self { sphere, samples, pixel_mm, apart_mm })
    }

    /// What is known of the ball's place before anything is seen of it.
    pub fn placed(&self) -> Place {
        Place { shift_mm: [0.0; 2], sigma_mm: [PLACED * self.sphere.radius; 2] }
    }

    /// Where the light stands that `looks`, the exposures of a bracket, show; `lamp` is its place (mm) at an angle of its circle. None
    /// where too little is lit, or nothing that looks like the ball.
    pub fn light(
        &self,
        looks: &[&Look],
        expected_deg: f64,
        lamp: &dyn Fn(f64) -> Vec3,
        place: &Place,
    ) -> Option<Light> {
        let task = Task { seen: self.lit(looks)?, place, lamp };
        let [right, down] = place.shift_mm;
        let at = |angle_deg| Vector3::new(right, down, angle_deg);
        let expected = self.fit(&task, at(expected_deg), true, &EDGES)?;
        let mut best = self.fit(&task, expected.at, false, &EDGES[2..])?;
        let far_deg = self.guess(&task, at)?;
        if best.misfit > UNLIKE || between(far_deg, best.at.z).abs() > APART as f64 {
            let far = self.fit(&task, at(far_deg), true, &EDGES[..1])?;
            let far = self.fit(&task, far.at, false, &EDGES[1..])?;
            best = if far.misfit < best.misfit { far } else { best };
        }
        let off = between(best.at.z, expected_deg);
        let away = if off.abs() < AWAY {
            let away_deg = best.at.z - AWAY.copysign(off);
            self.fit(&task, Vector3::new(best.at.x, best.at.y, away_deg), true, &EDGES[2..])?
        } else {
            expected
        };
        let worse = (away.misfit - best.misfit).max(1e-9);
        let sigma_deg = between(away.at.z, best.at.z).abs() * (NOISE / worse).sqrt();
        let edge_deg = self.edge_error_deg(&lamp(best.at.z)).max(self.edge_error_deg(&lamp(expected_deg)));
        let least = PLACE_ERROR.1 * self.sphere.radius;
        let sigma_mm = best.variance_mm2.map(|variance| (PLACE_ERROR.0 * variance.sqrt()).hypot(least));
        (best.misfit <= UNLIKE).then_some(Light {
            angle_deg: expected_deg + off,
            sigma_deg: sigma_deg.hypot(edge_deg).min(180.0),
            place: Place { shift_mm: [best.at.x, best.at.y], sigma_mm },
        })
    }

    /// Which samples are lit, by the exposure that shows most of them without drowning them.
    fn lit(&self, looks: &[&Look]) -> Option<Vec<f64>> {
        let levels = |look: &Look, least: f32| {
            self.samples.iter().filter(|(index, _)| look.samples.get(*index).is_some_and(|s| s.level >= least)).count()
        };
        let least = |look: &Look| DARK.max(look.background + ABOVE);
        let exposed = looks.iter().filter(|look| look.bright >= EXPOSED);
        let counted = exposed.map(|&look| (look, levels(look, least(look))));
        let undrowned = counted.filter(|&(look, lit)| levels(look, CLIPPED) as f64 <= DROWNED * lit as f64);
        let (look, lit) = undrowned.max_by_key(|&(_, lit)| lit)?;
        let seen = |(index, _): &(usize, Vec3)| look.samples.get(*index).map(|s| f64::from(s.level >= least(look)));
        (lit as f64 >= LEAST_LIT * self.disc()).then(|| self.samples.iter().filter_map(seen).collect())
    }

    /// What the place of the edge leaves open of the light's angle, degrees.
    fn edge_error_deg(&self, lamp: &Vec3) -> f64 {
        let [light, view] = [lamp - self.sphere.center, -self.sphere.center].map(|way| way.normalize());
        (EDGE_ERROR / light.cross(&view).norm()).min((1.0 - EDGE_ERROR).acos()).to_degrees()
    }

    /// Samples on the ball.
    fn disc(&self) -> f64 {
        std::f64::consts::PI * (self.sphere.radius / self.apart_mm).powi(2)
    }

    /// The best of some angles all around, edges very soft.
    fn guess(&self, task: &Task<'_>, at: impl Fn(f64) -> Vector3<f64>) -> Option<f64> {
        let misfit = |angle_deg: f64| -> f64 {
            let shown = self.shown(&at(angle_deg), task.lamp, EDGES[0]);
            let off = self.samples.iter().zip(&task.seen).map(|((_, sight), seen)| (seen - shown.share(sight)).powi(2));
            off.sum()
        };
        let angles = (-180..180).step_by(APART).map(f64::from);
        let judged = angles.map(|angle_deg| (angle_deg, misfit(angle_deg)));
        judged.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(angle_deg, _)| angle_deg)
    }

    /// Least squares from `at`, over shift and angle, or `held` at its angle; none where the numbers give out.
    fn fit(&self, task: &Task<'_>, mut at: Vector3<f64>, held: bool, edges: &[f64]) -> Option<Fit> {
        let mut fit = None;
        for &edge in edges {
            for _ in 0..ROUNDS {
                let (now, step) = self.step(task, &at, held, edge)?;
                fit = Some(now);
                at += step;
                if step.xy().amax() < SMALL.0 * self.apart_mm && step.z.abs() < SMALL.1 {
                    break;
                }
            }
        }
        fit
    }

    /// How well a light does, and the step towards a better one.
    fn step(&self, task: &Task<'_>, at: &Vector3<f64>, held: bool, edge: f64) -> Option<(Fit, Vector3<f64>)> {
        let by = Vector3::new(DIFFERENCE.0 * self.apart_mm, DIFFERENCE.0 * self.apart_mm, DIFFERENCE.1);
        let moved = |axis: usize| {
            let mut there = *at;
            there[axis] += by[axis];
            self.shown(&there, task.lamp, edge)
        };
        let (here, there) = (self.shown(at, task.lamp, edge), [moved(0), moved(1), moved(2)]);
        let (mut normal, mut right, mut off2, mut on_edge) = (Matrix3::zeros(), Vector3::zeros(), 0.0, 0_usize);
        for ((_, sight), seen) in self.samples.iter().zip(&task.seen) {
            let share = here.share(sight);
            let off = seen - share;
            off2 += off * off;
            on_edge += usize::from(share > 0.0 && share < 1.0);
            let slope = Vector3::from_fn(|axis, _| (there[axis].share(sight) - share) / by[axis]);
            normal += slope * slope.transpose();
            right += slope * off;
        }
        let Place { shift_mm: [x, y], sigma_mm: [sigma_x, sigma_y] } = *task.place;
        let noise = (off2 / on_edge.max(1) as f64).max(ON_EDGE_LEAST);
        let known = Vector3::new(sigma_x.powi(-2), sigma_y.powi(-2), 0.0);
        let away = Vector3::new(at.x - x, at.y - y, 0.0);
        normal += Matrix3::from_diagonal(&(known * noise));
        right -= known.component_mul(&away) * noise;
        if held {
            normal.fixed_view_mut::<1, 3>(2, 0).fill(0.0);
            normal.fixed_view_mut::<3, 1>(0, 2).fill(0.0);
            normal.m33 = 1.0;
            right.z = 0.0;
        }
        // A light whose angle nothing shows stays where it is.
        normal.m33 += 1e-9;
        let variance = normal.try_inverse()?;
        let (most_mm, most_deg) = (LONGEST.0 * self.sphere.radius, LONGEST.1);
        let step = variance * right;
        let step = Vector3::new(
            step.x.clamp(-most_mm, most_mm),
            step.y.clamp(-most_mm, most_mm),
            step.z.clamp(-most_deg, most_deg),
        );
        let misfit = (off2 + ON_EDGE * known.dot(&away.component_mul(&away))) / self.disc();
        let variance_mm2 = [variance.m11 * noise, variance.m22 * noise];
        let sound = step.iter().chain([&misfit]).all(|number| number.is_finite());
        sound.then_some((Fit { at: *at, variance_mm2, misfit }, step))
    }

    fn shown(&self, at: &Vector3<f64>, lamp: &dyn Fn(f64) -> Vec3, edge: f64) -> Shown {
        let width_mm = (edge * self.sphere.radius).max(NARROWEST * self.apart_mm);
        let Sphere { center, radius } = self.sphere;
        let center = center + Vec3::new(at.x, at.y, 0.0);
        Shown { center, radius, outline: radius + self.pixel_mm, lamp: lamp(at.z), width_mm }
    }
}

/// A ball under a light, with soft edges.
struct Shown {
    center: Vec3,
    radius: f64,
    /// Radius of what is seen: a pixel that the ball covers in part is lit.
    outline: f64,
    lamp: Vec3,
    width_mm: f64,
}

impl Shown {
    /// 1 where what is seen in this direction is lit, 0 where not, between on the edges.
    fn share(&self, sight: &Vec3) -> f64 {
        let along = self.center.dot(sight);
        let miss2 = (self.center - sight * along).norm_squared();
        let on_ball = (0.5 + (self.outline - miss2.sqrt()) / self.width_mm).clamp(0.0, 1.0);
        if on_ball == 0.0 {
            return 0.0;
        }
        let point = sight * (along - (self.radius * self.radius - miss2).max(0.0).sqrt());
        let way = self.lamp - point;
        let cosine = way.dot(&(point - self.center)) / (self.radius * way.norm());
        on_ball * (0.5 + 0.5 * cosine * self.radius / self.width_mm).clamp(0.0, 1.0)
    }
}

/// From one angle to another the short way round, degrees.
pub fn between(to_deg: f64, from_deg: f64) -> f64 {
    (to_deg - from_deg + 180.0).rem_euclid(360.0) - 180.0
}
