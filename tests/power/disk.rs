//! A disk that loses power. It does everything for real in a directory, and beside that keeps what POSIX would still promise after a
//! cut: the bytes of a file as of its last sync, the names of a directory as of its last sync. What came later may have survived or not:
//! every change of a name by itself, the bytes of a file in part, with holes, in any mixture of before and after. [`PowerDisk::image`]
//! makes one of the disks that are possible then, chosen by a seed.

use super::turns::Turns;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rigd::store::{Disk, Existing, RealDisk};
use std::collections::{BTreeMap, HashMap};
use std::fs::{self, File};
use std::io;
use std::os::fd::AsRawFd;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

/// Tells a sync of this file or directory from one that the disk acknowledges and forgets: what a protocol without that sync would be.
pub type Forgets = fn(&Path) -> bool;

#[derive(Debug)]
pub struct PowerDisk {
    root: PathBuf,
    forgets: Forgets,
    turns: Arc<Turns>,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    /// Operations before the cut; none: the power stays.
    left: Option<u64>,
    /// Whether the operation that the cut meets still happens; nobody is told.
    in_flight: bool,
    off: bool,
    nodes: Vec<Node>,
    /// Nodes by the inode that a file or directory has at present.
    inodes: HashMap<u64, usize>,
    /// What the files held when the power went.
    last: HashMap<usize, Vec<u8>>,
    /// Every operation so far, in words.
    trace: Vec<String>,
}

/// What is on disk for certain.
#[derive(Debug)]
enum Node {
    File(Vec<u8>),
    Directory { names: BTreeMap<String, usize>, changes: Vec<Change> },
}

/// A change of a directory that was not forced to disk yet.
#[derive(Clone, Debug)]
enum Change {
    Link(String, usize),
    Unlink(String),
    Rename(String, String, usize),
    Exchange([(String, usize); 2]),
}

impl Change {
    fn apply(self, names: &mut BTreeMap<String, usize>) {
        match self {
            Self::Link(name, node) => drop(names.insert(name, node)),
            Self::Unlink(name) => drop(names.remove(&name)),
            Self::Rename(from, to, node) => {
                if names.get(&from) == Some(&node) {
                    names.remove(&from);
                }
                names.insert(to, node);
            }
            Self::Exchange([(a, node_a), (b, node_b)]) => names.extend([(a, node_b), (b, node_a)]),
        }
    }
}

