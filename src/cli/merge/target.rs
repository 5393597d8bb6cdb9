//! Where `rigd merge` writes: an EXR file that appears whole or not at all, and never over an input.

use super::MergeInputError;
use crate::store::exr::ExrError;
use crate::store::files::{Unfinished, make_ready, shown};
use std::path::{Path, PathBuf};

/// How the name of the file must end.
const ENDING: &str = "exr";

/// The file to write.
pub(super) struct Target {
    out: PathBuf,
    directory: PathBuf,
    name: String,
}

impl Target {
    /// Checks that the file can be written, before work is spent on it.
    ///
    /// # Errors
    /// It is not called .exr, is one of the `inputs`, or cannot be written.
    pub fn new(out: PathBuf, inputs: &[PathBuf]) -> Result<Self, MergeInputError> {
        let refuse = |path: &Path, reason: &str| MergeInputError(format!("{}: {reason}", shown(path)));
        let is_exr = out.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(ENDING));
        let name = out.file_name().and_then(|name| name.to_str()).filter(|_| is_exr).map(str::to_owned);
        let name = name.ok_or_else(|| {
            refuse(&out, "radiance is written as OpenEXR, whatever the name: give --out a name that ends in .exr")
        })?;
        let directory = match out.parent() {
            Some(parent) if parent != Path::new("") => parent.to_owned(),
            _ => PathBuf::from("."),
        };
        make_ready(&directory, [name.as_str()], inputs).map_err(|(path, reason)| refuse(&path, &reason))?;
        Ok(Self { out, directory, name })
    }

    /// Writes the file with `write`, which gives what a person wants to know of it, and adds its name to that.
    pub fn write(&self, write: impl FnOnce(&Path) -> Result<String, ExrError>) -> anyhow::Result<String> {
        let mut unfinished = Unfinished::within(&self.directory);
        let said = write(&unfinished.path(&self.name))?;
        unfinished.finish().map_err(|(path, e)| anyhow::anyhow!("{}: it cannot get its name: {e}", shown(&path)))?;
        Ok(format!("{said}wrote {}", self.out.display()))
    }
}
