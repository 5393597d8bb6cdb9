//! The reference patch in the frames of a station: which pixels, how bright it must be under the planned light, how bright it is.

use super::drift::PatchReading;
use crate::numerics::geometry::{Light, Projection, Ray, Sphere, Vec3};
use crate::numerics::radiometry::drift::Patch;
use crate::numerics::radiometry::noise::SensorNoise;
use crate::pipeline::develop::{BracketFrame, Crop, Known, radiance};
use crate::session::plan::Station;
use rig_config::Rig;

/// A lamp that lights the patch at a smaller cosine tells nothing: there a degree by which its normal is stated wrong is more than 3 %.
const GRAZING: f64 = 0.5;
/// Points on the circle that bound its image.
const POINTS: u32 = 64;
/// Points of the rectangle, each way, at which the law is taken.
const GRID: usize = 5;
/// Steps in which the rectangle is shrunk until it lies on the patch, and the part of the patch's radius that it may use: pixels at the
/// rim are blurred.
const STEPS: u32 = 50;
const INNER: f64 = 0.94;

/// The patch as the camera sees it.
struct View {
    projection: Projection,
    center: Vec3,
    normal: Vec3,
    radius: f64,
    object: Sphere,
}

/// Reads the patch of a rig in a developed bracket; none if the rig has no patch.
pub fn read(
    rig: &Rig,
    station: &Station,
    frames: &[BracketFrame<'_>],
    known: &Known,
    noise: &SensorNoise,
) -> Option<Result<PatchReading, String>> {
    let view = View::of(rig)?;
    Some(view.read(&light(rig, station), frames, known, noise))
}

/// Its pixels in the frames of a station, where the lamp lights it well enough; none elsewhere, or without a patch.
pub fn lit(rig: &Rig, station: &Station) -> Option<Crop> {
    let view = View::of(rig)?;
    let part = view.pixels()?;
    view.expected(&part, &light(rig, station)).is_ok().then_some(part)
}

/// The lamp as planned for a station.
fn light(rig: &Rig, station: &Station) -> Light {
    Light::Point {
        position: Vec3::from(station.light_position_mm),
        intensity: station.light_intensity.unwrap_or(rig.lamp.intensity),
    }
}

impl View {
    fn of(rig: &Rig) -> Option<Self> {
        let (camera, patch) = (&rig.camera, rig.reference_patch.as_ref()?);
        Some(Self {
            projection: Projection::Pinhole {
                focal_px: camera.focal_px,
                principal_px: camera.principal_px,
                distortion: camera.distortion,
            },
            center: Vec3::from(patch.center_mm),
            normal: Vec3::from(patch.normal).normalize(),
            radius: 0.5 * patch.diameter_mm,
            object: Sphere { center: Vec3::from(rig.object.center_mm), radius: rig.object.radius_mm },
        })
    }

    fn read(
        &self,
        light: &Light,
        frames: &[BracketFrame<'_>],
        known: &Known,
        noise: &SensorNoise,
    ) -> Result<PatchReading, String> {
        let part = self.pixels().ok_or("the patch is too small in the picture")?;
        let expected = self.expected(&part, light)?;
        let image = radiance(frames, part, known, noise).map_err(|e| e.to_string())?;
        let whole = Patch { x: 0, y: 0, width: part.width, height: part.height };
        let mean = whole.mean(&image).map_err(|e| e.to_string())?;
        let (radiance, sigma) = (mean.radiance, mean.relative_variance.map(f64::sqrt));
        Ok(PatchReading { radiance, sigma, expected, aside: self.aside(light) })
    }

    /// Two directions in its plane, at right angles.
    fn axes(&self) -> [Vec3; 2] {
        let across = self.normal.cross(&Vec3::y()).try_normalize(0.1).unwrap_or_else(Vec3::x);
        [across, self.normal.cross(&across)]
    }

    /// Cosines of the lamp's direction with them, over its cosine with the normal.
    fn aside(&self, light: &Light) -> [f64; 2] {
        let direction = light.at(&self.center).0;
        self.axes().map(|axis| axis.dot(&direction) / self.normal.dot(&direction))
    }

    /// The point of the patch's plane that is seen at a place of the picture, pixels.
    fn point(&self, [x, y]: [f64; 2]) -> Vec3 {
        let ray = self.projection.ray(x, y);
        ray.origin + ray.direction * (self.normal.dot(&(self.center - ray.origin)) / self.normal.dot(&ray.direction))
    }

    /// The largest rectangle of pixels about its middle, in the shape of its image, that lies on it.
    fn pixels(&self) -> Option<Crop> {
        let [across, along] = self.axes();
        let middle = self.projection.project(&self.center);
        let mut half = [0.0_f64; 2];
        for i in 0..POINTS {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(POINTS)).sin_cos();
            let pixel = self.projection.project(&(self.center + (across * cos + along * sin) * self.radius));
            half = [0, 1].map(|axis| half[axis].max((pixel[axis] - middle[axis]).abs()));
        }
        let on_it = |size: &f64| {
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].iter().all(|corner| {
                let place = [0, 1].map(|axis| middle[axis] + corner[axis] * size * half[axis]);
                (self.point(place) - self.center).norm() <= INNER * self.radius
            })
        };
        let size = (1..STEPS).rev().map(|step| f64::from(step) / f64::from(STEPS)).find(on_it)?;
        let low = [0, 1].map(|axis| (middle[axis] - size * half[axis]).ceil().max(0.0));
        let high = [0, 1].map(|axis| (middle[axis] + size * half[axis]).floor());
        let [width, height] = [0, 1].map(|axis| (high[axis] - low[axis]).max(0.0) as usize);
        (width > 0 && height > 0).then_some(Crop { x: low[0] as usize, y: low[1] as usize, width, height })
    }

    /// Mean radiance of a white patch over these pixels, by Lambert's law and inverse square.
    fn expected(&self, part: &Crop, light: &Light) -> Result<[f64; 3], String> {
        let place =
            |start: usize, length: usize, i: usize| start as f64 + (i as f64 + 0.5) / GRID as f64 * length as f64;
        let mut sum = [0.0; 3];
        for i in 0..GRID * GRID {
            let point = self.point([place(part.x, part.width, i % GRID), place(part.y, part.height, i / GRID)]);
            let (direction, irradiance) = light.at(&point);
            let cosine = self.normal.dot(&direction);
            if cosine < GRAZING {
                let angle = cosine.clamp(-1.0, 1.0).acos().to_degrees();
                return Err(format!("the lamp stands {angle:.0} degrees off the patch's normal"));
            }
            let hit = self.object.intersect(&Ray { origin: point, direction });
            if hit.is_some_and(|hit| (hit.position - point).dot(&direction) > 0.0) {
                return Err("the object hides the lamp from the patch".into());
            }
            sum = std::array::from_fn(|c| sum[c] + cosine * irradiance[c] / std::f64::consts::PI);
        }
        Ok(sum.map(|s| s / (GRID * GRID) as f64))
    }
}
