//! Balls in an image: found without a click, outlines to subpixel, centres in millimetres.

use super::edges::{Limbs, limbs, steepest};
use super::hough::{Circle, circles, reduction};
use super::limb::LimbTable;
use super::outline::{EdgePoint, Fitted, Outline, fit, median};
use crate::numerics::geometry::{Projection, Vec3};
use crate::numerics::image::Image;
use nalgebra::Matrix3;

/// A ball and how well it is known.
#[derive(Clone, Debug)]
pub struct Ball {
    /// Its outline.
    pub outline: Outline,
    /// Centre, camera frame, mm; z = 0 for parallel rays.
    pub center: Vec3,
    /// Covariance of the centre, mm^2; zero for parallel rays.
    pub covariance: Matrix3<f64>,
    /// Radius, mm; for parallel rays as the outline shows it.
    pub radius: f64,
    /// Rms distance of the edge points from the outline, pixels.
    pub rms_px: f64,
    /// Share of the outline's sectors whose limb lies on it.
    pub covered: f64,
    /// Standard deviation of the blur at the limb, pixels.
    pub blur_px: f64,
}

/// Something round in the image that is not taken for a ball.
#[derive(Clone, Debug, PartialEq)]
pub struct Rejected {
    /// Centre, pixels.
    pub center_px: [f64; 2],
    /// Radius, pixels.
    pub radius_px: f64,
    /// Why.
    pub reason: String,
}

/// What an image shows.
#[derive(Clone, Debug)]
pub struct Found {
    /// Balls from left to right.
    pub balls: Vec<Ball>,
    /// Other round things.
    pub rejected: Vec<Rejected>,
}

/// Least share of the outline that must be seen.
const LEAST_COVERED: f64 = 0.4;
/// Largest rms distance of edge points from an ellipse, pixels; a ball in focus has a tenth of it.
const LARGEST_RMS_PX: f64 = 0.7;
/// The same in parts of the radius.
const LARGEST_RMS: f64 = 0.03;
/// Balls of one radius differ no more in the image, largest to smallest.
const LARGEST_RATIO: f64 = 1.5;
/// What limbs that no light reaches and terminators near the limb leave of the outline's radius and place, pixels: common to whole
/// arcs, so that the scatter of the sectors does not show it (measured on the pictures of `rigd study lights`).
const OUTLINE_BIAS_PX: f64 = 0.05;
/// A blurred ball: its limb is wider than this, standard deviations in pixels.
pub const LARGEST_BLUR_PX: f64 = 3.5;

/// Finds the balls of an image: the mean of frames under several lights shows the whole outline, where one light leaves half of
/// it dark. `radius_mm` is that of every ball.
///
/// Looks for one more round thing than `count`, so that the caller can tell when there are too many.
pub fn find(image: &Image<f32>, projection: &Projection, radius_mm: f64, count: usize) -> Found {
    let table = LimbTable::new();
    let mut found = Found { balls: Vec::new(), rejected: Vec::new() };
    for circle in circles(image, count + 3) {
        match ball(image, projection, radius_mm, &circle, &table) {
            Ok(ball) => found.balls.push(ball),
            Err(reason) => {
                found.rejected.push(Rejected { center_px: circle.center, radius_px: circle.radius, reason });
            }
        }
    }
    found.keep_one_size(projection, count);
    found.balls.sort_by(|a, b| a.outline.center_px(projection)[0].total_cmp(&b.outline.center_px(projection)[0]));
    found
}

impl Found {
    /// Balls of one radius at like distances look alike: of the sizes that occur, keeps the largest that `count` have, or else the
    /// one that most have.
    fn keep_one_size(&mut self, projection: &Projection, count: usize) {
        let radii: Vec<f64> = self.balls.iter().map(|b| b.outline.radius_px(projection)).collect();
        let alike =
            |size: f64| radii.iter().filter(|r| (**r / size) <= 1.0 && (**r / size) > 1.0 / LARGEST_RATIO).count();
        let Some(size) = radii.iter().copied().max_by(|a, b| {
            let (many_a, many_b) = (alike(*a).min(count), alike(*b).min(count));
            many_a.cmp(&many_b).then(a.total_cmp(b))
        }) else {
            return;
        };
        let (kept, other): (Vec<_>, Vec<_>) = std::mem::take(&mut self.balls)
            .into_iter()
            .zip(radii)
            .partition(|(_, r)| *r <= size && *r > size / LARGEST_RATIO);
        self.balls = kept.into_iter().map(|(ball, _)| ball).collect();
        self.rejected.extend(other.into_iter().map(|(ball, radius_px)| Rejected {
            center_px: ball.outline.center_px(projection),
            radius_px,
            reason: format!("it is of another size than the balls of {size:.0} px"),
        }));
    }
}

