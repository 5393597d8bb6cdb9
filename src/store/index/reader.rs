//! Questions to an index, beside its writer or without one.

use super::rows::{FitRow, FrameRow, Rows, RunRow};
use super::table::{FITS, FRAMES, RUNS};
use super::{FILE, IndexError, PATIENCE, VERSION, error};
use crate::store::journal::Head;
use rusqlite::{Connection, OpenFlags};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// An index that is read.
pub struct Reader {
    pub(super) connection: Connection,
    pub(super) path: PathBuf,
}

/// Which runs are asked for; what is none asks for all.
#[derive(Clone, Debug, Default)]
pub struct Wanted {
    /// In this state.
    pub state: Option<String>,
    /// With this calibration, by its id or its number; the calibration itself included.
    pub calibration: Option<String>,
    /// With a frame of this hash.
    pub frame: Option<String>,
}

impl Reader {
    /// Opens the index of a data directory; the daemon may go on writing to it.
    ///
    /// # Errors
    /// There is none, it is of another version, or it cannot be read.
    pub fn open(data: &Path) -> Result<Self, IndexError> {
        let path = data.join(FILE);
        if !path.exists() {
            return Err(IndexError::Missing { path: path.display().to_string() });
        }
        // Without a log beside it nobody writes; then it can be read where nothing may be written, in an archive for instance.
        let fixed = !path.with_extension("sqlite-wal").exists();
        let uri = format!("file:{}{}", encoded(&path), if fixed { "?immutable=1" } else { "" });
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(uri, flags).map_err(|e| error("open", &path, e))?;
        let reader = Self { connection, path };
        reader.connection.busy_timeout(PATIENCE).map_err(|e| reader.error(e))?;
        reader.check_version()?;
        Ok(reader)
    }

    /// All runs that are wanted, newest first, each with its last fit and, where a frame is asked for, the frames of that hash.
    ///
    /// # Errors
    /// The index cannot be read.
    pub fn runs(&self, wanted: &Wanted) -> Result<Vec<Rows>, IndexError> {
        let conditions = "WHERE (?1 IS NULL OR state = ?1)
            AND (?2 IS NULL OR calibration = ?2 OR CAST(calibration_version AS TEXT) = ?2 OR kind <> 'session' AND run = ?2)
            AND (?3 IS NULL OR run IN (SELECT run FROM frames WHERE blake3 = ?3)) ORDER BY run DESC";
        let runs = || -> rusqlite::Result<Vec<(String, RunRow)>> {
            let mut statement = self.connection.prepare(&RUNS.select(conditions))?;
            let asked = (&wanted.state, &wanted.calibration, &wanted.frame);
            statement.query_map(asked, |row| Ok((row.get(0)?, RUNS.row(row)?)))?.collect()
        };
        let filled = |(id, run): (String, RunRow)| -> rusqlite::Result<Rows> {
            let last: Option<FitRow> = FITS.of_run(&self.connection, &id)?.pop();
            let mut frames = Vec::new();
            if let Some(hash) = &wanted.frame {
                frames = FRAMES.of_run(&self.connection, &id)?;
                frames.retain(|frame: &FrameRow| frame.blake3 == *hash);
            }
            Ok(Rows { id, run, frames, fits: last.into_iter().collect() })
        };
        runs().and_then(|runs| runs.into_iter().map(filled).collect()).map_err(|e| self.error(e))
    }

    /// Everything that is said of a run; none where it is not in the index.
    ///
    /// # Errors
    /// The index cannot be read.
    pub fn rows(&self, id: &str) -> Result<Option<Rows>, IndexError> {
        let rows = || -> rusqlite::Result<Option<Rows>> {
            // In one transaction: the daemon may be writing.
            let transaction = self.connection.unchecked_transaction()?;
            let Some(run) = RUNS.of_run(&transaction, id)?.pop() else { return Ok(None) };
            let (frames, fits) = (FRAMES.of_run(&transaction, id)?, FITS.of_run(&transaction, id)?);
            Ok(Some(Rows { id: id.to_owned(), run, frames, fits }))
        };
        rows().map_err(|e| self.error(e))
    }

    /// How far the journal of every run is accounted for.
    ///
    /// # Errors
    /// The index cannot be read.
    pub fn heads(&self) -> Result<BTreeMap<String, Head>, IndexError> {
        let head = |(id, run): (String, RunRow)| {
            let records = u64::try_from(run.records).unwrap_or_default();
            (id, Head { records, hash: run.hash, fault: run.fault })
        };
        Ok(self.every_run()?.into_iter().map(head).collect())
    }

    fn every_run(&self) -> Result<Vec<(String, RunRow)>, IndexError> {
        let runs = || -> rusqlite::Result<Vec<_>> {
            let mut statement = self.connection.prepare(&RUNS.select("ORDER BY run"))?;
            statement.query_map([], |row| Ok((row.get(0)?, RUNS.row(row)?)))?.collect()
        };
        runs().map_err(|e| self.error(e))
    }

    pub(super) fn check_version(&self) -> Result<(), IndexError> {
        match self.number("PRAGMA user_version")? {
            VERSION => Ok(()),
            other => Err(self.damaged(format!("its tables are those of version {other}, not {VERSION}"))),
        }
    }

    /// Whether it is what was written: the pages hang together, and the rows of every run are those of its digest.
    pub(super) fn check(&self) -> Result<(), IndexError> {
        self.check_version()?;
        let said: String = self.ask("PRAGMA quick_check(1)")?;
        if said != "ok" {
            return Err(self.damaged(said));
        }
        let (mut frames, mut fits) = (0, 0);
        for (id, _) in self.every_run()? {
            let digest: Option<String> = self
                .connection
                .query_row("SELECT digest FROM runs WHERE run = ?1", [&id], |row| row.get(0))
                .map_err(|e| self.error(e))?;
            let rows = self.rows(&id)?.filter(|rows| rows.digest().ok() == digest);
            let rows = rows.ok_or_else(|| self.damaged(format!("the rows of {id} are not what was written")))?;
            (frames, fits) = (frames + rows.frames.len(), fits + rows.fits.len());
        }
        for (table, rows) in [("frames", frames), ("fits", fits)] {
            if usize::try_from(self.number(&format!("SELECT count(*) FROM {table}"))?) != Ok(rows) {
                return Err(self.damaged(format!("{table} has rows of no run")));
            }
        }
        Ok(())
    }

    fn number(&self, question: &str) -> Result<i64, IndexError> {
        self.ask(question)
    }

    fn ask<T: rusqlite::types::FromSql>(&self, question: &str) -> Result<T, IndexError> {
        self.connection.query_row(question, [], |row| row.get(0)).map_err(|e| self.error(e))
    }

    pub(super) fn damaged(&self, reason: String) -> IndexError {
        IndexError::Damaged { path: self.path.display().to_string(), reason }
    }

    pub(super) fn error(&self, of: rusqlite::Error) -> IndexError {
        error("use", &self.path, of)
    }
}

/// A path as part of a URI.
fn encoded(path: &Path) -> String {
    use std::os::unix::ffi::OsStrExt;
    let plain = |byte: &u8| byte.is_ascii_alphanumeric() || b"/._-".contains(byte);
    let one = |byte: u8| if plain(&byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") };
    path.as_os_str().as_bytes().iter().map(|&byte| one(byte)).collect()
}
