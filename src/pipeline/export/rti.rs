//! RTI (reflectance transformation imaging): pictures of one view, and a list of the directions from which they are lit (.lp), as
//! RTIBuilder and relight-cli read them.
//!
//! A list holds one direction a picture and supposes lamps of one strength, far away. So every picture is scaled by the irradiance in
//! the middle of the surface, and where the lamps really stand is told beside it. What the near lamps do to all other points is
//! measured: it is what a reader of the list gets wrong.

use crate::numerics::fit::observations::HIGHLIGHT_HALF_ANGLE;
use crate::numerics::geometry::{Angles, Light, SurfacePoint, Vec3};
use crate::numerics::image::{Image, RadianceImage};
use crate::numerics::radiometry::response::Response;
use crate::pipeline::dataset::Geometry;
use crate::pipeline::render::exposed;
use serde::Serialize;
use serde_json::{Value, json};

/// Name of the format.
pub const NAME: &str = "rti";
/// What it is.
pub const ABOUT: &str = "RTI: pictures through the response and their light directions (.lp)";

/// The list of directions, and the file beside it.
pub const LIST: &str = "rti.lp";
/// Where the lamps stand.
pub const LIGHTS: &str = "lights.json";

/// The level that this part of the surface's pixels stays below: what is brighter is a highlight, and may be clipped.
const LEVEL: f64 = 250.0;
const PART: f64 = 0.99;

/// A lamp as the list has it, and what that leaves out.
#[derive(Clone, Debug)]
pub struct Lamp {
    /// Its picture.
    pub file: String,
    /// Unit direction from the middle of the surface: x right, y up, z towards the camera.
    pub direction: Vec3,
    /// Factor of its picture: with it the middle of the surface has the same irradiance in all pictures.
    pub gain: f64,
    light: Light,
    /// Irradiance in the middle of the surface, mean over the channels, radiance units.
    irradiance: f64,
}

/// The surface and its lamps.
pub struct Stage<'a> {
    geometry: &'a Geometry,
    middle: Vec3,
    /// In the order of the dataset.
    pub lamps: Vec<Lamp>,
}

/// From the camera's frame (y down, z away) to that of the list (y up, z towards the camera).
fn turned(v: &Vec3) -> Vec3 {
    Vec3::new(v.x, -v.y, -v.z)
}

fn mean(rgb: [f64; 3]) -> f64 {
    rgb.iter().sum::<f64>() / 3.0
}

impl<'a> Stage<'a> {
    /// Where surface and lamps stand.
    ///
    /// # Errors
    /// The camera sees no point of the surface.
    pub fn of(geometry: &'a Geometry) -> Result<Self, String> {
        let (mut sum, mut count) = (Vec3::zeros(), 0_usize);
        for i in 0..geometry.width * geometry.height {
            if let Some(point) = surface(geometry, i) {
                sum += point.position;
                count += 1;
            }
        }
        if count == 0 {
            return Err("the camera sees no point of the object: check [object] and mask".to_owned());
        }
        let middle = sum / count as f64;
        let strengths: Vec<f64> = geometry.lights.iter().map(|light| mean(light.light.at(&middle).1)).collect();
        let common = strengths.iter().sum::<f64>() / strengths.len() as f64;
        let lamp = |(i, &irradiance): (usize, &f64)| {
            let light = geometry.lights[i].light.clone();
            let direction = turned(&light.at(&middle).0);
            Lamp { file: format!("light-{i:03}.png"), direction, gain: common / irradiance, light, irradiance }
        };
        let lamps = strengths.iter().enumerate().map(lamp).collect();
        Ok(Self { geometry, middle, lamps })
    }

    /// The list: how many pictures, and a line each with its name and direction.
    pub fn list(&self) -> String {
        let line = |lamp: &Lamp| {
            let d = &lamp.direction;
            format!("{} {:.8} {:.8} {:.8}\n", lamp.file, d.x, d.y, d.z)
        };
        format!("{}\n{}", self.lamps.len(), self.lamps.iter().map(line).collect::<String>())
    }

