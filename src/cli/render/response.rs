//! Through which response a rendered picture is shown.

use crate::numerics::radiometry::response::Response;
use crate::pipeline::calibration::response::ResponseCalibration;
use crate::session::calibration::file::{self, CalibrationFile};
use crate::store::files::{read_text, shown};
use std::path::{Path, PathBuf};

/// A response, and where it comes from.
pub struct Found {
    /// The curves.
    pub response: Response,
    /// Its name for people.
    pub name: String,
    /// The file that holds it.
    pub file: Option<PathBuf>,
}

/// The response in `given`; without it that of the session in which the result lies, or levels as sRGB has them.
///
/// # Errors
/// A file cannot be read, or holds no response.
pub fn find(given: Option<&Path>, result: &Path) -> Result<Found, String> {
    let of_session = || {
        let session = std::fs::canonicalize(result).ok()?.parent()?.join(file::NAME);
        session.exists().then_some(session)
    };
    let Some(path) = given.map(Path::to_owned).or_else(of_session) else {
        let name = "the levels of sRGB (no calibrated response is known: --response)".to_owned();
        return Ok(Found { response: Response::srgb(), name, file: None });
    };
    let (response, name) = read(&path)?;
    Ok(Found { response, name, file: Some(path) })
}

fn read(path: &Path) -> Result<(Response, String), String> {
    let refuse = |reason: String| {
        format!("{}: {reason}; give calibration.json or what `rigd calibrate response --out` wrote", shown(path))
    };
    let text = read_text(path, "response").map_err(refuse)?;
    let json: serde_json::Value = serde_json::from_str(&text).map_err(|e| refuse(e.to_string()))?;
    if json.get("log_exposure").is_some() {
        let calibration: ResponseCalibration = serde_json::from_value(json).map_err(|e| refuse(e.to_string()))?;
        return Ok((calibration.response().map_err(refuse)?, format!("the response of {}", shown(path))));
    }
    let (calibration, _) = CalibrationFile::read(path)?;
    Ok((calibration.response.response().map_err(refuse)?, format!("the response of {}", calibration.title())))
}
