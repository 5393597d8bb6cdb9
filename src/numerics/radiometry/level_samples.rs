//! Samples of an 8-bit bracket: the same pixels in every frame, by channel.

use super::bracket::Bracket;
use super::groups::{Channel, Group};
use super::response::Response;
use rayon::prelude::*;

/// Pixels looked at, at most: on a regular grid, from any frame size. Enough for 0.1 % on a frame that shows only a highlight.
pub const MANY: usize = 160_000;
/// From this level on a pixel counts as clipped.
const CLIPPED_LEVEL: f64 = 252.0;
/// Trust in a sample of which another channel is clipped: a camera's colour matrix may have spoilt it too, but the upper
/// levels of the weakest channel of a coloured object are seen in no other samples.
const CLIPPED_NEIGHBOUR: f64 = 0.25;

/// Levels of a grid of pixels in every frame.
pub struct LevelSamples {
    /// `levels[channel][frame][point]`.
    levels: [Vec<Vec<f32>>; 3],
}

impl LevelSamples {
    /// A regular grid of at most `most` pixels over the frames of `bracket`.
    pub fn new(bracket: &Bracket, most: usize) -> Self {
        let (width, height) = (bracket.width(), bracket.height());
        let step = ((width * height) as f64 / most as f64).sqrt().ceil().max(1.0) as usize;
        let grid = || (0..height).step_by(step).flat_map(|y| (0..width).step_by(step).map(move |x| y * width + x));
        let levels = std::array::from_fn(|channel| {
            let of = |frame: &super::bracket::Exposure| {
                grid().map(|pixel| f32::from(frame.levels.pixels[pixel][channel])).collect()
            };
            bracket.exposures().iter().map(of).collect()
        });
        Self { levels }
    }

    /// Number of pixels.
    pub fn points(&self) -> usize {
        self.levels[0].first().map_or(0, Vec::len)
    }

    /// The levels of every point, frame by frame.
    pub fn points_of(&self, channel: usize) -> Vec<Vec<u8>> {
        let frames = &self.levels[channel];
        (0..self.points()).map(|point| frames.iter().map(|frame| frame[point] as u8).collect()).collect()
    }

    /// Groups of about one radiance of every channel, seen through `response`; `trusted` levels bound the mean of a group.
    pub fn groups(&self, response: &Response, times: &[f64], trusted: (f64, f64)) -> Vec<Vec<Group>> {
        (0..3).into_par_iter().map(|channel| self.channel_groups(channel, response, times, trusted)).collect()
    }

    fn channel_groups(&self, channel: usize, response: &Response, times: &[f64], trusted: (f64, f64)) -> Vec<Group> {
        let others = [(channel + 1) % 3, (channel + 2) % 3];
        let trust = |frame: usize, point: usize| {
            let clipped = others.iter().any(|&other| self.levels[other][frame][point] == 255.0);
            if clipped { CLIPPED_NEIGHBOUR } else { 1.0 }
        };
        let exposure: Vec<f64> = response.log_exposure[channel].iter().map(|g| g.exp()).collect();
        let signals = &self.levels[channel];
        let channel = Channel {
            signals,
            exposure: &|level| exposure[(level as usize).min(255)],
            trusted,
            clipped: CLIPPED_LEVEL,
            trust: &trust,
        };
        channel.groups(times)
    }
}
