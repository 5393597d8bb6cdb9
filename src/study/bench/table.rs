//! The table for people, and as `bench.csv`.

use super::{Bar, Entry, Section, Times, chart};
use crate::numerics::simd::Level;
use crate::study::chart::ChartError;
use crate::study::csv::{self, number};
use std::path::Path;

/// Columns of `bench.csv`.
pub const COLUMNS: [&str; 15] = [
    "section",
    "scene",
    "work",
    "objective",
    "instruction_set",
    "points",
    "samples",
    "repeats",
    "cpu_best_s",
    "cpu_median_s",
    "ns_a_sample",
    "relight_error_pct",
    "times_scalar",
    "bar_s",
    "goal_s",
];

/// What stands above a section: what it is, then the names of its columns.
pub fn heading(section: Section) -> String {
    let title = match section {
        Section::Given => {
            "Size of the paper: materials given (2, Ward, coloured lobes), start and final weights included; one thread"
        }
        Section::Automatic => {
            "Size of the paper, everything automatic: number of materials, model, lobe, gains, standard errors; all cores"
        }
        Section::Large => "A large image, materials given: points of a marble scene over and over; one thread",
        Section::Growth => "Growth, materials given: points of a marble scene over and over; one thread",
        Section::Pass => "One pass of the inner loop, 2 materials; one thread",
    };
    let last = match section {
        Section::Given | Section::Automatic => "relight %",
        Section::Large | Section::Growth => "",
        Section::Pass => "x scalar",
    };
    let names = ["scene", "work", "objective", "points", "samples", "best", "median", "ns/sample", last, "bar"];
    format!("{title}\n{}", join(names.map(str::to_owned)))
}

/// A line of the table.
pub fn line(entry: &Entry) -> String {
    let digits = |value: Option<f64>, digits: usize| value.map_or(String::new(), |v| format!("{v:.digits$}"));
    let times = entry.times.as_ref().ok();
    let last = match entry.section {
        Section::Pass => digits(entry.speedup, 1),
        _ => digits(entry.relight.map(|error| 100.0 * error), 3),
    };
    let level = entry.level.map_or(String::new(), |level| format!(", {}", level_name(level)));
    join([
        entry.scene.to_owned(),
        format!("{}{level}", entry.work),
        entry.objective.to_owned(),
        entry.points.to_string(),
        entry.samples.to_string(),
        times.map_or(String::new(), |times| seconds(times.best_s)),
        times.map_or(String::new(), |times| seconds(times.median_s)),
        entry.ns_a_sample().map_or(String::new(), three_digits),
        last,
        match &entry.times {
            Ok(times) => entry.bar.map_or(String::new(), |bar| verdict(bar, times)),
            Err(shortage) => shortage.to_string(),
        },
    ])
}

fn join([scene, work, objective, points, samples, best, median, ns, last, bar]: [String; 10]) -> String {
    let line = format!(
        "  {scene:<26}{work:<27}{objective:<14}{points:>9}{samples:>11}{best:>10}{median:>10}{ns:>11}{last:>11}  {bar}"
    );
    line.trim_end().to_owned()
}

/// How the median compares with its bar.
pub(super) fn verdict(bar: Bar, times: &Times) -> String {
    let Bar { most_s, goal_s } = bar;
    if times.median_s <= goal_s {
        format!("reaches the goal of {}", seconds(goal_s))
    } else if times.median_s <= most_s {
        format!("holds {}, goal {}", seconds(most_s), seconds(goal_s))
    } else {
        format!("exceeds {}", seconds(most_s))
    }
}

/// A time to three digits with its unit.
pub(super) fn seconds(value: f64) -> String {
    let (value, unit) = if value < 0.1 { (1e3 * value, "ms") } else { (value, "s") };
    format!("{} {unit}", three_digits(value))
}

/// At least three digits, two decimals at most.
fn three_digits(value: f64) -> String {
    let decimals = match value {
        _ if value < 9.995 => 2,
        _ if value < 99.95 => 1,
        _ => 0,
    };
    format!("{value:.decimals$}")
}

fn level_name(level: Level) -> &'static str {
    match level {
        Level::Scalar => "scalar",
        Level::Avx2 => "AVX2",
        Level::Avx512 => "AVX-512",
    }
}

/// The entries as a table.
pub fn table(entries: &[Entry]) -> csv::Table {
    csv::Table { columns: &COLUMNS, rows: entries.iter().map(row).collect() }
}

/// Writes `bench.csv` and the chart of the growth (`growth.svg`, `growth.png`) into `directory`.
///
/// # Errors
/// A file cannot be written or the chart cannot be drawn.
pub fn write(directory: &Path, entries: &[Entry]) -> Result<(), ChartError> {
    let path = directory.join("bench.csv");
    table(entries).write(&path).map_err(|source| ChartError::Write { path: path.display().to_string(), source })?;
    chart::draw(entries)?.write(directory, "growth")
}

fn row(entry: &Entry) -> Vec<String> {
    let times = entry.times.as_ref().ok();
    vec![
        entry.section.name().to_owned(),
        entry.scene.to_owned(),
        entry.work.clone(),
        entry.objective.to_owned(),
        entry.level.map_or(String::new(), |level| level_name(level).to_owned()),
        entry.points.to_string(),
        entry.samples.to_string(),
        times.map_or(String::new(), |times| times.repeats.to_string()),
        number(times.map(|times| times.best_s)),
        number(times.map(|times| times.median_s)),
        number(entry.ns_a_sample()),
        number(entry.relight.map(|error| 100.0 * error)),
        number(entry.speedup),
        number(entry.bar.map(|bar| bar.most_s)),
        number(entry.bar.map(|bar| bar.goal_s)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_say_their_unit() {
        assert_eq!(seconds(0.000_412_4), "0.41 ms");
        assert_eq!(seconds(0.020_04), "20.0 ms");
        assert_eq!(seconds(0.5), "0.50 s");
        assert_eq!(seconds(1234.5), "1234 s");
    }

    #[test]
    fn the_median_is_held_against_the_bar() {
        let bar = Bar { most_s: 0.02, goal_s: 0.005 };
        let at = |median_s| verdict(bar, &Times { best_s: 0.001, median_s, repeats: 3 });
        assert_eq!(at(0.004), "reaches the goal of 5.00 ms");
        assert_eq!(at(0.02), "holds 20.0 ms, goal 5.00 ms");
        assert_eq!(at(0.021), "exceeds 20.0 ms");
    }
}
