//! lights.toml and the camera file.

use crate::numerics::calibration::lights::card::Card;
use crate::numerics::calibration::lights::plane::{Plane, pose};
use crate::numerics::geometry::{Projection, Vec3};
use crate::pipeline::calibration::lights::LightFrames;
use crate::store::files::read_text;
use serde::Deserialize;
use std::path::Path;

/// lights.toml.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LightsFile {
    pub light: Vec<ListedLight>,
    card: Option<ListedCard>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ListedLight {
    angle_deg: Option<f64>,
    silhouette: String,
    highlight: String,
    pub card: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ListedCard {
    corners_px: [[f64; 2]; 4],
    width_mm: Option<f64>,
    height_mm: Option<f64>,
    point_mm: Option<[f64; 3]>,
    normal: Option<[f64; 3]>,
    #[serde(default = "grey")]
    reflectance: f64,
    #[serde(default = "nominal")]
    reflectance_sigma: f64,
}

fn grey() -> f64 {
    0.18
}

/// An unmeasured card's grey is off by this much.
fn nominal() -> f64 {
    0.05
}

const LIST: &str = "lights.toml";
/// Below this ratio of residuals the corners do not tell which way the card is tilted.
const TELLS: f64 = 3.0;
/// Corners are placed no better than this, pixels.
const CORNER_PX: f64 = 0.3;
/// Farther off, the corners are no rectangle's of the given size, pixels.
const LARGEST_RMS_PX: f64 = 5.0;

impl ListedLight {
    pub fn frames(&self) -> LightFrames {
        LightFrames {
            angle_deg: self.angle_deg,
            silhouette: self.silhouette.clone(),
            highlight: self.highlight.clone(),
        }
    }
}

impl LightsFile {
    pub fn read(folder: &Path) -> Result<Self, String> {
        let path = folder.join(LIST);
        let refuse = |reason: String| format!("{}: {reason}", path.display());
        let text = read_text(&path, "list of lights").map_err(|reason| {
            refuse(format!("{reason}; write one [[light]] with silhouette = \"...\" and highlight = \"...\" per light"))
        })?;
        let list: Self = toml::from_str(&text).map_err(|e| refuse(e.to_string()))?;
        for (index, light) in list.light.iter().enumerate() {
            if light.angle_deg.is_some_and(|a| !a.is_finite()) {
                return Err(refuse(format!("light {}: angle_deg must be a finite number", index + 1)));
            }
            if light.card.is_some() && list.card.is_none() {
                return Err(refuse(format!(
                    "light {} has a card frame but there is no [card]: give corners_px with width_mm and height_mm, or point_mm and normal",
                    index + 1
                )));
            }
        }
        if list.card.is_some() && list.light.iter().all(|light| light.card.is_none()) {
            return Err(refuse("[card] is given but no light has a card frame: add card = \"....exr\"".into()));
        }
        Ok(list)
    }

    /// The card, and a warning where its corners leave its tilt open.
    pub fn card(&self, projection: &Projection) -> Result<Option<(Card, Option<String>)>, String> {
        let Some(listed) = &self.card else { return Ok(None) };
        let refuse = |reason: &str| Err(format!("{LIST}: [card] {reason}"));
        let numbers = listed.corners_px.iter().flatten().chain(listed.point_mm.iter().flatten());
        if !numbers.chain(listed.normal.iter().flatten()).all(|v| v.is_finite()) {
            return refuse("all numbers must be finite");
        }
        let reflects = listed.reflectance > 0.0 && listed.reflectance <= 1.0;
        if !(reflects && (0.0..1.0).contains(&listed.reflectance_sigma)) {
            return refuse("reflectance must lie in 0 to 1, and so must reflectance_sigma");
        }
        let (plane, warning) = match (listed.width_mm, listed.height_mm, listed.point_mm, listed.normal) {
            (Some(width), Some(height), None, None) if width > 0.0 && height > 0.0 => {
                listed.plane_from_corners(projection, [width, height])?
            }
            (None, None, Some(point), Some(normal)) if Vec3::from(normal).norm() > 0.0 => {
                let (point, normal) = (Vec3::from(point), Vec3::from(normal).normalize());
                let normal = if normal.dot(&point) > 0.0 { -normal } else { normal };
                (Plane { point, normal }, None)
            }
            _ => {
                return refuse(
                    "give width_mm and height_mm (greater than 0), or point_mm and normal (not 0), and not both",
                );
            }
        };
        let card = Card {
            plane,
            corners_px: listed.corners_px,
            reflectance: listed.reflectance,
            reflectance_sigma: listed.reflectance_sigma,
        };
        Ok(Some((card, warning)))
    }
}

impl ListedCard {
    fn plane_from_corners(&self, projection: &Projection, size: [f64; 2]) -> Result<(Plane, Option<String>), String> {
        let found = pose(projection, &self.corners_px, size).filter(|pose| pose.rms_px < LARGEST_RMS_PX).ok_or_else(|| {
            format!(
                "{LIST}: [card] corners_px are no picture of a {} x {} mm card: give its corners in order around it, the first edge a width",
                size[0], size[1]
            )
        })?;
        let open = found.other.filter(|(_, rms)| *rms < TELLS * found.rms_px.max(CORNER_PX));
        let warning = open.map(|(other, _)| {
            let degrees = other.normal.dot(&found.plane.normal).clamp(-1.0, 1.0).acos().to_degrees();
            format!(
                "the card's corners fit two planes that differ by {degrees:.0} degrees: give point_mm and normal from the board's pose"
            )
        });
        Ok((found.plane, warning))
    }
}

/// The camera's numbers that matter here.
#[derive(Deserialize)]
pub(super) struct CameraFile {
    pub width: usize,
    pub height: usize,
    focal_px: [f64; 2],
    principal_px: [f64; 2],
    #[serde(default)]
    distortion: [f64; 5],
}

impl CameraFile {
    pub fn read(path: &Path) -> Result<Self, String> {
        let refuse = |reason: String| format!("{}: {reason}", path.display());
        if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) {
            let camera = rig_config::Rig::read(path).map_err(|e| e.to_string())?.camera;
            let rig_config::Camera { width, height, focal_px, principal_px, distortion, .. } = camera;
            return Ok(Self { width, height, focal_px, principal_px, distortion });
        }
        let text = read_text(path, "camera calibration")
            .map_err(|reason| refuse(format!("{reason}; give a camera calibration (.json) or a rig file (.toml)")))?;
        let camera: Self = serde_json::from_str(&text).map_err(|e| {
            refuse(format!("{e}: a camera calibration holds width, height, focal_px, principal_px and distortion"))
        })?;
        let sound = camera.focal_px.iter().all(|f| f.is_finite() && *f > 0.0)
            && camera.principal_px.iter().chain(&camera.distortion).all(|v| v.is_finite())
            && camera.width > 0
            && camera.height > 0;
        if sound {
            Ok(camera)
        } else {
            Err(refuse("size and focal_px must be greater than 0 and all numbers finite".into()))
        }
    }

    pub fn projection(&self) -> Projection {
        Projection::Pinhole { focal_px: self.focal_px, principal_px: self.principal_px, distortion: self.distortion }
    }
}
