//! The samples a fit looks at: for every object point, the radiance and the angles under every light that counts.

use crate::numerics::geometry::{Angles, Light, Projection, Shape};
use crate::numerics::image::{Image, RadianceImage};
use rayon::prelude::*;

/// One point under one light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Index of the light.
    pub light: usize,
    /// The sample's angles.
    pub angles: Angles,
    /// Irradiance on the surface per channel: l_c cos(theta_i), with fall-off.
    pub irradiance: [f64; 3],
    /// Measured radiance per channel, positive.
    pub radiance: [f64; 3],
    /// Variance of the radiance per channel; 0 where unknown.
    pub variance: [f64; 3],
}

/// Every sample of every point, grouped by point.
#[derive(Clone, Debug, Default)]
pub struct Observations {
    /// Per point, index of its pixel in the image.
    pub pixel: Vec<usize>,
    /// Per point, where its samples begin in `samples`; one more entry than points.
    pub first: Vec<usize>,
    /// All samples, point by point.
    pub samples: Vec<Sample>,
    /// Lights in all, used or not.
    pub lights: usize,
    /// Lit, visible samples not used because their value was unusable (clipped, too dark, masked by the merge).
    pub unusable: usize,
    /// Of those, the ones within 6 degrees of the half vector: a lost highlight.
    pub unusable_highlight: usize,
}

/// Half angle below which a sample counts as highlight, radians (6 degrees; facts: judge the highlight by itself).
pub const HIGHLIGHT_HALF_ANGLE: f64 = 6.0 * std::f64::consts::PI / 180.0;

/// What the samples are taken from.
pub struct Scene<'a> {
    /// The camera.
    pub projection: &'a Projection,
    /// The object.
    pub object: &'a Shape,
    /// True on the object, where a mask was given.
    pub mask: Option<&'a Image<bool>>,
    /// Lights and the radiance under each.
    pub lights: Vec<(&'a Light, &'a RadianceImage)>,
    /// Least cos theta_i and cos theta_r of a sample.
    pub cosine_cutoff: f64,
}

/// A point with the samples found for it, before they are joined.
struct Gathered {
    pixel: usize,
    samples: Vec<Sample>,
    unusable: usize,
    unusable_highlight: usize,
}

impl Observations {
    /// Gathers the samples of `scene`. A point is kept when it has at least one sample.
    pub fn gather(scene: &Scene<'_>, width: usize, height: usize) -> Self {
        let rows: Vec<Vec<Gathered>> = (0..height)
            .into_par_iter()
            .map(|y| (0..width).filter_map(|x| gather_point(scene, x, y, y * width + x)).collect())
            .collect();
        let mut all = Self { lights: scene.lights.len(), first: vec![0], ..Self::default() };
        for point in rows.into_iter().flatten() {
            all.unusable += point.unusable;
            all.unusable_highlight += point.unusable_highlight;
            if !point.samples.is_empty() {
                all.push(point.pixel, &point.samples);
            }
        }
        all
    }

    /// Adds a point with its samples.
    pub fn push(&mut self, pixel: usize, samples: &[Sample]) {
        if self.first.is_empty() {
            self.first.push(0);
        }
        self.pixel.push(pixel);
        self.samples.extend_from_slice(samples);
        self.first.push(self.samples.len());
    }

    /// Number of points.
    pub fn points(&self) -> usize {
        self.pixel.len()
    }

    /// Samples of one point.
    pub fn of(&self, point: usize) -> &[Sample] {
        &self.samples[self.first[point]..self.first[point + 1]]
    }

    /// The samples whose light `keep` accepts, of the points that still have at least `least` of them; and, per point kept,
    /// its index here.
    pub fn filtered(&self, least: usize, keep: impl Fn(usize) -> bool) -> (Self, Vec<usize>) {
        let mut kept = Self { lights: self.lights, first: vec![0], ..Self::default() };
        let mut origin = Vec::new();
        for point in 0..self.points() {
            let samples: Vec<Sample> = self.of(point).iter().filter(|s| keep(s.light)).copied().collect();
            if samples.len() >= least {
                kept.push(self.pixel[point], &samples);
                origin.push(point);
            }
        }
        kept.unusable = self.unusable;
        kept.unusable_highlight = self.unusable_highlight;
        (kept, origin)
    }

    /// At most `count` points, evenly spread over the points here (deterministic).
    pub fn subset(&self, count: usize) -> Self {
        let mut kept = Self { lights: self.lights, first: vec![0], ..Self::default() };
        let total = self.points();
        let taken = count.min(total);
        for i in 0..taken {
            let point = i * total / taken;
            kept.push(self.pixel[point], self.of(point));
        }
        kept
    }
}

