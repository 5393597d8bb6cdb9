//! The report of a camera calibration: what is stored and what a person reads.

use super::board::{Board, Found};
use super::quality::median;
use crate::numerics::calibration::camera::{Calibrated, Freedom, NAMES, Size, UNKNOWNS};
use crate::numerics::geometry::Projection;
use serde::{Deserialize, Serialize};

/// A white square's mean level above this is clipped.
const CLIPPED: f64 = 250.0;
/// Less contrast between white and black squares than this makes corners noisy, levels.
const LOW_CONTRAST: f64 = 40.0;
/// Edges this many times as wide as in most photographs are told.
const SOFT: f64 = 2.0;
/// ... if they are wider than this, px.
const SOFT_PX: f64 = 3.0;
/// Views that a careful calibration has.
const ENOUGH_VIEWS: usize = 8;
/// A focal length less certain than this moves light positions by more than other errors do.
const FOCAL_SIGMA: f64 = 1e-3;
/// Distortion is extrapolated where corners reach less far than this part of the half diagonal.
const REACH: f64 = 0.6;

/// A calibrated camera: pinhole with Brown's distortion, pixel centres at +0.5, origin at the top left.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraCalibration {
    /// Columns of the photographs.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Focal lengths, px.
    pub focal_px: [f64; 2],
    /// Principal point, px.
    pub principal_px: [f64; 2],
    /// k1 k2 p1 p2 k3.
    pub distortion: [f64; 5],
    /// Standard deviations of all these; 0 for a parameter that was held.
    pub sigma: Sigma,
    /// Parameters that were held at the image's centre, at 0, or (fy) at the other's value.
    pub held: Vec<String>,
    /// Every freedom beyond the focal length, whether it is free, and why.
    pub decisions: Vec<Decision>,
    /// Covariance of fx fy cx cy k1 k2 p1 p2 k3.
    pub covariance: [[f64; UNKNOWNS]; UNKNOWNS],
    /// Root mean square distance between corners and reprojection over all views used, px.
    pub rms_px: f64,
    /// The board.
    pub board: Board,
    /// Every photograph.
    pub views: Vec<ViewReport>,
    /// What a person should know before using this.
    pub warnings: Vec<String>,
}

/// Standard deviations; 0 for what was held.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sigma {
    /// Of the focal lengths, px.
    pub focal_px: [f64; 2],
    /// Of the principal point, px.
    pub principal_px: [f64; 2],
    /// Of k1 k2 p1 p2 k3.
    pub distortion: [f64; 5],
}

/// Whether a group of parameters is free.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Decision {
    /// The parameters in words.
    pub parameters: String,
    /// True if they were estimated.
    pub free: bool,
    /// Why.
    pub reason: String,
}

/// One photograph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewReport {
    /// Name of the file.
    pub name: String,
    /// Corners found and refined.
    pub corners: usize,
    /// Root mean square distance between corners and reprojection, px; none for a view left out.
    pub rms_px: Option<f64>,
    /// Where the board lay; none for a view left out.
    pub pose: Option<PoseReport>,
    /// Width of the edges between squares, px; none if no board was found.
    pub edge_px: Option<f64>,
    /// Why it was left out, and what to do.
    pub rejected: Option<String>,
}

/// Board to camera frame: p = R(rotation_vector) (x, y, 0) + translation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseReport {
    /// Axis times angle, rad.
    pub rotation_vector: [f64; 3],
    /// Where the board's first corner lies, mm.
    pub translation_mm: [f64; 3],
    /// Standard deviations of a further small rotation about the camera's axes, rad.
    pub rotation_sigma: [f64; 3],
    /// Standard deviations of the translation, mm.
    pub translation_sigma_mm: [f64; 3],
}

impl CameraCalibration {
    /// The camera model that the other modules use.
    pub fn projection(&self) -> Projection {
        Projection::Pinhole { focal_px: self.focal_px, principal_px: self.principal_px, distortion: self.distortion }
    }
}

