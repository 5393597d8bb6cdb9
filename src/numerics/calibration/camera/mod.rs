//! Camera calibration from pictures of a flat board (Zhang 2000, "A flexible new technique for camera calibration"; Bouguet's
//! toolbox): interior, distortion and a pose per view with covariances, and which of the parameters the views determine.
//!
//! Pixel coordinates have their origin at the top left corner and pixel centres at +0.5; the board lies in its own x, y plane, mm.

mod adjust;
mod homography;
mod interior;
mod mixed;
mod pose;
mod select;
mod start;

pub use interior::{Freedom, Interior, NAMES, UNKNOWNS};
pub use mixed::Suggested;
pub use pose::Pose;
pub use select::Verdict;

use crate::numerics::geometry::Projection;
use mixed::Split;
use nalgebra::{Matrix6, SMatrix};
use select::{Choice, select};

/// Fewest good views. One tilted view determines a focal length; its error shows only beside others.
pub const MIN_VIEWS: usize = 3;
/// Fewest corners of a view: a pose and a residual that means something.
const MIN_CORNERS: usize = 8;
/// A view whose rms error is this many times the median's does not fit: its corners are mislabelled or the board is bent.
const MISFIT: f64 = 3.0;
/// ... but never one whose rms error is below this many stated standard deviations.
const MISFIT_FLOOR: f64 = 1.0;
/// A board seen more obliquely has a pose that its corners hardly determine, degrees.
const OBLIQUE_DEG: f64 = 75.0;
/// Board normals that differ by less, all of them, are parallel views, degrees.
const PARALLEL_DEG: f64 = 6.0;
/// Greatest relative standard deviation of a focal length that counts as measured.
const FOCAL_SIGMA: f64 = 0.01;

/// Views of another camera are exceptions if they are at most one in so many; more are a second set.
const EXCEPTIONS: usize = 3;

/// Size of the pictures, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Size {
    /// The image's centre, px.
    pub fn center(self) -> [f64; 2] {
        [self.width as f64 / 2.0, self.height as f64 / 2.0]
    }

    /// px.
    pub fn diagonal(self) -> f64 {
        (self.width as f64).hypot(self.height as f64)
    }
}

/// A corner of the board and where it is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// On the board, mm.
    pub board_mm: [f64; 2],
    /// In the picture, px.
    pub pixel: [f64; 2],
    /// Standard deviation of each pixel coordinate, px. Only ratios count: the residuals give the scale.
    pub sigma_px: f64,
}

/// One picture of the board.
#[derive(Clone, Debug)]
pub struct View {
    /// For messages.
    pub name: String,
    /// What was found of the board.
    pub corners: Vec<Corner>,
}

/// Why a view is left out.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BadView {
    /// Coordinates that are no numbers, or no positive sigma.
    #[error("its corners hold a value that is no number, or a sigma that is not positive")]
    NotNumbers,
    /// Fewer corners than a pose needs.
    #[error("it has {found} corners, at least {MIN_CORNERS} are needed: show the whole board")]
    TooFewCorners {
        /// Corners given.
        found: usize,
    },
    /// Collinear or coinciding corners.
    #[error("its corners lie on a line: show the board from the front, with corners in both directions")]
    Degenerate,
    /// A grazing view.
    #[error("the board is seen at {degrees:.0} degrees from its front, beyond {OBLIQUE_DEG:.0}: tilt it less")]
    Oblique {
        /// Angle between the board's normal and the line of sight, degrees.
        degrees: f64,
    },
    /// Its error stands out.
    #[error(
        "its reprojection error is {rms_px:.2} px rms, {:.1} times the median of all views: corners are mislabelled, the board \
         moved or was bent, or it is of another camera or zoom; take the photograph again", rms_px / median_px
    )]
    Misfit {
        /// Its rms error, px.
        rms_px: f64,
        /// Median of the views' rms errors, px.
        median_px: f64,
    },
    /// It fits another camera.
    #[error(
        "it does not fit the camera of the other photographs: it suggests {own}, they {others}; it is of another camera, zoom or focus, \
         or mirrored: take it again with this camera"
    )]
    OtherCamera {
        /// What it and others like it suggest.
        own: Suggested,
        /// What the other views suggest.
        others: Suggested,
    },
}

