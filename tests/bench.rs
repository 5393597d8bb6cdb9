//! The table of speed on small scenes: every part of it is there, and reads back. Times are not judged.
#![allow(clippy::unwrap_used)]

use rigd::study::bench::{self, COLUMNS, Entry, Plan, SECTIONS, Section};
use std::path::Path;
use std::process::Command;

/// A growth that no machine has the memory for.
const TOO_LARGE: usize = 100_000_000_000_000;

fn small() -> Plan {
    Plan { points: Some(200), repeats: 2, large_points: 2000, growth: vec![300, 9000, TOO_LARGE] }
}

/// The table as printed, and its entries.
fn measure(plan: &Plan) -> (Vec<String>, Vec<Entry>) {
    let mut lines = Vec::new();
    let entries = bench::run(plan, &mut |entry| {
        lines.push(bench::line(entry));
        Ok(())
    });
    (lines, entries.unwrap())
}

fn of(entries: &[Entry], section: Section) -> Vec<&Entry> {
    entries.iter().filter(|entry| entry.section == section).collect()
}

#[test]
fn the_table_has_every_part_and_reads_back() {
    let (lines, entries) = measure(&small());
    assert_eq!(lines.len(), entries.len());
    check_entries(&entries);
    for (line, entry) in lines.iter().zip(&entries).filter(|(_, entry)| entry.times.is_ok()) {
        let names = bench::heading(entry.section);
        let names = names.lines().last().unwrap();
        // A column of text begins below its name, one of numbers ends there.
        assert_eq!(line.find(entry.objective), names.find("objective"), "{line}");
        let end = |text: &str, of: &str| text.find(of).map(|at| at + of.len());
        assert_eq!(end(line, &format!(" {}", entry.points)), end(names, " points"), "{line}");
    }
    let directory = tempfile::tempdir().unwrap();
    bench::write(directory.path(), &entries).unwrap();
    check_csv(&directory.path().join("bench.csv"), &entries);
    assert!(image::open(directory.path().join("growth.png")).is_ok());
    assert!(std::fs::read_to_string(directory.path().join("growth.svg")).unwrap().contains("varpro"));
}

fn check_entries(entries: &[Entry]) {
    for section in SECTIONS {
        assert!(!of(entries, section).is_empty(), "nothing is {}", section.name());
    }
    let has = |section, work: &str, objective: &str| {
        of(entries, section).iter().any(|entry| entry.work.starts_with(work) && entry.objective == objective)
    };
    for solver in rigd::numerics::fit::solver::names() {
        assert!(has(Section::Given, solver, "noise-cauchy"), "{solver}");
    }
    for (solver, objective) in [("varpro", "noise"), ("subset", "noise"), ("zheng2008 (10 rounds)", "relative")] {
        assert!(has(Section::Given, solver, objective), "{solver} {objective}");
    }
    assert!(has(Section::Pass, "normal equations", "noise") && has(Section::Pass, "weights", "noise-cauchy"));
    assert_eq!(of(entries, Section::Given).iter().filter(|entry| entry.bar.is_some()).count(), 2);
    let large = of(entries, Section::Large);
    assert_eq!((large[0].points, large[0].samples), (2000, 14_000));
    for entry in entries {
        let too_large = entry.samples > TOO_LARGE / 2;
        assert_eq!(entry.times.is_err(), too_large, "{}", bench::line(entry));
        assert_eq!(bench::line(entry).contains("not measured: needs"), too_large);
        if let Ok(times) = entry.times {
            assert!(0.0 < times.best_s && times.best_s <= times.median_s);
            assert_eq!(times.repeats, 2);
        }
    }
}

/// Every row has every column, and the numbers are those of the entries.
fn check_csv(path: &Path, entries: &[Entry]) {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next().unwrap(), COLUMNS.join(","));
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), entries.len());
    let column = |name: &str| COLUMNS.iter().position(|known| *known == name).unwrap();
    for (row, entry) in rows.iter().zip(entries) {
        assert_eq!(row.len(), COLUMNS.len(), "{row:?}");
        assert_eq!(row[column("section")], entry.section.name());
        assert_eq!(row[column("samples")].parse(), Ok(entry.samples));
        let times = entry.times.as_ref().ok();
        assert_eq!(row[column("cpu_median_s")].parse().ok(), times.map(|times| times.median_s));
        assert_eq!(row[column("relight_error_pct")].parse().ok(), entry.relight.map(|error| 100.0 * error));
    }
}

#[test]
fn the_command_refuses_what_it_cannot_do_before_it_measures() {
    let run =
        |arguments: &[&str]| Command::new(env!("CARGO_BIN_EXE_rigd")).arg("bench").args(arguments).output().unwrap();
    assert_eq!(run(&["--repeats", "0"]).status.code(), Some(2));
    let nowhere = run(&["--out", "/dev/null/table"]);
    assert_eq!(nowhere.status.code(), Some(2));
    assert!(nowhere.stdout.is_empty());
    let message = String::from_utf8_lossy(&nowhere.stderr).into_owned();
    assert!(message.contains("/dev/null/table: no directory for the table"), "{message}");
}
