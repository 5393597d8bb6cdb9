//! Settle time of the arm from bursts of photographs: after how many seconds of rest the picture no longer changes.

use super::decode::decode;
use super::develop::Crop;
use crate::numerics::image::Image;
use crate::numerics::settle::{Blind, Burst, Cell, Difference, Frame, LATE, Measured, measure};
use serde::{Deserialize, Serialize};

/// Side of a JPEG's blocks, pixels: noise in two of them is independent.
const BLOCK: usize = 8;
/// Cells along a side of the object, at most.
const CELLS: usize = 16;
/// Sessions wait this many times the settle time.
const MARGIN: f64 = 2.0;

/// A photograph of a burst.
#[derive(Clone, Debug, PartialEq)]
pub struct Photograph {
    /// When it was asked for and when its file was there, seconds after the arm reported rest.
    pub since_rest_s: [f64; 2],
    /// Name of the file.
    pub name: String,
}

/// Photographs after one move, in order.
#[derive(Clone, Debug, PartialEq)]
pub struct Shots {
    /// From where the arm came, degrees.
    pub from_deg: f64,
    /// The photographs; more than [`LATE`].
    pub photographs: Vec<Photograph>,
}

/// What was shot where.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Arm angle of all bursts but the one beside, degrees.
    pub station_deg: f64,
    /// Arm angle of the burst beside, degrees: what a small turn changes in the picture.
    pub beside_deg: f64,
    /// The burst beside.
    pub beside: Shots,
    /// The bursts at the station, several from each start.
    pub bursts: Vec<Shots>,
    /// Exposure time, seconds.
    pub exposure_s: f64,
    /// The part of the frames that shows the object; all of them if none.
    pub crop: Option<Crop>,
    /// A motion below this may stay unseen, degrees: with more noise nothing is said.
    pub must_see_deg: f64,
}

/// The settle time after moves of one length.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OfMove {
    /// Length of the move, degrees.
    pub move_deg: f64,
    /// From here on every frame is at the noise floor: time of the shot request after the arm reported rest, seconds.
    pub settle_s: f64,
    /// The last frame above it, seconds: the truth lies between the two. Null when no frame was above it.
    pub last_above_s: Option<f64>,
    /// Greatest displacement that was seen, degrees.
    pub greatest_deg: f64,
}

/// A frame of the report.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Length of the move, degrees.
    pub move_deg: f64,
    /// Time of the shot request after the arm reported rest, seconds.
    pub delay_s: f64,
    /// Where the arm seems to stand, from where it came to rest, degrees.
    pub displacement_deg: f64,
    /// Difference from the last frames, over the noise floor: up to 4 it is noise.
    pub over_noise: f64,
    /// One of the last frames, which the others are compared with.
    pub last: bool,
}

/// What the bursts say.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SettleReport {
    /// The settle time, the longest of all moves, seconds.
    pub settle_s: f64,
    /// By how much it may be too long: the time to the last frame that was above the noise floor (all of it when none was), seconds.
    pub uncertainty_s: f64,
    /// What arm.settle_s should be, seconds: twice the settle time, rounded up.
    pub recommended_s: f64,
    /// The settle time by length of the move.
    pub moves: Vec<OfMove>,
    /// The smallest displacement that would have been seen, degrees.
    pub smallest_seen_deg: f64,
    /// Scatter of the last frames, degrees.
    pub noise_deg: f64,
    /// Greatest relative change of the lamp within a burst; it is told apart from a displacement.
    pub lamp_change: f64,
    /// The shutter opens at most this long after its request, seconds: the shortest time from request to file, less the exposure.
    pub shutter_lag_at_most_s: f64,
    /// Cells of the picture that were compared.
    pub cells: usize,
    /// What a person should know.
    pub warnings: Vec<String>,
    /// Every frame, by length of the move and time.
    pub table: Vec<Row>,
}

/// A photograph's bytes by its name.
pub type Load<'a> = &'a dyn Fn(&str) -> Result<Vec<u8>, String>;

