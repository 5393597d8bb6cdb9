//! Every change that a session makes to a disk, one method each, so that a test can count them, refuse them, and tell what a power cut
//! would leave of them (`tests/power_cut.rs`). Reading needs no such care: what is there can be read. Encoders write their files on
//! their own; these come into play here when they are synced and named ([`super::keep`]).

use super::{StoreError, io_error};
use nix::fcntl::{AT_FDCWD, RenameFlags, renameat2};
use std::fmt::Debug;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::Path;

/// What a rename does to a file that has the new name already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// The renamed file takes its place.
    Replaced,
    /// Nothing: the rename is refused.
    Kept,
    /// The two exchange their names; the other one must be there.
    Exchanged,
}

/// The disk as the store changes it. A method does what the operating system does unless a test's disk overrides it.
///
/// What POSIX promises after a power cut: the bytes of a file once [`Disk::sync`] has returned for it, the names in a directory once
/// [`Disk::sync_directory`] has. Anything else may be there, in part or not at all, in any order.
pub trait Disk: Send + Sync + Debug {
    /// Bytes free for us on the file system of `path`.
    fn free_bytes(&self, path: &Path) -> io::Result<u64> {
        let stat = nix::sys::statvfs::statvfs(path)?;
        Ok(stat.blocks_available() * stat.fragment_size())
    }

    /// Makes a directory where none is.
    fn make_directory(&self, path: &Path) -> io::Result<()> {
        fs::create_dir(path)
    }

    /// Opens a new file; refused when the name is taken.
    fn create(&self, path: &Path) -> io::Result<File> {
        OpenOptions::new().write(true).create_new(true).open(path)
    }

    /// Writes where the last write ended.
    fn write(&self, file: &mut File, bytes: &[u8]) -> io::Result<()> {
        file.write_all(bytes)
    }

    /// Cuts a file to `length` bytes; the next write goes there.
    fn cut(&self, file: &mut File, length: u64) -> io::Result<()> {
        file.set_len(length)?;
        file.seek(SeekFrom::Start(length)).map(|_| ())
    }

    /// Forces the bytes of a file to disk.
    fn sync(&self, file: &File) -> io::Result<()> {
        file.sync_all()
    }

    /// Gives a file or a directory another name in its directory, in one step.
    fn rename(&self, from: &Path, to: &Path, existing: Existing) -> io::Result<()> {
        let flags = match existing {
            Existing::Replaced => RenameFlags::empty(),
            Existing::Kept => RenameFlags::RENAME_NOREPLACE,
            Existing::Exchanged => RenameFlags::RENAME_EXCHANGE,
        };
        Ok(renameat2(AT_FDCWD, from, AT_FDCWD, to, flags)?)
    }

    /// Forces the names in a directory to disk.
    fn sync_directory(&self, directory: &Path) -> io::Result<()> {
        File::open(directory)?.sync_all()
    }

    /// Removes a file.
    fn remove(&self, path: &Path) -> io::Result<()> {
        fs::remove_file(path)
    }

    /// Removes a directory with all that is in it.
    fn remove_directory(&self, path: &Path) -> io::Result<()> {
        fs::remove_dir_all(path)
    }
}

/// The operating system's disk.
#[derive(Clone, Copy, Debug, Default)]
pub struct RealDisk;

impl Disk for RealDisk {}

/// Forces a directory's names to disk.
pub(super) fn sync_directory(disk: &dyn Disk, directory: &Path) -> Result<(), StoreError> {
    disk.sync_directory(directory).map_err(|e| io_error("sync the directory", directory, &e))
}

/// Makes a directory and those it lies in, as far as they are not there; durable when this returns.
pub(super) fn make_directories(disk: &dyn Disk, path: &Path) -> Result<(), StoreError> {
    if path.is_dir() {
        return Ok(());
    }
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    make_directories(disk, parent)?;
    disk.make_directory(path).map_err(|e| io_error("create", path, &e))?;
    sync_directory(disk, parent)
}

/// Writes a new file and forces its bytes to disk.
pub(super) fn write_synced(disk: &dyn Disk, path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    let mut file = disk.create(path).map_err(|e| io_error("create", path, &e))?;
    disk.write(&mut file, bytes).map_err(|e| io_error("write", path, &e))?;
    disk.sync(&file).map_err(|e| io_error("sync", path, &e))
}

/// Removes a file that may be there.
pub(super) fn remove_if_there(disk: &dyn Disk, path: &Path) -> Result<(), StoreError> {
    match disk.remove(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(io_error("remove", path, &error)),
        _ => Ok(()),
    }
}
