//! What a disk that may lose power knows of its files and directories: what is on it for certain, and what came later.

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

#[derive(Debug, Default)]
pub struct State {
    /// Operations before the cut; none: the power stays.
    pub left: Option<u64>,
    /// Whether the operation that the cut meets still happens; nobody is told.
    pub in_flight: bool,
    pub off: bool,
    pub nodes: Vec<Node>,
    /// Nodes by the inode that a file or directory has at present.
    pub inodes: HashMap<u64, usize>,
    /// What the files held when the power went.
    pub last: HashMap<usize, Vec<u8>>,
    /// Every operation so far, in words.
    pub trace: Vec<String>,
    /// Looks at the room on it that still find none.
    pub full: u32,
}

/// What is on disk for certain.
#[derive(Debug)]
pub enum Node {
    File(Vec<u8>),
    Directory { names: BTreeMap<String, usize>, changes: Vec<Change> },
}

/// A change of a directory that was not forced to disk yet.
#[derive(Clone, Debug)]
pub enum Change {
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

pub fn inode(path: &Path) -> io::Result<u64> {
    Ok(fs::symlink_metadata(path)?.ino())
}

pub fn name(path: &Path) -> String {
    path.file_name().unwrap().to_str().unwrap().to_owned()
}

/// The names in a directory, in the order of the alphabet.
pub fn listed(directory: &Path) -> io::Result<Vec<PathBuf>> {
    let mut paths: Vec<PathBuf> = fs::read_dir(directory)?.map(|entry| Ok(entry?.path())).collect::<io::Result<_>>()?;
    paths.sort();
    Ok(paths)
}

impl State {
    /// The node at a path; one that something else than this disk made is new, and nothing of it is on disk for certain.
    pub fn node(&mut self, path: &Path) -> io::Result<usize> {
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
    pub fn new_node(&mut self, path: &Path) -> io::Result<usize> {
        self.inodes.remove(&inode(path)?);
        self.node(path)
    }

    pub fn change(&mut self, directory: &Path, change: Change) -> io::Result<()> {
        let node = self.node(directory)?;
        if let Node::Directory { changes, .. } = &mut self.nodes[node] {
            changes.push(change);
        }
        Ok(())
    }

    pub fn link(&mut self, path: &Path) -> io::Result<()> {
        let node = self.new_node(path)?;
        self.change(path.parent().unwrap(), Change::Link(name(path), node))
    }

    pub fn forget_inodes(&mut self, path: &Path) -> io::Result<()> {
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
    pub fn remember(&mut self, path: &Path) {
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
    pub fn build(&self, node: usize, path: &Path, random: &mut StdRng, likely: f64, into: &mut Self) {
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
/// journal's depend on the time of day where threads run as they like.
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
