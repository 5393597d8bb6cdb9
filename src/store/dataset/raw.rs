//! dataset.toml as written, before any check.

use super::object::RawObject;
use super::{SessionLight, radiance_name};
use crate::numerics::geometry::Projection;
use serde::{Deserialize, Serialize};

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawDataset {
    pub format: u32,
    pub camera: RawCamera,
    pub object: RawObject,
    #[serde(default)]
    pub samples: RawSamples,
    #[serde(default)]
    pub light: Vec<RawLight>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawCamera {
    pub projection: RawProjection,
    pub width: usize,
    pub height: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_px: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub principal_px: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distortion: Option<[f64; 5]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mm_per_px: Option<f64>,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum RawProjection {
    Pinhole,
    Orthographic,
}

#[derive(Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawSamples {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub saturation: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cosine_cutoff: Option<f64>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawLight {
    pub image: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position_mm: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub intensity: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub direction: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub irradiance: Option<[f64; 3]>,
}

impl RawDataset {
    /// The dataset of a session: the rig's camera and sphere, and one light a station.
    pub fn of_session(rig: &rig_config::Rig, lights: &[SessionLight]) -> Self {
        let camera = &rig.camera;
        Self {
            format: 1,
            camera: RawCamera {
                projection: RawProjection::Pinhole,
                width: camera.width,
                height: camera.height,
                focal_px: Some(camera.focal_px),
                principal_px: Some(camera.principal_px),
                distortion: Some(camera.distortion),
                mm_per_px: None,
            },
            object: RawObject::sphere(rig.object.center_mm, rig.object.radius_mm),
            samples: RawSamples { saturation: None, cosine_cutoff: Some(rig.fit.cosine_cutoff) },
            light: lights
                .iter()
                .enumerate()
                .map(|(station, light)| RawLight {
                    image: radiance_name(station),
                    position_mm: Some(light.position_mm),
                    intensity: Some(light.intensity),
                    direction: None,
                    irradiance: None,
                })
                .collect(),
        }
    }

    pub fn projection(&self, reasons: &mut Vec<String>) -> Projection {
        let camera = &self.camera;
        match camera.projection {
            RawProjection::Orthographic => {
                let mm_per_px = camera.mm_per_px.unwrap_or(1.0);
                if !positive(mm_per_px) {
                    reasons.push(format!("[camera] mm_per_px = {mm_per_px}: must be positive"));
                }
                if camera.focal_px.is_some() || camera.principal_px.is_some() || camera.distortion.is_some() {
                    reasons.push(
                        "[camera] focal_px, principal_px and distortion belong to projection = \"pinhole\"".to_owned(),
                    );
                }
                Projection::Orthographic { mm_per_px }
            }
            RawProjection::Pinhole => {
                let focal_px = camera.focal_px.unwrap_or([f64::NAN; 2]);
                let principal_px = camera.principal_px.unwrap_or([f64::NAN; 2]);
                let distortion = camera.distortion.unwrap_or([0.0; 5]);
                if !focal_px.iter().all(|&f| positive(f)) {
                    reasons.push("[camera] focal_px: a pinhole camera needs two positive focal lengths".to_owned());
                }
                if !principal_px.iter().chain(&distortion).all(|v| v.is_finite()) {
                    reasons
                        .push("[camera] principal_px and distortion: a pinhole camera needs finite numbers".to_owned());
                }
                if camera.mm_per_px.is_some() {
                    reasons.push("[camera] mm_per_px belongs to projection = \"orthographic\"".to_owned());
                }
                Projection::Pinhole { focal_px, principal_px, distortion }
            }
        }
    }
}

pub(super) fn positive(value: f64) -> bool {
    value.is_finite() && value > 0.0
}