/// Finds the settle time.
///
/// # Errors
/// What kept it from being measured, and what to do.
pub fn settle_time(series: &Series, load: Load<'_>) -> Result<SettleReport, String> {
    let beside = burst(series, &series.beside, load)?;
    let bursts = series.bursts.iter().map(|shots| burst(series, shots, load)).collect::<Result<Vec<_>, _>>()?;
    let turn_deg = series.beside_deg - series.station_deg;
    let found = measure(&beside, turn_deg, &bursts).map_err(|blind| words_of(blind, series))?;
    refuse_unmeasured(&found, series)?;
    report(&found, series)
}

fn words_of(blind: Blind, series: &Series) -> String {
    let (at, time) = (series.station_deg, series.exposure_s);
    match blind {
        Blind::Dark => format!(
            "there is no light on the object at {at} degrees in {time:.3} s: too few parts of it are above level 12; take a longer exposure, \
             or look after lamp and object"
        ),
        Blind::Bright => {
            format!("the object is clipped at {at} degrees in {time:.3} s: take a shorter exposure")
        }
        Blind::NoPattern => format!(
            "the picture at {} degrees differs from that at {at} only as by a brighter lamp, or not at all: it cannot show how the arm \
             moves; put an object there on which light and shade lie",
            series.beside_deg
        ),
    }
}

fn refuse_unmeasured(found: &Measured, series: &Series) -> Result<(), String> {
    let Measured { smallest_deg, noise_deg, pixel_noise_deg, .. } = *found;
    if found.lamp_hides {
        return Err(format!(
            "the lamp changes by {:.2} % within a burst, which shows more than the motion of the arm does: let it warm up (lamp.soak_s), \
             keep other light out, and measure again",
            100.0 * found.lamp_change
        ));
    }
    if smallest_deg <= series.must_see_deg {
        return Ok(());
    }
    let seen = format!("a displacement below {smallest_deg:.3} degrees would not be seen");
    Err(if found.uneasy {
        format!(
            "the picture never settles within the bursts: in the last frames of each it still moves by {noise_deg:.3} degrees rms, {:.0} \
             times the noise of its pixels, and {seen}; hold the arm's motor current ($1=255), lower arm.acceleration_deg_s2, look for \
             what shakes the rig",
            noise_deg / pixel_noise_deg
        )
    } else {
        format!(
            "there is too much noise: {seen}, and {:.3} degrees must be; take a longer exposure or a brighter lamp",
            series.must_see_deg
        )
    })
}

fn report(found: &Measured, series: &Series) -> Result<SettleReport, String> {
    let move_of = |difference: &Difference| (series.station_deg - series.bursts[difference.burst].from_deg).abs();
    let mut lengths: Vec<f64> = found.differences.iter().map(move_of).collect();
    lengths.sort_by(|a, b| b.total_cmp(a));
    lengths.dedup();
    let first_late_s =
        found.differences.iter().filter(|d| d.late).map(|d| d.since_rest_s).fold(f64::INFINITY, f64::min);
    let (mut moves, mut table) = (Vec::new(), Vec::new());
    for &move_deg in &lengths {
        let of: Vec<&Difference> = found.differences.iter().filter(|d| move_of(d) == move_deg).collect();
        moves.push(of_move(&of, move_deg, first_late_s)?);
        table.extend(of.iter().map(|d| Row {
            move_deg,
            delay_s: d.since_rest_s,
            displacement_deg: d.displacement_deg,
            over_noise: d.over_noise,
            last: d.late,
        }));
    }
    let longest = moves.iter().max_by(|a, b| a.settle_s.total_cmp(&b.settle_s)).ok_or("there are no bursts")?;
    let settle_s = longest.settle_s;
    let lag = |photograph: &Photograph| photograph.since_rest_s[1] - photograph.since_rest_s[0] - series.exposure_s;
    let lags = series.bursts.iter().flat_map(|shots| &shots.photographs).map(lag);
    Ok(SettleReport {
        settle_s,
        uncertainty_s: settle_s - longest.last_above_s.unwrap_or(0.0),
        recommended_s: (100.0 * MARGIN * settle_s).ceil() / 100.0,
        smallest_seen_deg: found.smallest_deg,
        noise_deg: found.noise_deg,
        lamp_change: found.lamp_change,
        shutter_lag_at_most_s: lags.fold(f64::INFINITY, f64::min).max(0.0),
        cells: found.cells,
        warnings: warnings(found, longest),
        moves,
        table,
    })
}

