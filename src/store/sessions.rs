//! The data directory: its lock, its runs (sessions and calibrations), and the room that is left.

use super::files::read_bytes;
use super::journal::{self, Journal};
use super::manifest::{self, CALIBRATIONS, Manifest, SESSIONS};
use super::{
    Clock, Disk, Existing, RealClock, RealDisk, StoreError, frames, io_error, make_directories, remove_if_there,
    replace, sync_directory, write_synced,
};
use serde_json::{Map, Value};
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Prefix of a session directory that is still being made.
const UNFINISHED: &str = ".new-";
/// Prefix of a run's directory that is being removed.
const REMOVED: &str = ".removed-";
/// File that says that the lamp may be on.
const UNSAFE: &str = "lamp-may-be-on";

/// The data directory, held exclusively until it is released or this value is gone.
pub struct Store {
    directory: PathBuf,
    reserve_bytes: u64,
    disk: Arc<dyn Disk>,
    clock: Arc<dyn Clock>,
    lock: Option<File>,
    indexed: bool,
}

/// A session found on disk.
#[derive(Clone, Debug)]
pub struct Found {
    /// Its directory.
    pub directory: PathBuf,
    /// Its manifest.
    pub manifest: Manifest,
    /// What its journal says.
    pub journal: journal::Read,
}

/// Largest file of the data directory itself, bytes.
const LARGEST: u64 = 64 << 20;

impl Store {
    /// Opens `directory` (made if missing) and locks it; `reserve_bytes` stay free for journal and shutdown.
    pub fn open(directory: &Path, reserve_bytes: u64) -> Result<Self, StoreError> {
        Self::open_on(directory, reserve_bytes, Arc::new(RealDisk))
    }

