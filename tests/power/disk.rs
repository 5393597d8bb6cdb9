//! A disk that loses power. It does everything for real in a directory, and beside that keeps what POSIX would still promise after a
//! cut: the bytes of a file as of its last sync, the names of a directory as of its last sync. What came later may have survived or not:
//! every change of a name by itself, the bytes of a file in part, with holes, in any mixture of before and after. [`PowerDisk::image`]
//! makes one of the disks that are possible then, chosen by a seed.

use super::clock::VirtualClock;
use super::faults::Chance;
use super::state::{Change, Node, State, inode, listed, name};
use super::turns::Turns;
use rand::RngExt;
use rand::rngs::StdRng;
use rigd::store::{Disk, Existing, RealDisk};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

/// Tells a sync of this file or directory from one that the disk acknowledges and forgets: what a protocol without that sync would be.
pub type Forgets = fn(&Path) -> bool;

#[derive(Debug)]
pub struct PowerDisk {
    root: PathBuf,
    forgets: Forgets,
    turns: Arc<Turns>,
    clock: Arc<VirtualClock>,
    chance: Arc<Chance>,
    state: Mutex<State>,
}

impl PowerDisk {
    /// An empty disk whose file system begins at `root`.
    pub fn new(
        root: &Path,
        forgets: Forgets,
        turns: Arc<Turns>,
        clock: Arc<VirtualClock>,
        chance: Arc<Chance>,
    ) -> Self {
        fs::create_dir(root).unwrap();
        let mut state = State::default();
        state.node(root).unwrap();
        Self { root: root.to_owned(), forgets, turns, clock, chance, state: Mutex::new(state) }
    }

    /// The power goes at the operation after the next `left`.
    pub fn arm(&self, left: Option<u64>, in_flight: bool) {
        let mut state = self.lock();
        (state.left, state.in_flight) = (left, in_flight);
    }

    pub fn is_off(&self) -> bool {
        self.lock().off
    }

    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Every operation so far; sessions are called ID, for theirs is new each time.
    pub fn trace(&self) -> Vec<String> {
        let plain = |part: &str| match part.len() {
            36 => "ID".to_owned(),
            41 if part.starts_with(".new-") => ".new-ID".to_owned(),
            _ => part.to_owned(),
        };
        let told = |line: &String| line.split('/').map(plain).collect::<Vec<_>>().join("/");
        self.lock().trace.iter().map(told).collect()
    }

    /// The same disk, from now on forgetting these syncs.
    pub fn forgetting(self, forgets: Forgets) -> Self {
        Self { forgets, ..self }
    }

    /// The same disk in a machine of other turns.
    pub fn with_turns(self, turns: Arc<Turns>) -> Self {
        Self { turns, ..self }
    }

    /// One of the disks that may be found at `root` when the power is back.
    pub fn image(&self, random: &mut StdRng, root: &Path) -> Self {
        let mut state = self.lock();
        if !state.off {
            state.remember(&self.root);
        }
        let image = Self::new(root, self.forgets, self.turns.clone(), self.clock.clone(), self.chance.clone());
        let likely = [0.0, 0.2, 0.5, 0.8, 1.0][random.random_range(0..5)];
        let top = state.inodes[&inode(&self.root).unwrap()];
        state.build(top, root, random, likely, &mut image.lock());
        image
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap()
    }

    fn step<T>(
        &self,
        what: &str,
        path: &Path,
        bytes: &[u8],
        work: impl FnOnce(&mut State) -> io::Result<T>,
    ) -> io::Result<T> {
        let mut state = self.lock();
        let off = || Err(io::Error::other("the power is off"));
        if state.off {
            return off();
        }
        state.trace.push(format!("{what} /{}", path.strip_prefix(&self.root).unwrap_or(path).display()));
        if state.left == Some(0) {
            if state.in_flight {
                let _ = work(&mut state);
            }
            state.remember(&self.root);
            state.off = true;
            drop(state);
            self.clock.stop();
            self.turns.end();
            return off();
        }
        state.left = state.left.map(|left| left - 1);
        let done = work(&mut state)?;
        drop(state);
        self.turns.passed(bytes);
        Ok(done)
    }
}

/// The path under which an open file is known.
fn path_of(file: &File) -> PathBuf {
    fs::read_link(format!("/proc/self/fd/{}", file.as_raw_fd())).unwrap()
}

impl Disk for PowerDisk {
    fn free_bytes(&self, _path: &Path) -> io::Result<u64> {
        let mut state = self.lock();
        state.full = match state.full {
            0 => self.chance.disk().unwrap_or(0),
            looks => looks - 1,
        };
        Ok(if state.full > 0 { 0 } else { u64::MAX })
    }

    fn make_directory(&self, path: &Path) -> io::Result<()> {
        self.step("make directory", path, &[], |state| {
            RealDisk.make_directory(path)?;
            state.link(path)
        })
    }

    fn create(&self, path: &Path) -> io::Result<File> {
        self.step("create", path, &[], |state| {
            let file = RealDisk.create(path)?;
            state.link(path)?;
            Ok(file)
        })
    }

    fn write(&self, file: &mut File, bytes: &[u8]) -> io::Result<()> {
        self.step("write", &path_of(file), bytes, |_| RealDisk.write(file, bytes))
    }

    fn cut(&self, file: &mut File, length: u64) -> io::Result<()> {
        self.step("cut", &path_of(file), &[], |_| RealDisk.cut(file, length))
    }

    fn sync(&self, file: &File) -> io::Result<()> {
        let path = path_of(file);
        self.step("sync", &path, &[], |state| {
            if !(self.forgets)(&path) {
                let node = state.node(&path)?;
                state.nodes[node] = Node::File(fs::read(&path)?);
            }
            Ok(())
        })
    }

    fn rename(&self, from: &Path, to: &Path, existing: Existing) -> io::Result<()> {
        assert_eq!(from.parent(), to.parent(), "this model knows renames within a directory");
        self.step("rename", to, &[], |state| {
            let node = state.node(from)?;
            let other = to.exists().then(|| state.node(to)).transpose()?;
            RealDisk.rename(from, to, existing)?;
            let (from, name) = (name(from), name(to));
            let change = match (existing, other) {
                (Existing::Exchanged, Some(other)) => Change::Exchange([(from, node), (name, other)]),
                _ => Change::Rename(from, name, node),
            };
            state.change(to.parent().unwrap(), change)
        })
    }

    fn sync_directory(&self, directory: &Path) -> io::Result<()> {
        self.step("sync directory", directory, &[], |state| {
            let mut synced = BTreeMap::new();
            for entry in listed(directory)? {
                synced.insert(name(&entry), state.node(&entry)?);
            }
            let node = state.node(directory)?;
            if !(self.forgets)(directory) {
                state.nodes[node] = Node::Directory { names: synced, changes: Vec::new() };
            }
            Ok(())
        })
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.step("remove", path, &[], |state| {
            state.forget_inodes(path)?;
            RealDisk.remove(path)?;
            state.change(path.parent().unwrap(), Change::Unlink(name(path)))
        })
    }

    fn remove_directory(&self, path: &Path) -> io::Result<()> {
        self.step("remove directory", path, &[], |state| {
            state.forget_inodes(path)?;
            RealDisk.remove_directory(path)?;
            state.change(path.parent().unwrap(), Change::Unlink(name(path)))
        })
    }
}
