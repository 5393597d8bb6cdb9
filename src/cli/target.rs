//! The file that a command's `--out` names: it appears whole or not at all, and never over an input.

use crate::cli::error::bad_input;
use crate::store::files::{Unfinished, make_ready, shown};
use std::path::{Path, PathBuf};

/// The file to write.
pub struct Target {
    directory: PathBuf,
    name: String,
}

impl Target {
    /// Checks that the file can be written, before work is spent on it. Its name must end in `ending`, whose format it gets.
    ///
    /// # Errors
    /// In words, with the path: another ending, one of the `inputs`, or a place where nothing can be written.
    pub fn new(out: &Path, ending: &str, inputs: &[PathBuf]) -> Result<Self, String> {
        let refuse = |path: &Path, reason: &str| format!("{}: {reason}", shown(path));
        let fits = out.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending));
        let name = out.file_name().and_then(|name| name.to_str()).filter(|_| fits).map(str::to_owned);
        let name = name.ok_or_else(|| {
            refuse(
                out,
                &format!("this is written as {ending}, whatever the name: give --out a name that ends in .{ending}"),
            )
        })?;
        let directory = match out.parent() {
            Some(parent) if parent != Path::new("") => parent.to_owned(),
            _ => PathBuf::from("."),
        };
        make_ready(&directory, [name.as_str()], inputs).map_err(|(path, reason)| refuse(&path, &reason))?;
        Ok(Self { directory, name })
    }

    /// Of an option that may be left out.
    ///
    /// # Errors
    /// As [`Target::new`], as bad input.
    pub fn optional(out: Option<&Path>, ending: &str, inputs: &[PathBuf]) -> anyhow::Result<Option<Self>> {
        out.map(|out| Self::new(out, ending, inputs)).transpose().map_err(bad_input)
    }

    /// The file's path.
    pub fn path(&self) -> PathBuf {
        self.directory.join(&self.name)
    }

    /// Writes the file with `write`, which gets the path to write to.
    ///
    /// # Errors
    /// What `write` says, or that the file cannot get its name.
    pub fn write<T, E: Into<anyhow::Error>>(&self, write: impl FnOnce(&Path) -> Result<T, E>) -> anyhow::Result<T> {
        let mut unfinished = Unfinished::within(&self.directory);
        let written = write(&unfinished.path(&self.name)).map_err(Into::into)?;
        unfinished.finish().map_err(|(path, e)| anyhow::anyhow!("{}: it cannot get its name: {e}", shown(&path)))?;
        Ok(written)
    }

    /// Writes text.
    ///
    /// # Errors
    /// As [`Target::write`].
    pub fn write_text(&self, text: &str) -> anyhow::Result<()> {
        let named = |e: std::io::Error| anyhow::anyhow!("{}: the file cannot be written: {e}", shown(&self.path()));
        self.write(|path| std::fs::write(path, text)).map_err(|e| match e.downcast::<std::io::Error>() {
            Ok(e) => named(e),
            Err(other) => other,
        })
    }
}