fn gather_point(scene: &Scene<'_>, x: usize, y: usize, pixel: usize) -> Option<Gathered> {
    if scene.mask.is_some_and(|mask| !mask.pixels[pixel]) {
        return None;
    }
    let surface = scene.object.at(x, y, &scene.projection.ray(x as f64 + 0.5, y as f64 + 0.5))?;
    let mut gathered = Gathered { pixel, samples: Vec::new(), unusable: 0, unusable_highlight: 0 };
    for (index, (light, image)) in scene.lights.iter().enumerate() {
        let (to_light, facing) = light.at(&surface.position);
        let angles = Angles::new(&surface.normal, &to_light, &surface.view);
        if angles.cos_i <= scene.cosine_cutoff || angles.cos_r <= scene.cosine_cutoff {
            continue;
        }
        let radiance = image.radiance.pixels[pixel].map(f64::from);
        if !image.valid.pixels[pixel] || radiance.iter().any(|&value| value <= 0.0) {
            gathered.unusable += 1;
            gathered.unusable_highlight += usize::from(angles.half_angle() < HIGHLIGHT_HALF_ANGLE);
            continue;
        }
        let variance = image.variance.as_ref().map_or([0.0; 3], |v| v.pixels[pixel].map(f64::from));
        let irradiance = facing.map(|l| l * angles.cos_i);
        gathered.samples.push(Sample { light: index, angles, irradiance, radiance, variance });
    }
    Some(gathered)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::numerics::brdf::Material;
    use crate::numerics::brdf::ward::Ward;
    use crate::numerics::fit::{Mixture, predict};
    use crate::numerics::geometry::Vec3;
    use rand::{RngExt, SeedableRng, rngs::StdRng};

    /// A noise-free problem with known truth: points spread over a ball seen from -z, lights on an arc.
    pub(crate) fn synthetic(points: usize, materials: usize, seed: u64) -> (Observations, Mixture) {
        let mut rng = StdRng::seed_from_u64(seed);
        let known = [
            Material { rho_d: [0.6, 0.5, 0.4], rho_s: [0.05, 0.06, 0.04], beta: 0.12 },
            Material { rho_d: [0.1, 0.2, 0.35], rho_s: [0.07, 0.05, 0.06], beta: 0.25 },
            Material { rho_d: [0.3, 0.05, 0.1], rho_s: [0.03, 0.03, 0.05], beta: 0.18 },
        ];
        let mut observations = Observations { lights: 7, first: vec![0], ..Observations::default() };
        let mut mixture = Mixture { materials: known[..materials].to_vec(), gamma: Vec::new() };
        let view = -Vec3::z();
        while observations.points() < points {
            let (x, y): (f64, f64) = (rng.random_range(-0.95..0.95), rng.random_range(-0.95..0.95));
            if x * x + y * y > 0.9 {
                continue;
            }
            let normal = Vec3::new(x, y, -(1.0 - x * x - y * y).sqrt());
            let first = rng.random_range(0.0..1.0);
            let gamma: Vec<f64> = match materials {
                1 => vec![first],
                2 => vec![first, 1.0 - first],
                _ => vec![first * 0.6, (1.0 - first) * 0.6, rng.random_range(0.0..0.4)],
            };
            let mut samples = Vec::new();
            for light in 0..7 {
                let azimuth = (-60.0 + 20.0 * light as f64).to_radians();
                let direction = Vec3::new(azimuth.sin(), 0.1, -azimuth.cos()).normalize();
                let angles = Angles::new(&normal, &direction, &view);
                if angles.cos_i <= 0.1 || angles.cos_r <= 0.1 {
                    continue;
                }
                let irradiance = [3.0, 2.8, 2.5].map(|l| l * angles.cos_i);
                let mut sample = Sample { light, angles, irradiance, radiance: [0.0; 3], variance: [0.0; 3] };
                sample.radiance = predict(&Ward, &mixture.materials, &gamma, &sample);
                sample.variance = sample.radiance.map(|i| 1e-4 * i * i);
                samples.push(sample);
            }
            if samples.len() >= 4 {
                observations.push(observations.points(), &samples);
                mixture.gamma.extend(gamma);
            }
        }
        (observations, mixture)
    }

    #[test]
    fn a_light_that_is_filtered_out_leaves_no_sample() {
        let (observations, _) = synthetic(50, 2, 1);
        let (kept, origin) = observations.filtered(3, |light| light != 2);
        assert!(kept.samples.iter().all(|s| s.light != 2));
        assert_eq!(kept.points(), origin.len());
        for (point, &from) in origin.iter().enumerate() {
            assert_eq!(kept.pixel[point], observations.pixel[from]);
        }
    }
}