    /// Where the lamps stand, and how the pictures were made of the radiance.
    pub fn lights(&self, time_s: f64, response: &str) -> String {
        let lamp = |lamp: &Lamp| {
            let (position, intensity) = match &lamp.light {
                Light::Point { position, intensity } => {
                    let place = turned(&(position - self.middle));
                    (json!([place.x, place.y, place.z]), json!(intensity))
                }
                Light::Distant { .. } => (Value::Null, Value::Null),
            };
            json!({
                "file": lamp.file,
                "direction": [lamp.direction.x, lamp.direction.y, lamp.direction.z],
                "position_mm": position,
                "intensity": intensity,
                "irradiance_in_the_middle": lamp.irradiance,
                "gain": lamp.gain,
            })
        };
        let told = json!({
            "frame": "x right, y up, z towards the camera; millimetres from the middle of the surface that the camera sees",
            "pictures": "level = response(radiance x gain x exposure_s)",
            "exposure_s": time_s,
            "response": response,
            "intensity": "radiance units x mm^2, red, green, blue: irradiance at distance d is intensity / d^2; null for a distant light",
            "lights": self.lamps.iter().map(lamp).collect::<Vec<Value>>(),
        });
        format!("{told:#}\n")
    }
}

/// The point of the surface that a pixel sees.
fn surface(geometry: &Geometry, pixel: usize) -> Option<SurfacePoint> {
    let (x, y) = (pixel % geometry.width, pixel / geometry.width);
    if geometry.mask.as_ref().is_some_and(|mask| !mask.pixels[pixel]) {
        return None;
    }
    geometry.object.at(x, y, &geometry.projection.ray(x as f64 + 0.5, y as f64 + 0.5))
}

/// Bins of the logarithm of radiance, a hundredth wide.
const BINS_A_UNIT: f64 = 100.0;
const LOGS: (f64, f64) = (-90.0, 90.0);

/// How bright the surface is in all pictures.
pub struct Brightness {
    counts: Vec<u64>,
}

impl Default for Brightness {
    fn default() -> Self {
        Self { counts: vec![0; ((LOGS.1 - LOGS.0) * BINS_A_UNIT) as usize + 1] }
    }
}

impl Brightness {
    /// Adds a picture.
    pub fn add(&mut self, image: &RadianceImage, gain: f64) {
        let most = |pixel: &[f32; 3]| f64::from(pixel.iter().copied().fold(0.0, f32::max)) * gain;
        for (pixel, valid) in image.radiance.pixels.iter().zip(&image.valid.pixels) {
            let log = most(pixel).ln();
            if *valid && log.is_finite() {
                let bin = ((log.clamp(LOGS.0, LOGS.1) - LOGS.0) * BINS_A_UNIT) as usize;
                self.counts[bin] += 1;
            }
        }
    }

    /// The exposure time, seconds, at which nearly all pixels stay below clipping.
    ///
    /// # Errors
    /// No pixel of any picture is lit.
    pub fn time_s(&self, response: &Response) -> Result<f64, String> {
        let all: u64 = self.counts.iter().sum();
        let mut below = 0;
        let reached = self.counts.iter().position(|count| {
            below += count;
            below as f64 >= PART * all as f64
        });
        let bin = reached.filter(|_| all > 0).ok_or("no pixel of its pictures is lit: there is nothing to show")?;
        let log = LOGS.0 + (bin + 1) as f64 / BINS_A_UNIT;
        let exposure = (0..3).map(|c| response.log_exposure_at(c, LEVEL)).fold(f64::INFINITY, f64::min);
        Ok((exposure - log).exp())
    }
}

/// The picture of a lamp.
pub fn picture(image: &RadianceImage, lamp: &Lamp, response: &Response, time_s: f64) -> Image<[u8; 3]> {
    exposed(&image.radiance, response, lamp.gain * time_s)
}

