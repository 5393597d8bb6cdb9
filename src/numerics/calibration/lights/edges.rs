//! Edge points of a ball to subpixel, from profiles across its expected outline.

use super::limb::{Limb, LimbTable, Profile};
use super::outline::{EdgePoint, Outline, median};
use crate::numerics::geometry::Projection;
use crate::numerics::image::Image;
use std::f64::consts::TAU;

/// Bilinear level at pixel coordinates; none outside the image.
pub(super) fn level(image: &Image<f32>, x: f64, y: f64) -> Option<f64> {
    let (left, top) = (x - 0.5, y - 0.5);
    if !(left >= 0.0 && top >= 0.0) {
        return None;
    }
    let (column, row) = (left as usize, top as usize);
    if column + 1 >= image.width || row + 1 >= image.height {
        return None;
    }
    let (u, v) = (left.fract(), top.fract());
    let at = |dx, dy| f64::from(*image.at(column + dx, row + dy));
    Some((at(0, 0) * (1.0 - u) + at(1, 0) * u) * (1.0 - v) + (at(0, 1) * (1.0 - u) + at(1, 1) * u) * v)
}

/// The mean profile of a sector of the outline about `phi`, from `reach` pixels outside to `reach` inside in half pixels.
fn sector(
    image: &Image<f32>,
    projection: &Projection,
    outline: &Outline,
    phi: f64,
    (width, rays): (f64, usize),
    reach: f64,
) -> Option<Profile> {
    let steps = (2.0 * reach).ceil() as i32;
    let offsets: Vec<f64> = (-steps..=steps).map(|i| 0.5 * f64::from(i)).collect();
    let mut levels = vec![0.0; offsets.len()];
    for ray in 0..rays {
        let (at, normal) = outline.point(projection, phi + width * ((ray as f64 + 0.5) / rays as f64 - 0.5));
        for (sum, offset) in levels.iter_mut().zip(&offsets) {
            *sum += level(image, at[0] - offset * normal[0], at[1] - offset * normal[1])?;
        }
    }
    levels.iter_mut().for_each(|sum| *sum /= rays as f64);
    Some(Profile { offsets, levels })
}

/// Sectors of an outline: number, and rays averaged in each.
fn sectors(radius: f64) -> (usize, usize) {
    let count = (TAU * radius / 10.0).round().clamp(36.0, 120.0) as usize;
    (count, (TAU * radius / count as f64).round().clamp(3.0, 40.0) as usize)
}

fn profiles(image: &Image<f32>, projection: &Projection, outline: &Outline, reach: f64) -> Vec<(f64, Profile)> {
    let (count, rays) = sectors(outline.radius_px(projection));
    let width = TAU / count as f64;
    let at = |i| {
        let phi = i as f64 * width;
        sector(image, projection, outline, phi, (width, rays), reach).map(|profile| (phi, profile))
    };
    (0..count).filter_map(at).collect()
}

/// Edge points where the level changes most within `reach` pixels of the outline; for an outline known roughly.
pub(super) fn steepest(image: &Image<f32>, projection: &Projection, outline: &Outline, reach: f64) -> Vec<EdgePoint> {
    let mut points = Vec::new();
    for (phi, profile) in profiles(image, projection, outline, reach) {
        // Over 2 pixels, so that single noisy pixels do not win.
        let change: Vec<f64> = profile.levels.windows(5).map(|w| (w[4] + w[3] - w[1] - w[0]).abs()).collect();
        let Some(best) = (0..change.len()).max_by(|a, b| change[*a].total_cmp(&change[*b])) else { continue };
        if best > 0 && best + 1 < change.len() && change[best] > 3.0 * median(change.clone()) {
            let bend = change[best - 1] - 2.0 * change[best] + change[best + 1];
            let shift = if bend < 0.0 { 0.5 * (change[best - 1] - change[best + 1]) / bend } else { 0.0 };
            let offset = profile.offsets[best + 2] + 0.5 * shift;
            points.push(point(projection, outline, phi, offset, 1.0));
        }
    }
    points
}

fn point(projection: &Projection, outline: &Outline, phi: f64, offset: f64, sigma: f64) -> EdgePoint {
    let (at, normal) = outline.point(projection, phi);
    EdgePoint { at: [at[0] - offset * normal[0], at[1] - offset * normal[1]], sigma }
}

/// Limbs of one image about an outline known to a pixel or two.
pub(super) struct Limbs {
    /// Edge points.
    pub points: Vec<EdgePoint>,
    /// Standard deviation of the blur, pixels.
    pub blur: f64,
    /// Share of the sectors in which a limb was found.
    pub share: f64,
}

/// Finds the limb in every sector by the blurred profile; the blur, one for the ball, is the one that fits all sectors best.
pub(super) fn limbs(
    image: &Image<f32>,
    projection: &Projection,
    outline: &Outline,
    table: &LimbTable,
    blur: Option<f64>,
) -> Limbs {
    let radius = outline.radius_px(projection);
    let reach = (0.3 * radius).clamp(4.0, 8.0);
    let profiles = profiles(image, projection, outline, reach);
    let search = 0.4 * reach;
    let total = sectors(radius).0 as f64;
    let blur = blur.unwrap_or_else(|| {
        let blurs = (0..12).map(|i| 0.45 * 1.22_f64.powi(i));
        let cost = |sigma: f64| {
            let best = profiles.iter().filter_map(|(_, p)| p.limb(table, sigma, search).map(|l| l.rss / energy(p)));
            let all: Vec<f64> = best.collect();
            if 2 * all.len() < profiles.len() { f64::INFINITY } else { median(all) }
        };
        blurs.map(|sigma| (cost(sigma), sigma)).min_by(|a, b| a.0.total_cmp(&b.0)).map_or(1.0, |(_, sigma)| sigma)
    });
    let found: Vec<(f64, Limb)> =
        profiles.iter().filter_map(|(phi, p)| p.limb(table, blur, search).map(|limb| (*phi, limb))).collect();
    let sound = found.iter().filter(|(_, limb)| limb.sigma < 1.0);
    let points: Vec<EdgePoint> =
        sound.map(|(phi, limb)| point(projection, outline, *phi, limb.offset, limb.sigma.hypot(0.05))).collect();
    Limbs { share: points.len() as f64 / total, points, blur }
}

/// Scatter of a profile's levels, so that sectors of any contrast count alike.
fn energy(profile: &Profile) -> f64 {
    let mean = profile.levels.iter().sum::<f64>() / profile.levels.len() as f64;
    profile.levels.iter().map(|l| (l - mean) * (l - mean)).sum::<f64>().max(f64::MIN_POSITIVE)
}
