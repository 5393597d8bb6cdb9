//! What is made of frames (radiance, dataset.toml, results), durable before the journal speaks of it: a crash leaves the old file or
//! the new one under the name, never a part.

use super::files::UNFINISHED;
use super::{Disk, Existing, StoreError, io_error, remove_if_there, sync_directory};
use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Gives `path` the file that `write` makes at the path it is told; durable when this returns.
///
/// # Errors
/// In words; an earlier file stays as it was.
pub fn file(disk: &dyn Disk, path: &Path, write: impl FnOnce(&Path) -> Result<(), String>) -> Result<(), String> {
    let unfinished = beside(path);
    let kept = write(&unfinished).and_then(|()| name_file(disk, &unfinished, path).map_err(|e| e.to_string()));
    kept.inspect_err(|_| {
        // A full disk needs the room back; what cannot be removed is written over next time.
        let _ = remove_if_there(disk, &unfinished);
    })
}

fn name_file(disk: &dyn Disk, unfinished: &Path, path: &Path) -> Result<(), StoreError> {
    sync_file(disk, unfinished)?;
    disk.rename(unfinished, path, Existing::Replaced).map_err(|e| io_error("name", path, &e))?;
    sync_directory(disk, parent(path))
}

/// Gives `path` the directory of plain files that `write` makes at the path it is told; durable when this returns.
///
/// # Errors
/// In words; an earlier directory stays as it was.
pub fn directory(disk: &dyn Disk, path: &Path, write: impl FnOnce(&Path) -> Result<(), String>) -> Result<(), String> {
    let unfinished = beside(path);
    clear(disk, &unfinished).map_err(|e| e.to_string())?;
    let kept = write(&unfinished).and_then(|()| name_directory(disk, &unfinished, path).map_err(|e| e.to_string()));
    // What is left under that name is an unfinished directory, or the earlier one; it is cleared before the next is written.
    let _ = clear(disk, &unfinished);
    kept
}

fn name_directory(disk: &dyn Disk, unfinished: &Path, path: &Path) -> Result<(), StoreError> {
    for entry in std::fs::read_dir(unfinished).map_err(|e| io_error("list", unfinished, &e))? {
        sync_file(disk, &entry.map_err(|e| io_error("list", unfinished, &e))?.path())?;
    }
    sync_directory(disk, unfinished)?;
    let existing = if path.exists() { Existing::Exchanged } else { Existing::Kept };
    disk.rename(unfinished, path, existing).map_err(|e| io_error("name", path, &e))?;
    sync_directory(disk, parent(path))
}

fn sync_file(disk: &dyn Disk, path: &Path) -> Result<(), StoreError> {
    File::open(path).and_then(|file| disk.sync(&file)).map_err(|e| io_error("sync", path, &e))
}

/// Where something is written that is not finished yet; the ending stays, for it tells encoders the format.
fn beside(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    parent(path).join(format!("{UNFINISHED}{name}"))
}

fn parent(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Removes a directory that may be there.
fn clear(disk: &dyn Disk, directory: &Path) -> Result<(), StoreError> {
    match disk.remove_directory(directory) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(io_error("remove", directory, &error)),
        _ => Ok(()),
    }
}
