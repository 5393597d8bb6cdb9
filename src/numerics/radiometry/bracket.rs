//! A bracket of 8-bit frames, and the test whether its images contradict its times.

use super::contradictions;
pub use super::error::BracketError;
use crate::numerics::image::Image;

/// One frame of a bracket.
#[derive(Clone, Debug)]
pub struct Exposure {
    /// Name for messages.
    pub name: String,
    /// Pixel levels as the camera wrote them.
    pub levels: Image<[u8; 3]>,
    /// The time the shutter really was open, seconds.
    pub time_s: f64,
}

/// Frames of one scene, one size, ordered from the shortest to the longest exposure.
#[derive(Clone, Debug)]
pub struct Bracket {
    exposures: Vec<Exposure>,
    level_variance: [f64; 3],
    /// Levels at [`Bracket::sample_points`] before they were rounded, frame by frame.
    fine: Option<Vec<Vec<[f32; 3]>>>,
}

/// Pixels that times and response are measured on, at most: enough for 0.1 % on a frame that shows only a highlight.
pub const MANY: usize = 160_000;
/// A pixel that no frame shows brighter says nothing.
const SHOWN_LEVEL: u8 = 5;

impl Bracket {
    /// Checks and orders `exposures`. `level_variance` is the variance that storing the frame added to a channel, levels squared
    /// (1/12 for rounding alone).
    pub fn new(mut exposures: Vec<Exposure>, level_variance: [f64; 3]) -> Result<Self, BracketError> {
        let Some(first) = exposures.first() else {
            return Err(BracketError::TooFewFrames { found: 0, needed: 1 });
        };
        for frame in &exposures {
            if !(frame.time_s.is_finite() && frame.time_s > 0.0) {
                return Err(BracketError::BadTime { name: frame.name.clone(), time_s: frame.time_s });
            }
            let size = |frame: &Exposure| (frame.levels.width, frame.levels.height);
            if size(frame) != size(first) {
                return Err(BracketError::SizeDiffers {
                    name: frame.name.clone(),
                    width: frame.levels.width,
                    height: frame.levels.height,
                    first: first.name.clone(),
                    first_width: first.levels.width,
                    first_height: first.levels.height,
                });
            }
        }
        exposures.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        Ok(Self { exposures, level_variance, fine: None })
    }

    /// The frames, shortest exposure first; at least one.
    pub fn exposures(&self) -> &[Exposure] {
        &self.exposures
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.exposures[0].levels.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.exposures[0].levels.height
    }

    /// Variance that storing the frames added to each channel, levels squared.
    pub fn level_variance(&self) -> [f64; 3] {
        self.level_variance
    }

    /// The same frames with other times (seconds, in the order of the frames, one each).
    pub fn with_times(mut self, times_s: &[f64]) -> Result<Self, BracketError> {
        if times_s.len() != self.exposures.len() {
            return Err(BracketError::TooFewFrames { found: self.exposures.len(), needed: times_s.len() });
        }
        self.exposures.iter_mut().zip(times_s).for_each(|(frame, &time_s)| frame.time_s = time_s);
        let fine = self.fine.map(|fine| {
            let mut order: Vec<usize> = (0..fine.len()).collect();
            order.sort_by(|&a, &b| times_s[a].total_cmp(&times_s[b]));
            let mut fine: Vec<_> = fine.into_iter().map(Some).collect();
            order.into_iter().filter_map(|i| fine[i].take()).collect()
        });
        Ok(Self { fine, ..Self::new(self.exposures, self.level_variance)? })
    }

    /// Pixels (column, row) on a regular grid, at most `most` of those that the longest exposure shows.
    pub fn sample_points(&self, most: usize) -> Vec<(usize, usize)> {
        let Some(longest) = self.exposures.last() else { return Vec::new() };
        let shown = |pixel: &[u8; 3]| pixel.iter().any(|&level| level >= SHOWN_LEVEL);
        let count = longest.levels.pixels.iter().filter(|pixel| shown(pixel)).count();
        let step = (count as f64 / most as f64).sqrt().ceil().max(1.0) as usize;
        let rows = (0..self.height()).step_by(step);
        let grid = rows.flat_map(|y| (0..self.width()).step_by(step).map(move |x| (x, y)));
        grid.filter(|&(x, y)| shown(longest.levels.at(x, y))).collect()
    }

