//! Frames on disk: names, and the write that makes one durable before it is journalled.

use super::files::read_bytes;
use super::{Disk, Existing, StoreError, io_error, remove_if_there, sync_directory, write_synced};
use std::path::Path;

/// Ending of frames that a crash left without a record.
pub const ASIDE: &str = ".unacknowledged";

/// File name of a frame; `attempt` counts from 1 the shots made for this cell of the plan.
pub fn file_name(station: usize, exposure: usize, attempt: usize) -> String {
    match attempt {
        0 | 1 => format!("{station:03}-{exposure:02}.jpg"),
        _ => format!("{station:03}-{exposure:02}-a{attempt}.jpg"),
    }
}

/// Writes `bytes` as `directory/name`, durable when it returns: temporary file, fsync, rename that never replaces, fsync of the
/// directory. The frame counts only once its journal line is written too.
pub fn write(disk: &dyn Disk, directory: &Path, name: &str, bytes: &[u8]) -> Result<(), StoreError> {
    let temporary = directory.join(format!(".{name}.tmp"));
    let last = directory.join(name);
    let named = write_synced(disk, &temporary, bytes)
        .and_then(|()| disk.rename(&temporary, &last, Existing::Kept).map_err(|e| io_error("name", &last, &e)));
    if let Err(error) = named {
        // A full disk needs the room back; what cannot be removed now is removed at the next start.
        let _ = remove_if_there(disk, &temporary);
        return Err(error);
    }
    sync_directory(disk, directory)
}

/// Whether a committed frame is still what its journal line says; why not, in words.
pub fn check(path: &Path, bytes: u64, blake3: &str) -> Result<(), String> {
    std::fs::metadata(path).map_err(|e| format!("{} cannot be read: {e}", path.display()))?;
    let found = read_bytes(path, "frame", bytes).map_err(|reason| format!("{}: {reason}", path.display()))?;
    if found.len() as u64 != bytes {
        return Err(format!("{} has {} bytes, not the {bytes} that were committed", path.display(), found.len()));
    }
    if blake3::hash(&found).to_hex().as_str() != blake3 {
        return Err(format!("{} is not what was committed: its hash differs", path.display()));
    }
    Ok(())
}

/// Takes back a frame whose journal line could not be written.
pub fn take_back(disk: &dyn Disk, directory: &Path, name: &str) -> Result<(), StoreError> {
    remove_if_there(disk, &directory.join(name))?;
    sync_directory(disk, directory)
}

/// The names of all files of `directory`; none when it is gone.
pub fn names(directory: &Path) -> Result<Vec<String>, StoreError> {
    let entries = match std::fs::read_dir(directory) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(|e| io_error("list", directory, &e))?,
    };
    let name = |entry: std::io::Result<std::fs::DirEntry>| {
        entry.map(|entry| entry.file_name().to_string_lossy().into_owned()).map_err(|e| io_error("list", directory, &e))
    };
    entries.map(name).collect()
}

/// True for a name that [`file_name`] gives.
pub fn is_frame(name: &str) -> bool {
    let digits = |text: &str, least: usize| text.len() >= least && text.bytes().all(|b| b.is_ascii_digit());
    let Some((station, rest)) = name.strip_suffix(".jpg").and_then(|stem| stem.split_once('-')) else { return false };
    let (exposure, attempt) = rest.split_once("-a").unwrap_or((rest, "2"));
    digits(station, 3) && digits(exposure, 2) && digits(attempt, 1)
}

/// Clears `directory` of what a crash left: temporary files are removed, frames that `journalled` does not know (they were never
/// acknowledged, but they are pictures) get the ending [`ASIDE`], and everything that is not ours is left. Returns the names.
pub fn set_strays_aside(
    disk: &dyn Disk,
    directory: &Path,
    journalled: impl Fn(&str) -> bool,
) -> Result<Vec<String>, StoreError> {
    let ours = |name: &String| {
        is_frame(name) && !journalled(name)
            || name.strip_prefix('.').and_then(|name| name.strip_suffix(".tmp")).is_some_and(is_frame)
    };
    let mut strays: Vec<String> = names(directory)?.into_iter().filter(ours).collect();
    strays.sort();
    for name in &strays {
        let path = directory.join(name);
        if name.starts_with('.') {
            remove_if_there(disk, &path)?;
            continue;
        }
        let aside = free_name(directory, name);
        disk.rename(&path, &aside, Existing::Kept).map_err(|e| io_error("set aside", &path, &e))?;
    }
    if !strays.is_empty() {
        sync_directory(disk, directory)?;
    }
    Ok(strays)
}

/// A name that nothing has yet: one cell of a plan may be caught by several crashes.
fn free_name(directory: &Path, name: &str) -> std::path::PathBuf {
    let numbered =
        |n: usize| directory.join(if n == 0 { format!("{name}{ASIDE}") } else { format!("{name}.{n}{ASIDE}") });
    (0..).map(numbered).find(|path| !path.exists()).unwrap_or_else(|| directory.join(name))
}
