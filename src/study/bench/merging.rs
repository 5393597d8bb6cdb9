//! What developing a bracket costs: decoding, merging, writing, memory.

use super::photographs::{TIMES_S, exposure, files};
use super::{Bar, BenchError, Times, repeated};
use crate::numerics::image::RadianceImage;
use crate::numerics::radiometry::bracket::Bracket;
use crate::numerics::radiometry::merge::{Estimator, Merger};
use crate::numerics::radiometry::noise::SensorNoise;
use crate::numerics::radiometry::response::{REFERENCE_LEVEL, Response};
use crate::pipeline::decode::{JPEG_DECODER, decode_into};
use crate::pipeline::develop::{BracketFrame, Crop, develop, read_bracket};
use crate::store::exr::{Place, write_radiance, write_strips};
use crate::study::clock::OneThread;
use std::path::Path;
use std::time::Instant;

/// Rows merged at a time: 1.7 MB of a full frame, which stay in the cache until they are written.
pub const STRIP_ROWS: usize = 16;
/// Light positions of the session whose memory is measured.
const STATIONS: usize = 7;
/// Side of the square around the object that a session keeps: a ball of 60 mm at 1.5 m under the paper's lens.
const OBJECT_PX: usize = 1000;

/// A line of the table.
#[derive(Clone, Debug)]
pub struct Cost {
    /// What was done.
    pub work: String,
    /// Time it took.
    pub times: Times,
    /// Unit of time: processor time of one thread, or the wall clock.
    pub wall: bool,
    /// What the median is held against.
    pub bar: Option<Bar>,
}

impl Cost {
    /// Its line of a table.
    pub fn line(&self) -> String {
        let clock = if self.wall { ", wall" } else { "" };
        let bar = self.bar.map_or(String::new(), |bar| super::table::verdict(bar, &self.times));
        let work = format!("{}{clock}", self.work);
        let line = format!(
            "  {work:<44}{:>10}{:>10}  {bar}",
            super::table::seconds(self.times.best_s),
            super::table::seconds(self.times.median_s)
        );
        line.trim_end().to_owned()
    }
}

/// What was measured.
pub enum Finding {
    /// A time.
    Time(Cost),
    /// Most memory of the process during a session, bytes.
    Memory {
        /// What was done.
        work: String,
        /// Highest resident size.
        peak_bytes: u64,
    },
}

/// Measures everything on frames of `size`; files go to `directory` and stay there.
///
/// # Errors
/// Frames cannot be made, written or read, or a clock is missing.
pub fn run(
    size: (usize, usize),
    repeats: usize,
    directory: &Path,
    told: &mut dyn FnMut(&Finding) -> std::io::Result<()>,
) -> Result<(), BenchError> {
    let made = files(size).map_err(|e| BenchError::Frames(e.to_string()))?;
    let mut list = String::new();
    for (i, (bytes, time_s)) in made.iter().zip(TIMES_S).enumerate() {
        std::fs::write(directory.join(name(i)), bytes)?;
        list += &format!("[[frame]]\nfile = \"{}\"\ntime_s = {time_s:?}\n\n", name(i));
    }
    std::fs::write(directory.join("exposures.toml"), list)?;
    drop(made);
    // First, while the process is small.
    if let Some(peak_bytes) = session_peak(size, directory)? {
        told(&Finding::Memory { work: format!("session of {STATIONS} x {} frames", TIMES_S.len()), peak_bytes })?;
    }
    let files = read(directory)?;
    let mut told = |work: &str, wall: bool, times: Times, bar: Option<Bar>| {
        told(&Finding::Time(Cost { work: work.to_owned(), times, wall, bar })).map_err(BenchError::from)
    };
    let thread = OneThread::new()?;
    let mut picture = crate::numerics::image::Image::filled(0, 0, [0; 3]);
    let decode = || {
        let (decoded, cpu_s) = thread.time(|| decode_into(&files[4], &mut picture))?;
        decoded.map_err(|e| BenchError::Frames(e.to_string()))?;
        Ok(((), cpu_s))
    };
    let ((), times) = repeated(repeats, decode)?;
    told(&format!("decode one JPEG, {JPEG_DECODER}"), false, times, None)?;
    let bracket = read_bracket(&frames(&files), None).map_err(frames_error)?;
    let response = response();
    for estimator in Estimator::ALL {
        let bar = (estimator == Estimator::default()).then_some(Bar { most_s: 0.15, goal_s: 0.09 });
        let ((), times) = repeated(repeats, || {
            let (_, cpu_s) = thread.time(|| in_strips(&bracket, &response, estimator))?;
            Ok(((), cpu_s))
        })?;
        told(&format!("merge {} frames, {}", TIMES_S.len(), estimator.name()), false, times, bar)?;
    }
    drop(bracket);
    let out = directory.join("radiance.exr");
    let ((), times) = repeated(repeats, || {
        let begin = Instant::now();
        whole(&files, size, &response, &out)?;
        Ok(((), begin.elapsed().as_secs_f64()))
    })?;
    let bar = Bar { most_s: 1.2, goal_s: 1.2 };
    told("bracket, JPEG bytes to EXR on disk", true, times, Some(bar))
}