fn warnings(found: &Measured, longest: &OfMove) -> Vec<String> {
    let mut warnings = Vec::new();
    if found.uneasy {
        warnings.push(format!(
            "the last frames of the bursts scatter by {:.3} degrees, {:.1} times the noise of their pixels: something still moves",
            found.noise_deg,
            found.noise_deg / found.pixel_noise_deg
        ));
    }
    if let Some(last) = longest.last_above_s.filter(|last| *last < 0.5 * longest.settle_s) {
        warnings.push(format!(
            "no frame was asked for between {last:.2} and {:.2} s: frames came more slowly than in the first burst; measure again, with \
             nothing else to do for this computer",
            longest.settle_s
        ));
    }
    warnings
}

/// The settle time from the frames after moves of one length, by time.
fn of_move(of: &[&Difference], move_deg: f64, first_late_s: f64) -> Result<OfMove, String> {
    let last_above = of.iter().rposition(|difference| difference.differs());
    let last_above_s = last_above.map(|index| of[index].since_rest_s);
    let after = last_above.map_or(0, |index| index + 1);
    let early = of.get(after).filter(|_| last_above_s.is_none_or(|last| last < first_late_s));
    let settle_s = early.map(|difference| difference.since_rest_s).ok_or_else(|| {
        format!(
            "the picture never settles within the bursts: {:.2} s after a move of {move_deg} degrees it still differs, and the frames \
             it is compared with begin at {first_late_s:.2} s; look for what lets the arm swing so long",
            last_above_s.unwrap_or_default()
        )
    })?;
    let seen = of.iter().filter(|difference| difference.differs()).map(|difference| difference.displacement_deg.abs());
    Ok(OfMove { move_deg, settle_s, last_above_s, greatest_deg: seen.fold(0.0, f64::max) })
}

/// The cells of every photograph.
fn burst(series: &Series, shots: &Shots, load: Load<'_>) -> Result<Burst, String> {
    if shots.photographs.len() <= LATE {
        return Err(format!("a burst of {} frames: {} are needed at least", shots.photographs.len(), LATE + 1));
    }
    let frame = |photograph: &Photograph| {
        let picture = decode(&load(&photograph.name)?).map_err(|e| format!("{}: {e}", photograph.name))?;
        let whole = Crop { x: 0, y: 0, width: picture.width, height: picture.height };
        Ok(Frame { since_rest_s: photograph.since_rest_s[0], cells: cells(&picture, series.crop.unwrap_or(whole)) })
    };
    shots.photographs.iter().map(frame).collect()
}

/// The picture's luma in square cells, each of blocks of a chessboard: white ones are one half, black ones the other.
fn cells(picture: &Image<[u8; 3]>, crop: Crop) -> Vec<Cell> {
    let pair = 2 * BLOCK;
    let side = (crop.width.max(crop.height).div_ceil(CELLS)).div_ceil(pair).max(1) * pair;
    // Blocks are counted from the corner of the frame, where the camera's JPEG begins.
    let (left, top) = (crop.x.div_ceil(BLOCK) * BLOCK, crop.y.div_ceil(BLOCK) * BLOCK);
    let (right, bottom) = ((crop.x + crop.width).min(picture.width), (crop.y + crop.height).min(picture.height));
    let starts = |from: usize, to: usize| (from..(to + 1).saturating_sub(side)).step_by(side);
    let corners = starts(top, bottom).flat_map(|y| starts(left, right).map(move |x| (x, y)));
    corners.map(|(x, y)| cell(picture, x, y, side)).collect()
}

fn cell(picture: &Image<[u8; 3]>, left: usize, top: usize, side: usize) -> Cell {
    let mut halves = [0.0; 2];
    for y in top..top + side {
        for (x, [r, g, b]) in picture.row(y).iter().enumerate().skip(left).take(side) {
            halves[(x / BLOCK + y / BLOCK) % 2] +=
                0.299 * f64::from(*r) + 0.587 * f64::from(*g) + 0.114 * f64::from(*b);
        }
    }
    let half = 0.5 * (side * side) as f64;
    let [a, b] = halves.map(|sum| sum / half);
    Cell { level: 0.5 * (a + b), half_difference: 0.5 * (a - b) }
}
