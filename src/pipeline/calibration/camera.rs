//! Camera calibration from photographs of a chessboard: named files in, report out.

mod board;
mod card;
mod grid;
mod quality;
mod refine;
mod report;

pub use board::{BadPhotograph, Board, Found, find_board};
pub use card::card_on_board;
pub use quality::Quality;
pub use report::{CameraCalibration, Decision, PoseReport, Sigma, ViewReport};

use crate::numerics::calibration::camera::{
    BadView, BoardPose, CameraError, MIN_VIEWS, Size, View, board_pose as pose_of, calibrate,
};
use crate::numerics::geometry::Projection;
use crate::numerics::image::Image;
use crate::pipeline::decode::{FrameInfo, decode};
use crate::pipeline::fine::{Unread, fine_levels};
use rayon::prelude::*;

/// Two photographs whose corners lie closer than this, rms, show the same view: parts of the picture's diagonal.
const SAME_VIEW: f64 = 5e-4;

/// A photograph as the camera wrote it.
#[derive(Clone, Copy, Debug)]
pub struct Photograph<'a> {
    /// Name for messages.
    pub name: &'a str,
    /// The file: JPEG, PNG or BMP.
    pub bytes: &'a [u8],
}

/// Why photographs give no camera calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CameraCalibrationError {
    /// A board that cannot be.
    #[error("{0}")]
    Board(String),
    /// Too few photographs show the board.
    #[error(
        "{good} good photographs of the board out of {all}, at least {MIN_VIEWS} are needed: take 10 to 20, with the board tilted by 20 \
         to 30 degrees in different directions{}", listed(.rejected)
    )]
    TooFew {
        /// Photographs that could be used.
        good: usize,
        /// Photographs given.
        all: usize,
        /// The others: name and reason.
        rejected: Vec<(String, String)>,
    },
    /// The views do not determine the camera.
    #[error("{reason}{}", listed(.rejected))]
    Views {
        /// What is missing and what to do.
        reason: CameraError,
        /// Photographs left out: name and reason.
        rejected: Vec<(String, String)>,
    },
}

fn listed(rejected: &[(String, String)]) -> String {
    rejected.iter().map(|(name, reason)| format!("\n  {name}: {reason}")).collect()
}

/// Why one picture gives no pose of the board.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BoardPoseError {
    /// A board that cannot be.
    #[error("{0}")]
    Board(String),
    /// The board is not found.
    #[error("{name}: {reason}")]
    Photograph {
        /// The picture.
        name: String,
        /// What is wrong and what to do.
        reason: BadPhotograph,
    },
    /// Its corners give no pose.
    #[error("{name}: {reason}")]
    View {
        /// The picture.
        name: String,
        /// What is wrong and what to do.
        reason: BadView,
    },
}

