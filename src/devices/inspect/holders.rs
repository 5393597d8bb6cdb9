//! Which processes have a file open, and which are known to take devices.

use super::Host;
use std::fmt;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

/// A running program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Process {
    /// Process number.
    pub pid: u32,
    /// Name of its program.
    pub name: String,
}

impl fmt::Display for Process {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (process {})", self.name, self.pid)
    }
}

/// Who has a file open.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Holders {
    /// Every process known to have it open, but this one.
    pub found: Vec<Process>,
    /// Processes whose open files this user may not see.
    pub unseen: usize,
}

impl Holders {
    /// "nobody holds it", as far as this user may know.
    pub fn none_in_words(&self) -> String {
        match self.unseen {
            0 => "nobody else holds it".into(),
            unseen => {
                format!("nobody is known to hold it ({unseen} processes of other users hide what they have open)")
            }
        }
    }
}

/// Programs that open serial ports of their own accord.
const PORT_TAKERS: &[&str] = &["ModemManager", "brltty"];
/// Programs that open cameras of their own accord.
const CAMERA_TAKERS: &[&str] = &["gvfs-gphoto2-volume-monitor", "gvfsd-gphoto2"];

/// A program that is being started has its parent's files for less than this.
const START: Duration = Duration::from_millis(50);

/// Who has `path` open, and keeps it so; links are followed.
pub fn of(host: &Host, path: &Path) -> Holders {
    let path = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
    let mut holders = at_this_moment(host, &path);
    if !holders.found.is_empty() {
        thread::sleep(START);
        let later = at_this_moment(host, &path);
        holders.found.retain(|process| later.found.contains(process));
    }
    holders
}

fn at_this_moment(host: &Host, path: &Path) -> Holders {
    let mut holders = Holders::default();
    for (process, directory) in processes(host) {
        match fs::read_dir(directory.join("fd")) {
            Ok(files) => {
                let mut targets = files.flatten().filter_map(|file| fs::read_link(file.path()).ok());
                if targets.any(|target| target == path) {
                    holders.found.push(process);
                }
            }
            // It has ended meanwhile.
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(_) => holders.unseen += 1,
        }
    }
    holders
}

/// Running programs that take serial ports.
pub fn port_takers(host: &Host) -> Vec<Process> {
    running(host, PORT_TAKERS)
}

/// Running programs that take cameras.
pub fn camera_takers(host: &Host) -> Vec<Process> {
    running(host, CAMERA_TAKERS)
}

/// How to get a device back from a program of this name, and keep it.
pub fn remedy(name: &str) -> String {
    match name {
        "ModemManager" => {
            "`sudo systemctl disable --now ModemManager`, or a udev rule for the device with ENV{ID_MM_DEVICE_IGNORE}=\"1\""
                .into()
        }
        "brltty" => "`sudo apt remove brltty`, unless a braille display is used".into(),
        "gvfs-gphoto2-volume-monitor" | "gvfsd-gphoto2" => {
            "`gio mount -s gphoto2`, then `systemctl --user mask --now gvfs-gphoto2-volume-monitor`".into()
        }
        "rigd" | "camera-worker" => "a session of another rigd runs: wait for its end, or stop that rigd".into(),
        _ => "close that program".into(),
    }
}

fn running(host: &Host, names: &[&str]) -> Vec<Process> {
    processes(host).into_iter().map(|(process, _)| process).filter(|p| names.contains(&p.name.as_str())).collect()
}

/// Every process but this one and the kernel's own, with its directory, by number.
fn processes(host: &Host) -> Vec<(Process, PathBuf)> {
    let entries = fs::read_dir(&host.proc).into_iter().flatten().flatten();
    let process = |entry: fs::DirEntry| {
        let pid: u32 = entry.file_name().to_str()?.parse().ok()?;
        let name = name(&entry.path())?;
        (pid != std::process::id()).then(|| (Process { pid, name }, entry.path()))
    };
    let mut all: Vec<_> = entries.filter_map(process).collect();
    all.sort_by_key(|(process, _)| process.pid);
    all
}

/// The kernel keeps 15 characters of a name; the command line has all of it, unless an interpreter runs the program. Threads of the
/// kernel have no command line.
fn name(directory: &Path) -> Option<String> {
    let short = fs::read_to_string(directory.join("comm")).ok()?.trim_end().to_owned();
    let line = fs::read(directory.join("cmdline")).ok()?;
    let first = String::from_utf8_lossy(line.split(|byte| *byte == 0).next()?).into_owned();
    if first.is_empty() {
        return None;
    }
    let program = first.rsplit('/').next().unwrap_or(&first);
    Some(if program.starts_with(&short) { program.to_owned() } else { short })
}
