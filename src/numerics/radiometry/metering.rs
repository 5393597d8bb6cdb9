//! Which exposures of a bracket would still tell something, judged by those that were shot.
//!
//! What counts is the relative standard error of the merged samples, by the noise model and the rules of the merge. Where only a
//! bound of a radiance is known, because every frame so far is clipped or black there, it is taken to lie anywhere within some exposure
//! values beyond the bound.

use super::merge::precision::Precision;
use super::merge::{CLIPPED_LEVEL, LOWEST_LEVEL, frames_used};
use super::noise::SensorNoise;
use super::response::Response;

/// Exposure values beyond a bound within which an unknown radiance is expected, evenly.
const BEYOND_EV: f64 = 4.0;
/// Below this level a sample tells a bound only.
const SHOWN_LEVEL: u8 = 5;
/// Fraction of the golden ratio: its multiples spread evenly, however many there are.
const SPREAD: f64 = 0.618_033_988_749_894_9;
/// Relative standard error of a sample of which a channel is not shown.
const UNKNOWN: f64 = 1.0;

/// A bracket that is metered.
pub struct Meter<'a> {
    precision: [Precision<'a>; 3],
    times_s: &'a [f64],
}

/// What an exposure tells of a sample.
#[derive(Clone, Copy)]
struct Told {
    /// Inverse of the relative variance, each channel.
    precision: [f64; 3],
    /// The level is neither clipped nor too dark, each channel.
    usable: [bool; 3],
}

/// What every exposure tells, or would tell, of every sample.
pub struct Outlook {
    /// By sample, then by exposure.
    told: Vec<Told>,
    exposures: usize,
    /// Frames that a sample is merged from, at most.
    used: usize,
}

/// What some exposures are worth beside all of the bracket: relative standard error of a sample as the noise model has it, mean over
/// the samples and channels that all exposures show.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Worth {
    /// With these exposures.
    pub sigma: f64,
    /// With all of them.
    pub sigma_whole: f64,
}

impl<'a> Meter<'a> {
    /// A bracket of exposures of `times_s` (seconds, shortest first), stored with `level_variance` (levels squared).
    pub fn new(times_s: &'a [f64], response: &'a Response, noise: &'a SensorNoise, level_variance: [f64; 3]) -> Self {
        let precision =
            std::array::from_fn(|c| Precision::new(times_s.to_vec(), level_variance[c], response, noise, c));
        Self { precision, times_s }
    }

    /// Judges by the frames that were shot, at least one: which exposure, and its levels at the samples.
    pub fn outlook(&self, frames: &[(usize, &[[u8; 3]])]) -> Outlook {
        let mut frames = frames.to_vec();
        frames.sort_by_key(|(exposure, _)| *exposure);
        let samples = frames.iter().map(|(_, levels)| levels.len()).min().unwrap_or(0);
        let mut told = Vec::with_capacity(samples * self.times_s.len());
        for sample in 0..samples {
            let beyond = (SPREAD * (sample + 1) as f64).fract();
            let radiance: [f64; 3] = std::array::from_fn(|c| {
                let levels = frames.iter().map(|(exposure, levels)| (*exposure, levels[sample][c]));
                self.radiance(c, levels, 2_f64.powf(BEYOND_EV * beyond))
            });
            told.extend((0..self.times_s.len()).map(|exposure| self.told(&radiance, exposure)));
        }
        Outlook { told, exposures: self.times_s.len(), used: frames_used(&self.precision) }
    }

    /// Radiance by the longest frame that is not clipped; `factor` beyond the bound where that is all there is.
    fn radiance(&self, channel: usize, mut levels: impl Iterator<Item = (usize, u8)> + Clone, factor: f64) -> f64 {
        let precision = &self.precision[channel];
        let by = |exposure: usize, level: u8| precision.exposure(level.into()) / self.times_s[exposure];
        match levels.clone().take_while(|(_, level)| *level < CLIPPED_LEVEL).last() {
            Some((exposure, level)) if level >= SHOWN_LEVEL => by(exposure, level),
            Some((exposure, _)) => by(exposure, SHOWN_LEVEL) / factor,
            None => levels.next().map_or(0.0, |(exposure, _)| by(exposure, CLIPPED_LEVEL) * factor),
        }
    }

    fn told(&self, radiance: &[f64; 3], exposure: usize) -> Told {
        let of = |c: usize| &self.precision[c];
        let usable = std::array::from_fn(|c| {
            let level = of(c).level(radiance[c], exposure);
            (f64::from(LOWEST_LEVEL)..f64::from(CLIPPED_LEVEL)).contains(&level)
        });
        let precision = std::array::from_fn(|c| of(c).of(radiance[c], exposure) * radiance[c] * radiance[c]);
        Told { precision, usable }
    }
}

impl Outlook {
    /// What the exposures in `shot` are worth beside all.
    pub fn worth(&self, shot: &[usize]) -> Worth {
        let all: Vec<usize> = (0..self.exposures).collect();
        let (mut worth, mut samples) = (Worth::default(), 0.0);
        for told in self.told.chunks_exact(self.exposures.max(1)) {
            let Some(whole) = self.sigma(told, &all) else { continue };
            samples += 1.0;
            worth.sigma_whole += whole;
            worth.sigma += self.sigma(told, shot).unwrap_or(UNKNOWN);
        }
        let samples = f64::max(samples, 1.0);
        Worth { sigma: worth.sigma / samples, sigma_whole: worth.sigma_whole / samples }
    }

