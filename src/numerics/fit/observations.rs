//! The samples a fit looks at: for every object point, the radiance and the angles under every light that counts.

pub use super::row::{MAX_LIGHTS, Row, Sample};
use crate::numerics::geometry::{Angles, Light, Projection, Shape};
use crate::numerics::image::{Image, RadianceImage};
use crate::numerics::simd::{LANES, Lane};
use rayon::prelude::*;
use std::ops::Range;

/// Every sample of every point. Points stand in blocks of [`LANES`]; row k of a block holds the k-th sample of each.
#[derive(Clone, Debug, Default)]
pub struct Observations {
    /// Per point, index of its pixel in the image.
    pub pixel: Vec<usize>,
    /// Samples per point.
    count: Vec<u16>,
    /// Per block, where its rows begin.
    first: Vec<usize>,
    /// All rows, block by block.
    rows: Vec<Row>,
    /// Per row, the azimuths of the lights, radians (`fit::directions`); empty unless set.
    azimuth: Vec<Lane>,
    /// Samples in all.
    samples: usize,
    /// Lights in all, used or not.
    pub lights: usize,
    /// Lit, visible samples not used because their value was unusable (clipped, too dark, masked by the merge).
    pub unusable: usize,
    /// Of those, the ones within 6 degrees of the half vector: a lost highlight.
    pub unusable_highlight: usize,
}

