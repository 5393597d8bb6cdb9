//! `[object]` of a dataset.toml: which shape it is, and every contradiction in what is said of it.

use super::raw::positive;
use crate::numerics::geometry::{Cylinder, Projection, Shape, Sphere, Vec3};
use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum RawShape {
    Sphere,
    Cylinder,
    Normals,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawObject {
    shape: RawShape,
    #[serde(skip_serializing_if = "Option::is_none")]
    center_mm: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    radius_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    center_px: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    radius_px: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    axis_start_mm: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    axis_end_mm: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    normals: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    positions: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mask: Option<String>,
}

/// An object as far as the text alone describes it.
#[derive(Debug, PartialEq)]
pub(super) enum Object {
    /// Known in full.
    Solid(Shape),
    /// Held in files beside the text.
    Maps { normals: String, positions: Option<String> },
}

impl RawObject {
    /// A sphere before a pinhole camera, mm.
    pub fn sphere(center_mm: [f64; 3], radius_mm: f64) -> Self {
        Self {
            shape: RawShape::Sphere,
            center_mm: Some(center_mm),
            radius_mm: Some(radius_mm),
            center_px: None,
            radius_px: None,
            axis_start_mm: None,
            axis_end_mm: None,
            normals: None,
            positions: None,
            mask: None,
        }
    }

    /// The object, or none with the reasons why not.
    pub fn object(&self, projection: &Projection, reasons: &mut Vec<String>) -> Option<Object> {
        self.refuse_foreign_keys(projection, reasons);
        match (self.shape, projection) {
            (RawShape::Sphere, Projection::Pinhole { .. }) => self.sphere_mm(reasons),
            (RawShape::Sphere, Projection::Orthographic { mm_per_px }) => self.sphere_px(*mm_per_px, reasons),
            (RawShape::Cylinder, _) => self.cylinder(projection, reasons),
            (RawShape::Normals, _) => self.maps(projection, reasons),
        }
    }

    /// What the shape is called in messages, and the keys that describe it.
    fn kind(&self, projection: &Projection) -> (&'static str, &'static [&'static str]) {
        match (self.shape, projection) {
            (RawShape::Sphere, Projection::Pinhole { .. }) => {
                ("a sphere before a pinhole camera", &["center_mm", "radius_mm"])
            }
            (RawShape::Sphere, Projection::Orthographic { .. }) => {
                ("a sphere before an orthographic camera", &["center_px", "radius_px"])
            }
            (RawShape::Cylinder, _) => ("a cylinder", &["axis_start_mm", "axis_end_mm", "radius_mm"]),
            (RawShape::Normals, _) => ("shape = \"normals\"", &["normals", "positions"]),
        }
    }

    fn refuse_foreign_keys(&self, projection: &Projection, reasons: &mut Vec<String>) {
        let (kind, own) = self.kind(projection);
        let given = [
            ("center_mm", self.center_mm.is_some()),
            ("radius_mm", self.radius_mm.is_some()),
            ("center_px", self.center_px.is_some()),
            ("radius_px", self.radius_px.is_some()),
            ("axis_start_mm", self.axis_start_mm.is_some()),
            ("axis_end_mm", self.axis_end_mm.is_some()),
            ("normals", self.normals.is_some()),
            ("positions", self.positions.is_some()),
        ];
        for (key, _) in given.iter().filter(|(key, given)| *given && !own.contains(key)) {
            reasons.push(format!("[object] {key} does not belong to {kind}, which takes {}", own.join(", ")));
        }
    }

    fn sphere_mm(&self, reasons: &mut Vec<String>) -> Option<Object> {
        let (Some(center), Some(radius)) = (self.center_mm, self.radius_mm) else {
            reasons.push("[object] a sphere before a pinhole camera needs center_mm and radius_mm".to_owned());
            return None;
        };
        let finite = center.iter().all(|v| v.is_finite());
        if !finite || !positive(radius) || center[2] <= radius {
            reasons.push(format!(
                "[object] center_mm = {center:?}, radius_mm = {radius}: the sphere must lie wholly in front of the camera (z > radius > 0)"
            ));
        }
        Some(Object::Solid(Sphere { center: Vec3::from(center), radius }.into()))
    }

    fn sphere_px(&self, mm_per_px: f64, reasons: &mut Vec<String>) -> Option<Object> {
        let (Some(center), Some(radius)) = (self.center_px, self.radius_px) else {
            reasons.push("[object] a sphere before an orthographic camera needs center_px and radius_px".to_owned());
            return None;
        };
        if !center.iter().all(|v| v.is_finite()) || !positive(radius) {
            reasons.push(format!("[object] center_px = {center:?}, radius_px = {radius}: radius_px must be positive"));
        }
        // Depth does not matter to parallel rays; the centre is put at z = 0.
        let center = Vec3::new(center[0] * mm_per_px, center[1] * mm_per_px, 0.0);
        Some(Object::Solid(Sphere { center, radius: radius * mm_per_px }.into()))
    }

    fn cylinder(&self, projection: &Projection, reasons: &mut Vec<String>) -> Option<Object> {
        let (Some(start), Some(end), Some(radius)) = (self.axis_start_mm, self.axis_end_mm, self.radius_mm) else {
            reasons.push("[object] a cylinder needs axis_start_mm, axis_end_mm and radius_mm".to_owned());
            return None;
        };
        let Some(cylinder) = Cylinder::new(Vec3::from(start), Vec3::from(end), radius) else {
            reasons.push(format!(
                "[object] axis_start_mm = {start:?}, axis_end_mm = {end:?}, radius_mm = {radius}: the axis must have a length and the radius be positive"
            ));
            return None;
        };
        if matches!(projection, Projection::Pinhole { .. }) && cylinder.nearest_depth() <= 0.0 {
            reasons.push(format!(
                "[object] axis_start_mm = {start:?}, axis_end_mm = {end:?}: the cylinder must lie wholly in front of the camera (z > 0 everywhere)"
            ));
        }
        if let Projection::Orthographic { .. } = projection
            && start[..2] == end[..2]
        {
            reasons.push(
                "[object] axis_start_mm and axis_end_mm: the camera looks along the axis and sees only an end of the cylinder"
                    .to_owned(),
            );
        }
        Some(Object::Solid(Shape::Cylinder(cylinder)))
    }

    fn maps(&self, projection: &Projection, reasons: &mut Vec<String>) -> Option<Object> {
        let Some(normals) = self.normals.clone() else {
            reasons.push("[object] shape = \"normals\" needs normals, an EXR file with the channels X Y Z".to_owned());
            return None;
        };
        if matches!(projection, Projection::Pinhole { .. }) && self.positions.is_none() {
            reasons.push(
                "[object] normals before a pinhole camera need positions as well, an EXR file with the channels X Y Z in mm: its rays spread, so a normal alone does not say where the point lies"
                    .to_owned(),
            );
        }
        Some(Object::Maps { normals, positions: self.positions.clone() })
    }
}
