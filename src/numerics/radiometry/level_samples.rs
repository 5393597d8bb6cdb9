//! Samples of an 8-bit bracket: the same pixels in every frame, by channel.

use super::bracket::{Bracket, MANY};
use super::groups::{Channel, Group};
use super::response::Response;
use rayon::prelude::*;

/// From this level on a pixel counts as clipped.
const CLIPPED_LEVEL: f64 = 252.0;
/// From this level on a channel is white, whatever the file's storing made of it.
const WHITE_LEVEL: f32 = 254.5;
/// Trust in a sample of which another channel is clipped: a camera's colour matrix may have spoilt it too, but the upper
/// levels of the weakest channel of a coloured object are seen in no other samples.
const CLIPPED_NEIGHBOUR: f64 = 0.25;

/// Levels of a grid of pixels in every frame.
pub struct LevelSamples {
    /// `levels[channel][frame][point]`.
    levels: [Vec<Vec<f32>>; 3],
}

impl LevelSamples {
    /// Pixels of the frames of `bracket` on a regular grid, at most `most`; not rounded where a finer decoder told.
    pub fn new(bracket: &Bracket, most: usize) -> Self {
        let rounded = |channel: usize| {
            let points = bracket.sample_points(most);
            let of = |frame: &super::bracket::Exposure| {
                points.iter().map(|&(x, y)| f32::from(frame.levels.at(x, y)[channel])).collect()
            };
            bracket.exposures().iter().map(of).collect()
        };
        let levels = match bracket.fine_levels().filter(|_| most == MANY) {
            Some(fine) => std::array::from_fn(|channel| {
                fine.iter().map(|frame| frame.iter().map(|levels| levels[channel].min(255.0)).collect()).collect()
            }),
            None => std::array::from_fn(rounded),
        };
        Self { levels }
    }

    /// Number of pixels.
    pub fn points(&self) -> usize {
        self.levels[0].first().map_or(0, Vec::len)
    }

    /// The levels of every point, frame by frame.
    pub fn points_of(&self, channel: usize) -> Vec<Vec<u8>> {
        let frames = &self.levels[channel];
        (0..self.points()).map(|point| frames.iter().map(|frame| frame[point].round() as u8).collect()).collect()
    }

    /// Groups of about one radiance of every channel, seen through `response`; `trusted` levels bound the mean of a group.
    pub fn groups(&self, response: &Response, times: &[f64], trusted: (f64, f64)) -> Vec<Vec<Group>> {
        (0..3).into_par_iter().map(|channel| self.channel_groups(channel, response, times, trusted)).collect()
    }

    fn channel_groups(&self, channel: usize, response: &Response, times: &[f64], trusted: (f64, f64)) -> Vec<Group> {
        let others = [(channel + 1) % 3, (channel + 2) % 3];
        let trust = |frame: usize, point: usize| {
            let clipped = others.iter().any(|&other| self.levels[other][frame][point] >= WHITE_LEVEL);
            if clipped { CLIPPED_NEIGHBOUR } else { 1.0 }
        };
        let exposure: Vec<f64> = response.log_exposure[channel].iter().map(|g| g.exp()).collect();
        let signals = &self.levels[channel];
        let channel = Channel {
            signals,
            exposure: &|level| {
                let below = (level.max(0.0) as usize).min(254);
                let part = (level - below as f64).clamp(0.0, 1.0);
                exposure[below] * (1.0 - part) + exposure[below + 1] * part
            },
            trusted,
            clipped: CLIPPED_LEVEL,
            trust: &trust,
        };
        channel.groups(times)
    }
}
