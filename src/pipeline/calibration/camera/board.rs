//! The board and its corners in one picture.

use super::grid::{self, Grid};
use super::quality::{Quality, quality};
use super::refine::refine;
use crate::numerics::calibration::camera::{Corner, View};
use crate::numerics::image::Image;
use crate::pipeline::contain::contained;
use calib_targets_chessboard::{
    ChessboardDetector, ChessboardParams, GrayImageView, default_chess_config, detect_corners,
};
use serde::{Deserialize, Serialize};

/// The detector looks for corners of a few pixels: larger pictures are first reduced to about this many pixels a side.
const DETECTION_SIDE: usize = 1600;
/// Stated standard deviation of a refined corner, px. The residuals give the true one.
const CORNER_SIGMA_PX: f64 = 0.1;
/// Edges wider than this part of a square make a picture blurred.
const BLURRED: f64 = 0.3;

/// A chessboard.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Board {
    /// Inner corners along the one side: where four squares meet.
    pub columns: usize,
    /// Inner corners along the other.
    pub rows: usize,
    /// Side of a square, mm.
    pub square_mm: f64,
}

impl Board {
    /// What makes a board unusable.
    pub fn check(&self) -> Result<(), String> {
        let sides = 3..=60;
        if !sides.contains(&self.columns) || !sides.contains(&self.rows) {
            return Err(format!(
                "a board of {}x{} inner corners: give 3 to 60 a side, counted where four squares meet",
                self.columns, self.rows
            ));
        }
        if !(self.square_mm > 0.0 && self.square_mm < 1e4) {
            return Err(format!("squares of {} mm: measure the side of a square", self.square_mm));
        }
        Ok(())
    }

    /// Inner corners.
    pub fn corners(&self) -> usize {
        self.columns * self.rows
    }

    /// True when the squares' colours tell which corner is the first. Otherwise the board looks the same turned by half a turn.
    pub fn is_oriented(&self) -> bool {
        (self.columns + self.rows) % 2 == 1
    }
}

/// Why a photograph shows no usable board.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BadPhotograph {
    /// No picture file.
    #[error("{0}")]
    Undecodable(String),
    /// A file whose decoder made up the rest.
    #[error("its picture data end early or are damaged: fetch it from the camera again")]
    CutShort,
    /// Portrait among landscape.
    #[error("it is {width}x{height}, turned against the others: give the files as the camera wrote them")]
    Rotated {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// Another size.
    #[error(
        "it is {width}x{height}, most are {common_width}x{common_height}: give photographs of one camera and one picture size"
    )]
    OtherSize {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Columns of most.
        common_width: usize,
        /// Rows of most.
        common_height: usize,
    },
    /// Taken otherwise than most.
    #[error("its EXIF says {own}, that of most {most}: give photographs of one camera at one focal length")]
    OtherCamera {
        /// What its EXIF says: body, serial number, focal length.
        own: String,
        /// What that of most says.
        most: String,
    },
    /// Hardly anything but white.
    #[error("no board found; {percent:.0} % of it is clipped: expose less")]
    Overexposed {
        /// Share of clipped pixels, percent.
        percent: f64,
    },
    /// Hardly anything but black.
    #[error("no board found; its brightest parts reach level {level} of 255: expose more")]
    Underexposed {
        /// Level that 99 % of the pixels stay below.
        level: u8,
    },
    /// Nothing like a board.
    #[error("no board found: it is blurred, or shows no board; focus on the board and show all of it")]
    NoBoard,
    /// Some corners only.
    #[error(
        "{found} of {needed} corners found: the board is partly out of view, covered or blurred; show all of it with a white margin"
    )]
    Partial {
        /// Corners found.
        found: usize,
        /// Corners of the board.
        needed: usize,
    },
    /// A larger grid.
    #[error(
        "a grid of {columns}x{rows} corners found, larger than the board named: give the board's own number of inner corners"
    )]
    LargerBoard {
        /// Corners along the one side.
        columns: usize,
        /// Corners along the other.
        rows: usize,
    },
    /// Corners that refinement could not find again.
    #[error(
        "{lost} of {needed} corners have no sharp crossing: the board is covered, reflects light or is blurred; uncover it, tilt it out of the reflection, focus"
    )]
    Unsharp {
        /// Corners lost.
        lost: usize,
        /// Corners of the board.
        needed: usize,
    },
    /// Blurred edges.
    #[error("it is blurred: edges are {edge_px:.1} px wide, {:.0} % of a square; focus, and keep the board still", 100.0 * edge_px / square_px)]
    Blurred {
        /// Width of an edge, px.
        edge_px: f64,
        /// Side of a square, px.
        square_px: f64,
    },
    /// The same view again.
    #[error("it shows the board exactly where {of} does: move or tilt the board between photographs")]
    Duplicate {
        /// The earlier photograph.
        of: String,
    },
}

/// A board found in a picture.
#[derive(Clone, Debug)]
pub struct Found {
    /// Its corners, row by row from the first one, pixel centres at +0.5.
    pub view: View,
    /// How sharp and how well exposed it is.
    pub quality: Quality,
}

