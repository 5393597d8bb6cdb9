//! `index.sqlite` of the data directory: what all journals say, in tables, so that questions over all runs need not read them.
//!
//! It is made of the journals, and never the other way round: without it nothing is lost, and one that is missing, damaged or of
//! another version is made anew. So it has no migrations, and it does not lie on the store's [`super::Disk`]: a power cut may
//! leave anything of it.

mod reader;
mod rows;
mod table;

pub use reader::{Reader, Wanted};
pub use rows::{FitRow, FrameRow, Rows, RunRow};

use rusqlite::{Connection, ErrorCode};
use std::io::ErrorKind;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::time::Duration;
use table::{ALL, FITS, FRAMES, RUNS};

/// File name in the data directory; SQLite keeps its log and its shared memory beside it (`-wal`, `-shm`).
pub const FILE: &str = "index.sqlite";
/// The tables' own version (`PRAGMA user_version`).
const VERSION: i64 = 1;
/// How long a connection waits for another one.
const PATIENCE: Duration = Duration::from_secs(5);

/// Why an index cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum IndexError {
    /// There is none.
    #[error("{path} is not there: a daemon makes it when it starts, `rigd index rebuild` without one")]
    Missing {
        /// The file.
        path: String,
    },
    /// It does not hold what was written, or is of another version.
    #[error("{path} cannot be trusted: {reason}; `rigd index rebuild` makes it anew")]
    Damaged {
        /// The file.
        path: String,
        /// What is wrong.
        reason: String,
    },
    /// The disk, or the operating system, refused.
    #[error("cannot {what} {path}: {reason}")]
    Refused {
        /// The step.
        what: &'static str,
        /// The file.
        path: String,
        /// What SQLite or the system said.
        reason: String,
    },
}

fn error(what: &'static str, path: &Path, error: rusqlite::Error) -> IndexError {
    let (path, reason) = (path.display().to_string(), error.to_string());
    match error.sqlite_error_code() {
        Some(
            ErrorCode::DiskFull
            | ErrorCode::SystemIoFailure
            | ErrorCode::CannotOpen
            | ErrorCode::ReadOnly
            | ErrorCode::PermissionDenied
            | ErrorCode::DatabaseBusy
            | ErrorCode::DatabaseLocked
            | ErrorCode::FileLockingProtocolFailed
            | ErrorCode::OutOfMemory,
        ) => IndexError::Refused { what, path, reason },
        // Not a database, malformed, other tables, values of the wrong kind: this is not what was written.
        _ => IndexError::Damaged { path, reason },
    }
}

/// An index that is written. One at a time: whoever holds the data directory's lock.
pub struct Index(Reader);

impl Deref for Index {
    type Target = Reader;

    fn deref(&self) -> &Reader {
        &self.0
    }
}

impl Index {
    /// Opens the index of a data directory; one that is missing, damaged or of another version is made anew, without any run.
    ///
    /// # Errors
    /// The disk is full or refuses.
    pub fn open(data: &Path) -> Result<Self, IndexError> {
        let path = data.join(FILE);
        if !path.exists() {
            return Self::make(data);
        }
        match Self::connect(&path).and_then(|index| index.check().map(|()| index)) {
            Err(IndexError::Damaged { reason, .. }) => {
                tracing::warn!(path = %path.display(), reason, "the index is made anew from the journals");
                Self::make(data)
            }
            opened => opened,
        }
    }

    /// Makes an index without any run in place of what is there.
    ///
    /// # Errors
    /// The disk is full or refuses.
    pub fn make(data: &Path) -> Result<Self, IndexError> {
        let path = data.join(FILE);
        // The log last: one without its database is passed over.
        for name in ["index.sqlite", "index.sqlite-shm", "index.sqlite-wal"] {
            let path = data.join(name);
            match std::fs::remove_file(&path) {
                Err(e) if e.kind() != ErrorKind::NotFound => {
                    return Err(IndexError::Refused {
                        what: "remove",
                        path: path.display().to_string(),
                        reason: e.to_string(),
                    });
                }
                _ => {}
            }
        }
        let index = Self::connect(&path)?;
        let tables: String = ALL.iter().map(|table| table.create()).collect();
        let made = format!("BEGIN IMMEDIATE; {tables} PRAGMA user_version = {VERSION}; COMMIT;");
        index.connection.execute_batch(&made).map_err(|e| index.error(e))?;
        Ok(index)
    }

    fn connect(path: &PathBuf) -> Result<Self, IndexError> {
        let connection = Connection::open(path).map_err(|e| error("open", path, e))?;
        let set = || -> rusqlite::Result<String> {
            connection.busy_timeout(PATIENCE)?;
            let mode = connection.query_row("PRAGMA journal_mode = WAL", [], |row| row.get(0))?;
            connection.execute_batch("PRAGMA synchronous = FULL")?;
            Ok(mode)
        };
        let mode = set().map_err(|e| error("open", path, e))?;
        if mode != "wal" {
            let reason = format!("its file system allows no write-ahead log (journal mode {mode})");
            return Err(IndexError::Refused { what: "open", path: path.display().to_string(), reason });
        }
        Ok(Self(Reader { connection, path: path.clone() }))
    }

    /// Writes what is to be said of a run in place of what was, in one transaction.
    ///
    /// # Errors
    /// The disk is full or refuses.
    pub fn put(&mut self, rows: &Rows) -> Result<(), IndexError> {
        let put = || -> rusqlite::Result<()> {
            let transaction = self.connection.unchecked_transaction()?;
            delete(&transaction, &rows.id)?;
            rows.frames.iter().try_for_each(|frame| FRAMES.put(&transaction, &rows.id, frame))?;
            rows.fits.iter().try_for_each(|fit| FITS.put(&transaction, &rows.id, fit))?;
            let failed = |e: serde_json::Error| rusqlite::Error::ToSqlConversionFailure(e.into());
            let mut run = serde_json::to_value(&rows.run).map_err(failed)?;
            run["digest"] = rows.digest().map_err(failed)?.into();
            RUNS.put(&transaction, &rows.id, &run)?;
            transaction.commit()
        };
        put().map_err(|e| self.error(e))
    }

    /// Takes a run out.
    ///
    /// # Errors
    /// The disk is full or refuses.
    pub fn remove(&mut self, id: &str) -> Result<(), IndexError> {
        let remove = || -> rusqlite::Result<()> {
            let transaction = self.connection.unchecked_transaction()?;
            delete(&transaction, id)?;
            transaction.commit()
        };
        remove().map_err(|e| self.error(e))
    }
}

fn delete(connection: &Connection, id: &str) -> rusqlite::Result<()> {
    ALL.iter().try_for_each(|table| {
        connection.execute(&format!("DELETE FROM {} WHERE run = ?1", table.name), [id]).map(|_| ())
    })
}