    /// [`Store::open`] on a given disk.
    pub fn open_on(directory: &Path, reserve_bytes: u64, disk: Arc<dyn Disk>) -> Result<Self, StoreError> {
        for shelf in [SESSIONS, CALIBRATIONS] {
            make_directories(disk.as_ref(), &directory.join(shelf))?;
        }
        // The directory itself: a file in it could be removed and made anew, and each daemon would hold its own.
        let lock = File::open(directory).map_err(|e| io_error("open", directory, &e))?;
        lock.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => StoreError::Locked { path: directory.display().to_string() },
            TryLockError::Error(error) => io_error("lock", directory, &error),
        })?;
        let clock = Arc::new(RealClock::default());
        Ok(Self { directory: directory.to_path_buf(), reserve_bytes, disk, clock, lock: Some(lock), indexed: false })
    }

    /// The same with another clock than the machine's.
    pub fn with_clock(self, clock: Arc<dyn Clock>) -> Self {
        Self { clock, ..self }
    }

    /// The same with an index, which the engine keeps.
    pub fn with_index(self) -> Self {
        Self { indexed: true, ..self }
    }

    /// The data directory of which an index is to be kept; none where none is.
    pub fn indexed(&self) -> Option<&Path> {
        self.indexed.then_some(self.directory.as_path())
    }

    /// The clock that times its records.
    pub fn clock(&self) -> Arc<dyn Clock> {
        Arc::clone(&self.clock)
    }

    /// Lets another daemon open the directory. Called once nothing writes any more; what is on disk can still be read.
    pub fn release(&mut self) {
        self.lock = None;
    }

    /// True until [`Store::release`].
    pub fn is_held(&self) -> bool {
        self.lock.is_some()
    }

    /// The disk, for frame writes outside the store's owner.
    pub fn disk(&self) -> Arc<dyn Disk> {
        Arc::clone(&self.disk)
    }

    /// Writes down that the lamp may be on and why, or that it is not.
    pub fn mark_unsafe(&self, fault: Option<&str>) -> Result<(), StoreError> {
        match fault {
            Some(fault) => self.write_file(UNSAFE, fault.as_bytes()),
            None if self.is_marked_unsafe() => {
                remove_if_there(self.disk.as_ref(), &self.directory.join(UNSAFE))?;
                sync_directory(self.disk.as_ref(), &self.directory)
            }
            None => Ok(()),
        }
    }

    /// Whether an earlier daemon wrote down that the lamp may be on.
    pub fn is_marked_unsafe(&self) -> bool {
        self.directory.join(UNSAFE).exists()
    }

    /// A file of the data directory itself; none if there is none.
    pub fn read_file(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        let path = self.directory.join(name);
        if path.symlink_metadata().is_err_and(|error| error.kind() == std::io::ErrorKind::NotFound) {
            return Ok(None);
        }
        let corrupt = |reason| StoreError::Corrupt { path: path.display().to_string(), reason };
        read_bytes(&path, "file", LARGEST).map(Some).map_err(corrupt)
    }

    /// Writes such a file in place of what is there.
    pub fn write_file(&self, name: &str, bytes: &[u8]) -> Result<(), StoreError> {
        replace(self.disk.as_ref(), &self.directory, name, bytes)
    }

    /// Bytes free on the disk of the data directory, the reserve included; none when the system does not tell.
    pub fn free_bytes(&self) -> Option<u64> {
        self.disk.free_bytes(&self.directory).ok()
    }

    /// Bytes that stay free for journal and shutdown.
    pub fn reserve_bytes(&self) -> u64 {
        self.reserve_bytes
    }

    /// Refuses when `bytes` more would eat into the reserve.
    pub fn check_space(&self, bytes: u64) -> Result<(), StoreError> {
        check_space(self.disk.as_ref(), &self.directory, bytes, self.reserve_bytes)
    }

    /// What a frame writer needs to know of the store.
    pub fn frame_writer(&self, session: &Path) -> FrameWriter {
        FrameWriter { disk: self.disk(), directory: session.join("frames"), reserve_bytes: self.reserve_bytes }
    }

    /// Makes the directory of a run with its manifest, `files` (name and bytes) and first journal record; it appears whole or not at
    /// all.
    pub fn create(
        &self,
        manifest: &Manifest,
        files: &[(&str, &[u8])],
        kind: &str,
        fields: Map<String, Value>,
    ) -> Result<(PathBuf, Journal, Value), StoreError> {
        let shelf = self.directory.join(manifest.shelf());
        let unfinished = shelf.join(format!("{UNFINISHED}{}", manifest.id));
        let last = shelf.join(&manifest.id);
        self.disk.make_directory(&unfinished).map_err(|e| io_error("create", &unfinished, &e))?;
        self.make_shelves(&unfinished)?;
        manifest::write(self.disk.as_ref(), &unfinished, manifest)?;
        for (name, bytes) in files {
            write_synced(self.disk.as_ref(), &unfinished.join(name), bytes)?;
        }
        let path = unfinished.join(journal::FILE);
        let mut journal = Journal::create(&path, &manifest.id, manifest.simulated, (self.disk(), self.clock()))?;
        let record = journal.append(kind, fields)?;
        self.disk.rename(&unfinished, &last, Existing::Kept).map_err(|e| io_error("name", &last, &e))?;
        journal.moved_to(&last);
        sync_directory(self.disk.as_ref(), &shelf)?;
        Ok((last, journal, record))
    }

    /// Takes a run out of the data directory in one step, durable when this returns; the directory that is left may be removed then, and is
    /// at the next start. Nobody may write to the run any more.
    pub fn take_out(&self, run: &Path) -> Result<PathBuf, StoreError> {
        let shelf = run.parent().unwrap_or(&self.directory);
        let grave = shelf.join(format!("{REMOVED}{}", run.file_name().unwrap_or_default().to_string_lossy()));
        self.disk.rename(run, &grave, Existing::Kept).map_err(|e| io_error("take out", run, &e))?;
        sync_directory(self.disk.as_ref(), shelf)?;
        Ok(grave)
    }

    /// Makes the folders of a run where they are missing.
    pub fn make_shelves(&self, run: &Path) -> Result<(), StoreError> {
        for path in ["frames", "radiance"].map(|name| run.join(name)).iter().filter(|path| !path.is_dir()) {
            self.disk.make_directory(path).map_err(|e| io_error("create", path, &e))?;
        }
        Ok(())
    }

    /// Every run on disk, oldest first, and what could not be read. Directories that a crash left half made or half removed go.
    pub fn runs(&self) -> Result<(Vec<Found>, Vec<StoreError>), StoreError> {
        let (mut found, mut unreadable) = (Vec::new(), Vec::new());
        let mut directories = Vec::new();
        for shelf in [SESSIONS, CALIBRATIONS] {
            let path = self.directory.join(shelf);
            for entry in std::fs::read_dir(&path).map_err(|e| io_error("list", &path, &e))? {
                directories.push(entry.map_err(|e| io_error("list", &path, &e))?.path());
            }
        }
        for directory in directories {
            let name = directory.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            if [UNFINISHED, REMOVED].iter().any(|prefix| name.starts_with(prefix)) {
                if let Err(error) = self.disk.remove_directory(&directory) {
                    unreadable.push(io_error("remove", &directory, &error));
                }
                continue;
            }
            match read_session(&directory) {
                Ok(session) => found.push(session),
                Err(error) => unreadable.push(error),
            }
        }
        found.sort_by(|a, b| a.manifest.id.cmp(&b.manifest.id));
        Ok((found, unreadable))
    }

    /// Opens a session's journal for more records.
    pub fn open_journal(&self, directory: &Path, manifest: &Manifest) -> Result<Journal, StoreError> {
        Journal::open(&directory.join(journal::FILE), &manifest.id, manifest.simulated, (self.disk(), self.clock()))
    }

    /// Sets aside what a crash left in `frames/` and the journal does not know; returns the names.
    pub fn set_strays_aside(
        &self,
        directory: &Path,
        journalled: impl Fn(&str) -> bool,
    ) -> Result<Vec<String>, StoreError> {
        frames::set_strays_aside(self.disk.as_ref(), &directory.join("frames"), journalled)
    }
}

