//! What keeps a device from being used, told before it is opened: not there, not permitted, held by another program.
//!
//! `rigd doctor` prints it, and the daemon asks it before every opening. Everything is read below the roots of a [`Host`].

pub mod holders;
pub mod port;
pub mod usb;
mod worker;

pub use worker::worker;

use nix::unistd::{AccessFlags, access};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// How bad a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Grade {
    /// As it should be.
    Ok,
    /// A session can run, but someone should look at it.
    Warning,
    /// It keeps a session from running.
    Error,
}

/// One thing that was looked at.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// How bad it is.
    pub grade: Grade,
    /// What was found.
    pub what: String,
    /// The file, device, program or key of the rig file.
    #[serde(rename = "where")]
    pub place: String,
    /// What to do about it; none where nothing needs doing.
    pub remedy: Option<String>,
}

impl Finding {
    /// All is well.
    pub fn ok(place: impl ToString, what: impl Into<String>) -> Self {
        Self { grade: Grade::Ok, what: what.into(), place: place.to_string(), remedy: None }
    }

    /// To be looked at.
    pub fn warning(place: impl ToString, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { grade: Grade::Warning, what: what.into(), place: place.to_string(), remedy: Some(remedy.into()) }
    }

    /// Keeps a session from running.
    pub fn error(place: impl ToString, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { grade: Grade::Error, what: what.into(), place: place.to_string(), remedy: Some(remedy.into()) }
    }
}

/// Where the operating system tells of processes and devices.
#[derive(Clone, Debug)]
pub struct Host {
    /// `/proc`
    pub proc: PathBuf,
    /// `/sys`
    pub sys: PathBuf,
    /// `/dev`
    pub dev: PathBuf,
    /// `/run`
    pub run: PathBuf,
    /// Whether this process may read and write a file: lists of access (ACLs) count, so the file's mode alone does not tell.
    pub may_use: fn(&Path) -> bool,
}

impl Host {
    /// The computer this runs on.
    pub fn this() -> Self {
        let may_use = |path: &Path| access(path, AccessFlags::R_OK | AccessFlags::W_OK).is_ok();
        Self { proc: "/proc".into(), sys: "/sys".into(), dev: "/dev".into(), run: "/run".into(), may_use }
    }
}

/// True when one of the findings is an error.
pub fn any_error(findings: &[Finding]) -> bool {
    findings.iter().any(|finding| finding.grade == Grade::Error)
}

/// The errors among the findings as one sentence for a device's driver; none if there are none.
pub fn refusal(findings: &[Finding]) -> Option<String> {
    let errors: Vec<String> = findings
        .iter()
        .filter(|finding| finding.grade == Grade::Error)
        .map(|finding| match &finding.remedy {
            Some(remedy) => format!("{}: {remedy}", finding.what),
            None => finding.what.clone(),
        })
        .collect();
    (!errors.is_empty()).then(|| errors.join("; "))
}
