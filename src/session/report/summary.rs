//! The first section: what a technician wants to know.

use super::sources::{Fitted, Session};
use super::words::{count, percent};
use super::{ReportError, preview};
use crate::document::Block;
use crate::pipeline::report::{Identified, MaterialFile};
use crate::session::state::SessionState;

/// What the paper reports for its two balls (Zheng, Ma, Zeng 2008, section 4): marble, wood.
pub const PAPERS_ERRORS: [(&str, f64); 2] = [("marble", 0.0589), ("wood", 0.0434)];

pub fn of_session(session: &Session) -> Result<Vec<Block>, ReportError> {
    let snapshot = &session.ledger.snapshot;
    let mut blocks = vec![Block::Section("In short".into())];
    if session.manifest.simulated {
        blocks.push(Block::Warning("arm or camera is simulated: nothing here was measured on a real object.".into()));
    }
    blocks.push(Block::text(how_it_ended(session)));
    if let Some(fitted) = &session.fitted {
        blocks.push(preview::block(fitted)?);
        blocks.push(Block::text(how_good(fitted)));
        blocks.push(Block::text(how_sure(&fitted.material)));
    } else {
        blocks.push(Block::text(no_result(session)));
    }
    blocks.push(Block::text(match snapshot.refused {
        0 => "No frame had to be shot again.".to_owned(),
        n => format!("{} refused and shot again; the reasons are below.", count(n, "frame or bracket")),
    }));
    let own = session.ledger.warnings();
    let fitted = session.fitted.iter().flat_map(|fitted| fitted.report.warnings.clone());
    let of_calibration =
        session.calibration.iter().flat_map(|c| c.warnings.iter().map(|w| format!("calibration: {w}")));
    blocks.extend(warnings(own.into_iter().chain(fitted).chain(of_calibration), session.manifest.simulated));
    Ok(blocks)
}

pub fn of_result(fitted: &Fitted) -> Result<Vec<Block>, ReportError> {
    let mut blocks = vec![Block::Section("In short".into())];
    let simulated = fitted.material.provenance.simulated == Some(true);
    if simulated {
        blocks.push(Block::Warning(
            "the frames are of a simulated rig: nothing here was measured on a real object.".into(),
        ));
    }
    blocks.extend([
        Block::text(
            "This result was fitted to a dataset by itself: it does not say how that was captured or calibrated.",
        ),
        preview::block(fitted)?,
        Block::text(how_good(fitted)),
        Block::text(how_sure(&fitted.material)),
    ]);
    blocks.extend(warnings(fitted.report.warnings.iter().cloned(), simulated));
    Ok(blocks)
}

fn how_it_ended(session: &Session) -> String {
    let snapshot = &session.ledger.snapshot;
    let frames = format!(
        "{} of {} frames of {}",
        snapshot.frames_committed,
        snapshot.frames_planned,
        count(snapshot.stations, "light station")
    );
    let reason = snapshot.reason.as_ref().map(|reason| format!(" Reason: {reason}.")).unwrap_or_default();
    let what = match snapshot.state {
        SessionState::Completed => "The session is completed".to_owned(),
        SessionState::Stopped => "The session was stopped by a user; whole stations were kept and fitted".to_owned(),
        SessionState::Aborted => "The session was aborted by a user, and nothing was fitted".to_owned(),
        SessionState::Failed | SessionState::Halted => "The session failed".to_owned(),
        SessionState::Interrupted => format!(
            "The session was interrupted. What to do: mend the reason, then `rigd session resume {}`; what was shot is kept",
            session.manifest.id
        ),
        state => {
            format!("The session was not over when this was made (state {state}, journal record {})", snapshot.last_seq)
        }
    };
    format!("{what}: {frames} are on disk.{reason}")
}

/// Why there is no material.
pub fn no_result(session: &Session) -> String {
    let failed = session.journal.records.iter().rev().find(|record| record["type"] == "fit.finished");
    match failed.and_then(|record| record["error"].as_str()) {
        Some(reason) => format!("No material was fitted: {reason}. What to do: mend the reason and fit again (POST .../fit, or `rigd fit`)."),
        None if session.ledger.snapshot.state.is_final() => {
            "No material was fitted. Whole stations can be fitted with POST .../fit, or `rigd fit` on the session's directory.".into()
        }
        None => "The material is not fitted yet.".into(),
    }
}

fn how_good(fitted: &Fitted) -> String {
    let report = &fitted.report;
    let [marble, wood] = PAPERS_ERRORS.map(|(_, error)| percent(error));
    let left_out = match report.left_out_relative_error {
        Some(error) => format!("Lights that the fit did not see are predicted to {}: this says how well it relights.", percent(error)),
        None => "No light was left out of this fit, so how well it relights is told by the choice among models only (below).".into(),
    };
    format!(
        "The fitted material explains the measurements to {} on average (mean relative error; the method's paper reports {marble} for \
         marble and {wood} for wood). {left_out}",
        percent(report.mean_relative_error)
    )
}

fn how_sure(material: &MaterialFile) -> String {
    let all = || material.materials.iter().flat_map(|m| m.rho_d.iter().chain(&m.rho_s).chain(&m.beta));
    let of = |flag| all().filter(|parameter| parameter.identified == flag).count();
    let (sound, weak, open) = (of(Identified::Identified), of(Identified::Weak), of(Identified::Unidentified));
    let materials = count(material.materials.len(), "material");
    if weak + open == 0 {
        return format!("{materials}; all {sound} parameters are determined by the data.");
    }
    let of_open = match open {
        0 => String::new(),
        n => format!(", {n} not at all: do not use those as measured"),
    };
    format!(
        "{materials}; of {} parameters {sound} are determined by the data and {weak} weakly{of_open}. The table of parameters has the reasons.",
        sound + weak + open
    )
}

/// Each once, whoever said it; that it is all `simulated` stands above already.
fn warnings(all: impl Iterator<Item = String>, simulated: bool) -> Vec<Block> {
    let mut told: Vec<String> = Vec::new();
    for warning in all {
        if !told.contains(&warning) {
            told.push(warning);
        }
    }
    let head = Block::Section("Warnings, and what to do".into());
    if told.is_empty() {
        let none = if simulated { "None but the one above: this is a simulated rig." } else { "There are none." };
        return vec![head, Block::text(none)];
    }
    std::iter::once(head).chain(told.into_iter().map(Block::Warning)).collect()
}
