//! What the checks before a session find, on made-up computers.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod host;

use host::Tree;
use rigd::cli::doctor::{clock, data};
use rigd::devices::inspect::{Finding, Grade, port, refusal, usb};
use rigd::store::Disk;
use std::io;
use std::path::Path;

fn of_grade(findings: &[Finding], grade: Grade) -> Vec<&Finding> {
    findings.iter().filter(|finding| finding.grade == grade).collect()
}

fn only_error(findings: &[Finding]) -> &Finding {
    let errors = of_grade(findings, Grade::Error);
    assert_eq!(errors.len(), 1, "{findings:?}");
    errors[0]
}

fn has(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "{text:?} does not say {part:?}");
    }
}

#[test]
fn a_free_port_is_well_and_a_missing_one_names_those_there_are() {
    let tree = Tree::new();
    let tty = tree.file("dev/ttyUSB0");
    let findings = port::look(&tree.host(), &tty);
    assert!(findings.len() == 1 && findings[0].grade == Grade::Ok, "{findings:?}");
    has(&findings[0].what, &["nobody else holds it"]);

    let missing = tty.with_file_name("ttyUSB9");
    let findings = port::look(&tree.host(), &missing);
    let error = only_error(&findings);
    assert_eq!((error.what.as_str(), error.place.as_str()), ("there is no such device", missing.to_str().unwrap()));
    has(error.remedy.as_ref().unwrap(), &["arm.port", "another number", "by-id", "/ttyUSB0"]);
    tree.link("dev/serial/by-id/usb-rigd_light_arm-if00", &tty);
    has(port::look(&tree.host(), &missing)[0].remedy.as_ref().unwrap(), &["by-id/usb-rigd_light_arm-if00"]);
    let lasting = tree.host().dev.join("serial/by-id/usb-gone");
    let remedy = port::look(&tree.host(), &lasting)[0].remedy.clone().unwrap();
    assert!(!remedy.contains("another number"), "{remedy}");
}

#[test]
fn a_port_that_may_not_be_used_says_which_group_may() {
    let mut tree = Tree::new();
    let tty = tree.file("dev/ttyACM0");
    tree.may_use = |_| false;
    let findings = port::look(&tree.host(), &tty);
    let error = only_error(&findings);
    has(&error.what, &["may not read and write", "mode 6", "group"]);
    has(error.remedy.as_ref().unwrap(), &["dialout"]);
    has(&refusal(&findings).unwrap(), &["may not read", "dialout"]);
}

#[test]
fn the_holder_of_a_port_is_named_also_behind_a_link_and_others_are_only_warned_of() {
    let tree = Tree::new();
    let (tty, other) = (tree.file("dev/ttyUSB0"), tree.file("dev/ttyUSB1"));
    let by_id = tree.link("dev/serial/by-id/arm", &tty);
    tree.process(812, "ModemManager", "/usr/sbin/ModemManager --debug", &[&tty]);
    tree.process(90, "brltty", "/usr/bin/brltty", &[&other]);
    // A thread of the kernel, and a process that opened nothing.
    tree.process(2, "kthreadd", "", &[]);
    tree.process(77, "bash", "-bash", &[]);
    let findings = port::look(&tree.host(), &by_id);
    let error = only_error(&findings);
    assert_eq!(error.what, "held by ModemManager (process 812)");
    has(error.remedy.as_ref().unwrap(), &["ID_MM_DEVICE_IGNORE"]);
    let warnings = of_grade(&findings, Grade::Warning);
    assert_eq!(warnings.len(), 1, "{findings:?}");
    has(&warnings[0].what, &["brltty (process 90)"]);
    has(warnings[0].remedy.as_ref().unwrap(), &["remove brltty"]);
    assert!(of_grade(&findings, Grade::Ok).is_empty());
}

#[test]
fn what_a_script_is_called_and_what_other_users_hide_is_told() {
    let tree = Tree::new();
    let tty = tree.file("dev/ttyUSB0");
    tree.process(5, "terminal.py", "/usr/bin/python3 /home/x/terminal.py", &[&tty]);
    assert_eq!(only_error(&port::look(&tree.host(), &tty)).what, "held by terminal.py (process 5)");
    let tree = Tree::new();
    let tty = tree.file("dev/ttyUSB0");
    tree.closed_process(6, "dbus-daemon");
    tree.closed_process(7, "cron");
    has(&port::look(&tree.host(), &tty)[0].what, &["nobody is known to hold it", "2 processes of other users"]);
}

#[test]
fn an_eos_5d_is_judged_by_its_usb_mode() {
    let tree = Tree::new();
    tree.usb(5, "04a9:3101", "ff", "Canon Digital Camera");
    let findings = usb::look(&tree.host(), None);
    assert!(findings.iter().all(|finding| finding.grade == Grade::Ok), "{findings:?}");
    assert_eq!(findings[0].place, "usb:001,005");
    has(&findings[0].what, &["normal mode", "04a9:3101"]);

    let tree = Tree::new();
    tree.usb(5, "04a9:3102", "06", "Canon Digital Camera");
    let findings = usb::look(&tree.host(), None);
    let error = only_error(&findings);
    has(&error.what, &["PTP mode", "04a9:3102", "cannot"]);
    has(error.remedy.as_ref().unwrap(), &["menu", "PC connection"]);
    // Whether a body in this mode can be used after all is the driver's to say.
    assert!(refusal(&usb::refusals(&tree.host(), None)).is_none());
}

