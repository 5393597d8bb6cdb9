//! Where light and view stand about the normal, which the angles of a sample leave open and a turned normal needs.
//!
//! The frame of a point: z along the normal, x to the side the view leans to, y = z cross x. The cosines of a sample and
//! the azimuth of its light then give both directions; one number a sample is kept, and none unless asked for.

use super::observations::{Observations, Sample, Scene};
use crate::numerics::geometry::{Angles, Vec3};

/// A turn of the normal: its new direction is (tilt\[0\], tilt\[1\], 1) in the frame of its point.
pub type Tilt = [f64; 2];

/// Least cosine of a sample about a turned normal: below it lies in attached shadow.
const LEAST_COSINE: f64 = 0.02;

/// Sine of the angle between normal and view below which the frame turns to a fixed side.
const UPRIGHT: f64 = 1e-5;

/// Unit x axis of the frame of a point.
pub fn x_axis(normal: &Vec3, view: &Vec3) -> Vec3 {
    let lean = view - normal * normal.dot(view);
    if lean.norm() > UPRIGHT {
        return lean.normalize();
    }
    let side = if normal.x.abs() < 0.9 { Vec3::x() } else { Vec3::y() };
    (side - normal * normal.dot(&side)).normalize()
}

/// Azimuth of a light in the frame of its point, radians, from x towards y.
pub fn azimuth(normal: &Vec3, light: &Vec3, view: &Vec3) -> f64 {
    let x = x_axis(normal, view);
    normal.cross(&x).dot(light).atan2(x.dot(light))
}

/// The sample about a turned normal; none where that puts it in shadow.
pub fn turned(sample: &Sample, azimuth: f64, tilt: Tilt) -> Option<Sample> {
    if tilt == [0.0; 2] {
        return Some(*sample);
    }
    let sine = |cosine: f64| (1.0 - cosine * cosine).max(0.0).sqrt();
    let Angles { cos_i, cos_r, .. } = sample.angles;
    let view = Vec3::new(sine(cos_r), 0.0, cos_r);
    let light = Vec3::new(sine(cos_i) * azimuth.cos(), sine(cos_i) * azimuth.sin(), cos_i);
    let angles = Angles::new(&Vec3::new(tilt[0], tilt[1], 1.0).normalize(), &light, &view);
    let irradiance = sample.irradiance.map(|e| e * angles.cos_i / cos_i);
    (angles.cos_i >= LEAST_COSINE && angles.cos_r >= LEAST_COSINE).then_some(Sample { angles, irradiance, ..*sample })
}

/// Angle between a turned normal and the given one, degrees.
pub fn degrees(tilt: Tilt) -> f64 {
    tilt[0].hypot(tilt[1]).atan().to_degrees()
}

impl Observations {
    /// Fills in the azimuths of the lights of observations gathered from `scene`, an image of this width.
    pub fn gather_azimuths(&mut self, scene: &Scene<'_>, width: usize) {
        let pixels = self.pixel.clone();
        self.set_azimuths(|point, sample| {
            let (x, y) = (pixels[point] % width, pixels[point] / width);
            let ray = scene.projection.ray(x as f64 + 0.5, y as f64 + 0.5);
            let light = scene.lights.get(sample.light).map(|(light, _)| light);
            let seen = scene.object.at(x, y, &ray).zip(light);
            seen.map_or(0.0, |(at, light)| azimuth(&at.normal, &light.at(&at.position).0, &at.view))
        });
    }

    /// The samples about turned normals, a tilt a point; without those that fall into shadow.
    pub fn turned(&self, tilts: &[Tilt]) -> Self {
        let turn = |point: usize, sample: Sample| match self.azimuth_of(point, sample.light) {
            Some(azimuth) => turned(&sample, azimuth, tilts[point]),
            None => Some(sample),
        };
        self.changed(0, turn).0
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::expect_used)]
    use super::*;
    use rand::{RngExt, SeedableRng, rngs::StdRng};

    /// A turned sample has the angles (to the root of the rounding of a cosine near 1) that the turned normal makes with the light and the view themselves.
    #[test]
    fn turning_a_sample_is_turning_its_normal() {
        let mut rng = StdRng::seed_from_u64(61);
        let mut unit = || Vec3::from_fn(|_, _| rng.random_range(-1.0..1.0)).normalize();
        let mut tried = 0;
        while tried < 500 {
            let (normal, light, view) = (unit(), unit(), unit());
            let angles = Angles::new(&normal, &light, &view);
            if angles.cos_i < 0.2 || angles.cos_r < 0.2 {
                continue;
            }
            let view = if tried % 10 == 0 { normal } else { view };
            let angles = Angles::new(&normal, &light, &view);
            let tilt = [0.03, -0.05];
            let x = x_axis(&normal, &view);
            let new = (normal + x * tilt[0] + normal.cross(&x) * tilt[1]).normalize();
            let expected = Angles::new(&new, &light, &view);
            let sample =
                Sample { light: 0, angles, irradiance: [angles.cos_i; 3], radiance: [1.0; 3], variance: [0.0; 3] };
            let found = turned(&sample, azimuth(&normal, &light, &view), tilt).expect("lit");
            for (a, b) in [
                (found.angles.cos_i, expected.cos_i),
                (found.angles.cos_r, expected.cos_r),
                (found.angles.tan2_half, expected.tan2_half),
                (found.angles.cos_iv, expected.cos_iv),
                (found.irradiance[1], expected.cos_i),
            ] {
                assert!((a - b).abs() < 1e-7 * (1.0 + b.abs()), "{found:?} instead of {expected:?}");
            }
            tried += 1;
        }
    }
}
