//! Light positions: how far from the truth, and whether their covariance says so.
//!
//! Features: outlines and highlights of known noise. Pictures: rendered frames of balls, found without a click. Seven lights on an
//! arm of 800 mm, three balls of 20 mm radius at 2 m, 200 mm lens.

pub mod forward;
pub mod render;

use super::csv;
use crate::numerics::calibration::lights::balls::{self, Found};
use crate::numerics::calibration::lights::highlight::{self, Spots};
use crate::numerics::calibration::lights::joint::{SeenBall, Sighting};
use crate::numerics::calibration::lights::outline::{self, EdgePoint};
use crate::numerics::calibration::lights::solve::{Scene, Solved, solve};
use crate::numerics::geometry::Vec3;
use crate::numerics::image::Image;
use forward::{Rig, normal};
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;
use rayon::prelude::*;
use render::{Exposure, frame};
use std::path::Path;

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Seeds of every case of features.
    pub seeds: u64,
    /// Seeds of every case of pictures.
    pub pictures: u64,
    /// Pixels of the pictures in parts of the sensor's (1: 29 million pixels in 7 + 7 frames a seed).
    pub scale: f64,
}

/// One case over all its seeds.
#[derive(Clone, Debug)]
pub struct Case {
    /// What is seen, and how.
    pub name: String,
    /// Noise of a highlight's place, pixels of the full sensor.
    pub highlight_px: f64,
    /// True if the arm's circle and its angles are used.
    pub circle: bool,
    /// Rms of the distance from the truth, mm.
    pub rms_mm: f64,
    /// Largest distance, mm.
    pub worst_mm: f64,
    /// Share of the lights inside their 95 % ellipsoid.
    pub coverage: f64,
    /// Calibrations made.
    pub solved: usize,
    /// Calibrations refused.
    pub refused: usize,
}

/// 95 % quantile of chi^2 with 3 degrees of freedom.
const CHI2_95: f64 = 7.815;
/// Noise of an edge point of the features, pixels.
const EDGE_PX: f64 = 0.2;
/// Edge points of an outline.
const EDGES: usize = 360;

/// Measures every case.
pub fn run(plan: &Plan) -> Vec<Case> {
    let mut cases = Vec::new();
    for highlight_px in [0.05, 0.2] {
        for circle in [false, true] {
            let all = (0..plan.seeds).into_par_iter().map(|seed| features(seed, highlight_px, circle)).collect();
            cases.push(case("features", highlight_px, circle, all));
        }
    }
    for highlight_px in [0.05, 0.2] {
        // One after the other: a seed's frames fill memory enough.
        let all = (0..plan.pictures).map(|seed| pictures(seed, plan.scale, highlight_px * plan.scale)).collect();
        cases.push(case(&format!("pictures at scale {}", plan.scale), highlight_px, true, all));
    }
    cases
}

/// Errors (mm) and squared Mahalanobis distances of the lights of one seed; none if it was refused.
type Errors = Option<Vec<(f64, f64)>>;

fn case(name: &str, highlight_px: f64, circle: bool, all: Vec<Errors>) -> Case {
    let refused = all.iter().filter(|e| e.is_none()).count();
    let lights: Vec<(f64, f64)> = all.iter().flatten().flatten().copied().collect();
    let count = lights.len().max(1) as f64;
    Case {
        name: name.to_owned(),
        highlight_px,
        circle,
        rms_mm: (lights.iter().map(|(e, _)| e * e).sum::<f64>() / count).sqrt(),
        worst_mm: lights.iter().map(|(e, _)| *e).fold(0.0, f64::max),
        coverage: lights.iter().filter(|(_, m)| *m < CHI2_95).count() as f64 / count,
        solved: all.len() - refused,
        refused,
    }
}

fn errors(rig: &Rig, solved: &Solved) -> Errors {
    let of = |(lamp, truth): (&crate::numerics::calibration::lights::solve::Lamp, &Vec3)| {
        let error = lamp.position - truth;
        let inverse = lamp.covariance.try_inverse()?;
        Some((error.norm(), error.dot(&(inverse * error))))
    };
    solved.lamps.iter().zip(&rig.lamps).map(of).collect()
}

fn angles(rig: &Rig, circle: bool) -> Vec<Option<f64>> {
    rig.angles_deg.iter().map(|angle| circle.then(|| angle.to_radians())).collect()
}