pub(super) fn report(
    names: &[&str],
    board: &Board,
    size: Size,
    good: &[(usize, Found)],
    rejected: &[(usize, String)],
    calibrated: &Calibrated,
) -> CameraCalibration {
    let [fx, fy, cx, cy, distortion @ ..] = calibrated.interior.values();
    let sigma = |i: usize| calibrated.covariance[(i, i)].max(0.0).sqrt();
    let mut views: Vec<ViewReport> = names.iter().map(|name| unseen(name)).collect();
    for (i, reason) in rejected {
        views[*i].rejected = Some(reason.clone());
    }
    for (i, found) in good {
        views[*i].corners = found.view.corners.len();
        views[*i].edge_px = Some(found.quality.edge_px);
    }
    for (place, reason) in &calibrated.rejected {
        views[good[*place].0].rejected = Some(reason.to_string());
    }
    for used in &calibrated.views {
        let view = &mut views[good[used.index].0];
        let sigma = |i: usize| used.covariance[(i, i)].max(0.0).sqrt();
        view.rms_px = Some(used.rms_px);
        view.pose = Some(PoseReport {
            rotation_vector: used.pose.rotation_vector().into(),
            translation_mm: used.pose.translation_mm.into(),
            rotation_sigma: [0, 1, 2].map(sigma),
            translation_sigma_mm: [3, 4, 5].map(sigma),
        });
    }
    let decision = |(freedom, verdict): &(Freedom, crate::numerics::calibration::camera::Verdict)| Decision {
        parameters: freedom.name().to_owned(),
        free: verdict.is_free(),
        reason: verdict.to_string(),
    };
    let held = calibrated.verdicts.iter().filter(|(_, verdict)| !verdict.is_free());
    let held = held.flat_map(|(freedom, _)| freedom.unknowns()).map(|&i| NAMES[i].to_owned()).collect();
    CameraCalibration {
        width: size.width,
        height: size.height,
        focal_px: [fx, fy],
        principal_px: [cx, cy],
        distortion,
        sigma: Sigma {
            focal_px: [0, 1].map(sigma),
            principal_px: [2, 3].map(sigma),
            distortion: [4, 5, 6, 7, 8].map(sigma),
        },
        held,
        decisions: calibrated.verdicts.iter().map(decision).collect(),
        covariance: std::array::from_fn(|i| std::array::from_fn(|j| calibrated.covariance[(i, j)])),
        rms_px: calibrated.rms_px,
        board: *board,
        views,
        warnings: warnings(size, good, calibrated),
    }
}

fn unseen(name: &str) -> ViewReport {
    ViewReport { name: name.to_owned(), corners: 0, rms_px: None, pose: None, edge_px: None, rejected: None }
}

fn warnings(size: Size, good: &[(usize, Found)], calibrated: &Calibrated) -> Vec<String> {
    let used: Vec<&Found> = calibrated.views.iter().map(|view| &good[view.index].1).collect();
    let mut warnings = Vec::new();
    if used.len() < ENOUGH_VIEWS {
        warnings.push(format!("only {} views: take 10 to 20, tilted by 20 to 30 degrees", used.len()));
    }
    let focal_sigma = calibrated.covariance[(0, 0)].max(0.0).sqrt() / calibrated.interior.values()[0];
    if focal_sigma > FOCAL_SIGMA {
        warnings.push(format!(
            "the focal length is uncertain by {:.2} %, more than {:.1} %: take more views, tilted more",
            100.0 * focal_sigma,
            100.0 * FOCAL_SIGMA
        ));
    }
    let usual = median(&mut used.iter().map(|found| found.quality.edge_px).collect::<Vec<_>>());
    for found in &used {
        let (name, quality) = (&found.view.name, &found.quality);
        if quality.edge_px > SOFT * usual && quality.edge_px > SOFT_PX {
            let edge = quality.edge_px;
            warnings.push(format!("{name}: soft, edges are {edge:.1} px wide, {usual:.1} in most: focus again"));
        }
        if quality.white > CLIPPED {
            warnings.push(format!("{name}: the white squares are clipped, which moves corners: expose less"));
        }
        if quality.white - quality.black < LOW_CONTRAST {
            let contrast = quality.white - quality.black;
            warnings
                .push(format!("{name}: white and black differ by {contrast:.0} levels only: light the board better"));
        }
    }
    let reach = reach(size, &used);
    if reach < REACH {
        warnings.push(format!(
            "corners reach {:.0} % of the way to the picture's corners: distortion beyond is extrapolated; move the board \
             to the edges in some photographs",
            100.0 * reach
        ));
    }
    warnings
}

/// How far corners reach from the centre, in half diagonals.
fn reach(size: Size, used: &[&Found]) -> f64 {
    let [x, y] = size.center();
    let corners = used.iter().flat_map(|found| &found.view.corners);
    corners.map(|c| (c.pixel[0] - x).hypot(c.pixel[1] - y)).fold(0.0, f64::max) / (0.5 * size.diagonal())
}
