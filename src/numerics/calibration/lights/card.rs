//! Light intensity from a grey card of known plane: radiance = reflectance / pi * intensity * cos(theta) / d^2 (Lambert, paper
//! 3.2; inverse-square fall-off is ours).

use super::outline::median;
use super::plane::Plane;
use crate::numerics::geometry::{Projection, Vec3};
use crate::numerics::image::RadianceImage;
use nalgebra::{Matrix2, Matrix3, Vector2};
use std::f64::consts::PI;

/// A diffuse card.
#[derive(Clone, Debug, PartialEq)]
pub struct Card {
    /// Its plane.
    pub plane: Plane,
    /// Its corners in the image, in order around it, pixels.
    pub corners_px: [[f64; 2]; 4],
    /// Diffuse reflectance; 0.18 for the usual grey card.
    pub reflectance: f64,
    /// Its relative standard deviation.
    pub reflectance_sigma: f64,
}

/// A light's position.
#[derive(Clone, Debug, PartialEq)]
pub struct LampAt {
    /// mm.
    pub position: Vec3,
    /// mm^2.
    pub covariance: Matrix3<f64>,
}

/// The intensity of one light.
#[derive(Clone, Debug, PartialEq)]
pub struct Intensity {
    /// Per channel, radiance units x mm^2.
    pub value: [f64; 3],
    /// Standard deviation per channel, the card's reflectance included.
    pub sigma: [f64; 3],
    /// Relative standard deviation without the reflectance, which is common to all lights; largest channel.
    pub own_sigma: f64,
    /// Dimmest cell of the card against the median, relative; 0 for an even card.
    pub dimmest: f64,
    /// Unit direction from the middle of the card to the light.
    pub direction: Vec3,
}

/// Why a card gives no intensity.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CardFault {
    /// Light from behind or along the card.
    #[error(
        "the light stands {degrees:.0} degrees off the card's normal, at most {most:.0} can be used: turn the card towards the light"
    )]
    Grazing {
        /// Angle, degrees.
        degrees: f64,
        /// Largest usable angle, degrees.
        most: f64,
    },
    /// Too few usable pixels.
    #[error(
        "only {percent:.0} % of the card's pixels hold radiance (the rest clipped, too dark or outside the frame): shoot its bracket again"
    )]
    Pixels {
        /// Share, percent.
        percent: f64,
    },
    /// No light on it.
    #[error("the card is dark: is the lamp on, and does nothing stand before it?")]
    Dark,
}

/// Cells along each side of the card.
const CELLS: usize = 8;
/// Share of the card's side left out at each edge: a card is darker and dirtier there.
const MARGIN: f64 = 0.08;
/// Largest angle between normal and light, degrees: a card shines at grazing light.
const MOST_DEGREES: f64 = 75.0;

