//! Whether what was shot is exposed so that it can be measured.

use crate::numerics::image::Image;
use crate::pipeline::calibration::camera::Found;
use crate::pipeline::calibration::lights::CalibratedBall;
use crate::pipeline::decode::decode;

/// A channel from here on is clipped: a camera's curve is flat there.
const CLIPPED: f64 = 250.0;
/// More white squares clipped than this are no reflection on some of them but an exposure too long: every edge is moved towards the
/// black squares, by more the more it is blurred.
const MOST_CLIPPED: f64 = 0.25;
/// Half the side of the middle of a square that is looked at, as a part of its side.
const MIDDLE: f64 = 0.2;

/// Refuses a view of the board whose white is clipped; `corners` are its inner corners by columns and rows.
///
/// # Errors
/// How much of it, and what to do.
pub fn check_board(bytes: &[u8], found: &Found, corners: (usize, usize)) -> Result<(), String> {
    let picture = decode(bytes).map_err(|e| e.to_string())?;
    let middle_grey = 0.5 * (found.quality.white + found.quality.black);
    let (mut white, mut clipped) = (0_usize, 0_usize);
    for row in 0..corners.1 - 1 {
        for column in 0..corners.0 - 1 {
            let at = |row: usize, column: usize| found.view.corners[row * corners.0 + column].pixel;
            let square = [at(row, column), at(row, column + 1), at(row + 1, column + 1), at(row + 1, column)];
            let levels = middle_of(&picture, &square);
            if levels.iter().sum::<f64>() / 3.0 > middle_grey {
                white += 1;
                clipped += usize::from(levels.iter().any(|&level| level >= CLIPPED));
            }
        }
    }
    if clipped as f64 <= MOST_CLIPPED * white as f64 {
        return Ok(());
    }
    Err(format!(
        "{clipped} of {white} white squares are clipped to white: turn the board a little away from the lamp or move it off; if every \
         view is so bright, abort, shorten calibration.board_exposure in the rig file and start the daemon anew"
    ))
}

/// Mean of each channel over the middle of a square, of which the corners are given.
fn middle_of(picture: &Image<[u8; 3]>, square: &[[f64; 2]; 4]) -> [f64; 3] {
    let [x, y] = [0, 1].map(|axis| square.iter().map(|corner| corner[axis]).sum::<f64>() / 4.0);
    let side = (square[2][0] - square[0][0]).hypot(square[2][1] - square[0][1]) / std::f64::consts::SQRT_2;
    let half = (MIDDLE * side).floor();
    let range = |at: f64, size: usize| (at - half).max(0.0) as usize..((at + half) as usize + 1).min(size);
    let (mut sum, mut count) = ([0.0; 3], 0.0_f64);
    for row in range(y, picture.height) {
        for column in range(x, picture.width) {
            let pixel = picture.at(column, row);
            sum = std::array::from_fn(|c| sum[c] + f64::from(pixel[c]));
            count += 1.0;
        }
    }
    sum.map(|sum| sum / count.max(1.0))
}

/// Clipped pixels on a ball that are no hot pixels.
const LEAST_SPOT: usize = 4;

/// Refuses a frame, the least exposed of its station, in which highlights of balls are clipped.
///
/// # Errors
/// On which ball, and what to do.
pub fn check_highlights(name: &str, clipped: &Image<bool>, balls: &[CalibratedBall]) -> Result<(), String> {
    for (index, ball) in balls.iter().enumerate() {
        let [x, y] = ball.image_center_px;
        let on_ball = |i: usize| {
            let (column, row) = ((i % clipped.width) as f64 + 0.5, (i / clipped.width) as f64 + 0.5);
            (column - x).hypot(row - y) < ball.image_radius_px
        };
        let count = clipped.pixels.iter().enumerate().filter(|(i, clipped)| **clipped && on_ball(*i)).count();
        if count >= LEAST_SPOT {
            return Err(format!(
                "{name}: the highlight on ball {} is clipped ({count} pixels) in the shortest exposure too: abort, add a shorter one to \
                 calibration.exposures in the rig file and start the daemon anew; or take away what else shines on the balls",
                index + 1
            ));
        }
    }
    Ok(())
}