fn ball(
    image: &Image<f32>,
    projection: &Projection,
    radius_mm: f64,
    circle: &Circle,
    table: &LimbTable,
) -> Result<Ball, String> {
    let mut outline = Outline::from_circle(projection, circle.center, circle.radius);
    let coarse = 2.0 * reduction(image) as f64 + 2.0;
    for reach in [coarse, 0.5 * coarse + 2.0] {
        let edges = steepest(image, projection, &outline, reach);
        outline = refit(projection, &edges)?.outline;
    }
    let mut blur = None;
    let mut last: Option<(Fitted, Limbs)> = None;
    for _ in 0..3 {
        let limbs = limbs(image, projection, &outline, table, blur);
        let fitted = refit(projection, &limbs.points)?;
        outline = fitted.outline.clone();
        blur = Some(limbs.blur);
        last = Some((fitted, limbs));
    }
    let Some((fitted, limbs)) = last else { return Err("it has no outline".into()) };
    let covered = limbs.share * fitted.inliers;
    if covered < LEAST_COVERED {
        return Err(format!("only {:.0} % of its outline can be seen", 100.0 * covered));
    }
    if fitted.rms_px > LARGEST_RMS_PX.min(LARGEST_RMS * circle.radius) {
        return Err(format!("its outline is {:.2} px rms off a ball's", fitted.rms_px));
    }
    made(projection, radius_mm, fitted, covered, limbs.blur).ok_or_else(|| "its outline opens no cone".into())
}

fn refit(projection: &Projection, edges: &[EdgePoint]) -> Result<Fitted, String> {
    fit(projection, edges).ok_or_else(|| format!("only {} edge points, which give no ellipse", edges.len()))
}

fn made(projection: &Projection, radius_mm: f64, fitted: Fitted, covered: f64, blur_px: f64) -> Option<Ball> {
    let (scale, radius) = match (projection, &fitted.outline) {
        (Projection::Orthographic { mm_per_px }, Outline::Circle { radius, .. }) => (*mm_per_px, radius * mm_per_px),
        _ => (1.0, radius_mm),
    };
    let jacobian = fitted.outline.center_jacobian(radius_mm);
    let center = fitted.outline.sphere_center(radius_mm)? * scale;
    let bias = match &fitted.outline {
        Outline::Circle { .. } => Matrix3::zeros(),
        Outline::Cone { .. } => {
            let part = OUTLINE_BIAS_PX / fitted.outline.radius_px(projection);
            (center * center.transpose() + Matrix3::identity() * (radius * radius)) * (part * part)
        }
    };
    Some(Ball {
        center,
        covariance: jacobian * fitted.covariance * jacobian.transpose() + bias,
        radius,
        rms_px: fitted.rms_px,
        covered,
        blur_px,
        outline: fitted.outline,
    })
}

/// By how much (x, y pixels) the outline lies elsewhere in another image, with its standard deviation; none where too little
/// of the outline is seen. One light's own frame shows the lit limb only, and that is enough.
pub fn shift(image: &Image<f32>, projection: &Projection, ball: &Ball) -> Option<([f64; 2], f64)> {
    let reach = (0.1 * ball.outline.radius_px(projection)).clamp(4.0, 12.0);
    let edges = steepest(image, projection, &ball.outline, reach);
    let rows: Vec<([f64; 2], f64)> = edges.iter().map(|p| across(projection, ball, p.at)).collect();
    if rows.len() < 12 {
        return None;
    }
    let mut weights = vec![1.0; rows.len()];
    let (mut shift, mut scale) = ([0.0; 2], 0.0);
    for _ in 0..20 {
        let mut normal = nalgebra::Matrix2::zeros();
        let mut right = nalgebra::Vector2::zeros();
        for ((n, d), weight) in rows.iter().zip(&weights) {
            let n = nalgebra::Vector2::new(n[0], n[1]);
            normal += n * n.transpose() * *weight;
            right += n * (*d * *weight);
        }
        let moved = normal.try_inverse()? * right;
        shift = [moved.x, moved.y];
        let residuals: Vec<f64> = rows.iter().map(|(n, d)| d - n[0] * shift[0] - n[1] * shift[1]).collect();
        scale = 1.4826 * median(residuals.iter().map(|r| r.abs()).collect()).max(1e-3);
        weights = residuals.iter().map(|r| 1.0 / (1.0 + (r / (2.385 * scale)).powi(2))).collect();
    }
    Some((shift, scale / (rows.len() as f64 / 2.0).sqrt()))
}

/// Outward normal at the outline nearest to a pixel, and the pixel's distance from the outline.
fn across(projection: &Projection, ball: &Ball, at: [f64; 2]) -> ([f64; 2], f64) {
    let center = ball.outline.center_px(projection);
    let (dx, dy) = (at[0] - center[0], at[1] - center[1]);
    let length = dx.hypot(dy).max(1e-9);
    ([dx / length, dy / length], ball.outline.distance(projection, at))
}