/// The intensity of the lamp that lights the card in `image`.
///
/// # Errors
/// Grazing light, too few valid pixels, or a dark card.
pub fn intensity(
    image: &RadianceImage,
    projection: &Projection,
    card: &Card,
    lamp: &LampAt,
) -> Result<Intensity, CardFault> {
    let to_lamp = lamp.position - card.plane.point;
    let cosine = card.plane.normal.dot(&to_lamp.normalize());
    let degrees = cosine.clamp(-1.0, 1.0).acos().to_degrees();
    if degrees > MOST_DEGREES {
        return Err(CardFault::Grazing { degrees, most: MOST_DEGREES });
    }
    let mut cells: Vec<[Vec<f64>; 3]> = vec![Default::default(); CELLS * CELLS];
    let (mut inside, mut used) = (0_usize, 0_usize);
    for (x, y, u, v) in card.pixels(image.radiance.width, image.radiance.height) {
        inside += 1;
        let Some(point) = card.plane.meets(&projection.ray(x as f64 + 0.5, y as f64 + 0.5)) else { continue };
        if !*image.valid.at(x, y) {
            continue;
        }
        used += 1;
        let to_lamp = lamp.position - point;
        let d2 = to_lamp.norm_squared();
        let expected = card.reflectance / PI * card.plane.normal.dot(&to_lamp) / (d2 * d2.sqrt());
        let cell = (v * CELLS as f64) as usize * CELLS + (u * CELLS as f64) as usize;
        for (channel, radiance) in image.radiance.at(x, y).iter().enumerate() {
            cells[cell][channel].push(f64::from(*radiance) / expected);
        }
    }
    let percent = 100.0 * used as f64 / inside.max(1) as f64;
    if percent < 70.0 || inside < 4 * CELLS * CELLS {
        return Err(CardFault::Pixels { percent });
    }
    let geometric = lamp.relative_sigma(&card.plane);
    let (mut value, mut sigma, mut own_sigma, mut dimmest) = ([0.0; 3], [0.0; 3], 0.0_f64, 0.0_f64);
    for channel in 0..3 {
        let means: Vec<f64> =
            cells.iter().filter(|c| !c[channel].is_empty()).map(|c| median(c[channel].clone())).collect();
        let middle = median(means.clone());
        if middle <= 0.0 {
            return Err(CardFault::Dark);
        }
        let scatter = 1.4826 * median(means.iter().map(|m| (m - middle).abs()).collect()) / middle;
        // The median's standard error over the cells, 1.25 times that of a mean.
        let statistical = 1.25 * scatter / (means.len() as f64).sqrt();
        let least = means.iter().copied().fold(f64::INFINITY, f64::min);
        value[channel] = middle;
        own_sigma = own_sigma.max(statistical.hypot(geometric));
        sigma[channel] = middle * statistical.hypot(geometric).hypot(card.reflectance_sigma);
        dimmest = dimmest.max(1.0 - least / middle);
    }
    Ok(Intensity { value, sigma, own_sigma, dimmest, direction: to_lamp.normalize() })
}

impl LampAt {
    /// Relative standard deviation of the irradiance on the plane's point that the lamp's position leaves.
    fn relative_sigma(&self, plane: &Plane) -> f64 {
        let d = self.position - plane.point;
        let gradient = plane.normal / plane.normal.dot(&d) - d * (3.0 / d.norm_squared());
        gradient.dot(&(self.covariance * gradient)).max(0.0).sqrt()
    }
}

impl Card {
    /// Pixels inside the card's margin with their place (0 to 1, across and down).
    fn pixels(&self, width: usize, height: usize) -> Vec<(usize, usize, f64, f64)> {
        let range = |axis: usize, most: usize| {
            let all = self.corners_px.map(|c| c[axis]);
            let (low, high) =
                (all.iter().copied().fold(f64::INFINITY, f64::min), all.iter().copied().fold(0.0, f64::max));
            low.max(0.0) as usize..(high.max(0.0).ceil() as usize).min(most)
        };
        let mut pixels = Vec::new();
        for y in range(1, height) {
            for x in range(0, width) {
                if let Some([u, v]) = self.place([x as f64 + 0.5, y as f64 + 0.5]) {
                    pixels.push((x, y, u, v));
                }
            }
        }
        pixels
    }

    /// Place of a pixel on the card without its margin, 0 to 1; none outside. Inverse bilinear map by Newton's method.
    fn place(&self, at: [f64; 2]) -> Option<[f64; 2]> {
        let [a, b, c, d] = self.corners_px.map(Vector2::from);
        let at = Vector2::from(at);
        let mut uv = Vector2::new(0.5, 0.5);
        for _ in 0..8 {
            let (u, v) = (uv.x, uv.y);
            let here = a * ((1.0 - u) * (1.0 - v)) + b * (u * (1.0 - v)) + c * (u * v) + d * ((1.0 - u) * v);
            let along_u = (b - a) * (1.0 - v) + (c - d) * v;
            let along_v = (d - a) * (1.0 - u) + (c - b) * u;
            uv += Matrix2::from_columns(&[along_u, along_v]).try_inverse()? * (at - here);
        }
        let scaled = uv.map(|t| (t - MARGIN) / (1.0 - 2.0 * MARGIN));
        (scaled.min() >= 0.0 && scaled.max() < 1.0).then(|| [scaled.x, scaled.y])
    }
}