/// Why views give no calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// Pictures without pixels.
    #[error("pictures of {width}x{height} pixels: give photographs")]
    NoPicture {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// Too few good views.
    #[error(
        "{good} good views of the board, at least {MIN_VIEWS} are needed{}: photograph the board 10 to 20 times, tilted by 20 \
         to 30 degrees in different directions", listed(.rejected)
    )]
    TooFewViews {
        /// Views that could be used.
        good: usize,
        /// The others: name and reason.
        rejected: Vec<(String, BadView)>,
    },
    /// The board never turned.
    #[error(
        "all {views} views show the board parallel to within {degrees:.1} degrees, which leaves the focal length open: tilt \
         the board by 20 to 30 degrees in different directions"
    )]
    Parallel {
        /// Views used.
        views: usize,
        /// Greatest angle between two board normals, degrees.
        degrees: f64,
    },
    /// The focal length is not determined.
    #[error(
        "the {views} views leave the focal length uncertain by {percent:.1} %: tilt the board by 20 to 30 degrees in different \
         directions and let it fill the picture"
    )]
    FocalOpen {
        /// Views used.
        views: usize,
        /// Relative standard deviation, percent.
        percent: f64,
    },
    /// Two groups of views, neither of which can be called the exception.
    #[error(
        "the photographs are not of one camera: {} suggest {few}, the others {most}; give photographs of one camera at one zoom and \
         focus, none of them mirrored", .names.join(", ")
    )]
    TwoCameras {
        /// Views of the smaller group.
        names: Vec<String>,
        /// What they suggest.
        few: Suggested,
        /// What the others suggest.
        most: Suggested,
    },
    /// The adjustment ran out of steps.
    #[error("the adjustment of {views} views did not converge: check the board's size and take the photographs again")]
    NoConvergence {
        /// Views used.
        views: usize,
    },
}

fn listed(rejected: &[(String, BadView)]) -> String {
    rejected.iter().map(|(name, reason)| format!("; {name}: {reason}")).collect()
}

/// A view that was used.
#[derive(Clone, Debug)]
pub struct UsedView {
    /// Index in the views given.
    pub index: usize,
    /// Where the board lay.
    pub pose: Pose,
    /// Covariance of the pose: rotation vector (camera axes, rad), translation (mm).
    pub covariance: Matrix6<f64>,
    /// Root mean square distance between corners and reprojection, px.
    pub rms_px: f64,
}

/// A calibrated camera.
#[derive(Clone, Debug)]
pub struct Calibrated {
    /// Focal lengths, principal point and distortion.
    pub interior: Interior,
    /// Covariance of [`Interior::values`] from the residuals' own scatter; rows of held parameters are zero.
    pub covariance: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    /// Root mean square distance over all corners used, px.
    pub rms_px: f64,
    /// Measured over stated standard deviation of a corner.
    pub sigma_scale: f64,
    /// Every freedom beyond the focal length, and why it is free or held.
    pub verdicts: Vec<(Freedom, Verdict)>,
    /// Views used.
    pub views: Vec<UsedView>,
    /// Views left out: index and reason.
    pub rejected: Vec<(usize, BadView)>,
}

/// Calibrates a camera; views that do not fit are left out one by one, the worst first.
///
/// # Errors
/// Too few good views, or views that leave the focal length open.
pub fn calibrate(views: &[View], size: Size) -> Result<Calibrated, CameraError> {
    if size.width == 0 || size.height == 0 {
        return Err(CameraError::NoPicture { width: size.width, height: size.height });
    }
    let mut rejected: Vec<(usize, BadView)> = Vec::new();
    let mut good: Vec<usize> = Vec::new();
    for (i, view) in views.iter().enumerate() {
        match check(view) {
            Ok(()) => good.push(i),
            Err(reason) => rejected.push((i, reason)),
        }
    }
    loop {
        let used: Vec<&View> = good.iter().map(|&i| &views[i]).collect();
        let choice = if used.len() < MIN_VIEWS {
            None
        } else {
            start::start(&used, size).and_then(|(interior, poses)| select(&used, size, interior, poses))
        };
        let Some(choice) = choice else {
            let rejected = rejected.iter().map(|(i, reason)| (views[*i].name.clone(), reason.clone())).collect();
            return Err(CameraError::TooFewViews { good: good.len(), rejected });
        };
        if let Some((at, reason)) = worst(&used, &choice) {
            rejected.push((good.remove(at), reason));
            continue;
        }
        let Some(Split { few, of_few, of_most }) = mixed::split(&used, &choice) else {
            return finish(&used, &good, choice, rejected);
        };
        if few.len() * EXCEPTIONS > used.len() {
            let names = few.iter().map(|&at| used[at].name.clone()).collect();
            return Err(CameraError::TwoCameras { names, few: of_few, most: of_most });
        }
        let reason = BadView::OtherCamera { own: of_few, others: of_most };
        rejected.extend(few.iter().map(|&at| (good[at], reason.clone())));
        good = (0..good.len()).filter(|at| !few.contains(at)).map(|at| good[at]).collect();
    }
}

/// A board's pose under a known interior.
#[derive(Clone, Copy, Debug)]
pub struct BoardPose {
    /// Where the board lies.
    pub pose: Pose,
    /// Root mean square distance between corners and reprojection, px.
    pub rms_px: f64,
    /// The same for the board mirrored across the line of sight: where it is hardly larger, the picture does not tell which of the
    /// two tilts is the true one.
    pub mirrored_rms_px: f64,
}

