//! Everything on disk: session directories, journal, frame commit, datasets, results, EXR in and out.
//!
//! Plain files that any editor opens; nothing but the files is the truth:
//!
//! ```text
//! DATA/
//!   lock                         held by the daemon while it runs: a second one is refused
//!   sessions/<uuid v7>/
//!     manifest.json              plan, rig file, software, devices, Idempotency-Key
//!     journal.jsonl              what happened, one JSON object a line, append-only, hash-chained
//!     frames/SSS-EE.jpg          station and exposure, both from 0; a later attempt is SSS-EE-aN.jpg (N from 2)
//!     frames/.SSS-EE.jpg.tmp     a frame being written; removed at the next start
//!     radiance/NN.exr            developed stations, numbered as the lights of dataset.toml
//!     calibration.json           copy of the calibration it uses, if any
//!     dataset.toml               makes the session a dataset (docs/dataset.md)
//!     result/                    the fitted material
//!   calibrations/<uuid v7>/      calibration runs: the same, with result/calibration.json
//! ```
//!
//! Invariants, checked by `tests/store_crash.rs` for a kill at every step: every journalled frame has a file of that size and
//! hash; every frame in `frames/` is journalled or is set aside at the next start; a file is never overwritten.
pub mod dataset;
pub mod exr;
pub mod files;
pub mod frames;
pub mod journal;
pub mod manifest;
pub mod result;
pub mod sessions;

pub use sessions::Store;

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;

/// Why the store could not do something.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StoreError {
    /// Another process holds the data directory.
    #[error("{path} is in use by another rigd: stop that daemon or choose another --data")]
    Locked {
        /// The lock file.
        path: String,
    },
    /// The disk is full, or would be filled beyond the reserve.
    #[error("{needed} bytes are needed and {free} are free on {path}: make room")]
    NoSpace {
        /// The data directory.
        path: String,
        /// Bytes needed now, the reserve included.
        needed: u64,
        /// Bytes free.
        free: u64,
    },
    /// The operating system refused.
    #[error("cannot {what} {path}: {reason}")]
    Io {
        /// The step.
        what: &'static str,
        /// The file.
        path: String,
        /// What the operating system said.
        reason: String,
    },
    /// A file does not say what it must.
    #[error("{path}: {reason}")]
    Corrupt {
        /// The file.
        path: String,
        /// What is wrong and what to do.
        reason: String,
    },
}

impl StoreError {
    /// Tells a lack of space how much was needed and how much there is.
    fn with_need(self, disk: &dyn Disk, needed: u64) -> Self {
        match self {
            Self::NoSpace { path, .. } => {
                let free = disk.free_bytes(Path::new(&path)).unwrap_or(0);
                Self::NoSpace { path, needed, free }
            }
            other => other,
        }
    }
}

/// One step of a durable write, in the order in which a frame takes them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Open the temporary file.
    CreateTemp,
    /// Write the bytes.
    Write,
    /// Force the file to disk.
    SyncFile,
    /// Give the file its name.
    Rename,
    /// Force the directory to disk.
    SyncDirectory,
    /// Write the journal line.
    Append,
    /// Force the journal to disk: from here on the record counts.
    SyncJournal,
    /// Remove a temporary or stray file.
    Remove,
}

/// The disk as the store sees it. [`RealDisk`] is the operating system's; tests fill it up or cut it off at a step.
pub trait Disk: Send + Sync {
    /// Bytes free for us on the file system of `path`.
    fn free_bytes(&self, path: &Path) -> io::Result<u64>;
    /// Asked before every step; an error is that step's failure.
    fn before(&self, step: Step) -> io::Result<()>;
}

/// The operating system's disk.
#[derive(Clone, Copy, Debug, Default)]
pub struct RealDisk;

impl Disk for RealDisk {
    fn free_bytes(&self, path: &Path) -> io::Result<u64> {
        let stat = nix::sys::statvfs::statvfs(path)?;
        Ok(stat.blocks_available() * stat.fragment_size())
    }

    fn before(&self, _step: Step) -> io::Result<()> {
        Ok(())
    }
}

/// Writes `directory/name` in place of what is there; a crash leaves the old file or the new one, never half of either.
fn replace(disk: &dyn Disk, directory: &Path, name: &str, bytes: &[u8]) -> Result<(), StoreError> {
    let (path, temporary) = (directory.join(name), directory.join(format!(".{name}.tmp")));
    remove_if_there(disk, &temporary)?;
    write_synced(disk, &temporary, bytes)?;
    disk.before(Step::Rename)
        .and_then(|()| std::fs::rename(&temporary, &path))
        .map_err(|e| io_error("name", &path, &e))?;
    sync_directory(disk, directory)
}

/// Names the step and the file that an operating-system error belongs to.
fn io_error(what: &'static str, path: &Path, error: &io::Error) -> StoreError {
    let path = path.display().to_string();
    if error.kind() == io::ErrorKind::StorageFull || error.kind() == io::ErrorKind::QuotaExceeded {
        return StoreError::NoSpace { path, needed: 0, free: 0 };
    }
    StoreError::Io { what, path, reason: error.to_string() }
}

/// Forces a directory's names to disk.
fn sync_directory(disk: &dyn Disk, directory: &Path) -> Result<(), StoreError> {
    disk.before(Step::SyncDirectory)
        .and_then(|()| File::open(directory)?.sync_all())
        .map_err(|e| io_error("sync the directory", directory, &e))
}

/// Writes a new file and forces its bytes to disk.
fn write_synced(disk: &dyn Disk, path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    let mut file = disk
        .before(Step::CreateTemp)
        .and_then(|()| OpenOptions::new().write(true).create_new(true).open(path))
        .map_err(|e| io_error("create", path, &e))?;
    disk.before(Step::Write).and_then(|()| file.write_all(bytes)).map_err(|e| io_error("write", path, &e))?;
    disk.before(Step::SyncFile).and_then(|()| file.sync_all()).map_err(|e| io_error("sync", path, &e))
}

/// Removes a file that may be there.
fn remove_if_there(disk: &dyn Disk, path: &Path) -> Result<(), StoreError> {
    match disk.before(Step::Remove).and_then(|()| std::fs::remove_file(path)) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(io_error("remove", path, &error)),
        _ => Ok(()),
    }
}