/// What the intensities of several lights say together: one bulb has one intensity.
#[derive(Clone, Debug, PartialEq)]
pub struct Agreement {
    /// The bulb's intensity: medians over the lights.
    pub bulb: [f64; 3],
    /// Ratio of every light's intensity to the bulb's, mean of the channels.
    pub ratios: Vec<f64>,
    /// Lights (index) whose intensity departs by more than chance, after what a tilt of the card explains.
    pub departing: Vec<usize>,
    /// By how many degrees the card would have to be tilted for the lights to agree better, if it is beyond chance.
    pub tilt_degrees: Option<f64>,
}

/// Departures of less than this are the lamp's drift and a card that is not quite Lambert's.
const DRIFT: f64 = 0.03;
/// A smaller tilt costs less than 2 % at 45 degrees.
const LEAST_TILT_DEGREES: f64 = 1.0;

/// Compares lights; with fewer than two there is nothing to compare.
pub fn agree(intensities: &[Intensity], plane: &Plane) -> Option<Agreement> {
    if intensities.len() < 2 {
        return None;
    }
    let bulb: [f64; 3] = std::array::from_fn(|c| median_mean(intensities.iter().map(|i| i.value[c]).collect()));
    let ratios: Vec<f64> =
        intensities.iter().map(|i| (0..3).map(|c| i.value[c] / bulb[c]).sum::<f64>() / 3.0).collect();
    let tolerance = |i: &Intensity| (4.0 * i.own_sigma).max(DRIFT);
    let (tilt, explained) = tilt(intensities, plane, &ratios);
    let outside = |ratios: &[f64]| -> Vec<usize> {
        (0..ratios.len()).filter(|&i| (ratios[i] - 1.0).abs() > tolerance(&intensities[i])).collect()
    };
    let (plain, tilted) = (outside(&ratios), outside(&explained));
    // A tilt is believed where it explains most of the departures; a shadow on one light is no tilt.
    let is_tilt =
        intensities.len() >= 4 && tilt > LEAST_TILT_DEGREES && tilted.len() < plain.len() && tilted.is_empty();
    Some(Agreement {
        bulb,
        departing: if is_tilt { Vec::new() } else { plain },
        tilt_degrees: is_tilt.then_some(tilt),
        ratios,
    })
}

/// The tilt of the normal (degrees) that makes the ratios most alike, and the ratios without it. A normal off by t changes the
/// cosine of a light l by t . l.
fn tilt(intensities: &[Intensity], plane: &Plane, ratios: &[f64]) -> (f64, Vec<f64>) {
    let e1 = plane.normal.cross(&if plane.normal.x.abs() < 0.7 { Vec3::x() } else { Vec3::y() }).normalize();
    let e2 = plane.normal.cross(&e1);
    let row = |i: &Intensity| {
        let cosine = plane.normal.dot(&i.direction);
        Vec3::new(1.0, e1.dot(&i.direction) / cosine, e2.dot(&i.direction) / cosine)
    };
    let rows: Vec<Vec3> = intensities.iter().map(row).collect();
    let (mut normal, mut right) = (Matrix3::zeros(), Vec3::zeros());
    for (row, ratio) in rows.iter().zip(ratios) {
        normal += row * row.transpose();
        right += row * *ratio;
    }
    let Some(x) = normal.try_inverse().map(|inverse| inverse * right) else { return (0.0, ratios.to_vec()) };
    let explained = rows.iter().zip(ratios).map(|(row, ratio)| ratio / row.dot(&x)).collect();
    ((x.y.hypot(x.z) / x.x.abs().max(1e-12)).atan().to_degrees(), explained)
}

/// Median; of an even number the mean of the middle two.
fn median_mean(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    if values.len() % 2 == 1 { values[middle] } else { 0.5 * (values[middle - 1] + values[middle]) }
}
