//! BagIt bags (RFC 8493) of session directories: files are copied and hashed in one pass; what is no regular file is never opened.

use super::files::{UNFINISHED, check_regular, shown};
use crate::pipeline::export::archive::{DATA, DECLARATION, METADATA, Payload, manifest};
use nix::fcntl::OFlag;
use sha2::{Digest, Sha256};
use std::fs::{self, File, OpenOptions};
use std::io::{Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

/// Bytes copied at a time.
const PIECE: usize = 1 << 20;
/// Deepest folder of a session that is looked into; its own are one deep.
const DEEPEST: usize = 16;

/// What lies in a session directory.
#[derive(Debug, Default)]
pub struct Listed {
    /// Regular files, as paths inside it, sorted.
    pub files: Vec<String>,
    /// What is left out, and why.
    pub left_out: Vec<String>,
}

/// Lists a session directory. Links, pipes, sockets and devices are left out and told, and so are unfinished files, whose names
/// begin with a dot.
///
/// # Errors
/// The path at fault, and why it cannot be read.
pub fn list(directory: &Path) -> Result<Listed, String> {
    let mut listed = Listed::default();
    let mut folders = vec![(String::new(), 0)];
    while let Some((folder, depth)) = folders.pop() {
        let path = directory.join(&folder);
        let failed = |e: std::io::Error| format!("{}: {e}", shown(&path));
        for entry in fs::read_dir(&path).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let mut leave = |why: &str| {
                let name = path.strip_prefix(directory).unwrap_or(&path).join(entry.file_name());
                listed.left_out.push(format!("{}: {why}", shown(&name)));
            };
            let Ok(name) = entry.file_name().into_string() else {
                leave("its name is not UTF-8");
                continue;
            };
            let kind = entry.file_type().map_err(failed)?;
            if name.starts_with('.') {
                leave("an unfinished file");
            } else if kind.is_dir() && depth == DEEPEST {
                leave("a folder too deep inside others");
            } else if kind.is_dir() {
                folders.push((format!("{folder}{name}/"), depth + 1));
            } else if kind.is_file() {
                listed.files.push(format!("{folder}{name}"));
            } else {
                leave(if kind.is_symlink() { "a link" } else { "no regular file" });
            }
        }
    }
    listed.files.sort();
    listed.left_out.sort();
    if listed.files.iter().any(|file| file == METADATA) {
        return Err(format!(
            "{}: a crate has a file of this name of its own: rename it",
            shown(&directory.join(METADATA))
        ));
    }
    Ok(listed)
}

/// A bag that is being made beside the name it will have. Dropped unfinished, it is removed.
pub struct Bag {
    out: PathBuf,
    unfinished: PathBuf,
    payload: Vec<Payload>,
}

/// A path and what is wrong with it.
type Fault = (PathBuf, String);

fn at(path: &Path) -> impl Fn(std::io::Error) -> Fault + '_ {
    move |error| (path.to_owned(), error.to_string())
}

impl Bag {
    /// A bag that will be `out`, which is an empty directory or not there yet.
    ///
    /// # Errors
    /// There is something, or no directory can be made beside it.
    pub fn new(out: &Path) -> Result<Self, Fault> {
        if out.is_symlink() {
            return Err((out.to_owned(), "this is a link: give the directory itself as --out".to_owned()));
        }
        let empty = match fs::read_dir(out) {
            Ok(mut entries) => entries.next().is_none(),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => true,
            Err(error) => return Err((out.to_owned(), format!("{error}; give another --out"))),
        };
        if !empty {
            let reason = "there are files in it, and all files of a bag belong to it: give an empty directory as --out";
            return Err((out.to_owned(), reason.to_owned()));
        }
        let named = out.file_name().map(|name| name.to_string_lossy().into_owned());
        let Some(name) = named else {
            return Err((
                out.to_owned(),
                "it has no name of its own: give the path of a new directory as --out".to_owned(),
            ));
        };
        let parent = out.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        fs::create_dir_all(parent).map_err(at(parent))?;
        let unfinished = parent.join(format!("{UNFINISHED}{name}"));
        let reason = |e: std::io::Error| {
            (
                unfinished.clone(),
                format!(
                    "{e}: no bag can be made here; remove it if it is left of an earlier export, or give another --out"
                ),
            )
        };
        fs::create_dir(&unfinished).map_err(reason)?;
        let bag = Self { out: out.to_owned(), unfinished, payload: Vec::new() };
        let data = bag.unfinished.join(DATA);
        fs::create_dir(&data).map_err(at(&data))?;
        Ok(bag)
    }