    /// Adds what a finer decoder says of [`Bracket::sample_points`] of [`MANY`], frame by frame: levels that are not rounded. Without
    /// it, or if it is not complete, the rounded ones stand.
    #[must_use]
    pub fn with_fine_levels(mut self, fine: Vec<Vec<[f32; 3]>>) -> Self {
        let points = self.sample_points(MANY).len();
        let complete = fine.len() == self.exposures.len() && fine.iter().all(|frame| frame.len() == points);
        self.fine = complete.then_some(fine);
        self
    }

    /// Unrounded levels of the sample points, frame by frame, where they are known.
    pub fn fine_levels(&self) -> Option<&[Vec<[f32; 3]>]> {
        self.fine.as_deref()
    }

    /// The times of the frames, seconds, shortest first.
    pub fn times_s(&self) -> Vec<f64> {
        self.exposures.iter().map(|frame| frame.time_s).collect()
    }

    /// Green level of the darkest thousandth of the longest exposure's pixels: in a dark enclosure it is black.
    pub fn darkest_green(&self) -> u8 {
        self.exposures.last().map_or(0, contradictions::darkest_green)
    }

    /// Refuses frames that are black or clipped all over, every one: nothing can be measured on them.
    pub fn check_exposed(&self) -> Result<(), BracketError> {
        contradictions::check_exposed(&self.exposures)
    }

    /// Compares every exposure with the next clearly longer one, without any response: where the shorter frame's green is well
    /// exposed, the longer one must be brighter. Returns what each pair said; refuses the bracket, naming the frames, when images
    /// and times contradict each other and when one picture stands under two times. On sound brackets at most 1.8 % of the pixels
    /// fail to get brighter, on false ones 10 % and more.
    pub fn check_times(&self) -> Result<Vec<PairTest>, BracketError> {
        contradictions::check_different(&self.exposures)?;
        let longer = |(i, shorter): (usize, &Exposure)| {
            let clearly = |frame: &&Exposure| frame.time_s >= PairTest::MIN_RATIO * shorter.time_s;
            self.exposures[i + 1..].iter().find(clearly).map(|longer| PairTest::new(shorter, longer))
        };
        let all: Vec<PairTest> = self.exposures.iter().enumerate().filter_map(longer).collect();
        let pairs: Vec<PairTest> = all.iter().filter(|p| p.verdict == Verdict::Contradicts).cloned().collect();
        if pairs.is_empty() {
            return Ok(all);
        }
        Err(BracketError::Contradicts { pairs, remedy: contradictions::remedy(&self.exposures) })
    }
}

/// What a pair of exposures says about its times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The longer exposure is the brighter one.
    Sound,
    /// It is not.
    Contradicts,
    /// Too few usable pixels: proves nothing.
    NotTestable,
}

/// The comparison of an exposure with a longer one.
#[derive(Clone, Debug, PartialEq)]
pub struct PairTest {
    /// Name and time (s) of the shorter exposure.
    pub shorter: (String, f64),
    /// Name and time (s) of the longer exposure.
    pub longer: (String, f64),
    /// Pixels whose green level is above 20 and below 200 in the shorter exposure.
    pub pixels: usize,
    /// Share of these that do not get brighter in the longer exposure, 0 to 1.
    pub not_brighter: f64,
    /// The conclusion.
    pub verdict: Verdict,
}

impl PairTest {
    /// Fewer pixels than this prove nothing.
    const MIN_PIXELS: usize = 300;
    /// A smaller ratio of times changes dark levels by too little to be told from noise.
    const MIN_RATIO: f64 = 1.5;
    /// Between the 1.8 % of the worst sound pair and the 10 % of the best false pair measured on public brackets.
    const MAX_NOT_BRIGHTER: f64 = 0.05;