    /// The exposure among `candidates` that tells most beside those in `shot`; none where none tells anything.
    pub fn best(&self, shot: &[usize], candidates: impl Iterator<Item = usize>) -> Option<usize> {
        let mut best = (self.worth(shot).sigma, None);
        for candidate in candidates.filter(|candidate| !shot.contains(candidate)) {
            let with = self.worth(&[shot, &[candidate][..]].concat()).sigma;
            if with < best.0 {
                best = (with, Some(candidate));
            }
        }
        best.1
    }

    /// Relative standard error of a sample by some exposures, mean over its channels; none where they do not show one of them. As the
    /// merge does, it takes the longest frames that are not clipped.
    fn sigma(&self, told: &[Told], exposures: &[usize]) -> Option<f64> {
        let of_channel = |c: usize| {
            let mut open: Vec<usize> = exposures.iter().copied().filter(|&e| told[e].precision[c] > 0.0).collect();
            open.sort_unstable_by(|a, b| b.cmp(a));
            open.truncate(self.used);
            let known = open.iter().any(|&e| told[e].usable[c]);
            known.then(|| open.iter().map(|&e| told[e].precision[c]).sum::<f64>().sqrt().recip().min(UNKNOWN))
        };
        (0..3).map(of_channel).sum::<Option<f64>>().map(|sum| sum / 3.0)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    const TIMES_S: [f64; 6] = [1.0 / 64.0, 1.0 / 16.0, 0.25, 1.0, 4.0, 16.0];
    const NOISE: SensorNoise = SensorNoise { full_well_e: 60_000.0, read_noise_e: 20.0 };

    /// Levels of radiances through a power law of 2.2 whose unit gives level 128.
    fn frame(radiances: &[f64], time_s: f64) -> Vec<[u8; 3]> {
        let level = |r: &f64| (128.0 * (r * time_s).powf(1.0 / 2.2)).round().clamp(0.0, 255.0) as u8;
        radiances.iter().map(|r| [level(r); 3]).collect()
    }

    fn with_outlook<T>(radiances: &[f64], shot: &[usize], look: impl FnOnce(&Outlook) -> T) -> T {
        let response = Response::typical();
        let frames: Vec<_> = shot.iter().map(|&e| (e, frame(radiances, TIMES_S[e]))).collect();
        let frames: Vec<_> = frames.iter().map(|(e, levels)| (*e, &levels[..])).collect();
        look(&Meter::new(&TIMES_S, &response, &NOISE, [1.0; 3]).outlook(&frames))
    }

    #[test]
    fn the_whole_bracket_costs_nothing_and_none_of_it_everything() {
        with_outlook(&[0.5; 40], &[3], |outlook| {
            let whole = outlook.worth(&[0, 1, 2, 3, 4, 5]);
            assert_eq!(whole.sigma, whole.sigma_whole);
            assert_eq!(outlook.worth(&[]).sigma, 1.0);
            let one = outlook.worth(&[3]);
            assert!(one.sigma > one.sigma_whole && one.sigma < 0.1, "{one:?}");
        });
    }

    #[test]
    fn a_scene_of_one_radiance_needs_no_frame_that_is_clipped_or_all_but_black_there() {
        // Level 128 after 2 s: longer frames than 4 s are clipped, the shortest is at level 14.
        with_outlook(&[0.5; 40], &[3], |outlook| {
            assert_eq!(outlook.best(&[3], 0..6), Some(4));
            let worth = outlook.worth(&[2, 3, 4]);
            assert!(worth.sigma < 1.02 * worth.sigma_whole, "{worth:?}");
            assert!(outlook.best(&[2, 3, 4], [5].into_iter()).is_none());
        });
    }

    #[test]
    fn clipped_and_black_samples_ask_for_shorter_and_longer_frames() {
        let mut radiances = vec![0.5; 90];
        radiances.extend([300.0; 10]);
        with_outlook(&radiances, &[3, 4], |outlook| {
            let next = outlook.best(&[3, 4], 0..6).unwrap();
            assert!(next < 2, "{next}");
        });
        with_outlook(&[1e-3; 50], &[2], |outlook| assert!(outlook.best(&[2], 0..6).unwrap() > 3));
    }

    #[test]
    fn a_few_samples_that_are_not_shown_weigh_more_than_noise_in_all_others() {
        let mut radiances = vec![0.5; 990];
        radiances.extend([30.0; 10]);
        with_outlook(&radiances, &[1, 3], |outlook| {
            // Level 171 after a 16th of a second: the next frame is clipped there.
            let (without, with) = (outlook.worth(&[2, 3, 4]), outlook.worth(&[1, 4]));
            assert!(without.sigma > 1.5 * without.sigma_whole && with.sigma < without.sigma, "{without:?} {with:?}");
        });
    }
}
