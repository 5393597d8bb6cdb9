//! Why frames are no usable bracket.

use super::bracket::PairTest;

/// Why frames are no usable bracket. Every message names the frames and says what to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BracketError {
    /// Fewer frames than the step needs.
    #[error("{found} frames in the bracket, at least {needed} are needed: shoot more exposures")]
    TooFewFrames {
        /// Frames given.
        found: usize,
        /// Frames needed.
        needed: usize,
    },
    /// A time that no shutter has.
    #[error("frame {name}: exposure time {time_s} s: give the time the shutter was open, a positive number of seconds")]
    BadTime {
        /// The frame.
        name: String,
        /// Its time, seconds.
        time_s: f64,
    },
    /// Frames of different sizes.
    #[error("frame {name} is {width}x{height}, {first} is {first_width}x{first_height}: a bracket has one size")]
    SizeDiffers {
        /// The frame.
        name: String,
        /// Its columns.
        width: usize,
        /// Its rows.
        height: usize,
        /// The frame it is compared with.
        first: String,
        /// Columns of that frame.
        first_width: usize,
        /// Rows of that frame.
        first_height: usize,
    },
    /// Two frames with one time.
    #[error("frames {a} and {b} have the same exposure time, {time_s} s: correct the times or leave one frame out")]
    SameTime {
        /// A frame.
        a: String,
        /// Another.
        b: String,
        /// Their time, seconds.
        time_s: f64,
    },
    /// Longer exposures that are not brighter.
    #[error("the images contradict the listed times: {}; {remedy}", list(.pairs))]
    Contradicts {
        /// The pairs that do.
        pairs: Vec<PairTest>,
        /// What seems to have happened, and what to do.
        remedy: String,
    },
    /// One picture under two times.
    #[error("frames {a} and {b} are the same picture, pixel for pixel: give the file of the exposure that is missing")]
    SamePicture {
        /// A frame.
        a: String,
        /// The other.
        b: String,
    },
    /// Nothing is exposed.
    #[error("every frame is {what}: {frame} is the nearest to an exposure, with green at level {level}; {remedy}")]
    NothingExposed {
        /// Black or clipped.
        what: &'static str,
        /// The frame nearest to being exposed.
        frame: String,
        /// Its level.
        level: u8,
        /// What to do.
        remedy: &'static str,
    },
    /// Too few frames show the same pixels.
    #[error(
        "{found} frames show enough of what another frame shows; at least {needed} of different times must: shoot exposures at most 2 EV apart, none \
         black or clipped"
    )]
    TooFewOverlap {
        /// Frames that overlap.
        found: usize,
        /// Frames needed.
        needed: usize,
    },
    /// Too little of the level range is seen to solve for a response.
    #[error(
        "{channel}: {pixels} pixels have usable levels in two frames, covering levels {lowest} to {highest}; \
         {needed} pixels on both sides of level 128 are needed: shoot more or other exposures"
    )]
    NoCoverage {
        /// Name of the channel.
        channel: &'static str,
        /// Pixels that are neither black nor clipped in at least two frames.
        pixels: usize,
        /// Lowest level covered.
        lowest: u8,
        /// Highest level covered.
        highest: u8,
        /// Pixels needed.
        needed: usize,
    },
}

fn list(pairs: &[PairTest]) -> String {
    pairs.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}
