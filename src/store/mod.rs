//! Everything on disk: session directories, journal, frame commit, datasets, results, EXR in and out.
//!
//! Plain files that any editor opens; nothing but the files is the truth:
//!
//! ```text
//! DATA/
//!   lock                         held by the daemon while it runs: a second one is refused
//!   index.sqlite                 what all journals say, in tables; made of them, and anew where it is missing or damaged
//!   sessions/<uuid v7>/
//!     manifest.json              plan, rig file, software, devices, Idempotency-Key
//!     journal.jsonl              what happened, one JSON object a line, append-only, hash-chained
//!     frames/SSS-EE.jpg          station and exposure, both from 0; a later attempt is SSS-EE-aN.jpg (N from 2)
//!     frames/.SSS-EE.jpg.tmp     a frame being written; removed at the next start
//!     radiance/NN.exr            developed stations, numbered as the lights of dataset.toml
//!     calibration.json           copy of the calibration it uses, if any
//!     dataset.toml               makes the session a dataset (docs/dataset.md)
//!     result/                    the fitted material
//!     verified.json              that `rigd verify` found all frames sound, and as of which journal
//!   calibrations/<uuid v7>/      calibration runs: the same, with result/calibration.json
//! ```
//!
//! Invariants, checked by `tests/store_crash.rs` for a kill at every step and by `tests/power_cut.rs` for a power cut at any: every
//! journalled frame has a file of that size and hash; every frame in `frames/` is journalled or is set aside at the next start; a frame is
//! never overwritten; what the journal calls developed or fitted is whole on disk (docs/durability.md).
pub mod bag;
pub mod clock;
pub mod dataset;
pub mod disk;
pub mod export;
pub mod exr;
pub mod files;
pub mod frames;
pub mod index;
pub mod journal;
pub mod keep;
pub mod manifest;
pub mod memory;
pub mod mesh;
pub mod png;
pub mod result;
pub mod sessions;
pub mod verified;

pub use clock::{Clock, RealClock};
pub use disk::{Disk, Existing, RealDisk};
pub use sessions::Store;

use disk::{make_directories, remove_if_there, sync_directory, write_synced};
use std::io;
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

/// Writes `directory/name` in place of what is there; a crash leaves the old file or the new one, never half of either.
fn replace(disk: &dyn Disk, directory: &Path, name: &str, bytes: &[u8]) -> Result<(), StoreError> {
    let (path, temporary) = (directory.join(name), directory.join(format!(".{name}.tmp")));
    remove_if_there(disk, &temporary)?;
    write_synced(disk, &temporary, bytes)?;
    disk.rename(&temporary, &path, Existing::Replaced).map_err(|e| io_error("name", &path, &e))?;
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
