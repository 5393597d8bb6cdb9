//! Whether the views are of one camera: photographs taken with two cameras, two zooms, or mirrored in part fit one camera between
//! them, with an error that no single view stands out by.
//!
//! Near the adjusted camera the cost of a view, its pose eliminated, is a quadratic in the focal length and the principal point. The
//! views are split into the two groups whose own cameras explain them best (Lloyd's iteration from every pair of views); if the
//! groups explain far more than chance and an imperfect lens model do, there are two cameras.

use super::adjust::alone;
use super::select::Choice;
use super::{MIN_VIEWS, View};
use nalgebra::{Matrix3, Vector3};

/// Fall of chi^2 for two cameras, in units of the noise left, as a part of the residuals. The photographs of OpenCV's samples, each
/// side by itself, reach 0.08; both sides together 0.34; a quarter of one side zoomed by 5 % 0.5, mirrored 1.5.
const GAIN: f64 = 0.25;
/// ... and at least so much: among few corners chance finds groups.
const LEAST_GAIN: f64 = 100.0;
/// Rounds of assigning views to groups.
const ROUNDS: usize = 30;
/// Weight of the joint camera in a group's own, as a part of a view's: a single view leaves much of its camera open.
const HOLD: f64 = 1e-3;
const HOLD_AT_START: f64 = 0.3;

/// The focal length (px) and the principal point (px) that some views suggest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Suggested {
    /// Mean focal length.
    pub focal_px: f64,
    /// Principal point.
    pub principal_px: [f64; 2],
}

impl std::fmt::Display for Suggested {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [x, y] = self.principal_px;
        write!(f, "a focal length of {:.0} px and a principal point at ({x:.0}, {y:.0})", self.focal_px)
    }
}

/// Two groups of views with a camera each.
pub(super) struct Split {
    /// Places of the views in the smaller group.
    pub few: Vec<usize>,
    /// What these suggest.
    pub of_few: Suggested,
    /// What the others suggest.
    pub of_most: Suggested,
}

/// Cost of a view by focal length (logarithm) and principal point, about the adjusted camera: x'Hx - 2 p'x + c.
struct Part {
    hessian: Matrix3<f64>,
    pull: Vector3<f64>,
    cost: f64,
}

impl Part {
    fn at(&self, x: &Vector3<f64>) -> f64 {
        self.cost - 2.0 * self.pull.dot(x) + x.dot(&(self.hessian * x))
    }
}

/// The two cameras of the views, if there are two.
pub(super) fn split(views: &[&View], choice: &Choice) -> Option<Split> {
    if views.len() <= MIN_VIEWS {
        return None;
    }
    let adjusted = &choice.fit.adjusted;
    let part = |(view, pose)| {
        let view: &&View = view;
        let (hessian, gradient, cost) = alone(&view.corners, &adjusted.interior, pose)?;
        let unknowns = [0, 2, 3];
        let hessian = Matrix3::from_fn(|i, j| hessian[(unknowns[i], unknowns[j])]);
        Some(Part { hessian, pull: -Vector3::from_fn(|i, _| gradient[unknowns[i]]), cost })
    };
    let parts: Vec<Part> = views.iter().zip(&adjusted.poses).map(part).collect::<Option<_>>()?;
    let all: Vec<usize> = (0..parts.len()).collect();
    let mean = parts.iter().map(|part| part.hessian).sum::<Matrix3<f64>>() / parts.len() as f64;
    let pairs = all.iter().flat_map(|&i| (0..i).map(move |j| [i, j]));
    let groups = pairs.filter_map(|pair| grouped(&parts, &mean, pair));
    let cost = |groups: &[Vec<usize>; 2]| groups.iter().map(|group| cost(&parts, group, &mean)).sum::<f64>();
    let groups = groups.min_by(|a, b| cost(a).total_cmp(&cost(b)))?;
    let residuals = views.iter().map(|view| 2 * view.corners.len()).sum::<usize>() as f64;
    let noise = cost(&groups) / (residuals - 6.0 * views.len() as f64 - 6.0).max(1.0);
    let gain = (self::cost(&parts, &all, &mean) - cost(&groups)) / noise;
    if gain.is_nan() || gain < LEAST_GAIN || gain < GAIN * residuals {
        return None;
    }
    let suggested = |group: &[usize]| {
        let x = camera(&parts, group, &(mean * HOLD)).unwrap_or_default();
        let [fx, fy, cx, cy, ..] = adjusted.interior.values();
        Suggested { focal_px: (fx * fy).sqrt() * x[0].exp(), principal_px: [cx + x[1], cy + x[2]] }
    };
    let [few, most] = groups;
    Some(Split { of_few: suggested(&few), of_most: suggested(&most), few })
}

/// The smaller and the larger group that grow from a pair of views; none if one of them comes out empty.
fn grouped(parts: &[Part], mean: &Matrix3<f64>, pair: [usize; 2]) -> Option<[Vec<usize>; 2]> {
    let mut cameras = pair.map(|seed| camera(parts, &[seed], &(mean * HOLD_AT_START)));
    let mut groups: [Vec<usize>; 2] = Default::default();
    for _ in 0..ROUNDS {
        let [a, b] = [cameras[0]?, cameras[1]?];
        let (first, second) = (0..parts.len()).partition(|&i| parts[i].at(&a) <= parts[i].at(&b));
        let next = [first, second];
        if next.iter().any(Vec::is_empty) {
            return None;
        }
        if next == groups {
            break;
        }
        cameras = next.each_ref().map(|group| camera(parts, group, &(mean * HOLD)));
        groups = next;
    }
    groups.sort_by_key(Vec::len);
    Some(groups)
}

/// The camera of a group, `held` to the joint one.
fn camera(parts: &[Part], group: &[usize], held: &Matrix3<f64>) -> Option<Vector3<f64>> {
    let hessian = held + group.iter().map(|&i| parts[i].hessian).sum::<Matrix3<f64>>();
    let pull = group.iter().map(|&i| parts[i].pull).sum::<Vector3<f64>>();
    Some(hessian.cholesky()?.solve(&pull))
}

/// Cost of a group under its own camera.
fn cost(parts: &[Part], group: &[usize], mean: &Matrix3<f64>) -> f64 {
    let x = camera(parts, group, &(mean * HOLD)).unwrap_or_default();
    group.iter().map(|&i| parts[i].at(&x)).sum()
}
