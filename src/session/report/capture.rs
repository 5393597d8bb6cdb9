//! What was captured, and with what.

use super::sources::Session;
use super::words::{count, duration, moment, three};
use crate::document::{Block, Table};
use rig_config::{ArmDriver, CameraDriver, Rig};

pub fn section(session: &Session) -> Vec<Block> {
    let mut blocks = vec![Block::Section("What was captured".into()), Block::Table(what(session))];
    blocks.push(Block::Table(stations(session)));
    blocks.push(Block::Section("With what".into()));
    blocks.push(Block::Table(with_what(session)));
    blocks
}

/// A table of two columns.
fn facts(caption: &str, rows: Vec<(&str, String)>) -> Table {
    let mut table = Table::new(caption, ["What", "Value"]);
    rows.into_iter().for_each(|(what, value)| table.row([what.to_owned(), value]));
    table
}

fn what(session: &Session) -> Table {
    let (snapshot, plan) = (&session.ledger.snapshot, &session.plan);
    let exposures: Vec<&str> = plan.exposures.iter().map(|exposure| exposure.label.as_str()).collect();
    facts(
        "The session",
        vec![
            ("Sample", session.manifest.name.clone()),
            ("Session", session.manifest.id.clone()),
            ("Started", moment(&session.manifest.started)),
            ("Ended", snapshot.ended.as_deref().map_or_else(|| "not yet".to_owned(), moment)),
            ("State", snapshot.state.to_string()),
            ("Frames that count", format!("{} of {} planned", snapshot.frames_committed, snapshot.frames_planned)),
            (
                "Light stations",
                format!("{}, of which {} developed to radiance", snapshot.stations, snapshot.stations_developed),
            ),
            ("Exposures a station, s", exposures.join(", ")),
            (
                "Left out by an adaptive plan",
                snapshot.saved.as_ref().map_or_else(|| "nothing: the plan is not adaptive".into(), ToString::to_string),
            ),
            ("Interruptions", snapshot.interruptions.to_string()),
        ],
    )
}

fn stations(session: &Session) -> Table {
    let mut table = Table::new(
        "Light stations, in the order in which they were shot",
        ["Station", "Arm angle, degrees", "Light position, mm", "Frames"],
    );
    for (index, station) in session.plan.stations.iter().enumerate() {
        let frames = session.ledger.frames().filter(|frame| frame.station == index).count();
        let developed = if session.ledger.is_developed(index) { "" } else { ", not developed" };
        table.row([
            index.to_string(),
            format!("{:.2}", station.angle_deg),
            three(station.light_position_mm, 1),
            format!("{frames}{developed}"),
        ]);
    }
    super::words::shorten(&mut table, "manifest.json");
    table
}

fn with_what(session: &Session) -> Table {
    let manifest = &session.manifest;
    let unanswered = || "it has not answered".to_owned();
    let mut rows = vec![
        ("Program", manifest.software.clone()),
        ("Arm (firmware)", manifest.arm.clone().unwrap_or_else(unanswered)),
        ("Camera", manifest.camera.clone().unwrap_or_else(unanswered)),
        ("Body's serial number, by its frames", by_frames(session, |optics| optics.body_serial.clone())),
        ("Lens, focal length by its frames", by_frames(session, |optics| optics.focal_mm.map(|mm| format!("{mm} mm")))),
    ];
    match &session.rig {
        Ok(rig) => rows.extend(of_rig(rig)),
        Err(reason) => rows.push(("Rig file", format!("this version cannot read it: {reason}"))),
    }
    facts("The rig", rows)
}

fn by_frames(session: &Session, said: impl Fn(&crate::session::quality::Optics) -> Option<String>) -> String {
    match &session.optics {
        None => "not known: the first frame is not there, or is not what was committed".into(),
        Some(optics) => said(optics).unwrap_or_else(|| "the frames do not say".into()),
    }
}

fn of_rig(rig: &Rig) -> Vec<(&'static str, String)> {
    let arm = match &rig.arm.driver {
        ArmDriver::Rigproto { .. } => "rigproto",
        ArmDriver::Grbl { .. } => "grbl",
        ArmDriver::Simulated => "simulated",
    };
    let camera = match &rig.camera.driver {
        CameraDriver::Gphoto2 { .. } => "gphoto2",
        CameraDriver::Replay { .. } => "replay",
        CameraDriver::Simulated => "simulated",
    };
    let (lamp, lens) = (&rig.lamp, &rig.camera);
    let steady = if lamp.steady_s > 0.0 {
        format!(", then watched over {} until steady", duration(lamp.steady_s))
    } else {
        String::new()
    };
    vec![
        ("Rig file", rig.name.clone()),
        ("Drivers of arm and camera", format!("{arm}, {camera}")),
        ("Frame", format!("{} x {} pixels", lens.width, lens.height)),
        ("Aperture, ISO", format!("f/{}, ISO {}", lens.f_number, lens.iso)),
        ("Focal length of the rig file", format!("{:.1}, {:.1} px", lens.focal_px[0], lens.focal_px[1])),
        ("Lamp", format!("{} permille, {} of warm-up{steady}", lamp.level_permille, duration(lamp.soak_s))),
        ("Wait after a move", duration(rig.arm.settle_s)),
        ("Object", format!("sphere of {} mm radius", rig.object.radius_mm)),
        ("Reference patch", if rig.reference_patch.is_some() { "yes".into() } else { "none".into() }),
        (
            "Plan of the rig file",
            format!(
                "{}, {}",
                count(rig.plan.stations_deg.len(), "station"),
                count(rig.plan.exposures.len(), "exposure")
            ),
        ),
    ]
}