fn name(frame: usize) -> String {
    format!("{frame:02}.jpg")
}

fn read(directory: &Path) -> std::io::Result<Vec<Vec<u8>>> {
    (0..TIMES_S.len()).map(|frame| std::fs::read(directory.join(name(frame)))).collect()
}

fn frames(files: &[Vec<u8>]) -> Vec<BracketFrame<'_>> {
    let frame = |(bytes, time_s)| BracketFrame { name: "simulated", bytes, time_s };
    files.iter().map(Vec::as_slice).zip(TIMES_S).map(frame).collect()
}

fn frames_error(error: impl ToString) -> BenchError {
    BenchError::Frames(error.to_string())
}

const NOISE: SensorNoise = SensorNoise { full_well_e: 80_000.0, read_noise_e: 30.0 };

/// The curve the frames were made with.
fn response() -> Response {
    let log = |z: u32| (exposure(f64::from(z).max(0.25)) / exposure(REFERENCE_LEVEL as f64)).ln();
    let curve: Vec<f64> = (0..256).map(log).collect();
    Response { log_exposure: [curve.clone(), curve.clone(), curve] }
}

/// Merges all rows, keeping none; a sum so that none is left out by the compiler.
fn in_strips(bracket: &Bracket, response: &Response, estimator: Estimator) -> f32 {
    let merger = Merger::new(bracket, response, &NOISE, estimator);
    let mut strip = merger.empty(STRIP_ROWS);
    let mut sum = 0.0;
    for row in (0..bracket.height()).step_by(STRIP_ROWS) {
        merger.strip(row, &mut strip);
        sum += strip.radiance.pixels[0][0];
    }
    std::hint::black_box(sum)
}

/// Files to EXR, the response known.
fn whole(files: &[Vec<u8>], size: (usize, usize), response: &Response, out: &Path) -> Result<(), BenchError> {
    let bracket = read_bracket(&frames(files), None).map_err(frames_error)?;
    let merger = Merger::new(&bracket, response, &NOISE, Estimator::default());
    let mut strip: RadianceImage = merger.empty(STRIP_ROWS);
    let place = Place { origin: (0, 0), full: size, size };
    write_strips(out, place, &[], &mut strip, |row, strip| merger.strip(row, strip)).map_err(frames_error)
}

/// Most memory of the process while it develops a session as the worker does: response from the first bracket, every bracket
/// cropped to the object. None where the system does not say.
fn session_peak(size: (usize, usize), directory: &Path) -> Result<Option<u64>, BenchError> {
    // Sets the mark of the highest resident size back; what cannot be set back is still an upper bound.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
    let (width, height) = (OBJECT_PX.min(size.0), OBJECT_PX.min(size.1));
    let crop = Crop { x: (size.0 - width) / 2, y: (size.1 - height) / 2, width, height };
    let mut known = None;
    for _ in 0..STATIONS {
        let files = read(directory)?;
        let developed = develop(&frames(&files), Some(crop), known.as_ref(), &NOISE).map_err(frames_error)?;
        let out = directory.join("station.exr");
        write_radiance(&out, &developed.image, (crop.x, crop.y), size, &[]).map_err(frames_error)?;
        known = Some(developed.known);
    }
    let status = std::fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok());
    Ok(kib.map(|kib| 1024 * kib))
}

/// What stands above the table.
pub fn heading((width, height): (usize, usize)) -> String {
    format!(
        "{} JPEG frames of {width} x {height}; processor time of one thread, or wall time of all\n  {:<44}{:>10}{:>10}  bar",
        TIMES_S.len(),
        "work",
        "best",
        "median"
    )
}

/// A line of the table.
pub fn line(finding: &Finding) -> String {
    match finding {
        Finding::Time(cost) => cost.line(),
        Finding::Memory { work, peak_bytes } => {
            let held = if *peak_bytes <= 400_000_000 { "holds 400 MB" } else { "exceeds 400 MB" };
            format!("  {:<44}{:>20}  {held}", format!("{work}, peak memory"), format!("{} MB", peak_bytes / 1_000_000))
        }
    }
}
