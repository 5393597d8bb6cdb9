//! Frames on disk: names, and the write that makes one durable before it is journalled.

use super::{Disk, Existing, StoreError, io_error, remove_if_there, sync_directory, write_synced};
use std::path::Path;

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
    let found = std::fs::read(path).map_err(|e| format!("{} cannot be read: {e}", path.display()))?;
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

/// The names of all files of `directory`.
pub fn names(directory: &Path) -> Result<Vec<String>, StoreError> {
    let entries = std::fs::read_dir(directory).map_err(|e| io_error("list", directory, &e))?;
    let name = |entry: std::io::Result<std::fs::DirEntry>| {
        entry.map(|entry| entry.file_name().to_string_lossy().into_owned()).map_err(|e| io_error("list", directory, &e))
    };
    entries.map(name).collect()
}

/// Removes every file of `directory` that `journalled` does not know: temporary files and frames that were never acknowledged.
/// Returns their names.
pub fn remove_strays(
    disk: &dyn Disk,
    directory: &Path,
    journalled: impl Fn(&str) -> bool,
) -> Result<Vec<String>, StoreError> {
    let mut removed: Vec<String> = names(directory)?.into_iter().filter(|name| !journalled(name)).collect();
    for name in &removed {
        remove_if_there(disk, &directory.join(name))?;
    }
    if !removed.is_empty() {
        sync_directory(disk, directory)?;
    }
    removed.sort();
    Ok(removed)
}
