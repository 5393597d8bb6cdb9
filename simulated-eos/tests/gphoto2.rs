//! The stock `gphoto2` program against the simulated body. Where the program is not installed these tests do nothing and say so;
//! `make test` installs it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod support;

use simulated_eos::{BodyOptions, Fault, Moment, PictureKind, Release, Server};
use std::fs;
use std::io::Write;
use std::process::{Command, Output};
use support::{expected, server};
use tempfile::TempDir;

/// The program with a home and a working directory of its own.
struct Gphoto2 {
    port: String,
    directory: TempDir,
}

impl Gphoto2 {
    /// None, with a word on stderr, if there is no such program.
    fn on(server: &Server) -> Option<Self> {
        if Command::new("gphoto2").arg("--version").output().is_err() {
            // Past the test harness, which keeps what a passing test says with a macro to itself.
            let words = "SKIPPED: the program gphoto2 is not installed: the simulated camera was not tried with it";
            let _ = writeln!(std::io::stderr(), "{words}");
            return None;
        }
        Some(Self { port: server.gphoto2_port(), directory: tempfile::tempdir().unwrap() })
    }

    fn run(&self, arguments: &[&str]) -> Output {
        // Without an end of its own the program would wait as long as the camera lets it.
        let output = Command::new("timeout")
            .args(["120", "gphoto2", "--port", &self.port, "--camera", "PTP/IP Camera"])
            .args(arguments)
            .current_dir(self.directory.path())
            .env("HOME", self.directory.path())
            .env("LANG", "C")
            .output();
        output.unwrap()
    }

    /// What it prints when it succeeds.
    fn say(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{arguments:?}: {text}{}", String::from_utf8_lossy(&output.stderr));
        text
    }

    fn file(&self, name: &str) -> String {
        fs::read_to_string(self.directory.path().join(name)).unwrap()
    }
}

#[test]
fn it_says_who_it_is_and_what_can_be_set() {
    let server = server(BodyOptions { serial: "0456102345".into(), ..BodyOptions::default() });
    let Some(gphoto2) = Gphoto2::on(&server) else { return };
    let summary = gphoto2.say(&["--summary"]);
    for words in ["Model: Canon EOS 5D Mark II", "Serial Number: 0456102345", "Canon EOS Capture"] {
        assert!(summary.contains(words), "no `{words}` in:\n{summary}");
    }
    let list = gphoto2.say(&["--list-config"]);
    for key in ["shutterspeed", "aperture", "iso", "imageformat", "capturetarget", "availableshots", "eosserialnumber"]
    {
        assert!(list.contains(&format!("/{key}\n")), "no {key} in:\n{list}");
    }
    let shutter = gphoto2.say(&["--get-config", "shutterspeed"]);
    assert!(shutter.contains("Current: 1/100\n"), "{shutter}");
    let offered: Vec<&str> =
        shutter.lines().filter_map(|line| line.strip_prefix("Choice: ")?.split(' ').nth(1)).collect();
    assert_eq!(offered.len(), 55);
    // libgphoto2 labels two third stops differently from the body's display.
    assert_eq!(offered[..9], ["30", "25", "20", "15", "13", "10.3", "8", "6.3", "5"]);
    assert_eq!(offered[54], "1/8000");
    let iso = gphoto2.say(&["--get-config", "iso"]);
    assert!(iso.contains("Choice: 0 100\n") && iso.contains("Choice: 18 6400\n"), "{iso}");
    let format = gphoto2.say(&["--get-config", "imageformat"]);
    for name in ["Large Fine JPEG", "RAW", "RAW + Large Fine JPEG"] {
        assert!(format.contains(&format!(" {name}\n")), "no {name} in:\n{format}");
    }
    // A home of its own means shots to memory, whose number is another.
    gphoto2.say(&["--set-config-value", "capturetarget=Memory card"]);
    assert!(gphoto2.say(&["--get-config", "eosserialnumber"]).contains("Current: 0456102345\n"));
    assert!(gphoto2.say(&["--get-config", "availableshots"]).contains("Current: 500\n"));
    assert!(gphoto2.say(&["--get-config", "batterylevel"]).contains("Current: 100%\n"));
}

#[test]
fn a_bracket_of_ten_exposures_arrives_whole() {
    for release in [Release::Buttons, Release::Command] {
        let server = server(BodyOptions { release, ..BodyOptions::default() });
        let Some(gphoto2) = Gphoto2::on(&server) else { return };
        gphoto2.say(&["--set-config-value", "capturetarget=Memory card"]);
        let bracket = ["1/100", "1/50", "1/25", "1/10", "1/5", "0.4", "1", "2.5", "6.3", "15"];
        let mut arguments = vec!["--set-config-value", "aperture=5.6"];
        let settings = bracket.map(|label| format!("shutterspeed={label}"));
        for setting in &settings {
            arguments.extend(["--set-config-value", setting, "--capture-image-and-download", "--keep"]);
        }
        gphoto2.say(&arguments);
        let files = fs::read_dir(gphoto2.directory.path()).unwrap();
        let mut names: Vec<String> = files.map(|file| file.unwrap().file_name().into_string().unwrap()).collect();
        names.retain(|name| name.ends_with(".JPG"));
        names.sort();
        assert_eq!(names.len(), 10, "{names:?}");
        for (index, (name, label)) in names.iter().zip(bracket).enumerate() {
            let display = if label == "6.3" { "6" } else { label };
            let frame = u32::try_from(index + 1).unwrap();
            assert_eq!(gphoto2.file(name), expected(frame, display, "5.6", 100, PictureKind::Jpeg), "{name}");
        }
    }
}

#[test]
fn a_capture_to_memory_leaves_the_card_empty() {
    let server = server(BodyOptions::default());
    let Some(gphoto2) = Gphoto2::on(&server) else { return };
    gphoto2.say(&["--set-config-value", "capturetarget=Internal RAM"]);
    gphoto2.say(&["--set-config-value", "imageformat=RAW", "--capture-image-and-download", "--filename", "file.cr2"]);
    assert_eq!(gphoto2.file("file.cr2"), expected(1, "1/100", "5.6", 100, PictureKind::Raw));
    let listed = gphoto2.say(&["--list-files"]);
    assert!(!listed.contains("IMG_"), "{listed}");
}

#[test]
fn faults_reach_the_program() {
    let server = server(BodyOptions::default());
    let Some(gphoto2) = Gphoto2::on(&server) else { return };
    // To memory, a camera that never has shots available keeps libgphoto2 2.5.30 in an endless loop (config.c:358).
    gphoto2.say(&["--set-config-value", "capturetarget=Memory card"]);
    let capture = ["--capture-image"];
    let fails_with = |fault, words: &str| {
        server.faults().inject(fault, 1);
        let text = String::from_utf8_lossy(&gphoto2.run(&capture).stderr).into_owned();
        assert!(text.contains(words), "{fault:?}: {text}");
    };
    fails_with(Fault::Busy(Moment::Release), "I/O in progress");
    fails_with(Fault::CardFull, "0x200c");
    fails_with(Fault::LinkDrop(Moment::Release), "Error");
    gphoto2.say(&capture);
    assert!(server.faults().all_struck());
}
