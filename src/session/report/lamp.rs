//! What the lamp did over the night.

use super::sources::Session;
use super::words::{CHANNEL_SERIES, CHANNELS, between, percent, shorten};
use crate::document::plot::{Axis, Plot, Series, Style};
use crate::document::{Block, Table};
use serde_json::Value;

pub fn section(session: &Session) -> Vec<Block> {
    let mut blocks = vec![Block::Section("The lamp".into()), Block::text(warm_up(session)), Block::text(room(session))];
    match &session.ledger.snapshot.lamp_drift {
        Some(drift) => {
            let text = format!(
                "By the reference patch, read at {} stations, the lamp changed by {} at most since the first, and by {} at most from one to the next. \
                 The intensities in dataset.toml follow it.",
                drift.stations,
                percent(drift.change),
                percent(drift.step)
            );
            blocks.extend([Block::text(text), drift_chart(session)]);
        }
        None => blocks.push(Block::text(untold(session))),
    }
    let mut table =
        Table::new("Changes of the lamp within a bracket", ["Station", "Seen by", "Change", "Standard error"]);
    for record in of_type(session, "lamp.drifted") {
        let part = |key: &str| record[key].as_f64().map_or_else(|| "not told".to_owned(), percent);
        table.row([
            record["station"].to_string(),
            record["by"].as_str().unwrap_or("object").to_owned(),
            part("change"),
            part("sigma"),
        ]);
    }
    if table.rows.is_empty() {
        blocks.push(Block::text("Within no bracket was a change of the lamp seen (0.6 % and more would be)."));
    } else {
        shorten(&mut table, "journal.jsonl");
        blocks.push(Block::Table(table));
    }
    blocks
}

fn of_type<'a>(session: &'a Session, kind: &'a str) -> impl DoubleEndedIterator<Item = &'a Value> {
    session.journal.records.iter().filter(move |record| record["type"] == kind)
}

fn warm_up(session: &Session) -> String {
    let tests = of_type(session, "lamp.tested").count();
    match of_type(session, "lamp.steady").next_back() {
        Some(record) => format!(
            "Before shooting, the lamp was looked at until it was steady: {} test frames, the last three within {}.",
            record["frames"],
            record["spread"].as_f64().map_or_else(|| "an unknown part".to_owned(), percent)
        ),
        None if tests > 0 => format!("Before shooting, {tests} test frames did not show a steady lamp; see the warnings."),
        None => "Nobody looked whether the lamp was steady before shooting (lamp.steady_s of the rig file, or a version that did not look).".into(),
    }
}

fn room(session: &Session) -> String {
    let unknown = || "unknown".to_owned();
    match (of_type(session, "ambient.measured").next_back(), of_type(session, "ambient.failed").next_back()) {
        (Some(record), _) => format!(
            "With the lamp off, the longest exposure showed level {}: {} of the light of a dimly exposed pixel (2 % and more is warned of).",
            record["level"].as_f64().map_or_else(unknown, |level| format!("{level:.1}")),
            record["share"].as_f64().map_or_else(unknown, percent)
        ),
        (None, Some(record)) => format!(
            "The dark room could not be looked at: {}.",
            record["reason"].as_str().unwrap_or("the journal does not say why")
        ),
        (None, None) => "Nobody looked whether the room was dark.".into(),
    }
}

fn untold(session: &Session) -> String {
    match &session.rig {
        Ok(rig) if rig.reference_patch.is_none() => "The rig has no reference patch, so nothing tells how the lamp changed from station to station: it is \
             taken to be steady. What to do for better: fix a grey patch beside the object ([reference_patch] of the rig file)."
            .into(),
        _ => session.ledger.warnings().into_iter().find(|warning| warning.starts_with("the reference patch")).unwrap_or_else(|| {
            "No station told how bright the lamp was, by the reference patch: it is taken to be steady.".into()
        }),
    }
}

/// Brightness against the time since the first frame.
fn drift_chart(session: &Session) -> Block {
    let ledger = &session.ledger;
    let brightness = ledger.brightness(ledger.stations());
    let begin = of_type(session, "frame.committed").next().and_then(|record| record["time"].as_str());
    // Of a station that was shot again, its last first frame.
    let hours = |station: usize| {
        let file = &ledger.frames().find(|frame| frame.station == station)?.file;
        let record = of_type(session, "frame.committed").find(|record| record["file"] == file.as_str())?;
        Some(between(begin?, record["time"].as_str()?)? / 3600.0)
    };
    let at: Vec<Option<f64>> = (0..brightness.len()).map(hours).collect();
    let series = (0..3).map(|c| {
        let point = |(station, now): (usize, &[f64; 3])| Some([at[station]?, now[c], 0.0]);
        let mut points: Vec<[f64; 3]> = brightness.iter().enumerate().filter_map(point).collect();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        Series { name: Some(CHANNELS[c].into()), colour: CHANNEL_SERIES[c], style: Style::Line, points }
    });
    Block::Drawing(
        Plot {
            caption: "Brightness of the lamp at every station, relative to the first. Flat is good; a slow slope is taken into account.".into(),
            alternative: "Brightness of the lamp against time, one line a channel".into(),
            x: Axis::linear("hours since the first frame", &[]),
            y: Axis::linear("brightness", &[1.0]),
            series: series.collect(),
        }
        .drawn(),
    )
}
