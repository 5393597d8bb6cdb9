//! A made-up computer in a folder: processes and what they have open, USB devices, serial ports.
#![allow(dead_code, clippy::unwrap_used)]

use rigd::devices::inspect::Host;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

pub struct Tree {
    folder: tempfile::TempDir,
    pub may_use: fn(&Path) -> bool,
}

impl Tree {
    /// Nothing runs and nothing is plugged in; every file may be used.
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        for name in ["proc", "sys", "dev", "run"] {
            fs::create_dir(folder.path().join(name)).unwrap();
        }
        Self { folder, may_use: |_| true }
    }

    pub fn host(&self) -> Host {
        let at = |name: &str| self.folder.path().join(name);
        Host { proc: at("proc"), sys: at("sys"), dev: at("dev"), run: at("run"), may_use: self.may_use }
    }

    /// An empty file below the root, its folders included.
    pub fn file(&self, name: &str) -> PathBuf {
        self.text(name, "")
    }

    pub fn text(&self, name: &str, text: &str) -> PathBuf {
        let path = self.folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, text).unwrap();
        path.canonicalize().unwrap()
    }

    pub fn link(&self, name: &str, target: &Path) -> PathBuf {
        let path = self.folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        symlink(target, &path).unwrap();
        path
    }

    /// A process as the kernel shows it: 15 characters of its name, its command line, its open files.
    pub fn process(&self, pid: u32, short: &str, line: &str, open: &[&Path]) {
        self.text(&format!("proc/{pid}/comm"), &format!("{short}\n"));
        self.text(&format!("proc/{pid}/cmdline"), &line.replace(' ', "\0"));
        self.link(&format!("proc/{pid}/fd/0"), Path::new("/dev/null"));
        for (number, path) in open.iter().enumerate() {
            self.link(&format!("proc/{pid}/fd/{}", number + 3), path);
        }
    }

    /// A process of another user: what it has open cannot be listed.
    pub fn closed_process(&self, pid: u32, name: &str) {
        self.text(&format!("proc/{pid}/comm"), &format!("{name}\n"));
        self.text(&format!("proc/{pid}/cmdline"), name);
        self.file(&format!("proc/{pid}/fd"));
    }

    /// A USB device with one interface; returns its device file.
    pub fn usb(&self, device: u32, id: &str, class: &str, product: &str) -> PathBuf {
        let (vendor, number) = id.split_once(':').unwrap();
        let folder = format!("sys/bus/usb/devices/1-{device}");
        for (name, text) in [
            ("idVendor", vendor),
            ("idProduct", number),
            ("busnum", "1"),
            ("devnum", &device.to_string()),
            ("product", product),
        ] {
            self.text(&format!("{folder}/{name}"), &format!("{text}\n"));
        }
        self.text(&format!("{folder}/1-{device}:1.0/bInterfaceClass"), &format!("{class}\n"));
        self.file(&format!("dev/bus/usb/001/{device:03}"))
    }
}