    /// Copies a file of `directory` under the same path inside it, and takes its hash on the way.
    ///
    /// # Errors
    /// It cannot be read, is no regular file, or cannot be written.
    pub fn copy(&mut self, directory: &Path, path: &str) -> Result<(), Fault> {
        let (from, to) = (directory.join(path), self.unfinished.join(DATA).join(path));
        // Between the listing and here it may have become a link or a pipe: neither is opened for good.
        let flags = (OFlag::O_NOFOLLOW | OFlag::O_NONBLOCK).bits();
        check_regular(&from, "file").map_err(|reason| (from.clone(), reason))?;
        let mut source = OpenOptions::new().read(true).custom_flags(flags).open(&from).map_err(at(&from))?;
        if !source.metadata().map_err(at(&from))?.is_file() {
            return Err((from, "this is no regular file any more".to_owned()));
        }
        let folder = to.parent().unwrap_or(&self.unfinished);
        fs::create_dir_all(folder).map_err(at(folder))?;
        let mut target = File::create_new(&to).map_err(at(&to))?;
        let (mut hash, mut bytes, mut piece) = (Sha256::new(), 0, vec![0; PIECE]);
        loop {
            let read = source.read(&mut piece).map_err(at(&from))?;
            if read == 0 {
                break;
            }
            target.write_all(&piece[..read]).map_err(at(&to))?;
            hash.update(&piece[..read]);
            bytes += read as u64;
        }
        self.payload.push(Payload { path: path.to_owned(), bytes, sha256: hexadecimal(&hash.finalize()) });
        Ok(())
    }

    /// The files copied so far.
    pub fn payload(&self) -> &[Payload] {
        &self.payload
    }

    /// Adds the crate's description to the files, writes the tag files `tags` (name and text) beside those that every bag has, and gives
    /// the bag its name.
    ///
    /// # Errors
    /// A file cannot be written, or the bag not be named.
    pub fn finish(
        mut self,
        metadata: &str,
        information: impl Fn(&[Payload]) -> String,
        tags: &[(&str, &str)],
    ) -> Result<(), Fault> {
        let write = |name: &Path, text: &str| {
            let path = self.unfinished.join(name);
            fs::write(&path, text).map_err(at(&path))
        };
        write(&Path::new(DATA).join(METADATA), metadata)?;
        let described = Payload {
            path: METADATA.to_owned(),
            bytes: metadata.len() as u64,
            sha256: hexadecimal(&Sha256::digest(metadata.as_bytes())),
        };
        self.payload.push(described);
        let payload = manifest(self.payload.iter().map(|file| (file.sha256.as_str(), format!("{DATA}/{}", file.path))));
        let information = information(&self.payload);
        let own =
            [("manifest-sha256.txt", payload.as_str()), ("bag-info.txt", &information), ("bagit.txt", DECLARATION)];
        let mut hashes = Vec::new();
        for (name, text) in tags.iter().copied().chain(own) {
            write(Path::new(name), text)?;
            hashes.push((hexadecimal(&Sha256::digest(text.as_bytes())), name));
        }
        let tags = manifest(hashes.iter().map(|(hash, name)| (hash.as_str(), (*name).to_owned())));
        write(Path::new("tagmanifest-sha256.txt"), &tags)?;
        fs::rename(&self.unfinished, &self.out).map_err(at(&self.out))
    }
}

impl Drop for Bag {
    fn drop(&mut self) {
        // After it got its name there is nothing left to remove.
        let _ = fs::remove_dir_all(&self.unfinished);
    }
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