/// Finds the whole board and its corners to subpixel.
///
/// The corners run row by row. The first is the one at which the board's corner square is dark; where the colours do not tell
/// ([`Board::is_oriented`]), the one nearest to the picture's top left corner. Columns and rows turn as x and y do in the picture.
pub fn find_board(name: &str, picture: &Image<[u8; 3]>, board: &Board) -> Result<Found, BadPhotograph> {
    let grey = grey(picture);
    let grid = locate(&grey, board)?;
    let (corners, lost) = refine(&grey, &grid);
    if lost > 0 {
        return Err(BadPhotograph::Unsharp { lost, needed: board.corners() });
    }
    let grid = Grid { corners, ..grid }.oriented(&grey);
    let quality = quality(&grey, &grid);
    if quality.edge_px > BLURRED * quality.square_px {
        return Err(BadPhotograph::Blurred { edge_px: quality.edge_px, square_px: quality.square_px });
    }
    let corner = |(i, &[x, y]): (usize, &[f64; 2])| Corner {
        board_mm: [(i % grid.columns) as f64 * board.square_mm, (i / grid.columns) as f64 * board.square_mm],
        pixel: [x + 0.5, y + 0.5],
        sigma_px: CORNER_SIGMA_PX,
    };
    let corners = grid.corners.iter().enumerate().map(corner).collect();
    Ok(Found { view: View { name: name.to_owned(), corners }, quality })
}

/// Luminance, nearly; the board is grey.
fn grey(picture: &Image<[u8; 3]>) -> Image<u8> {
    let level = |p: &[u8; 3]| ((u16::from(p[0]) + 2 * u16::from(p[1]) + u16::from(p[2]) + 2) / 4) as u8;
    Image { width: picture.width, height: picture.height, pixels: picture.pixels.iter().map(level).collect() }
}

/// The grid of exactly the board's size, to about a pixel.
fn locate(grey: &Image<u8>, board: &Board) -> Result<Grid, BadPhotograph> {
    let mut reduction = 1;
    while grey.width.max(grey.height) / reduction > DETECTION_SIDE {
        reduction *= 2;
    }
    let mut best = Err(poor(grey));
    for reduction in [reduction, reduction.div_ceil(2), 2 * reduction] {
        let reduced = reduced(grey, reduction);
        for labelled in detected(&reduced) {
            match grid::crop(&labelled, board) {
                Ok(grid) => return Ok(grid.scaled(reduction)),
                Err(reason) => best = better(best, reason),
            }
        }
    }
    best
}

/// The reason that says most: a larger board, then the most corners.
fn better(best: Result<Grid, BadPhotograph>, reason: BadPhotograph) -> Result<Grid, BadPhotograph> {
    let rank = |reason: &BadPhotograph| match reason {
        BadPhotograph::LargerBoard { .. } => usize::MAX,
        BadPhotograph::Partial { found, .. } => *found,
        _ => 0,
    };
    match best {
        Err(known) if rank(&known) >= rank(&reason) => Err(known),
        _ => Err(reason),
    }
}

/// Labelled corners: grid coordinates and pixels.
pub(super) type Labelled = Vec<([i32; 2], [f64; 2])>;

/// What the detector makes of a picture, under each of its tolerances.
fn detected(grey: &Image<u8>) -> Vec<Labelled> {
    let detect = || {
        let view = GrayImageView { width: grey.width, height: grey.height, data: &grey.pixels };
        let corners = detect_corners(&view, &default_chess_config());
        let mut found = Vec::new();
        for parameters in ChessboardParams::sweep_default() {
            let Ok(detector) = ChessboardDetector::new(parameters) else { continue };
            for detection in detector.detect_all(&corners) {
                let label = |c: &calib_targets_chessboard::ChessboardCorner| {
                    ([c.grid.u, c.grid.v], [f64::from(c.position.x), f64::from(c.position.y)])
                };
                found.push(detection.corners.iter().map(label).collect());
            }
        }
        found
    };
    contained(detect).unwrap_or_default()
}

/// Mean of each block of `by` x `by` pixels.
fn reduced(image: &Image<u8>, by: usize) -> Image<u8> {
    let (width, height) = (image.width / by, image.height / by);
    let block = |x: usize, y: usize| {
        let rows = (y * by..(y + 1) * by).map(|row| &image.pixels[row * image.width + x * by..][..by]);
        let sum: usize = rows.flatten().map(|p| usize::from(*p)).sum();
        (sum / (by * by)) as u8
    };
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| block(x, y)).collect();
    Image { width, height, pixels }
}

/// Why nothing is seen, from the levels alone.
fn poor(grey: &Image<u8>) -> BadPhotograph {
    let mut counts = [0usize; 256];
    grey.pixels.iter().for_each(|p| counts[usize::from(*p)] += 1);
    let all = grey.pixels.len().max(1);
    let clipped = counts[254..].iter().sum::<usize>() as f64 / all as f64;
    if clipped > 0.3 {
        return BadPhotograph::Overexposed { percent: 100.0 * clipped };
    }
    let mut below = 0;
    let level = (0..=255u8).find(|&level| {
        below += counts[usize::from(level)];
        below * 100 >= all * 99
    });
    match level {
        Some(level) if level < 40 => BadPhotograph::Underexposed { level },
        _ => BadPhotograph::NoBoard,
    }
}