/// One calibration from noisy outlines and highlights.
fn features(seed: u64, highlight_px: f64, circle: bool) -> Errors {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let rig = Rig::draw(1.0, &mut random);
    let balls = (0..rig.balls.len())
        .map(|ball| {
            let points: Vec<EdgePoint> = rig
                .noisy_outline(ball, EDGES, EDGE_PX, &mut random)
                .into_iter()
                .map(|at| EdgePoint { at, sigma: 1.0 })
                .collect();
            let fitted = outline::fit(&rig.projection, &points)?;
            let jacobian = fitted.outline.center_jacobian(rig.radius);
            Some(SeenBall {
                center: fitted.outline.sphere_center(rig.radius)?,
                covariance: jacobian * fitted.covariance * jacobian.transpose(),
                radius: rig.radius,
            })
        })
        .collect::<Option<Vec<_>>>()?;
    let mut sightings = Vec::new();
    for light in 0..rig.lamps.len() {
        for ball in 0..balls.len() {
            let at = rig.highlight(ball, light).map(|v| v + highlight_px * normal(&mut random));
            // The estimator is never told the noise: what the finder promises at least is all it knows.
            sightings.push(Sighting { light, ball, at, sigma_px: highlight::LEAST_SIGMA_PX });
        }
    }
    solve_with(&rig, balls, sightings, circle)
}

fn solve_with(rig: &Rig, balls: Vec<SeenBall>, sightings: Vec<Sighting>, circle: bool) -> Errors {
    let angle_sigma = 0.05_f64.to_radians();
    let scene = Scene { projection: &rig.projection, balls, sightings, angles: angles(rig, circle), angle_sigma };
    errors(rig, &solve(&scene).ok()?)
}

/// The mean of the frames that show the balls, one under each light.
pub fn mean_silhouette(rig: &Rig, random: &mut Xoshiro256PlusPlus) -> Image<f32> {
    let mut mean = Image::filled(rig.size.0, rig.size.1, 0.0_f32);
    let still = vec![[0.0; 2]; rig.balls.len()];
    for lamp in 0..rig.lamps.len() {
        let image = frame(rig, lamp, &Exposure::SILHOUETTE, &still, random);
        for (sum, level) in mean.pixels.iter_mut().zip(&image.pixels) {
            *sum += level / rig.lamps.len() as f32;
        }
    }
    mean
}

/// One calibration from rendered pictures, found without a click.
fn pictures(seed: u64, scale: f64, highlight_px: f64) -> Errors {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let rig = Rig::draw(scale, &mut random);
    let Found { balls, .. } = balls::find(&mean_silhouette(&rig, &mut random), &rig.projection, rig.radius, 3);
    if balls.len() != rig.balls.len() {
        return None;
    }
    let mut sightings = Vec::new();
    for light in 0..rig.lamps.len() {
        let moved: Vec<[f64; 2]> =
            rig.balls.iter().map(|_| std::array::from_fn(|_| highlight_px * normal(&mut random))).collect();
        let level = frame(&rig, light, &Exposure::HIGHLIGHT, &moved, &mut random);
        let clipped = Image {
            width: level.width,
            height: level.height,
            pixels: level.pixels.iter().map(|l| *l >= 0.99).collect(),
        };
        let spots = Spots { level, clipped };
        for (ball, seen) in balls.iter().enumerate() {
            if let Ok(found) = highlight::find(&spots, &rig.projection, seen) {
                sightings.push(Sighting { light, ball, at: found.at, sigma_px: found.sigma_px });
            }
        }
    }
    let seen = balls.iter().map(|b| SeenBall { center: b.center, covariance: b.covariance, radius: b.radius });
    solve_with(&rig, seen.collect(), sightings, true)
}

/// Columns of `lights.csv`.
pub const COLUMNS: [&str; 8] =
    ["seen", "highlight_noise_px", "arm_circle", "rms_mm", "worst_mm", "coverage_95", "solved", "refused"];

/// Writes `lights.csv` into `directory`.
///
/// # Errors
/// The file cannot be written.
pub fn write(directory: &Path, cases: &[Case]) -> std::io::Result<()> {
    table(cases).write(&directory.join("lights.csv"))
}

/// The cases as a table.
pub fn table(cases: &[Case]) -> csv::Table {
    let line = |case: &Case| {
        vec![
            case.name.clone(),
            case.highlight_px.to_string(),
            case.circle.to_string(),
            case.rms_mm.to_string(),
            case.worst_mm.to_string(),
            case.coverage.to_string(),
            case.solved.to_string(),
            case.refused.to_string(),
        ]
    };
    csv::Table { columns: &COLUMNS, rows: cases.iter().map(line).collect() }
}
