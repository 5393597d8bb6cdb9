//! Does the lamp stand where the arm says? After every bracket the part of the object that is lit tells: an arm that slipped on its shaft,
//! lost steps or has a wrong zero reports an angle at which the lamp is not.

use crate::numerics::geometry::{Projection, Sphere, Vec3};
use crate::numerics::quality::{Ball, Light, Look, Place, between};
use rig_config::Rig;

/// How far the lamp may stand from where it is expected, degrees: by the first reading, which shows what the rig file's geometry is
/// worth, and by later ones, which are held against the session's own. Never less than so many standard errors.
const FIRST: f64 = 10.0;
const LATER: f64 = 6.0;
const ERRORS: f64 = 4.0;
/// A lamp less far off the camera's way, degrees, is not judged: the edge of what it lights lies on the outline, and one sound bracket in
/// a hundred reads as 10 degrees off.
const FRONT: f64 = 30.0;
/// A reading of a larger standard error says nothing of the session's own zero, degrees.
const SURE: f64 = 1.5;
/// Readings from which a zero that is further off than this, degrees, is told.
const ZERO_READINGS: usize = 3;
const ZERO: f64 = 3.0;

/// What the brackets of a session say of the lamp's place.
pub struct Shadow {
    rig: Rig,
    seen: Option<(Ball, Place)>,
    /// Angles by the pictures less those by the arm, degrees.
    offsets: Vec<f64>,
    zero_told: bool,
}

/// Where the lamp stands by a bracket's pictures, and where it should, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// By the pictures.
    pub seen_deg: f64,
    /// Standard error of that.
    pub sigma_deg: f64,
    /// By the arm and what the session showed before.
    pub expected_deg: f64,
    /// Greatest difference of the two on a sound rig.
    pub most_deg: f64,
}

impl Reading {
    /// By how much the lamp stands further round than expected, degrees.
    pub fn off_deg(&self) -> f64 {
        between(self.seen_deg, self.expected_deg)
    }
}

impl Shadow {
    /// Nothing is seen yet.
    pub fn new(rig: &Rig) -> Self {
        Self { rig: rig.clone(), seen: None, offsets: Vec::new(), zero_told: false }
    }

    /// Where the lamp stands by the frames of a bracket, with the arm at `angle_deg` by its own word; none where they do not tell.
    pub fn read(&mut self, looks: &[&Look], angle_deg: f64) -> Option<(Reading, Light)> {
        self.find(looks);
        let (ball, place) = self.seen.as_ref()?;
        let expected_deg = angle_deg + self.usual();
        let lamp = |angle_deg: f64| Vec3::from(self.rig.lamp.position_mm(angle_deg));
        let light = ball.light(looks, expected_deg, &lamp, place)?;
        let least = if self.offsets.is_empty() { FIRST } else { LATER };
        let (seen_deg, sigma_deg) = (light.angle_deg, light.sigma_deg);
        let most_deg = least.max(ERRORS * sigma_deg);
        Some((Reading { seen_deg, sigma_deg, expected_deg, most_deg }, light))
    }

    /// Judges a bracket.
    ///
    /// # Errors
    /// Where the lamp stands instead.
    pub fn judge(&mut self, looks: &[&Look], angle_deg: f64) -> Result<(), String> {
        if self.off_camera_deg(angle_deg + self.usual()) < FRONT {
            return Ok(());
        }
        let Some((reading, light)) = self.read(looks, angle_deg) else { return Ok(()) };
        if reading.off_deg().abs() > reading.most_deg {
            let Reading { seen_deg, sigma_deg, expected_deg, most_deg } = reading;
            return Err(format!(
                "the light stands at about {seen_deg:.1} degrees by the pictures (standard error {sigma_deg:.1}), at {expected_deg:.1} was \
                 expected with the arm at {angle_deg:.1} by its own word, give or take {most_deg:.1}"
            ));
        }
        if let Some((_, place)) = &mut self.seen {
            *place = light.place;
        }
        if reading.sigma_deg <= SURE {
            self.offsets.push(between(reading.seen_deg, angle_deg));
        }
        Ok(())
    }

    /// How far off the camera's way the lamp stands, seen from the object, degrees.
    fn off_camera_deg(&self, angle_deg: f64) -> f64 {
        let center = Vec3::from(self.rig.object.center_mm);
        let lamp = Vec3::from(self.rig.lamp.position_mm(angle_deg)) - center;
        lamp.angle(&-center).to_degrees()
    }

    /// The arm's zero is not where the rig file says: told once.
    pub fn zero_warning(&mut self) -> Option<String> {
        let usual = self.usual();
        if self.zero_told || self.offsets.len() < ZERO_READINGS || usual.abs() <= ZERO {
            return None;
        }
        self.zero_told = true;
        Some(format!(
            "by the pictures the light stands {usual:+.1} degrees from where the rig file puts it, alike at {} stations: see to the arm's \
             zero and its lamp on the shaft, or to lamp.circle_center_mm and object.center_mm, and calibrate anew",
            self.offsets.len()
        ))
    }

    /// What the pictures and the arm usually differ by: the median.
    fn usual(&self) -> f64 {
        let mut offsets = self.offsets.clone();
        offsets.sort_by(f64::total_cmp);
        let at = |index: usize| offsets.get(index).copied().unwrap_or_default();
        0.5 * (at(offsets.len().saturating_sub(1) / 2) + at(offsets.len() / 2))
    }

    /// Finds out which samples show the object, once.
    fn find(&mut self, looks: &[&Look]) {
        let (None, Some(look)) = (&self.seen, looks.first()) else { return };
        let (camera, object) = (&self.rig.camera, &self.rig.object);
        let projection = Projection::Pinhole {
            focal_px: camera.focal_px,
            principal_px: camera.principal_px,
            distortion: camera.distortion,
        };
        let sphere = Sphere { center: Vec3::from(object.center_mm), radius: object.radius_mm };
        self.seen = Ball::new(sphere, &projection, look).map(|ball| {
            let place = ball.placed();
            (ball, place)
        });
    }
}
