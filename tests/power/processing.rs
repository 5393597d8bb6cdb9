//! A pipeline whose pieces of work are small and known beforehand; they go to disk as those of the real one do.

use super::turns::Turns;
use rigd::numerics::radiometry::metering::Worth;
use rigd::pipeline::fit::OnProgress;
use rigd::session::adaptive::Weighed;
use rigd::session::processing::{Bracket, FitJob, Judged, Next, OpenBracket, Processing, StepJob};
use rigd::store::keep;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

pub const DATASET: &str = "# what a dataset.toml would be\nformat = 1\n";
/// The files of a result.
pub const RESULT: [&str; 2] = ["material.json", "report.json"];

/// Radiance of a bracket: its frames' hashes, in order.
pub fn radiance<'a>(hashes: impl Iterator<Item = &'a str>) -> String {
    hashes.map(|hash| format!("radiance of {hash}\n")).collect()
}

/// A file of the result of fit number `fit`.
pub fn result(name: &str, fit: u64) -> String {
    format!("{{\"file\":\"{name}\",\"iterations\":{fit}}}")
}

pub struct Keeping {
    pub turns: Arc<Turns>,
    /// Fits so far, over all lives.
    pub fits: Arc<AtomicU64>,
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    fs::write(path, text).map_err(|e| e.to_string())
}

fn expect(path: &Path, text: &str) -> Result<(), String> {
    let found = fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    if found == text { Ok(()) } else { Err(format!("{} is torn: {found:?}", path.display())) }
}

impl Processing for Keeping {
    fn least_exposures(&self) -> usize {
        1
    }

    fn develop(&mut self, bracket: &Bracket) -> Result<Value, String> {
        self.turns.worker();
        let path = bracket.directory.join(format!("radiance/{:02}.exr", bracket.station));
        let text = radiance(bracket.frames.iter().map(|frame| frame.blake3.as_str()));
        // The engine must not wait for a station that will not be developed.
        keep::file(bracket.disk.as_ref(), &path, |path| write(path, &text)).inspect_err(|_| self.turns.end())?;
        Ok(Value::Null)
    }

    /// Stations of odd numbers need the last exposure alone, the others all.
    fn meter(&mut self, bracket: &OpenBracket) -> Result<Next, String> {
        let last = bracket.exposures.len() - 1;
        let needed = if bracket.number % 2 == 1 { last..=last } else { 0..=last };
        let next = needed.into_iter().nth(bracket.frames.len());
        Ok(next.map_or(Next::Enough(Worth::default()), Next::Shoot))
    }

    fn weigh(&mut self, _: &FitJob, _: OnProgress<'_>) -> Result<Weighed, String> {
        Err("lights are not judged here".into())
    }

    fn judge(&mut self, _: &StepJob) -> Result<Judged, String> {
        Err("no calibration here".into())
    }

    fn fit(&mut self, job: &FitJob, _: OnProgress<'_>) -> Result<Value, String> {
        let dataset = job.directory.join("dataset.toml");
        if !dataset.exists() {
            keep::file(job.disk.as_ref(), &dataset, |path| write(path, DATASET))?;
        }
        expect(&dataset, DATASET)?;
        let fit = self.fits.fetch_add(1, Ordering::SeqCst) + 1;
        keep::directory(job.disk.as_ref(), &job.directory.join("result"), |directory| {
            fs::create_dir(directory).map_err(|e| e.to_string())?;
            RESULT.into_iter().try_for_each(|name| write(&directory.join(name), &result(name, fit)))
        })?;
        Ok(json!({"mean_relative_error": 0.04, "iterations": fit, "termination": "converged"}))
    }
}
