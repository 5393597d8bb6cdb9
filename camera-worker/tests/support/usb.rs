//! A simulated USB bus under the real libgphoto2: its port driver, built with the system's compiler, asks the simulator.

use simulated_eos::{Body, Faults, UsbBus};
use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;
use tempfile::TempDir;

/// A bus that workers with [`Usb::environment`] see in place of the machine's own.
pub struct Usb {
    pub bus: UsbBus,
    socket: TempDir,
}

impl Usb {
    pub fn new(bodies: Vec<Body>) -> Self {
        let socket = tempfile::tempdir().unwrap();
        Self { bus: UsbBus::start(&socket.path().join("bus"), bodies).unwrap(), socket }
    }

    pub fn environment(&self) -> Vec<(String, String)> {
        let socket = self.socket.path().join("bus").display().to_string();
        vec![("IOLIBS".into(), iolibs().into()), ("SIMULATED_USB".into(), socket)]
    }

    /// Port of the first body.
    pub fn port(&self) -> String {
        self.bus.port(0).unwrap()
    }

    /// Faults of the first body.
    pub fn faults(&self) -> Faults {
        self.bus.faults(0).unwrap()
    }

    /// Processes that have this bus in their environment, by the kernel's word.
    pub fn hosts(&self) -> Vec<u32> {
        let mark = format!("SIMULATED_USB={}\0", self.socket.path().join("bus").display());
        let all =
            std::fs::read_dir("/proc").unwrap().filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok());
        let of_this = |process: &u32| {
            let environment = std::fs::read(format!("/proc/{process}/environ")).unwrap_or_default();
            environment.windows(mark.len()).any(|part| part == mark.as_bytes())
        };
        all.filter(of_this).collect()
    }
}

/// The directory of the driver alone, so that libgphoto2 has no other port.
fn iolibs() -> &'static str {
    static BUILT: OnceLock<String> = OnceLock::new();
    BUILT.get_or_init(|| {
        let directory = Path::new(env!("CARGO_TARGET_TMPDIR")).join("iolibs");
        std::fs::create_dir_all(&directory).unwrap();
        let new = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
        let library = new.path().join("simulated_usb.so");
        let flags = Command::new("pkg-config").args(["--cflags", "libgphoto2_port"]).output().unwrap();
        assert!(flags.status.success(), "pkg-config does not know libgphoto2_port: install libgphoto2-dev");
        let built = Command::new("cc")
            .args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-O1", "-shared", "-fPIC", "-o"])
            .arg(&library)
            .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/../simulated-eos/iolib/simulated_usb.c"))
            .args(String::from_utf8(flags.stdout).unwrap().split_whitespace())
            .status();
        assert!(built.unwrap().success());
        // Other test programs may be loading it.
        std::fs::rename(library, directory.join("simulated_usb.so")).unwrap();
        directory.display().to_string()
    })
}