/// Half angle below which a sample counts as highlight, radians (6 degrees).
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
        let mut all = Self::new(scene.lights.len());
        for point in rows.into_iter().flatten() {
            all.unusable += point.unusable;
            all.unusable_highlight += point.unusable_highlight;
            if !point.samples.is_empty() {
                all.push(point.pixel, &point.samples);
            }
        }
        all
    }

    /// No points yet, under this many lights.
    pub fn new(lights: usize) -> Self {
        Self { lights, ..Self::default() }
    }

    /// Adds a point with its samples.
    pub fn push(&mut self, pixel: usize, samples: &[Sample]) {
        let lane = self.pixel.len() % LANES;
        for (row, sample) in self.open(pixel, samples.len()).iter_mut().zip(samples) {
            row.set(lane, sample);
        }
    }

    /// Adds a point of so many samples; returns the rows it stands in.
    fn open(&mut self, pixel: usize, samples: usize) -> &mut [Row] {
        if self.pixel.len().is_multiple_of(LANES) {
            self.first.push(self.rows.len());
        }
        let first = self.first[self.first.len() - 1];
        self.rows.resize(self.rows.len().max(first + samples), Row::EMPTY);
        self.pixel.push(pixel);
        self.count.push(u16::try_from(samples).unwrap_or(u16::MAX));
        self.samples += samples;
        &mut self.rows[first..first + samples]
    }

    /// Number of points.
    pub fn points(&self) -> usize {
        self.pixel.len()
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// Channels that say something of their own: 1 where all three hold the same radiances, as a grey picture's do; else 3.
    pub fn channels(&self) -> usize {
        let grey = |row: &Row| row.radiance[0] == row.radiance[1] && row.radiance[0] == row.radiance[2];
        if self.rows.iter().all(grey) { 1 } else { 3 }
    }

    /// Independent residuals of a fit: samples times [`Self::channels`].
    pub fn residuals(&self) -> usize {
        self.channels() * self.samples
    }

    /// Number of blocks of points.
    pub fn blocks(&self) -> usize {
        self.first.len()
    }

    /// Rows of some blocks.
    pub fn rows_of(&self, blocks: Range<usize>) -> Range<usize> {
        let at = |block: usize| self.first.get(block).copied().unwrap_or(self.rows.len());
        at(blocks.start)..at(blocks.end)
    }

    /// All rows, block by block.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Samples of one point.
    pub fn of(&self, point: usize) -> impl ExactSizeIterator<Item = Sample> + Clone + '_ {
        let (first, count) = (self.first[point / LANES], usize::from(self.count[point]));
        self.rows[first..first + count].iter().map(move |row| row.get(point % LANES))
    }

    /// All samples, point by point.
    pub fn all(&self) -> impl Iterator<Item = Sample> + '_ {
        (0..self.points()).flat_map(|point| self.of(point))
    }

    /// Indices of the lights that have a sample, ascending.
    pub fn lights_in_use(&self) -> Vec<usize> {
        let mut used = vec![false; self.lights];
        for point in 0..self.points() {
            let first = self.first[point / LANES];
            for row in &self.rows[first..first + usize::from(self.count[point])] {
                if let Some(used) = used.get_mut(usize::from(row.light[point % LANES])) {
                    *used = true;
                }
            }
        }
        (0..self.lights).filter(|&light| used[light]).collect()
    }

    /// Gives every sample the azimuth of its light, radians (`fit::directions`); once all points are there.
    pub fn set_azimuths(&mut self, of: impl Fn(usize, &Sample) -> f64) {
        let mut azimuth = vec![[0.0; LANES]; self.rows.len()];
        for point in 0..self.points() {
            for (row, sample) in azimuth[self.first[point / LANES]..].iter_mut().zip(self.of(point)) {
                row[point % LANES] = of(point, &sample) as f32;
            }
        }
        self.azimuth = azimuth;
    }

    /// True when the azimuths of the lights were set.
    pub fn has_azimuths(&self) -> bool {
        !self.azimuth.is_empty()
    }

    /// Azimuth of a light at a point; none where none was set or the point has no such sample.
    pub fn azimuth_of(&self, point: usize, light: usize) -> Option<f64> {
        let index = self.of(point).position(|sample| sample.light == light)?;
        self.azimuth.get(self.first[point / LANES] + index).map(|row| f64::from(row[point % LANES]))
    }

    /// Takes over the azimuths of `source`, where point p here is point `origin[p]`.
    fn inherit_azimuths(&mut self, source: &Self, origin: &[usize]) {
        if source.has_azimuths() {
            self.set_azimuths(|point, sample| source.azimuth_of(origin[point], sample.light).unwrap_or(0.0));
        }
    }

    /// The samples that `change` returns for the samples here, of the points that still have at least `least` of them; and,
    /// per point kept, its index here.
    pub fn changed(&self, least: usize, mut change: impl FnMut(usize, Sample) -> Option<Sample>) -> (Self, Vec<usize>) {
        let mut kept = Self { unusable: self.unusable, ..Self::new(self.lights) };
        kept.unusable_highlight = self.unusable_highlight;
        let mut origin = Vec::new();
        let mut samples = Vec::new();
        for point in 0..self.points() {
            samples.clear();
            samples.extend(self.of(point).filter_map(|sample| change(point, sample)));
            if samples.len() >= least {
                kept.push(self.pixel[point], &samples);
                origin.push(point);
            }
        }
        kept.inherit_azimuths(self, &origin);
        (kept, origin)
    }

    /// The samples whose light `keep` accepts, of the points that still have at least `least` of them; and, per point kept,
    /// its index here.
    pub fn filtered(&self, least: usize, keep: impl Fn(usize) -> bool) -> (Self, Vec<usize>) {
        self.changed(least, |_, sample| keep(sample.light).then_some(sample))
    }

    /// The same with the irradiance of each light times its gain.
    pub fn with_gains(&self, gains: &[f64]) -> Self {
        let mut changed = self.clone();
        for row in &mut changed.rows {
            for lane in 0..LANES {
                let gain = gains[usize::from(row.light[lane])] as f32;
                row.irradiance.iter_mut().for_each(|channel| channel[lane] *= gain);
            }
        }
        changed
    }

    /// The points of these indices.
    pub fn select(&self, points: &[usize]) -> Self {
        let mut kept = Self::new(self.lights);
        for &point in points {
            let (first, count) = (self.first[point / LANES], usize::from(self.count[point]));
            let lane = kept.pixel.len() % LANES;
            for (row, source) in kept.open(self.pixel[point], count).iter_mut().zip(&self.rows[first..first + count]) {
                row.copy(lane, source, point % LANES);
            }
        }
        kept.inherit_azimuths(self, points);
        kept
    }

    /// At most `count` points, evenly spread over the points here (deterministic).
    pub fn subset(&self, count: usize) -> Self {
        let total = self.points();
        let taken = count.min(total);
        let spread: Vec<usize> = (0..taken).map(|i| i * total / taken).collect();
        self.select(&spread)
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
        let variance = image.variance.as_ref().map_or([0.0; 3], |v| v.pixels[pixel].map(f64::from));
        let irradiance = facing.map(|l| l * angles.cos_i);
        let sample = Sample { light: index, angles, irradiance, radiance, variance };
        if image.valid.pixels[pixel] && sample.usable() {
            gathered.samples.push(sample);
        } else {
            gathered.unusable += 1;
            gathered.unusable_highlight += usize::from(angles.half_angle() < HIGHLIGHT_HALF_ANGLE);
        }
    }
    Some(gathered)
}

