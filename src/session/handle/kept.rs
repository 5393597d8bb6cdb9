//! What a session left on disk, as users get it.

use super::{EngineError, EngineHandle};
use crate::document::{html, pdf};
use crate::session::processing::read_json;
use crate::session::report;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// How a report is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReportForm {
    /// For browsers.
    Html,
    /// For paper.
    Pdf,
}

/// What a page with a report may load: what the report itself says.
pub const REPORT_POLICY: &str = html::POLICY;

impl EngineHandle {
    /// The frames of a session or calibration: station, exposure, file, blake3, bytes, shutter, state.
    pub fn frames(&self, id: &str) -> Result<Vec<Value>, EngineError> {
        Ok(self.book.lock().entry(id)?.ledger.frame_list())
    }

    /// Path of a frame of the session, if one of that name was ever committed and is there.
    pub fn frame_file(&self, id: &str, name: &str) -> Result<Option<PathBuf>, EngineError> {
        let (known, path) = {
            let inner = self.book.lock();
            let entry = inner.session(id)?;
            (entry.ledger.has_file(name), entry.directory.join("frames").join(name))
        };
        Ok((is_plain(name) && known && path.is_file()).then_some(path))
    }

    /// The fitted material: `material.json` and `report.json` of the session under the keys `material` and `report`, if it has one.
    pub fn material(&self, id: &str) -> Result<Option<Value>, EngineError> {
        let files = (self.result_file(id, "material.json")?, self.result_file(id, "report.json")?);
        let (Some(material), Some(report)) = files else { return Ok(None) };
        let read = |path: &Path| read_json(path).map_err(EngineError::Storage);
        Ok(Some(json!({"material": read(&material)?, "report": read(&report)?})))
    }

    /// Path of a result file (`preview.png`, `weights.exr`, `valid.png`, ...) of the session, if there.
    pub fn result_file(&self, id: &str, name: &str) -> Result<Option<PathBuf>, EngineError> {
        let directory = self.book.lock().entry(id)?.directory.join("result");
        let path = directory.join(name);
        Ok((is_plain(name) && path.is_file()).then_some(path))
    }

    /// The report of a session as far as it has got, made of its files: seconds of work, and as much memory as its maps.
    pub fn report(&self, id: &str, form: ReportForm) -> Result<Vec<u8>, EngineError> {
        let directory = self.book.lock().session(id)?.directory.clone();
        let damaged = |e: report::ReportError| EngineError::DamagedSession { id: id.to_owned(), reason: e.to_string() };
        let document = report::of_session(&directory).map_err(damaged)?;
        Ok(match form {
            ReportForm::Html => html::write(&document).into_bytes(),
            ReportForm::Pdf => pdf::write(&document),
        })
    }
}

/// True for a name that leads out of no directory.
fn is_plain(name: &str) -> bool {
    !name.starts_with('.') && name.bytes().all(|b| b.is_ascii_alphanumeric() || b"._-".contains(&b))
}
