//! The files that a report is made of.

use super::ReportError;
use crate::numerics::image::Image;
use crate::pipeline::report::{MaterialFile, Report};
use crate::session::calibration::file::{self, CalibrationFile};
use crate::session::ledger::Ledger;
use crate::session::plan::CapturePlan;
use crate::session::quality::Optics;
use crate::session::verify;
use crate::session::work::Work;
use crate::store::exr::{Planes, read_planes};
use crate::store::files::{read_text, shown};
use crate::store::journal;
use crate::store::manifest::Manifest;
use crate::store::result;
use rig_config::Rig;
use std::path::{Path, PathBuf};

/// A session as its files tell it.
pub struct Session {
    pub directory: PathBuf,
    pub manifest: Manifest,
    pub journal: journal::Read,
    pub ledger: Ledger,
    pub plan: CapturePlan,
    /// The rig file, or why this version cannot read it.
    pub rig: Result<Rig, String>,
    pub calibration: Option<CalibrationFile>,
    /// What the first frame says of body and lens; none where no frame is there any more.
    pub optics: Option<Optics>,
    pub fitted: Option<Fitted>,
}

impl Session {
    pub fn read(directory: &Path) -> Result<Self, ReportError> {
        let (manifest, journal, ledger) = verify::read(directory)?;
        let damaged = |name: &str, reason: String| ReportError::Damaged { path: shown(&directory.join(name)), reason };
        let fault = journal.head.fault.clone().or_else(|| journal.foreign(&manifest.id));
        if let Some(fault) = fault {
            let remedy = "put the journal back from a copy; `rigd verify` says what else is not what was committed";
            return Err(damaged(journal::FILE, format!("{fault}: {remedy}")));
        }
        let unplanned = |e: serde_json::Error| damaged("manifest.json", format!("it holds no plan: {e}"));
        let Work::Capture(plan) = Work::of(&manifest).map_err(unplanned)? else {
            return Err(ReportError::Nothing {
                path: shown(directory),
                reason: "this is a calibration: `rigd calibrate show` prints what it measured; give a session".into(),
            });
        };
        let calibration = match plan.calibration {
            Some(_) => Some(read_calibration(directory)?),
            None => None,
        };
        let rig = Rig::from_toml(&manifest.rig_file, "manifest.json").map_err(|e| e.to_string());
        let fitted = Fitted::read(&directory.join("result"))?;
        let optics = optics(directory, &ledger);
        let directory = directory.to_owned();
        Ok(Self { directory, manifest, journal, ledger, plan, rig, calibration, optics, fitted })
    }
}

fn read_calibration(directory: &Path) -> Result<CalibrationFile, ReportError> {
    let path = directory.join(file::NAME);
    let (calibration, _) = CalibrationFile::read(&path).map_err(|reason| ReportError::Damaged {
        path: shown(directory),
        reason: format!("the session's copy of its calibration: {reason}"),
    })?;
    Ok(calibration)
}

/// Of the first frame that counts; frames that were put away are no reason not to report.
fn optics(directory: &Path, ledger: &Ledger) -> Option<Optics> {
    let frame = ledger.frames().next()?;
    crate::session::processing::read_frame(directory, frame).ok().map(|bytes| Optics::of(&bytes))
}

/// A result directory.
pub struct Fitted {
    pub directory: PathBuf,
    pub report: Report,
    pub material: MaterialFile,
    /// A map a material.
    pub weights: Vec<Image<f32>>,
    /// Mean relative error of every pixel, by channel; none where the file is missing.
    pub residual: Option<Planes>,
}

impl Fitted {
    /// None where no fit has ended.
    pub fn read(directory: &Path) -> Result<Option<Self>, ReportError> {
        let path = directory.join("report.json");
        if !path.exists() {
            return Ok(None);
        }
        let damaged = |path: &Path, reason: String| ReportError::Damaged { path: shown(path), reason };
        let text = read_text(&path, "report").map_err(|reason| damaged(&path, reason))?;
        let remedy = "fit again, or put the file back from a copy";
        let report: Report = serde_json::from_str(&text).map_err(|e| damaged(&path, format!("{e}: {remedy}")))?;
        let stored = result::read_material(directory)?;
        let [width, height] = stored.material.size;
        let path = directory.join("residual.exr");
        let residual = match path.exists() {
            true => Some(
                read_planes(&path, (width, height)).map_err(|e| damaged(&path, format!("{}: {remedy}", e.reason)))?,
            ),
            false => None,
        };
        let (directory, material, weights) = (directory.to_owned(), stored.material, stored.weights);
        Ok(Some(Self { directory, report, material, weights, residual }))
    }
}