fn read_session(directory: &Path) -> Result<Found, StoreError> {
    let manifest = manifest::read(directory)?;
    let journal = journal::read(&directory.join(journal::FILE))?;
    Ok(Found { directory: directory.to_path_buf(), manifest, journal })
}

fn check_space(disk: &dyn Disk, path: &Path, bytes: u64, reserve_bytes: u64) -> Result<(), StoreError> {
    let free = disk.free_bytes(path).map_err(|e| io_error("ask the free space of", path, &e))?;
    let needed = bytes.saturating_add(reserve_bytes);
    if free < needed {
        return Err(StoreError::NoSpace { path: path.display().to_string(), needed, free });
    }
    Ok(())
}

/// Writes frames of one session without holding the store.
#[derive(Clone)]
pub struct FrameWriter {
    disk: Arc<dyn Disk>,
    directory: PathBuf,
    reserve_bytes: u64,
}

impl FrameWriter {
    /// Makes `bytes` durable under `name`, unless that would eat into the reserve.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), StoreError> {
        self.check_space(bytes.len() as u64)?;
        let needed = (bytes.len() as u64).saturating_add(self.reserve_bytes);
        frames::write(self.disk.as_ref(), &self.directory, name, bytes)
            .map_err(|error| error.with_need(self.disk.as_ref(), needed))
    }

    /// A committed frame of so many bytes; why it cannot be read, in words.
    pub fn read(&self, name: &str, bytes: u64) -> Result<Vec<u8>, String> {
        let path = self.directory.join(name);
        read_bytes(&path, "frame", bytes).map_err(|reason| format!("{}: {reason}", path.display()))
    }

    /// Whether a committed frame is still what it was; why not, in words.
    pub fn check(&self, name: &str, bytes: u64, blake3: &str) -> Result<(), String> {
        frames::check(&self.directory.join(name), bytes, blake3)
    }

    /// Takes back a frame whose journal line could not be written.
    pub fn take_back(&self, name: &str) -> Result<(), StoreError> {
        frames::take_back(self.disk.as_ref(), &self.directory, name)
    }

    /// Refuses when `bytes` more would eat into the reserve.
    pub fn check_space(&self, bytes: u64) -> Result<(), StoreError> {
        check_space(self.disk.as_ref(), &self.directory, bytes, self.reserve_bytes)
    }

    /// Whether `bytes` more fit when the reserve may be used up.
    pub fn fits(&self, bytes: u64) -> bool {
        check_space(self.disk.as_ref(), &self.directory, bytes, 0).is_ok()
    }
}