#[test]
fn cameras_are_told_from_printers_and_from_each_other() {
    let tree = Tree::new();
    tree.usb(3, "04a9:1912", "ff", "LiDE 220 scanner");
    tree.usb(4, "046d:c31c", "03", "Keyboard");
    let findings = usb::look(&tree.host(), None);
    assert_eq!(only_error(&findings).what, "there is no camera on USB");
    tree.usb(7, "04b0:0422", "06", "NIKON DSC D700");
    tree.usb(8, "04a9:3199", "06", "Canon EOS 5D Mark II");
    let found: Vec<_> = usb::cameras(&tree.host()).into_iter().map(|camera| camera.port).collect();
    assert_eq!(found, ["usb:001,007", "usb:001,008"]);
    let findings = usb::look(&tree.host(), None);
    assert_eq!(findings.len(), 1, "{findings:?}");
    assert_eq!((findings[0].grade, findings[0].place.as_str()), (Grade::Warning, "camera.port"));
    assert!(usb::look(&tree.host(), Some("usb:001,008")).iter().all(|finding| finding.grade == Grade::Ok));
    let findings = usb::look(&tree.host(), Some("usb:001,005"));
    has(only_error(&findings).remedy.as_ref().unwrap(), &["usb:001,007", "usb:001,008"]);
    assert!(usb::refusals(&tree.host(), Some("usb:001,005")).is_empty());
}

#[test]
fn the_desktop_that_holds_a_camera_is_named_in_full_and_one_that_waits_is_warned_of() {
    let tree = Tree::new();
    let node = tree.usb(5, "04a9:3199", "06", "Canon EOS 5D Mark II");
    tree.process(1201, "gvfs-gphoto2-vo", "/usr/libexec/gvfs-gphoto2-volume-monitor", &[]);
    let findings = usb::look(&tree.host(), None);
    let warnings = of_grade(&findings, Grade::Warning);
    assert!(warnings.len() == 1 && of_grade(&findings, Grade::Error).is_empty(), "{findings:?}");
    has(&warnings[0].what, &["gvfs-gphoto2-volume-monitor (process 1201)"]);
    assert!(refusal(&usb::refusals(&tree.host(), None)).is_none());

    tree.process(1300, "gvfsd-gphoto2", "/usr/libexec/gvfsd-gphoto2 --spawner :1.4", &[&node]);
    let findings = usb::look(&tree.host(), None);
    let error = only_error(&findings);
    assert_eq!(error.what, "the camera is held by gvfsd-gphoto2 (process 1300)");
    has(error.remedy.as_ref().unwrap(), &["gio mount -s gphoto2", "mask"]);
    has(&refusal(&usb::refusals(&tree.host(), Some("usb:001,005"))).unwrap(), &["gvfsd-gphoto2", "gio mount"]);
}

#[test]
fn a_camera_that_may_not_be_used_says_what_gives_the_right() {
    let mut tree = Tree::new();
    let node = tree.usb(5, "04a9:3199", "06", "Canon EOS 5D Mark II");
    tree.may_use = |_| false;
    let findings = usb::look(&tree.host(), None);
    let error = only_error(&findings);
    assert_eq!(Path::new(&error.place), tree.host().dev.join("bus/usb/001/005"));
    assert!(node.exists());
    has(error.remedy.as_ref().unwrap(), &["udev", "plugdev"]);
    has(&refusal(&usb::refusals(&tree.host(), None)).unwrap(), &["USB device"]);
}

#[test]
fn the_clock_is_wrong_unset_or_set() {
    let tree = Tree::new();
    let at = |text: &str| clock::look(&tree.host(), text.parse().unwrap());
    let lost = at("1970-01-01T00:03:00Z");
    assert_eq!(lost.grade, Grade::Warning);
    has(&lost.what, &["1970-01-01"]);
    let unset = at("2027-03-01T20:00:00Z");
    assert_eq!(unset.grade, Grade::Warning);
    has(unset.remedy.as_ref().unwrap(), &["set-ntp"]);
    tree.file("run/systemd/timesync/synchronized");
    assert_eq!(at("2027-03-01T20:00:00Z").grade, Grade::Ok);
    assert_eq!(at("1970-01-01T00:03:00Z").grade, Grade::Warning);
}

#[derive(Debug)]
struct Free(u64);

impl Disk for Free {
    fn free_bytes(&self, _path: &Path) -> io::Result<u64> {
        Ok(self.0)
    }
}

#[test]
fn the_plan_of_the_paper_has_room_or_not() {
    let mut tree = Tree::new();
    let text = rig_config::SHIPPED.iter().find(|(name, _)| *name == "zheng-2008").unwrap().1;
    let mut rig = rig_config::Rig::from_toml(text, "zheng-2008").unwrap();
    rig.storage.data = tree.host().run.join("not/yet/there");
    rig.storage.reserve_bytes = 1_000_000_000;
    // 70 frames of 12.7 million pixels are at least some hundred MB; with seven radiance images of 28 bytes a pixel below 5 GB.
    let grade = |tree: &Tree, free: u64| data::room(&tree.host(), &rig, &Free(free)).grade;
    assert_eq!(grade(&tree, 5_000_000_000), Grade::Ok);
    assert_eq!(grade(&tree, 1_300_000_000), Grade::Error);
    has(&data::room(&tree.host(), &rig, &Free(500_000_000)).what, &["only 0.50 GB are free"]);
    assert!(!rig.storage.data.exists(), "looking made the directory");
    tree.may_use = |_| false;
    let finding = data::room(&tree.host(), &rig, &Free(u64::MAX));
    assert_eq!(finding.grade, Grade::Error);
    has(&finding.what, &["may not write to", "/run"]);
}
