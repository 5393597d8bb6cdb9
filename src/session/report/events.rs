//! Frames that were shot again and why, devices that had to be brought back.

use super::sources::Session;
use super::words::{moment, shorten};
use crate::document::{Block, Table};
use serde_json::Value;

pub fn section(session: &Session) -> Vec<Block> {
    let mut blocks = vec![Block::Section("Frames shot again, and why".into())];
    let refused = table(session, Table::new("Refused frames and brackets", ["When", "What", "Why"]), |kind| {
        ["frame.rejected", "bracket.rejected", "frame.lost"].contains(&kind)
    });
    blocks.push(refused.unwrap_or_else(|| Block::text("None: every frame served at once.")));
    let superseded = session.ledger.labelled().into_iter().filter(|(_, state)| *state == "superseded").count();
    if superseded > 0 {
        blocks.push(Block::text(format!(
            "{superseded} frames are kept on disk and do not count: later ones took their place."
        )));
    }
    blocks.push(Block::Section("Faults and recoveries".into()));
    let recovered = table(session, Table::new("Faults and recoveries", ["When", "What", "Why"]), |kind| {
        ["fault.raised", "fault.cleared", "camera.recovery", "bracket.resumed", "metering.failed"].contains(&kind)
    });
    blocks.push(recovered.unwrap_or_else(|| Block::text("None: no device failed.")));
    let states =
        table(session, Table::new("Course of the session", ["When", "What", "Why"]), |kind| kind == "session.state");
    blocks.extend(states);
    blocks
}

/// None where nothing of these kinds happened.
fn table(session: &Session, mut table: Table, wanted: impl Fn(&str) -> bool) -> Option<Block> {
    for record in &session.journal.records {
        let Some(kind) = record["type"].as_str().filter(|kind| wanted(kind)) else { continue };
        let why = record["reason"].as_str().unwrap_or_default().to_owned();
        table.row([moment(record["time"].as_str().unwrap_or_default()), what(kind, record), why]);
    }
    shorten(&mut table, "journal.jsonl");
    (!table.rows.is_empty()).then_some(Block::Table(table))
}

fn what(kind: &str, record: &Value) -> String {
    let text = |key: &str| match &record[key] {
        Value::Null => "not told".to_owned(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    let cell = || format!("station {}, exposure {}", text("station"), text("exposure"));
    match kind {
        "frame.rejected" => format!("{} ({} s), attempt {}", cell(), text("shutter"), text("attempt")),
        "bracket.rejected" => format!("bracket of station {}", text("station")),
        "frame.lost" => format!("{}: {} was no longer what was committed", cell(), text("file")),
        "fault.raised" => format!("{}: fault", text("device")),
        "fault.cleared" => format!("{}: well again", text("device")),
        "camera.recovery" => format!("camera: {}", text("rung")),
        "bracket.resumed" => format!("bracket of station {} went on", text("station")),
        "session.state" => text("state"),
        other => format!("{other}, station {}", text("station")),
    }
}
