//! A bracket that the stock `gphoto2` program shoots on the served EOS is the bracket that the simulated camera shoots by itself: merged, the
//! radiance agrees to 1e-6. Where the program is not installed the test does nothing and says so; `make test` installs it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rigd::store::exr::read_radiance;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};

const STATION: &str = "2";
/// The plan's bracket as ptp2 labels it: its "6" is the half stop.
const LABELS: [&str; 10] = ["1/100", "1/40", "1/20", "1/8", "1/4", "0.6", "1.3", "3.2", "6.3", "15"];

struct Served(Child);

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn rigd(args: &[&str]) {
    let output = Command::new(env!("CARGO_BIN_EXE_rigd")).args(args).output().unwrap();
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_bracket_of_the_stock_program_merges_to_the_same_radiance() {
    if Command::new("gphoto2").arg("--version").output().is_err() {
        // Past the test harness, which keeps what a passing test says with a macro to itself.
        let _ =
            writeln!(std::io::stderr(), "SKIPPED: the program gphoto2 is not installed: no bracket was shot with it");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (_, text) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated").unwrap();
    fs::write(path("rig.toml"), text.replace("speed = 40.0", "speed = 400.0")).unwrap();
    rigd(&["simulate", "camera", "--config", &path("rig.toml"), "--station", STATION, "--out", &path("direct")]);

    let served = Command::new(env!("CARGO_BIN_EXE_rigd"))
        .args(["simulate", "camera", "--config", &path("rig.toml"), "--station", STATION, "--serve", "0"])
        .stdout(Stdio::piped())
        .spawn();
    let mut served = Served(served.unwrap());
    let mut port = String::new();
    BufReader::new(served.0.stdout.take().unwrap()).read_line(&mut port).unwrap();
    fs::create_dir(path("shot")).unwrap();
    for (i, label) in LABELS.iter().enumerate() {
        let output = Command::new("timeout")
            .args(["120", "gphoto2", "--port", port.trim(), "--camera", "PTP/IP Camera"])
            .args(["--set-config-value", &format!("shutterspeed={label}"), "--capture-image-and-download"])
            .args(["--filename", &format!("shot/00{STATION}-{i:02}.jpg")])
            .current_dir(folder.path())
            .env("HOME", folder.path())
            .env("LANG", "C")
            .output()
            .unwrap();
        assert!(output.status.success(), "{label}: {}", String::from_utf8_lossy(&output.stderr));
    }
    fs::copy(path("direct/exposures.toml"), path("shot/exposures.toml")).unwrap();
    for bracket in ["direct", "shot"] {
        rigd(&["merge", &path(bracket), "--out", &path(&format!("{bracket}.exr"))]);
    }
    let radiance = |name: &str| read_radiance(Path::new(&path(name)), (288, 192)).unwrap();
    let (direct, shot) = (radiance("direct.exr"), radiance("shot.exr"));
    assert_eq!(direct.valid.pixels, shot.valid.pixels);
    assert!(direct.valid.pixels.iter().filter(|valid| **valid).count() > 8_000);
    for (a, b) in direct.radiance.pixels.iter().zip(&shot.radiance.pixels) {
        for c in 0..3 {
            assert!((a[c] - b[c]).abs() <= 1e-6 * a[c].abs(), "{a:?} {b:?}");
        }
    }
}
