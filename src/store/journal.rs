//! The journal of a session: one JSON object a line, numbered from 1 without gaps, each naming the blake3 of the line before.
//!
//! Every record has `seq`, `time` (RFC 3339), `type`, `session`, `simulated` and `prev` (null in the first). A record counts once
//! `append` has returned: the line is then on disk. A last line that a crash left half written never counted and is cut.

use super::files::check_regular;
use super::{Clock, Disk, StoreError, io_error, sync_directory};
use serde_json::{Map, Value, json};
use std::fs::{File, OpenOptions};
use std::io::{Read as _, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// File name in the session directory.
pub const FILE: &str = "journal.jsonl";

/// What a journal is written on and timed by.
pub type Machine = (Arc<dyn Disk>, Arc<dyn Clock>);

/// A journal open for writing.
pub struct Journal {
    path: PathBuf,
    file: File,
    disk: Arc<dyn Disk>,
    clock: Arc<dyn Clock>,
    session: String,
    simulated: bool,
    head: Head,
    length: u64,
    unusable: Option<String>,
}

/// How far a journal goes: two journals with the same head are the same.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Head {
    /// Records up to the first fault.
    pub records: u64,
    /// Hash of the last one's line; none before the first.
    pub hash: Option<String>,
    /// Why the rest cannot be trusted: a broken number or hash chain. A torn last line is no fault.
    pub fault: Option<String>,
}

/// What a journal file says.
#[derive(Clone, Debug, Default)]
pub struct Read {
    /// The records up to the first fault.
    pub records: Vec<Value>,
    /// Bytes of the file that hold those records.
    pub length: u64,
    /// How far that goes.
    pub head: Head,
}

impl Read {
    /// The first record that is not of the run `id`, in words.
    pub fn foreign(&self, id: &str) -> Option<String> {
        let other = self.records.iter().find(|record| record["session"] != id)?;
        Some(format!("record {} is of {}, not of {id}: the journal of another run", other["seq"], other["session"]))
    }
}

/// Reads a journal piece by piece, as it grows, without changing it.
pub struct Follower {
    path: PathBuf,
    length: u64,
    head: Head,
}

impl Follower {
    /// Nothing of it is read yet.
    pub fn new(path: PathBuf) -> Self {
        Self { path, length: 0, head: Head::default() }
    }

    /// How far it was read.
    pub fn head(&self) -> &Head {
        &self.head
    }

    /// The records after those already read, up to number `last`; fewer where the file holds no more that can be trusted.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn read_to(&mut self, last: u64) -> Result<Vec<Value>, StoreError> {
        let mut bytes = Vec::new();
        let mut file = open_regular(&self.path)?;
        file.seek(SeekFrom::Start(self.length))
            .and_then(|_| file.read_to_end(&mut bytes))
            .map_err(|e| io_error("read", &self.path, &e))?;
        let read = walk(&bytes, self.head.clone(), last);
        (self.length, self.head) = (self.length + read.length, read.head);
        Ok(read.records)
    }
}

/// Reads a journal without changing it.
pub fn read(path: &Path) -> Result<Read, StoreError> {
    Ok(parse(&bytes_of(path)?))
}

/// A pipe without a writer would hang for ever, a device has no end.
fn open_regular(path: &Path) -> Result<File, StoreError> {
    let corrupt = |reason| StoreError::Corrupt { path: path.display().to_string(), reason };
    check_regular(path, "journal").map_err(corrupt)?;
    File::open(path).map_err(|e| io_error("open", path, &e))
}

pub(super) fn bytes_of(path: &Path) -> Result<Vec<u8>, StoreError> {
    let mut bytes = Vec::new();
    open_regular(path)?.read_to_end(&mut bytes).map_err(|e| io_error("read", path, &e))?;
    Ok(bytes)
}

fn parse(bytes: &[u8]) -> Read {
    let mut read = walk(bytes, Head::default(), u64::MAX);
    if read.records.is_empty() && read.head.fault.is_none() {
        // The first record is on disk before the session has its name.
        read.head.fault = Some("line 1: there is no whole record".into());
    }
    read
}

/// Takes lines after those of `head` as long as each follows from the one before, up to record number `last`.
fn walk(bytes: &[u8], head: Head, last: u64) -> Read {
    let mut read = Read { head, ..Read::default() };
    for line in bytes.split_inclusive(|&b| b == b'\n') {
        let number = read.head.records + 1;
        let at_end = read.length as usize + line.len() == bytes.len();
        let Some(text) = line.strip_suffix(b"\n").filter(|_| number <= last) else { break };
        match check(text, number, read.head.hash.as_deref()) {
            Ok(record) => read.records.push(record),
            // A page at the very end that never reached the disk reads as zeros; all else that is unreadable was changed.
            Err(Fault::Unreadable(_)) if at_end && text.contains(&0) => break,
            Err(Fault::Unreadable(reason) | Fault::Chain(reason)) => {
                read.head.fault = Some(format!("line {number}: {reason}"));
                break;
            }
        }
        (read.head.records, read.head.hash) = (number, Some(hash(text)));
        read.length += line.len() as u64;
    }
    read
}

