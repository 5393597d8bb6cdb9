//! Exports on disk: all files of one, or none.

use super::exr::{Planes, write_planes};
use super::files::Unfinished;
use crate::pipeline::export::{Content, File};
use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Writes the files of an export into `directory`, which is ready for them ([`super::files::make_ready`]); an earlier export of the
/// same names stays as it was until all are written.
///
/// # Errors
/// The path at fault, and why.
pub fn write(directory: &Path, files: Vec<File>) -> Result<(), (PathBuf, String)> {
    let mut unfinished = Unfinished::within(directory);
    for File { name, content } in files {
        let path = unfinished.path(&name);
        let failed = |reason: &dyn Display| (path.clone(), reason.to_string());
        match content {
            Content::Text(text) => std::fs::write(&path, text).map_err(|e| failed(&e))?,
            Content::Bytes(bytes) => std::fs::write(&path, bytes).map_err(|e| failed(&e))?,
            Content::Planes([width, height], channels, about) => {
                let planes = Planes { origin: (0, 0), full: (width, height), size: (width, height), channels };
                write_planes(&path, planes, about).map_err(|e| (path.clone(), e.reason))?;
            }
        }
    }
    unfinished.finish().map_err(|(path, error)| (path, error.to_string()))
}