impl PowerDisk {
    /// An empty disk whose file system begins at `root`.
    pub fn new(root: &Path, forgets: Forgets, turns: Arc<Turns>) -> Self {
        fs::create_dir(root).unwrap();
        let mut state = State::default();
        state.node(root).unwrap();
        Self { root: root.to_owned(), forgets, turns, state: Mutex::new(state) }
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
        let image = Self::new(root, self.forgets, self.turns.clone());
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

fn inode(path: &Path) -> io::Result<u64> {
    Ok(fs::symlink_metadata(path)?.ino())
}

fn name(path: &Path) -> String {
    path.file_name().unwrap().to_str().unwrap().to_owned()
}

/// The path under which an open file is known.
fn path_of(file: &File) -> PathBuf {
    fs::read_link(format!("/proc/self/fd/{}", file.as_raw_fd())).unwrap()
}

/// The names in a directory, in the order of the alphabet.
fn listed(directory: &Path) -> io::Result<Vec<PathBuf>> {
    let mut paths: Vec<PathBuf> = fs::read_dir(directory)?.map(|entry| Ok(entry?.path())).collect::<io::Result<_>>()?;
    paths.sort();
    Ok(paths)
}

impl State {
    /// The node at a path; one that something else than this disk made is new, and nothing of it is on disk for certain.
    fn node(&mut self, path: &Path) -> io::Result<usize> {
        let found = fs::symlink_metadata(path)?;
        if let Some(&node) = self.inodes.get(&found.ino()) {
            return Ok(node);
        }
        self.nodes.push(if found.is_dir() {
            Node::Directory { names: BTreeMap::new(), changes: Vec::new() }
        } else {
            Node::File(Vec::new())
        });
        self.inodes.insert(found.ino(), self.nodes.len() - 1);
        Ok(self.nodes.len() - 1)
    }

    /// The node at a path where something new was made: the inode may have been another file's.
    fn new_node(&mut self, path: &Path) -> io::Result<usize> {
        self.inodes.remove(&inode(path)?);
        self.node(path)
    }

    fn change(&mut self, directory: &Path, change: Change) -> io::Result<()> {
        let node = self.node(directory)?;
        if let Node::Directory { changes, .. } = &mut self.nodes[node] {
            changes.push(change);
        }
        Ok(())
    }

    fn link(&mut self, path: &Path) -> io::Result<()> {
        let node = self.new_node(path)?;
        self.change(path.parent().unwrap(), Change::Link(name(path), node))
    }

    fn forget_inodes(&mut self, path: &Path) -> io::Result<()> {
        if path.is_dir() {
            for entry in listed(path)? {
                self.forget_inodes(&entry)?;
                self.change(path, Change::Unlink(name(&entry)))?;
            }
        }
        self.inodes.remove(&inode(path)?);
        Ok(())
    }

    /// Notes what the files hold now, and what lies there that this disk was never told of.
    fn remember(&mut self, path: &Path) {
        let node = self.node(path).unwrap();
        if path.is_file() {
            self.last.insert(node, fs::read(path).unwrap());
            return;
        }
        let mut now = BTreeMap::new();
        if let Node::Directory { names, changes } = &self.nodes[node] {
            now.clone_from(names);
            changes.iter().cloned().for_each(|change| change.apply(&mut now));
        }
        for entry in listed(path).unwrap() {
            self.remember(&entry);
            let found = self.node(&entry).unwrap();
            if now.get(&name(&entry)) != Some(&found) {
                self.change(path, Change::Link(name(&entry), found)).unwrap();
            }
        }
    }

    /// Puts what may have survived of `node` at `path`.
    fn build(&self, node: usize, path: &Path, random: &mut StdRng, likely: f64, into: &mut Self) {
        let made = match &self.nodes[node] {
            Node::File(synced) => {
                let bytes = survived(synced, self.last.get(&node), random);
                fs::write(path, &bytes).unwrap();
                Node::File(bytes)
            }
            Node::Directory { names, changes } => {
                let mut names = names.clone();
                for change in changes.iter().filter(|_| random.random_bool(likely)) {
                    change.clone().apply(&mut names);
                }
                let _ = fs::create_dir(path);
                let child = |(name, node): (String, usize)| {
                    let path = path.join(&name);
                    self.build(node, &path, random, likely, into);
                    let made = into.node(&path).unwrap();
                    (name, made)
                };
                Node::Directory { names: names.into_iter().map(child).collect(), changes: Vec::new() }
            }
        };
        let at = into.new_node(path).unwrap();
        into.nodes[at] = made;
    }
}

/// Bytes of a file after a cut, of what was forced to disk and what it held at last. One draw decides, whatever the lengths are: a
/// journal's depend on the time of day.
fn survived(synced: &[u8], last: Option<&Vec<u8>>, random: &mut StdRng) -> Vec<u8> {
    let mut random = StdRng::seed_from_u64(random.random());
    let Some(last) = last.filter(|last| *last != synced) else { return synced.to_vec() };
    let mut within = |from: usize, to: usize| from + ((to + 1 - from) as f64 * random.random::<f64>()) as usize;
    match within(0, 3) {
        0 => synced.to_vec(),
        1 => last.clone(),
        2 => {
            let torn = within(0, last.len());
            last[..torn].iter().chain(synced.iter().skip(torn)).copied().collect()
        }
        _ => {
            let length = within(synced.len().min(last.len()), synced.len().max(last.len()));
            let mut bytes = Vec::new();
            while bytes.len() < length {
                let end = (bytes.len() + within(1, 64)).min(length);
                let source = if within(0, 1) == 0 { synced } else { last };
                // Where a file grew and the bytes did not come, there are zeros.
                bytes.extend((bytes.len()..end).map(|at| source.get(at).copied().unwrap_or(0)).collect::<Vec<_>>());
            }
            bytes
        }
    }
}

impl Disk for PowerDisk {
    fn free_bytes(&self, _path: &Path) -> io::Result<u64> {
        Ok(u64::MAX)
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
