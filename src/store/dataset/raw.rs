//! dataset.toml as written, before any check.

use super::radiance_name;
use crate::numerics::geometry::{Projection, Sphere, Vec3};
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

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum RawShape {
    Sphere,
    Cylinder,
    Normals,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawObject {
    pub shape: RawShape,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub center_mm: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub center_px: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius_px: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mask: Option<String>,
    #[serde(skip_serializing)]
    axis_start_mm: Option<[f64; 3]>,
    #[serde(skip_serializing)]
    axis_end_mm: Option<[f64; 3]>,
    #[serde(skip_serializing)]
    normals: Option<String>,
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
    /// The dataset of a session: the rig's camera and sphere, and one light position a station, mm.
    pub fn of_session(rig: &rig_config::Rig, light_positions_mm: &[[f64; 3]]) -> Self {
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
            object: RawObject {
                shape: RawShape::Sphere,
                center_mm: Some(rig.object.center_mm),
                radius_mm: Some(rig.object.radius_mm),
                center_px: None,
                radius_px: None,
                mask: None,
                axis_start_mm: None,
                axis_end_mm: None,
                normals: None,
            },
            samples: RawSamples { saturation: None, cosine_cutoff: Some(rig.fit.cosine_cutoff) },
            light: light_positions_mm
                .iter()
                .enumerate()
                .map(|(station, &position_mm)| RawLight {
                    image: radiance_name(station),
                    position_mm: Some(position_mm),
                    intensity: Some(rig.lamp.intensity),
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

    pub fn sphere(&self, projection: &Projection, reasons: &mut Vec<String>) -> Sphere {
        let nowhere = Sphere { center: Vec3::z(), radius: 0.0 };
        let object = &self.object;
        let kind = match object.shape {
            RawShape::Sphere => None,
            RawShape::Cylinder => Some("cylinder"),
            RawShape::Normals => Some("normals"),
        };
        if let Some(kind) = kind {
            reasons.push(format!("[object] shape = \"{kind}\" is not available in this version: only \"sphere\" is"));
            return nowhere;
        }
        if object.axis_start_mm.is_some() || object.axis_end_mm.is_some() || object.normals.is_some() {
            reasons.push("[object] axis_start_mm, axis_end_mm and normals do not belong to a sphere".to_owned());
        }
        match projection {
            Projection::Pinhole { .. } => self.sphere_mm(reasons),
            Projection::Orthographic { mm_per_px } => self.sphere_px(*mm_per_px, reasons),
        }
        .unwrap_or(nowhere)
    }

    fn sphere_mm(&self, reasons: &mut Vec<String>) -> Option<Sphere> {
        let object = &self.object;
        let (Some(center), Some(radius)) = (object.center_mm, object.radius_mm) else {
            reasons.push("[object] a sphere before a pinhole camera needs center_mm and radius_mm".to_owned());
            return None;
        };
        if object.center_px.is_some() || object.radius_px.is_some() {
            reasons.push("[object] center_px and radius_px belong to an orthographic camera".to_owned());
        }
        let finite = center.iter().all(|v| v.is_finite());
        if !finite || !positive(radius) || center[2] <= radius {
            reasons.push(format!(
                "[object] center_mm = {center:?}, radius_mm = {radius}: the sphere must lie wholly in front of the camera (z > radius > 0)"
            ));
        }
        Some(Sphere { center: Vec3::from(center), radius })
    }

    fn sphere_px(&self, mm_per_px: f64, reasons: &mut Vec<String>) -> Option<Sphere> {
        let object = &self.object;
        let (Some(center), Some(radius)) = (object.center_px, object.radius_px) else {
            reasons.push("[object] a sphere before an orthographic camera needs center_px and radius_px".to_owned());
            return None;
        };
        if object.center_mm.is_some() || object.radius_mm.is_some() {
            reasons.push("[object] center_mm and radius_mm belong to a pinhole camera".to_owned());
        }
        if !center.iter().all(|v| v.is_finite()) || !positive(radius) {
            reasons.push(format!("[object] center_px = {center:?}, radius_px = {radius}: radius_px must be positive"));
        }
        // Depth does not matter to parallel rays; the centre is put at z = 0.
        let center = Vec3::new(center[0] * mm_per_px, center[1] * mm_per_px, 0.0);
        Some(Sphere { center, radius: radius * mm_per_px })
    }
}

fn positive(value: f64) -> bool {
    value.is_finite() && value > 0.0
}
