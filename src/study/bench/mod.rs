//! The table of speed: what fits cost in processor time, from one pass of the inner loop to a hundred million samples.

mod chart;
mod fits;
mod growth;
mod memory;
pub mod merging;
mod passes;
pub mod photographs;
pub mod rendering;
mod table;

use super::clock::ClockError;
use super::median;
use crate::numerics::fit::objective::Objective;
use crate::numerics::fit::solver::Refusal;
use crate::numerics::simd::Level;
use crate::pipeline::fit::FitError;
pub use memory::Shortage;
pub use table::{COLUMNS, heading, line, table, write};

/// How much is measured.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Points of the scenes; none takes their full size, that of the paper.
    pub points: Option<usize>,
    /// How often each thing is measured; sizes above [`ONCE_ABOVE`] samples of the growth once.
    pub repeats: usize,
    /// Points of the large image.
    pub large_points: usize,
    /// Sizes of the growth, samples.
    pub growth: Vec<usize>,
}

/// The growth measures sizes above this many samples once.
pub const ONCE_ABOVE: usize = 1_000_000;

impl Plan {
    /// Sizes up to a million samples: half a minute on one thread.
    pub fn short(repeats: usize) -> Self {
        let growth = vec![10_000, 100_000, 1_000_000];
        Self { points: None, repeats, large_points: 4_000_000, growth }
    }

    /// Sizes up to a hundred million samples: minutes, and some 12 GB of memory.
    pub fn long(repeats: usize) -> Self {
        let short = Self::short(repeats);
        Self { growth: [short.growth, vec![10_000_000, 100_000_000]].concat(), ..short }
    }
}

/// A part of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Section {
    /// Fits of the size of the paper, the materials given.
    Given,
    /// Fits of the size of the paper, everything left to the data.
    Automatic,
    /// A fit of an image of millions of pixels.
    Large,
    /// Fits of growing size.
    Growth,
    /// Single passes of the inner loop.
    Pass,
}

/// Every section, in the order of the table.
pub const SECTIONS: [Section; 5] = [Section::Given, Section::Automatic, Section::Large, Section::Growth, Section::Pass];

impl Section {
    /// Name in `bench.csv`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Given => "given",
            Self::Automatic => "automatic",
            Self::Large => "large",
            Self::Growth => "growth",
            Self::Pass => "pass",
        }
    }
}

/// Processor times an entry is held against, seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bar {
    /// The median must not exceed it.
    pub most_s: f64,
    /// What is aimed at.
    pub goal_s: f64,
}

/// Processor time of repeated runs, seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Times {
    /// The shortest.
    pub best_s: f64,
    /// The median.
    pub median_s: f64,
    /// How many runs.
    pub repeats: usize,
}

/// A line of the table.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Where it belongs.
    pub section: Section,
    /// The scene.
    pub scene: &'static str,
    /// Solver or pass.
    pub work: String,
    /// What was minimised.
    pub objective: &'static str,
    /// Instruction set, where it was prescribed; otherwise the widest one there is.
    pub level: Option<Level>,
    /// Points.
    pub points: usize,
    /// Samples.
    pub samples: usize,
    /// What it cost, or why it was not tried.
    pub times: Result<Times, Shortage>,
    /// Relative error under lights the fit never saw, where the scene says it.
    pub relight: Option<f64>,
    /// How many times faster than the same one lane at a time.
    pub speedup: Option<f64>,
    /// What the median is held against.
    pub bar: Option<Bar>,
}

impl Entry {
    /// What `work` on so many points and samples of a scene cost.
    fn new(
        (section, scene): (Section, &'static str),
        (work, objective): (String, Objective),
        [points, samples]: [usize; 2],
        times: Result<Times, Shortage>,
    ) -> Self {
        let objective = objective.name();
        let (level, relight, speedup, bar) = (None, None, None, None);
        Self { section, scene, work, objective, level, points, samples, times, relight, speedup, bar }
    }

    /// Median processor time of a sample, ns.
    pub fn ns_a_sample(&self) -> Option<f64> {
        self.times.as_ref().ok().map(|times| 1e9 * times.median_s / self.samples as f64)
    }
}

/// Why nothing could be measured.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// No thread, or no clock.
    #[error(transparent)]
    Clock(#[from] ClockError),
    /// A solver refuses a scene.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The automatic fit failed.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The free memory is not known.
    #[error("/proc/meminfo does not say how much memory is available{0}: large sizes cannot be measured safely")]
    Memory(String),
    /// Frames cannot be made, read or merged.
    #[error("the frames cannot be developed: {0}")]
    Frames(String),
    /// The scene to be rendered is refused.
    #[error("the scene cannot be rendered: {0}")]
    Scene(String),
    /// Nobody reads the table any more, or files cannot be written.
    #[error("table or files cannot be written: {0}")]
    Print(#[from] std::io::Error),
}

/// Who hears of every entry as soon as it is measured.
pub type OnEntry<'a> = &'a mut dyn FnMut(&Entry) -> std::io::Result<()>;

/// Measures everything.
///
/// # Errors
/// A thread or clock is missing, a solver refuses a scene, or `told` fails.
pub fn run(plan: &Plan, told: OnEntry<'_>) -> Result<Vec<Entry>, BenchError> {
    let mut entries = Vec::new();
    let mut add = |entry: Entry| {
        told(&entry)?;
        entries.push(entry);
        Ok(())
    };
    fits::given(plan, &mut add)?;
    fits::automatic(plan, &mut add)?;
    growth::large(plan, &mut add)?;
    growth::growth(plan, &mut add)?;
    passes::passes(plan, &mut add)?;
    Ok(entries)
}

/// Takes an entry.
type Add<'a> = &'a mut dyn FnMut(Entry) -> Result<(), BenchError>;

/// Best and median of the seconds that `once` says, and what it gave last.
fn repeated<T>(
    repeats: usize,
    mut once: impl FnMut() -> Result<(T, f64), BenchError>,
) -> Result<(T, Times), BenchError> {
    let (mut made, first_s) = once()?;
    let mut all_s = vec![first_s];
    while all_s.len() < repeats {
        let cpu_s;
        (made, cpu_s) = once()?;
        all_s.push(cpu_s);
    }
    let best_s = all_s.iter().copied().fold(f64::INFINITY, f64::min);
    let repeats = all_s.len();
    Ok((made, Times { best_s, median_s: median(all_s), repeats }))
}
