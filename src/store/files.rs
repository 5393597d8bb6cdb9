//! Files of others read and files of ours written: what is no regular file or too large is never opened, and a file appears
//! under its name whole or not at all.

use std::collections::HashSet;
use std::fs::{File, FileType};
use std::io::{ErrorKind, Read};
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::{Path, PathBuf};

/// Largest text file read, bytes: a dataset of a thousand lights has 0.2 million.
const LARGEST_TEXT: u64 = 16 << 20;

/// What stands before the name of a file until it is whole; the ending stays, for it tells encoders the format.
pub(super) const UNFINISHED: &str = ".unfinished-";

/// A file, whatever it is called: device and inode.
pub type Identity = (u64, u64);

/// Which file this path leads to; none if there is none.
pub fn identity(path: &Path) -> Option<Identity> {
    std::fs::metadata(path).ok().map(|found| (found.dev(), found.ino()))
}

/// A path as messages show it: control characters, which could rewrite a terminal, as escapes.
pub fn shown(path: &Path) -> String {
    escaped(&path.display().to_string())
}

/// A name out of a file as messages show it: control characters as escapes.
pub fn escaped(name: &str) -> String {
    name.chars().flat_map(|c| if c.is_control() { c.escape_default().collect() } else { vec![c] }).collect()
}

/// Refuses what is not a regular file, before it is opened: a pipe without a writer would hang for ever, a device has no end.
/// Links are followed. The reason does not name the path; `what` is what the file should be: "image".
///
/// # Errors
/// What stands there instead.
pub fn check_regular(path: &Path, what: &str) -> Result<(), String> {
    match std::fs::metadata(path) {
        Ok(found) if found.is_file() => Ok(()),
        Ok(found) => Err(format!("this is {}, not a file: give the file of the {what}", kind(found.file_type()))),
        Err(error) => Err(absence(path, what, &error)),
    }
}

/// What something is that is no regular file.
fn kind(found: FileType) -> &'static str {
    if found.is_dir() {
        "a directory"
    } else if found.is_fifo() {
        "a pipe (FIFO)"
    } else if found.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}

fn absence(path: &Path, what: &str, error: &std::io::Error) -> String {
    if error.kind() != ErrorKind::NotFound {
        // A loop of links, a folder that may not be entered, a name too long: the system's own words tell.
        return format!("the {what} cannot be reached ({error}): correct the path");
    }
    match std::fs::read_link(path) {
        Ok(target) => {
            format!("this link points to {}, where nothing is: mend the link or put the {what} there", shown(&target))
        }
        Err(_) => format!("there is no such {what}: put it there, or correct the path"),
    }
}

/// Bytes of a regular file of at most `most` bytes. The reason does not name the path.
///
/// # Errors
/// It is no regular file, is larger, or cannot be read.
pub fn read_bytes(path: &Path, what: &str, most: u64) -> Result<Vec<u8>, String> {
    check_regular(path, what)?;
    let mut bytes = Vec::new();
    let read = File::open(path).and_then(|file| file.take(most.saturating_add(1)).read_to_end(&mut bytes));
    read.map_err(|e| format!("the {what} cannot be read: {e}"))?;
    if bytes.len() as u64 > most {
        return Err(format!("larger than {most} bytes: this is no {what}"));
    }
    Ok(bytes)
}

/// Text of a regular file of bounded size: the one way in which descriptions and lists are read. The reason does not name
/// the path.
///
/// # Errors
/// It is no regular file, is too large, cannot be read, or is not UTF-8.
pub fn read_text(path: &Path, what: &str) -> Result<String, String> {
    String::from_utf8(read_bytes(path, what, LARGEST_TEXT)?).map_err(|e| {
        let line = 1 + e.as_bytes()[..e.utf8_error().valid_up_to()].iter().filter(|&&byte| byte == b'\n').count();
        format!("line {line} is not UTF-8: save the file as UTF-8 text")
    })
}

/// Files of a directory that are being written beside the names they will have. Dropped unfinished, it removes them.
pub struct Unfinished {
    directory: PathBuf,
    names: Vec<String>,
}

impl Unfinished {
    /// No file yet.
    pub fn within(directory: &Path) -> Self {
        Self { directory: directory.to_owned(), names: Vec::new() }
    }

    /// Where to write the file that will be called `name`.
    pub fn path(&mut self, name: &str) -> PathBuf {
        self.names.push(name.to_owned());
        self.directory.join(format!("{UNFINISHED}{name}"))
    }

    /// Gives every file its name, in the order in which they were begun. The last one seals the others: while they change,
    /// none of its name is there.
    ///
    /// # Errors
    /// The first path that could not be named, and why.
    pub fn finish(mut self) -> Result<(), (PathBuf, std::io::Error)> {
        let names = std::mem::take(&mut self.names);
        if let [_, .., seal] = names.as_slice() {
            let seal = self.directory.join(seal);
            match std::fs::remove_file(&seal) {
                Err(e) if e.kind() != ErrorKind::NotFound => {
                    self.names = names;
                    return Err((seal, e));
                }
                _ => {}
            }
        }
        for (done, name) in names.iter().enumerate() {
            let path = self.directory.join(name);
            if let Err(error) = std::fs::rename(self.directory.join(format!("{UNFINISHED}{name}")), &path) {
                self.names = names[done..].to_vec();
                return Err((path, error));
            }
        }
        Ok(())
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        for name in &self.names {
            // Half a file only takes room; if it cannot be removed, its name says what it is.
            let _ = std::fs::remove_file(self.directory.join(format!("{UNFINISHED}{name}")));
        }
    }
}

/// Makes `directory` ready for files of these names, before work is spent on them: it is there and can be written, no name
/// is taken by something else than a file, and none is one of the `inputs`, whatever links lead there.
///
/// # Errors
/// The path at fault, and why.
pub fn make_ready<'a>(
    directory: &Path,
    names: impl IntoIterator<Item = &'a str>,
    inputs: &[PathBuf],
) -> Result<(), (PathBuf, String)> {
    std::fs::create_dir_all(directory)
        .map_err(|e| (directory.to_owned(), format!("no directory for the result: {e}; give another --out")))?;
    let inputs: HashSet<Identity> = inputs.iter().filter_map(|path| identity(path)).collect();
    for name in names {
        for path in [directory.join(name), directory.join(format!("{UNFINISHED}{name}"))] {
            if identity(&path).is_some_and(|file| inputs.contains(&file)) {
                return Err((
                    path,
                    "this file is read as input and would be written over: give another --out".to_owned(),
                ));
            }
            match path.symlink_metadata() {
                Ok(found) if !found.is_file() && !found.is_symlink() => {
                    let kind = kind(found.file_type());
                    return Err((
                        path,
                        format!("this is {kind} where a file belongs: remove it or give another --out"),
                    ));
                }
                _ => {}
            }
        }
        // Permissions do not tell all (a file system may be mounted to be read only): a trial does.
        let trial = directory.join(format!("{UNFINISHED}{name}"));
        // What an earlier try left is unlinked, never opened: it may be a link to somebody's file.
        match std::fs::remove_file(&trial) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
            _ => File::create_new(&trial).and_then(|_| std::fs::remove_file(&trial)),
        }
        .map_err(|e| (directory.to_owned(), format!("no file can be written here: {e}; give another --out")))?;
    }
    Ok(())
}
