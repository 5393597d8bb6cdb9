//! A disk that counts, fills up, and dies at a step.

use rigd::store::{Disk, Existing, RealDisk};
use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};

/// The real disk, except that it has as much room as a test says and dies at the step a test says.
#[derive(Debug)]
pub struct TestDisk {
    pub free: AtomicU64,
    /// Steps left before it is dead for good; negative: it lives.
    pub steps_left: AtomicI64,
    pub dead: AtomicBool,
    /// Nothing can be written, whatever `free` says.
    pub full: AtomicBool,
    pub steps: AtomicU64,
    /// How often the room was asked for.
    pub asked: AtomicU64,
}

impl Default for TestDisk {
    fn default() -> Self {
        Self {
            free: AtomicU64::new(u64::MAX),
            steps_left: AtomicI64::new(-1),
            dead: AtomicBool::new(false),
            full: AtomicBool::new(false),
            steps: AtomicU64::new(0),
            asked: AtomicU64::new(0),
        }
    }
}

impl TestDisk {
    fn step(&self) -> io::Result<RealDisk> {
        self.steps.fetch_add(1, Ordering::SeqCst);
        let left = self.steps_left.load(Ordering::SeqCst);
        if left == 0 {
            self.dead.store(true, Ordering::SeqCst);
        }
        if self.dead.load(Ordering::SeqCst) {
            return Err(io::Error::other("killed by the test"));
        }
        if left > 0 {
            self.steps_left.store(left - 1, Ordering::SeqCst);
        }
        Ok(RealDisk)
    }
}

impl Disk for TestDisk {
    fn free_bytes(&self, _path: &Path) -> io::Result<u64> {
        let free = self.free.load(Ordering::SeqCst);
        self.asked.fetch_add(1, Ordering::SeqCst);
        Ok(free)
    }
    fn make_directory(&self, path: &Path) -> io::Result<()> {
        self.step()?.make_directory(path)
    }
    fn create(&self, path: &Path) -> io::Result<File> {
        self.step()?.create(path)
    }
    fn write(&self, file: &mut File, bytes: &[u8]) -> io::Result<()> {
        let disk = self.step()?;
        if self.full.load(Ordering::SeqCst) {
            return Err(io::ErrorKind::StorageFull.into());
        }
        disk.write(file, bytes)
    }
    fn cut(&self, file: &mut File, length: u64) -> io::Result<()> {
        self.step()?.cut(file, length)
    }
    fn sync(&self, file: &File) -> io::Result<()> {
        self.step()?.sync(file)
    }
    fn rename(&self, from: &Path, to: &Path, existing: Existing) -> io::Result<()> {
        self.step()?.rename(from, to, existing)
    }
    fn sync_directory(&self, directory: &Path) -> io::Result<()> {
        self.step()?.sync_directory(directory)
    }
    fn remove(&self, path: &Path) -> io::Result<()> {
        self.step()?.remove(path)
    }
    fn remove_directory(&self, path: &Path) -> io::Result<()> {
        self.step()?.remove_directory(path)
    }
}