/// What the list and its pictures lose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Loss {
    /// Mean of |radiance out of the levels - radiance| / radiance, over lit pixels and channels.
    pub mean: f64,
    /// The same where the half angle is below 6 degrees; none if there is no such pixel.
    pub highlight: Option<f64>,
    /// Part of the lit pixels that are clipped in a channel.
    pub clipped: f64,
    /// Angle between the direction of the list and the lamp as the point sees it: mean and largest, degrees.
    pub direction_deg: [f64; 2],
    /// Relative difference of the irradiance from that in the middle: mean and largest.
    pub irradiance: [f64; 2],
}

/// Sums of what is lost.
#[derive(Default)]
pub struct Sums {
    levels: (f64, usize),
    highlights: (f64, usize),
    clipped: usize,
    lit: usize,
    angle: (f64, f64),
    irradiance: (f64, f64),
}

impl Sums {
    /// Adds a picture, `levels`, made of `image` for the lamp `index` of the stage.
    pub fn add(
        &mut self,
        stage: &Stage<'_>,
        index: usize,
        image: &RadianceImage,
        levels: &Image<[u8; 3]>,
        (response, time_s): (&Response, f64),
    ) {
        let lamp = &stage.lamps[index];
        let direction = turned(&lamp.direction);
        for (i, &level) in levels.pixels.iter().enumerate() {
            let Some(point) = surface(stage.geometry, i).filter(|_| image.valid.pixels[i]) else { continue };
            let (to_light, irradiance) = lamp.light.at(&point.position);
            let angles = Angles::new(&point.normal, &to_light, &point.view);
            if angles.cos_i <= stage.geometry.cosine_cutoff || angles.cos_r <= stage.geometry.cosine_cutoff {
                continue;
            }
            self.lit += 1;
            self.clipped += usize::from(level.contains(&255));
            let angle = to_light.cross(&direction).norm().atan2(to_light.dot(&direction)).to_degrees();
            let off = (mean(irradiance) / lamp.irradiance - 1.0).abs();
            for (sums, value) in [(&mut self.angle, angle), (&mut self.irradiance, off)] {
                *sums = (sums.0 + value, sums.1.max(value));
            }
            for c in 0..3 {
                let radiance = f64::from(image.radiance.pixels[i][c]);
                if radiance <= 0.0 {
                    continue;
                }
                let told = response.log_exposure_at(c, f64::from(level[c])).exp() / (lamp.gain * time_s);
                let difference = (told - radiance).abs() / radiance;
                self.levels = (self.levels.0 + difference, self.levels.1 + 1);
                if angles.half_angle() < HIGHLIGHT_HALF_ANGLE {
                    self.highlights = (self.highlights.0 + difference, self.highlights.1 + 1);
                }
            }
        }
    }

    /// The means.
    pub fn loss(&self) -> Loss {
        let part = |(sum, count): (f64, usize)| (count > 0).then(|| sum / count as f64);
        let lit = self.lit.max(1) as f64;
        Loss {
            mean: part(self.levels).unwrap_or(0.0),
            highlight: part(self.highlights),
            clipped: self.clipped as f64 / lit,
            direction_deg: [self.angle.0 / lit, self.angle.1],
            irradiance: [self.irradiance.0 / lit, self.irradiance.1],
        }
    }
}

impl Loss {
    /// The loss as sentences.
    pub fn sentences(&self) -> Vec<String> {
        let percent = |part: f64| format!("{:.2} %", 100.0 * part);
        let highlight = self.highlight.map_or(String::new(), |part| format!(", in highlights {}", percent(part)));
        let [angle, largest] = self.direction_deg;
        vec![
            format!(
                "Measured: radiance out of the levels differs from what was measured by {} in the mean{highlight}; {} of the lit pixels are clipped.",
                percent(self.mean),
                percent(self.clipped)
            ),
            format!(
                "Measured: points see the lamp {angle:.2} degrees from the direction in the list in the mean, {largest:.2} at most, and its irradiance differs from that in the middle by {} in the mean, {} at most: correct it with {LIGHTS}.",
                percent(self.irradiance[0]),
                percent(self.irradiance[1])
            ),
        ]
    }
}