enum Fault {
    Unreadable(String),
    Chain(String),
}

fn check(text: &[u8], seq: u64, prev: Option<&str>) -> Result<Value, Fault> {
    let record: Value = serde_json::from_slice(text).map_err(|e| Fault::Unreadable(format!("not JSON: {e}")))?;
    if record["seq"] != json!(seq) {
        return Err(Fault::Chain(format!("seq is {}, not {seq}: a line is missing or was added", record["seq"])));
    }
    if record["prev"] != json!(prev) {
        return Err(Fault::Chain("prev is not the hash of the line before: a line was changed".into()));
    }
    Ok(record)
}

fn hash(line: &[u8]) -> String {
    blake3::hash(line).to_hex().to_string()
}

impl Journal {
    /// Starts the journal of a new session.
    pub fn create(path: &Path, session: &str, simulated: bool, (disk, clock): Machine) -> Result<Self, StoreError> {
        let file = disk.create(path).map_err(|e| io_error("create", path, &e))?;
        if let Some(directory) = path.parent() {
            sync_directory(disk.as_ref(), directory)?;
        }
        let (path, session) = (path.to_path_buf(), session.to_owned());
        Ok(Self { path, file, disk, clock, session, simulated, head: Head::default(), length: 0, unusable: None })
    }

    /// Opens the journal of an earlier session: cuts a torn last line, refuses a broken chain.
    pub fn open(path: &Path, session: &str, simulated: bool, (disk, clock): Machine) -> Result<Self, StoreError> {
        let read = read(path)?;
        let path = path.to_path_buf();
        if let Some(reason) = read.head.fault {
            return Err(StoreError::Corrupt { path: path.display().to_string(), reason });
        }
        let mut file = OpenOptions::new().write(true).open(&path).map_err(|e| io_error("open", &path, &e))?;
        disk.cut(&mut file, read.length)
            .and_then(|()| disk.sync(&file))
            .map_err(|e| io_error("cut the torn last line of", &path, &e))?;
        let (session, head, length) = (session.to_owned(), read.head, read.length);
        Ok(Self { path, file, disk, clock, session, simulated, head, length, unusable: None })
    }

    /// How far it goes.
    pub fn head(&self) -> &Head {
        &self.head
    }

    /// Tells the journal the new name of its directory, for messages.
    pub(super) fn moved_to(&mut self, directory: &Path) {
        self.path = directory.join(FILE);
    }

    /// Appends a record and forces it to disk; returns it as written.
    pub fn append(&mut self, kind: &str, fields: Map<String, Value>) -> Result<Value, StoreError> {
        if let Some(reason) = &self.unusable {
            return Err(StoreError::Corrupt { path: self.path.display().to_string(), reason: reason.clone() });
        }
        let mut record = fields;
        record.insert("seq".into(), json!(self.head.records + 1));
        record.insert("time".into(), json!(self.clock.now().to_string()));
        record.insert("type".into(), json!(kind));
        record.insert("session".into(), json!(self.session));
        record.insert("simulated".into(), json!(self.simulated));
        record.insert("prev".into(), json!(self.head.hash));
        let mut line = Value::Object(record).to_string().into_bytes();
        // What memory holds is what a reader of the file gets, to the last digit of a number.
        let record = serde_json::from_slice(&line)
            .map_err(|e| StoreError::Corrupt { path: self.path.display().to_string(), reason: e.to_string() })?;
        let hash = hash(&line);
        line.push(b'\n');
        self.write(&line)?;
        self.head.records += 1;
        self.head.hash = Some(hash);
        self.length += line.len() as u64;
        Ok(record)
    }

    fn write(&mut self, line: &[u8]) -> Result<(), StoreError> {
        let written = self.disk.write(&mut self.file, line);
        if let Err(error) = written {
            self.cut_back();
            let error = io_error("append to", &self.path, &error);
            return Err(error.with_need(self.disk.as_ref(), line.len() as u64));
        }
        self.disk.sync(&self.file).map_err(|error| {
            // After a failed sync the kernel may have dropped the page: what is on disk is unknown, so nothing more is promised.
            self.unusable = Some(format!("a sync failed ({error}): restart the daemon, which reads what is there"));
            io_error("sync", &self.path, &error)
        })
    }