#[cfg(test)]
pub(crate) mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::numerics::brdf::Material;
    use crate::numerics::brdf::ward::Ward;
    use crate::numerics::fit::directions::azimuth;
    use crate::numerics::fit::{Mixture, predict};
    use crate::numerics::geometry::Vec3;
    use rand::{RngExt, SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, Normal};

    /// A noise-free problem with known truth: points spread over a ball seen from -z, lights on an arc.
    pub(crate) fn synthetic(points: usize, materials: usize, seed: u64) -> (Observations, Mixture) {
        let mut rng = StdRng::seed_from_u64(seed);
        let known = [
            Material { rho_d: [0.6, 0.5, 0.4], rho_s: [0.05, 0.06, 0.04], beta: 0.12 },
            Material { rho_d: [0.1, 0.2, 0.35], rho_s: [0.07, 0.05, 0.06], beta: 0.25 },
            Material { rho_d: [0.3, 0.05, 0.1], rho_s: [0.03, 0.03, 0.05], beta: 0.18 },
        ];
        let mut observations = Observations::new(7);
        let mut mixture = Mixture { materials: known[..materials].to_vec(), gamma: Vec::new() };
        let view = -Vec3::z();
        let mut azimuths: Vec<[f64; 7]> = Vec::new();
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
            let mut about = [0.0; 7];
            for light in 0..7 {
                let station = (-60.0 + 20.0 * light as f64).to_radians();
                let direction = Vec3::new(station.sin(), 0.1, -station.cos()).normalize();
                let angles = Angles::new(&normal, &direction, &view);
                about[light] = azimuth(&normal, &direction, &view);
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
                azimuths.push(about);
            }
        }
        observations.set_azimuths(|point, sample| azimuths[point][sample.light]);
        (observations, mixture)
    }

    /// The observations with normal errors of `deviation` times each radiance; variances say so.
    pub(crate) fn noisy(observations: &Observations, deviation: f64, seed: u64) -> Observations {
        let mut rng = StdRng::seed_from_u64(seed);
        let normal = Normal::new(0.0, deviation).unwrap();
        let disturb = |_, mut sample: Sample| {
            for radiance in &mut sample.radiance {
                *radiance *= (1.0 + normal.sample(&mut rng)).max(0.01);
            }
            sample.variance = [0.0; 3];
            Some(sample)
        };
        observations.changed(1, disturb).0
    }

    #[test]
    fn a_light_that_is_filtered_out_leaves_no_sample() {
        let (observations, _) = synthetic(50, 2, 1);
        let (kept, origin) = observations.filtered(3, |light| light != 2);
        assert!(kept.all().all(|s| s.light != 2));
        assert_eq!(kept.points(), origin.len());
        for (point, &from) in origin.iter().enumerate() {
            assert_eq!(kept.pixel[point], observations.pixel[from]);
        }
    }
}
