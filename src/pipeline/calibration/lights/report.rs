//! What a calibration of the lights says: plain numbers with their units, to be stored.

use crate::numerics::calibration::lights::balls::Ball;
use crate::numerics::calibration::lights::solve::{Lamp, SolvedCircle};
use crate::numerics::geometry::{Light, Projection, Vec3};
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

/// Light positions, and intensities once a card was measured. Camera frame: x right, y down, z forward, mm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightsCalibration {
    /// Lights in the order given.
    pub lights: Vec<CalibratedLight>,
    /// The arm's circle; none unless three lights' angles are known.
    pub circle: Option<ArmCircle>,
    /// Radiant intensity of the one bulb, medians over the lights that light the card, radiance units x mm^2; for lights whose
    /// own is null.
    pub bulb_intensity: Option<[f64; 3]>,
    /// The balls, from left to right.
    pub balls: Vec<CalibratedBall>,
    /// Rms of the highlights' residuals, pixels.
    pub rms_px: f64,
    /// Sum of squared residuals by their standard deviations, a degree of freedom.
    pub reduced_chi2: f64,
    /// Factor on the highlights' standard deviations that their residuals ask for; contained in the covariances.
    pub highlight_sigma_factor: f64,
    /// What concerns no single light.
    pub warnings: Vec<String>,
}

/// One light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibratedLight {
    /// The arm's angle, degrees; null if not known.
    pub angle_deg: Option<f64>,
    /// Position, mm.
    pub position_mm: [f64; 3],
    /// Covariance of the position, mm^2. It holds the noise of outlines, highlights and encoder, not the error of focal length and
    /// ball radius.
    pub covariance_mm2: [[f64; 3]; 3],
    /// Distance from the arm's circle of the point where the mirror rays meet by themselves, mm.
    pub circle_residual_mm: Option<f64>,
    /// Balls whose highlights were used.
    pub balls_used: usize,
    /// Radiant intensity per channel, radiance units x mm^2: irradiance at distance d (mm) is intensity / d^2. Null until the
    /// card was measured.
    pub intensity: Option<[f64; 3]>,
    /// Its standard deviation, the card's reflectance included.
    pub intensity_sigma: Option<[f64; 3]>,
    /// What was seen of this light.
    pub warnings: Vec<String>,
}

/// The circle on which the arm carries the lamp.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArmCircle {
    /// Centre, mm.
    pub center_mm: [f64; 3],
    /// Standard deviation of the centre, mm.
    pub center_sigma_mm: [f64; 3],
    /// Unit axis about which positive angles turn (right hand).
    pub axis: [f64; 3],
    /// Standard deviation of the axis' direction, degrees.
    pub axis_sigma_deg: f64,
    /// Unit direction from the centre to the lamp at angle 0.
    pub zero: [f64; 3],
    /// Radius, mm.
    pub radius_mm: f64,
    /// Its standard deviation, mm.
    pub radius_sigma_mm: f64,
}

/// One ball.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibratedBall {
    /// Centre, mm.
    pub center_mm: [f64; 3],
    /// Its covariance, mm^2.
    pub covariance_mm2: [[f64; 3]; 3],
    /// Radius, mm, as given.
    pub radius_mm: f64,
    /// Centre of the outline in the image, pixels.
    pub image_center_px: [f64; 2],
    /// Radius of the outline in the image, pixels.
    pub image_radius_px: f64,
    /// Rms distance of the edge points from the outline, pixels.
    pub outline_rms_px: f64,
    /// Share of the outline that was found.
    pub outline_covered: f64,
}

impl LightsCalibration {
    /// Lights whose positions (mm) are taken for granted: without uncertainty, balls or circle.
    pub fn nominal(positions_mm: &[[f64; 3]]) -> Self {
        let light = |&position_mm: &[f64; 3]| CalibratedLight {
            angle_deg: None,
            position_mm,
            covariance_mm2: [[0.0; 3]; 3],
            circle_residual_mm: None,
            balls_used: 0,
            intensity: None,
            intensity_sigma: None,
            warnings: Vec::new(),
        };
        Self {
            lights: positions_mm.iter().map(light).collect(),
            circle: None,
            bulb_intensity: None,
            balls: Vec::new(),
            rms_px: 0.0,
            reduced_chi2: 0.0,
            highlight_sigma_factor: 1.0,
            warnings: Vec::new(),
        }
    }

    /// The lights as the fit takes them; none for a light without intensity of its own or the bulb's.
    pub fn light(&self, index: usize) -> Option<Light> {
        let light = self.lights.get(index)?;
        let intensity = light.intensity.or(self.bulb_intensity)?;
        Some(Light::Point { position: Vec3::from(light.position_mm), intensity })
    }
}

impl ArmCircle {
    /// Position of the lamp with the arm at `angle_deg`, mm.
    pub fn position_mm(&self, angle_deg: f64) -> [f64; 3] {
        let (sin, cos) = angle_deg.to_radians().sin_cos();
        let (zero, axis) = (Vec3::from(self.zero), Vec3::from(self.axis));
        let lamp = Vec3::from(self.center_mm) + (zero * cos + axis.cross(&zero) * sin) * self.radius_mm;
        lamp.into()
    }
}

impl From<&SolvedCircle> for ArmCircle {
    fn from(solved: &SolvedCircle) -> Self {
        let frame = &solved.circle.frame;
        Self {
            center_mm: solved.circle.center.into(),
            center_sigma_mm: solved.center_sigma.into(),
            axis: frame.column(2).into_owned().into(),
            axis_sigma_deg: solved.axis_sigma.to_degrees(),
            zero: frame.column(0).into_owned().into(),
            radius_mm: solved.circle.radius,
            radius_sigma_mm: solved.radius_sigma,
        }
    }
}

impl CalibratedLight {
    pub(super) fn new(angle_deg: Option<f64>, lamp: &Lamp) -> Self {
        Self {
            angle_deg,
            position_mm: lamp.position.into(),
            covariance_mm2: rows(&lamp.covariance),
            circle_residual_mm: lamp.circle_residual,
            balls_used: lamp.highlights,
            intensity: None,
            intensity_sigma: None,
            warnings: Vec::new(),
        }
    }
}

impl CalibratedBall {
    pub(super) fn new(projection: &Projection, ball: &Ball, center: &Vec3, covariance: &Matrix3<f64>) -> Self {
        Self {
            center_mm: (*center).into(),
            covariance_mm2: rows(covariance),
            radius_mm: ball.radius,
            image_center_px: ball.outline.center_px(projection),
            image_radius_px: ball.outline.radius_px(projection),
            outline_rms_px: ball.rms_px,
            outline_covered: ball.covered,
        }
    }
}

fn rows(m: &Matrix3<f64>) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| m[(i, j)]))
}