/// Finds the board's pose in one view under a known pinhole camera. The covariance of the corners is not propagated.
///
/// # Errors
/// Corners that give no pose, or a projection that is no pinhole (told as degenerate corners).
pub fn board_pose(view: &View, projection: &Projection) -> Result<BoardPose, BadView> {
    check(view)?;
    let interior = Interior::of(projection).ok_or(BadView::Degenerate)?;
    let posed = pose::pose(&view.corners, &interior).ok_or(BadView::Degenerate)?;
    let weights: f64 = view.corners.iter().map(|c| c.sigma_px.powi(-2)).sum();
    let [rms_px, mirrored_rms_px] = [posed.cost, posed.mirrored_cost].map(|cost| (cost / weights).sqrt());
    Ok(BoardPose { pose: posed.pose, rms_px, mirrored_rms_px })
}

/// Whether a view can take part at all.
fn check(view: &View) -> Result<(), BadView> {
    let sound =
        |c: &Corner| c.board_mm.iter().chain(&c.pixel).all(|v| v.abs() < 1e9) && c.sigma_px > 1e-9 && c.sigma_px < 1e9;
    if !view.corners.iter().all(sound) {
        return Err(BadView::NotNumbers);
    }
    if view.corners.len() < MIN_CORNERS {
        return Err(BadView::TooFewCorners { found: view.corners.len() });
    }
    homography::homography(&view.corners).map(|_| ()).ok_or(BadView::Degenerate)
}

/// The view to leave out next, by its place in `views`.
fn worst(views: &[&View], choice: &Choice) -> Option<(usize, BadView)> {
    let rms: Vec<f64> = (0..views.len()).map(|i| choice.fit.adjusted.rms_px(views[i], i)).collect();
    let mut sorted = rms.clone();
    sorted.sort_by(f64::total_cmp);
    // The lower middle: of three views the second.
    let median_px = sorted[(sorted.len() - 1) / 2];
    let (at, rms_px) = rms.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let stated = views[at].corners.iter().map(|c| c.sigma_px).sum::<f64>() / views[at].corners.len() as f64;
    if rms_px > MISFIT * median_px && rms_px > MISFIT_FLOOR * stated {
        return Some((at, BadView::Misfit { rms_px, median_px }));
    }
    let oblique = |i: usize| {
        let pose = &choice.fit.adjusted.poses[i];
        let sight = pose.place(pose::middle(&views[i].corners)).normalize();
        pose.normal().dot(&sight).abs().clamp(0.0, 1.0).acos().to_degrees()
    };
    let angles = (0..views.len()).map(oblique).enumerate();
    let (at, degrees) = angles.max_by(|a, b| a.1.total_cmp(&b.1))?;
    (degrees > OBLIQUE_DEG).then_some((at, BadView::Oblique { degrees }))
}

fn finish(
    views: &[&View],
    good: &[usize],
    choice: Choice,
    mut rejected: Vec<(usize, BadView)>,
) -> Result<Calibrated, CameraError> {
    let Choice { fit, verdicts } = choice;
    let sigma = fit.focal_sigma();
    let open = || {
        let degrees = spread_deg(&fit.adjusted.poses);
        let views = views.len();
        if degrees < PARALLEL_DEG {
            CameraError::Parallel { views, degrees }
        } else {
            CameraError::FocalOpen { views, percent: 100.0 * sigma }
        }
    };
    let (covariance, poses) = fit.covariance.clone().filter(|_| sigma <= FOCAL_SIGMA).ok_or_else(open)?;
    if !fit.adjusted.converged {
        return Err(CameraError::NoConvergence { views: views.len() });
    }
    rejected.sort_by_key(|(i, _)| *i);
    let used = |i: usize| {
        let rms_px = fit.adjusted.rms_px(views[i], i);
        UsedView { index: good[i], pose: fit.adjusted.poses[i], covariance: poses[i], rms_px }
    };
    let used: Vec<UsedView> = (0..views.len()).map(used).collect();
    let corners = |i: usize| views[i].corners.len() as f64;
    let squares: f64 = used.iter().enumerate().map(|(i, view)| view.rms_px * view.rms_px * corners(i)).sum();
    let all: f64 = (0..views.len()).map(corners).sum();
    Ok(Calibrated {
        interior: fit.adjusted.interior,
        covariance,
        rms_px: (squares / all).sqrt(),
        sigma_scale: fit.variance.sqrt(),
        verdicts,
        views: used,
        rejected,
    })
}

/// Greatest angle between two board normals, degrees.
fn spread_deg(poses: &[Pose]) -> f64 {
    let angle = |a: &Pose, b: &Pose| a.normal().dot(&b.normal()).clamp(-1.0, 1.0).acos().to_degrees();
    poses.iter().flat_map(|a| poses.iter().map(move |b| angle(a, b))).fold(0.0, f64::max)
}