/// Calibrates a camera from photographs of one board; those that do not serve are left out and listed with the reason.
///
/// # Errors
/// Too few good photographs, or views that leave the focal length open.
pub fn calibrate_camera(
    photographs: &[Photograph<'_>],
    board: &Board,
) -> Result<CameraCalibration, CameraCalibrationError> {
    board.check().map_err(CameraCalibrationError::Board)?;
    let looked = photographs.par_iter().map(|photograph| look(photograph, board)).collect::<Vec<_>>();
    let size = common_size(&looked);
    let said: Vec<Option<String>> = photographs.iter().map(camera_said).collect();
    let usual = most_frequent(said.iter().flatten());
    let mut rejected: Vec<(usize, String)> = Vec::new();
    let mut good: Vec<(usize, Found)> = Vec::new();
    for (i, looked) in looked.into_iter().enumerate() {
        let sorted =
            sort_out(looked, size, &good).and_then(|found| same_camera(said[i].as_ref(), usual).map(|()| found));
        match sorted {
            Ok(found) => good.push((i, found)),
            Err(reason) => rejected.push((i, reason.to_string())),
        }
    }
    let named = |rejected: &[(usize, String)]| {
        rejected.iter().map(|(i, reason)| (photographs[*i].name.to_owned(), reason.clone())).collect::<Vec<_>>()
    };
    if good.len() < MIN_VIEWS {
        let rejected = named(&rejected);
        return Err(CameraCalibrationError::TooFew { good: good.len(), all: photographs.len(), rejected });
    }
    let views: Vec<View> = good.iter().map(|(_, found)| found.view.clone()).collect();
    let calibrated = calibrate(&views, size).map_err(|error| match error {
        CameraError::TooFewViews { good, rejected: more } => {
            let mut rejected = named(&rejected);
            rejected.extend(more.into_iter().map(|(name, reason)| (name, reason.to_string())));
            CameraCalibrationError::TooFew { good, all: photographs.len(), rejected }
        }
        reason => CameraCalibrationError::Views { reason, rejected: named(&rejected) },
    })?;
    let names: Vec<&str> = photographs.iter().map(|p| p.name).collect();
    Ok(report::report(&names, board, size, &good, &rejected, &calibrated))
}

/// The board's pose in one picture under a known camera: a card that lies on the board has the same plane.
///
/// # Errors
/// No whole board in the picture, or corners that give no pose.
pub fn board_pose(
    name: &str,
    picture: &Image<[u8; 3]>,
    board: &Board,
    projection: &Projection,
) -> Result<BoardPose, BoardPoseError> {
    board.check().map_err(BoardPoseError::Board)?;
    let found = find_board(name, picture, board)
        .map_err(|reason| BoardPoseError::Photograph { name: name.to_owned(), reason })?;
    pose_of(&found.view, projection).map_err(|reason| BoardPoseError::View { name: name.to_owned(), reason })
}

/// Looks at one more view of the board while views are still being taken; `earlier` are those taken, with a number each.
///
/// # Errors
/// Why it does not serve, and what to do.
pub fn look_at_view(
    photograph: &Photograph<'_>,
    board: &Board,
    (width, height): (usize, usize),
    earlier: &[(usize, Found)],
) -> Result<Found, BadPhotograph> {
    sort_out(look(photograph, board), Size { width, height }, earlier)
}

/// A photograph's size, if it has one, and its board.
type Looked = (Option<Size>, Result<Found, BadPhotograph>);

fn look(photograph: &Photograph<'_>, board: &Board) -> Looked {
    match decode(photograph.bytes) {
        Ok(picture) => {
            let size = Size { width: picture.width, height: picture.height };
            let found = find_board(photograph.name, &picture, board).map_err(|reason| {
                let damaged = fine_levels(photograph.bytes, &[]) == Err(Unread::Damaged);
                if damaged { BadPhotograph::CutShort } else { reason }
            });
            (Some(size), found)
        }
        Err(error) => (None, Err(BadPhotograph::Undecodable(error.to_string()))),
    }
}

/// The size most photographs have.
fn common_size(looked: &[Looked]) -> Size {
    most_frequent(looked.iter().filter_map(|(size, _)| size.as_ref())).copied().unwrap_or(Size { width: 0, height: 0 })
}

/// What occurs most often; the first of them where several do.
fn most_frequent<'a, T: PartialEq>(all: impl Iterator<Item = &'a T> + Clone) -> Option<&'a T> {
    let count = |one: &T| all.clone().filter(|other| *other == one).count();
    let most = all.clone().map(count).max()?;
    all.clone().find(|one| count(one) == most)
}

/// Body and focal length as the EXIF says; none where it does not.
fn camera_said(photograph: &Photograph<'_>) -> Option<String> {
    let FrameInfo { model, serial, focal_length_mm, .. } = FrameInfo::read(photograph.bytes);
    let said = [model, serial.map(|s| format!("number {s}")), focal_length_mm.map(|f| format!("{f} mm"))];
    let said = said.into_iter().flatten().collect::<Vec<_>>().join(", ");
    let shown: String = said.chars().filter(|c| !c.is_control()).collect();
    Some(shown).filter(|shown| !shown.is_empty())
}

/// Refuses a photograph whose EXIF names another camera, or another focal length, than that of most does.
fn same_camera(said: Option<&String>, usual: Option<&String>) -> Result<(), BadPhotograph> {
    match (said, usual) {
        (Some(own), Some(most)) if own != most => {
            Err(BadPhotograph::OtherCamera { own: own.clone(), most: most.clone() })
        }
        _ => Ok(()),
    }
}

fn sort_out((size, found): Looked, common: Size, good: &[(usize, Found)]) -> Result<Found, BadPhotograph> {
    if let Some(Size { width, height }) = size.filter(|size| *size != common) {
        if (width, height) == (common.height, common.width) {
            return Err(BadPhotograph::Rotated { width, height });
        }
        let Size { width: common_width, height: common_height } = common;
        return Err(BadPhotograph::OtherSize { width, height, common_width, common_height });
    }
    let found = found?;
    let same = good.iter().find(|(_, earlier)| apart_px(&earlier.view, &found.view) < SAME_VIEW * common.diagonal());
    match same {
        Some((_, earlier)) => Err(BadPhotograph::Duplicate { of: earlier.view.name.clone() }),
        None => Ok(found),
    }
}

/// Root mean square distance between the corners of two views, px.
fn apart_px(a: &View, b: &View) -> f64 {
    let distance2 = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
    let pixels = |view: &View| view.corners.iter().map(|c| c.pixel).collect::<Vec<_>>();
    let (a, b) = (pixels(a), pixels(b));
    (a.iter().zip(&b).map(distance2).sum::<f64>() / a.len().max(1) as f64).sqrt()
}