    /// Takes back what a failed write may have left, so that the next line starts clean.
    fn cut_back(&mut self) {
        if let Err(error) = self.disk.cut(&mut self.file, self.length) {
            self.unusable = Some(format!("a half-written line could not be cut ({error}): restart the daemon"));
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;
    use crate::store::{RealClock, RealDisk};

    fn machine() -> Machine {
        (Arc::new(RealDisk), Arc::new(RealClock::default()))
    }

    fn written(directory: &Path, records: usize) -> PathBuf {
        let path = directory.join("journal.jsonl");
        let mut journal = Journal::create(&path, "s", true, machine()).unwrap();
        for i in 0..records {
            journal.append("test", json!({ "i": i }).as_object().unwrap().clone()).unwrap();
        }
        path
    }

    #[test]
    fn numbers_and_chain_are_as_an_outsider_computes_them() {
        let directory = tempfile::tempdir().unwrap();
        let text = std::fs::read_to_string(written(directory.path(), 4)).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        for (i, line) in lines.iter().enumerate() {
            let record: Value = serde_json::from_str(line).unwrap();
            assert_eq!(record["seq"], i + 1);
            assert_eq!(record["i"], i);
            let expected = (i > 0).then(|| blake3::hash(lines[i - 1].as_bytes()).to_hex().to_string());
            assert_eq!(record["prev"], json!(expected));
            assert!(record["time"].as_str().unwrap().parse::<jiff::Timestamp>().is_ok());
        }
    }

    #[test]
    fn cut_at_any_byte_keeps_the_whole_lines_and_goes_on() {
        let directory = tempfile::tempdir().unwrap();
        let path = written(directory.path(), 3);
        let whole = std::fs::read(&path).unwrap();
        for length in 0..=whole.len() {
            std::fs::write(&path, &whole[..length]).unwrap();
            let kept = whole[..length].iter().filter(|&&b| b == b'\n').count();
            let opened = Journal::open(&path, "s", true, machine());
            if kept == 0 {
                // No session has its name before its first record is whole.
                assert!(matches!(opened, Err(StoreError::Corrupt { .. })), "cut at {length}");
                continue;
            }
            let mut journal = opened.unwrap();
            journal.append("after", Map::new()).unwrap();
            let read = read(&path).unwrap();
            assert_eq!((read.records.len(), read.head.fault), (kept + 1, None), "cut at {length}");
        }
    }

    /// A journal read in pieces is the journal read at once, wherever the pieces end and whatever is cut off behind them.
    #[test]
    fn followed_piece_by_piece_it_is_what_it_is_at_once() {
        let directory = tempfile::tempdir().unwrap();
        let path = written(directory.path(), 4);
        let bytes = std::fs::read(&path).unwrap();
        let whole = read(&path).unwrap();
        for (first, length) in (0..=5).flat_map(|first| (0..=bytes.len()).map(move |length| (first, length))) {
            std::fs::write(&path, &bytes[..length]).unwrap();
            let mut follower = Follower::new(path.clone());
            let mut records = follower.read_to(first).unwrap();
            assert!(records.len() as u64 <= first);
            std::fs::write(&path, &bytes).unwrap();
            records.extend(follower.read_to(u64::MAX).unwrap());
            assert_eq!((&records, follower.head()), (&whole.records, &whole.head), "{first} of {length} bytes");
        }
        let changed = String::from_utf8(bytes).unwrap().replace("\"i\":2", "\"i\":7");
        std::fs::write(&path, changed).unwrap();
        let mut follower = Follower::new(path);
        assert_eq!((follower.read_to(3).unwrap().len(), &follower.head().fault), (3, &None));
        assert_eq!(follower.read_to(4).unwrap().len(), 0);
        assert!(follower.head().fault.as_ref().is_some_and(|fault| fault.starts_with("line 4")));
    }

    #[test]
    fn a_changed_removed_or_added_line_is_reported_with_its_number() {
        let directory = tempfile::tempdir().unwrap();
        let path = written(directory.path(), 4);
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<&str> = text.split_inclusive('\n').collect();
        let changed = text.replacen("\"i\":1", "\"i\":7", 1);
        let removed = [lines[0], lines[2], lines[3]].concat();
        let added = [lines[0], lines[0], lines[1]].concat();
        for (bad, line) in [(changed, "line 3"), (removed, "line 2"), (added, "line 2")] {
            std::fs::write(&path, bad).unwrap();
            let fault = read(&path).unwrap().head.fault.unwrap();
            assert!(fault.starts_with(line), "{fault}");
            assert!(matches!(Journal::open(&path, "s", true, machine()), Err(StoreError::Corrupt { .. })));
        }
    }
}
