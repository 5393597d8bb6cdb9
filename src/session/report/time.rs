//! Where the time went: by stage, and station by station.

use super::sources::Session;
use super::words::{between, duration, or, percent};
use crate::document::plot::{Axis, Plot, Series, Style};
use crate::document::{Block, Table};
use std::collections::BTreeMap;

pub fn section(session: &Session) -> Vec<Block> {
    let mut blocks = vec![Block::Section("Where the time went".into())];
    blocks.push(by_stage(session));
    let stations = by_station(session);
    if stations.is_empty() {
        blocks.push(Block::text("No station was shot, so there is no time to show for one."));
        return blocks;
    }
    let last = stations.keys().next_back().copied().unwrap_or_default();
    let points = stations.iter().map(|(station, seconds)| [*station as f64, *seconds, 0.0]).collect();
    blocks.push(Block::Drawing(
        Plot {
            caption: "Time from the arm's arrival at a station to the last frame of its bracket, all brackets that were shot there together. One that stands \
                      out was shot again, or waited."
                .into(),
            alternative: "Seconds at each station, one bar a station".into(),
            x: Axis::named("station", (0..=last).map(|i| i.to_string()).collect()),
            y: Axis::linear("seconds", &[0.0]),
            series: vec![Series { name: None, colour: 0, style: Style::Bars, points }],
        }
        .drawn(),
    ));
    if session.manifest.simulated {
        blocks.push(Block::text(
            "A simulated rig may run faster than a real one: these are seconds of the clock on the wall.",
        ));
    }
    blocks
}

fn by_stage(session: &Session) -> Block {
    let Some(budget) = &session.ledger.snapshot.time_budget else {
        return Block::text("The journal has no time budget: it has one after the first whole station.");
    };
    let total = budget.total_s();
    let mut table = Table::new("Seconds of the clock on the wall", ["Spent on", "Time", "Part"]);
    for (stage, seconds) in [
        ("preparation: devices, homing, warm-up", budget.preparation_s),
        ("moving the arm", budget.motion_s),
        ("waiting until it stands still", budget.settling_s),
        ("shutter open", budget.shutter_s),
        ("files from the camera", budget.transfer_s),
        ("camera: setting, releasing, getting ready", budget.camera_s),
        ("checking, writing, journalling", budget.storing_s),
        ("recovery: refused shots, devices brought back", budget.recovery_s),
        ("held up: paused, waiting for room", budget.held_s),
        ("all else", budget.other_s),
        ("all of it", total),
    ] {
        let part = or((total > 0.0).then(|| percent(seconds / total)), "");
        table.row([stage.to_owned(), duration(seconds), part]);
    }
    let overhead = or(budget.overhead.map(percent), "not known");
    table.caption += &format!("; overhead over what a perfect rig would need as well: {overhead}");
    Block::Table(table)
}

/// Seconds at every station that was shot.
fn by_station(session: &Session) -> BTreeMap<usize, f64> {
    let mut spent = BTreeMap::new();
    // The station where the arm stands, and since when.
    let mut here: Option<(usize, &str)> = None;
    let mut last: Option<(usize, f64)> = None;
    for record in &session.journal.records {
        let station = record["station"]
            .as_u64()
            .and_then(|s| usize::try_from(s).ok())
            .filter(|s| *s < session.plan.stations.len());
        let Some(time) = record["time"].as_str() else { continue };
        match (record["type"].as_str(), station, here) {
            (Some("arm.moved"), Some(station), _) => {
                settle(&mut spent, last.take());
                here = Some((station, time));
            }
            (Some("frame.committed"), Some(station), Some((at, since))) if station == at => {
                last = between(since, time).map(|seconds| (station, seconds));
            }
            _ => {}
        }
    }
    settle(&mut spent, last);
    spent
}

/// A clock that was set back tells nothing.
fn settle(spent: &mut BTreeMap<usize, f64>, visit: Option<(usize, f64)>) {
    if let Some((station, seconds)) = visit.filter(|(_, seconds)| *seconds >= 0.0) {
        *spent.entry(station).or_insert(0.0) += seconds;
    }
}