    fn new(shorter: &Exposure, longer: &Exposure) -> Self {
        const GREEN: usize = 1;
        let (mut pixels, mut not_brighter) = (0_usize, 0_usize);
        for (short, long) in shorter.levels.pixels.iter().zip(&longer.levels.pixels) {
            if short[GREEN] > 20 && short[GREEN] < 200 {
                pixels += 1;
                not_brighter += usize::from(long[GREEN] <= short[GREEN]);
            }
        }
        let share = not_brighter as f64 / pixels.max(1) as f64;
        let verdict = if pixels < Self::MIN_PIXELS {
            Verdict::NotTestable
        } else if share > Self::MAX_NOT_BRIGHTER {
            Verdict::Contradicts
        } else {
            Verdict::Sound
        };
        Self {
            shorter: (shorter.name.clone(), shorter.time_s),
            longer: (longer.name.clone(), longer.time_s),
            pixels,
            not_brighter: share,
            verdict,
        }
    }
}

impl std::fmt::Display for PairTest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ((short, short_s), (long, long_s)) = (&self.shorter, &self.longer);
        write!(
            f,
            "from {short} ({} s) to {long} ({} s), listed as {:+.2} EV, {:.1} % of {} pixels do not get brighter",
            four_digits(*short_s),
            four_digits(*long_s),
            (long_s / short_s).log2(),
            100.0 * self.not_brighter,
            self.pixels
        )
    }
}

/// A time as people read it: shutter times are powers of the cube root of two.
fn four_digits(time_s: f64) -> f64 {
    format!("{time_s:.3e}").parse().unwrap_or(time_s)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn frame(name: &str, level: u8, time_s: f64) -> Exposure {
        Exposure { name: name.into(), levels: Image::filled(40, 40, [level; 3]), time_s }
    }

    #[test]
    fn a_longer_exposure_that_is_no_brighter_is_refused_by_name() {
        let bracket = Bracket::new(vec![frame("long", 90, 1.0), frame("short", 90, 0.5)], [1.0 / 12.0; 3]).unwrap();
        let message = bracket.check_times().unwrap_err().to_string();
        assert!(message.contains("from short (0.5 s) to long (1 s)") && message.contains("100.0 %"), "{message}");
    }

    #[test]
    fn steps_too_small_to_see_are_judged_by_the_next_longer_frame() {
        let frames = vec![frame("a", 90, 1.0), frame("b", 90, 1.26), frame("c", 130, 1.59)];
        let pairs = Bracket::new(frames, [0.0; 3]).unwrap().check_times().unwrap();
        let named: Vec<_> = pairs.iter().map(|p| (p.shorter.0.as_str(), p.longer.0.as_str(), p.verdict)).collect();
        assert_eq!(named, [("a", "c", Verdict::Sound)]);
    }

    #[test]
    fn black_frames_prove_nothing() {
        let bracket = Bracket::new(vec![frame("long", 2, 1.0), frame("short", 2, 0.5)], [1.0 / 12.0; 3]).unwrap();
        assert_eq!(bracket.check_times().unwrap()[0].verdict, Verdict::NotTestable);
    }

    #[test]
    fn times_and_sizes_are_checked() {
        for time_s in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let result = Bracket::new(vec![frame("a", 1, time_s)], [0.0; 3]);
            assert!(matches!(result, Err(BracketError::BadTime { .. })), "{time_s}");
        }
        let small = Exposure { name: "b".into(), levels: Image::filled(2, 2, [0; 3]), time_s: 2.0 };
        assert!(matches!(
            Bracket::new(vec![frame("a", 1, 1.0), small], [0.0; 3]),
            Err(BracketError::SizeDiffers { .. })
        ));
        assert!(matches!(Bracket::new(Vec::new(), [0.0; 3]), Err(BracketError::TooFewFrames { .. })));
    }
}
