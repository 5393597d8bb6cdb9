//! The camera on USB.

use super::{Finding, Host, any_error, holders};
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Vendor number of Canon.
const CANON: u16 = 0x04a9;
/// Product numbers that Canon gives to cameras; its printers and scanners have lower ones.
const CANON_CAMERAS: std::ops::RangeInclusive<u16> = 0x3000..=0x33ff;
/// The EOS 5D of 2005 as the old Canon protocol's camera, and as a PTP one.
const EOS_5D_NORMAL: (u16, u16) = (CANON, 0x3101);
const EOS_5D_PTP: (u16, u16) = (CANON, 0x3102);
/// USB class of still-image devices.
const STILL_IMAGE: &str = "06";

/// A camera that the kernel lists.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UsbCamera {
    /// Vendor and product number.
    pub id: (u16, u16),
    /// Product as it names itself.
    pub product: String,
    /// As libgphoto2 spells it: `usb:001,005`.
    pub port: String,
    /// Device file.
    pub node: PathBuf,
}

/// Every camera on USB, by port.
pub fn cameras(host: &Host) -> Vec<UsbCamera> {
    let entries = fs::read_dir(host.sys.join("bus/usb/devices")).into_iter().flatten().flatten();
    let mut all: Vec<UsbCamera> = entries.filter_map(|entry| camera(host, &entry.path())).collect();
    all.sort_by(|a, b| a.port.cmp(&b.port));
    all
}

/// The camera at `port` (any, without one): whether it is there, in a mode that can shoot, may be used, and is free. Nothing is opened.
pub fn look(host: &Host, port: Option<&str>) -> Vec<Finding> {
    let found = wanted(host, port);
    let mut findings = match &found[..] {
        [] => vec![missing(host, port)],
        [camera] => vec![mode(camera)].into_iter().chain(usable(host, camera)).collect(),
        several => {
            let all: Vec<&str> = several.iter().map(|camera| camera.port.as_str()).collect();
            let what = format!("there are {} cameras: {}", several.len(), all.join(", "));
            vec![Finding::warning("camera.port", what, "unplug the others, or say in the rig file which is meant")]
        }
    };
    for taker in holders::camera_takers(host) {
        if !findings.iter().any(|finding| finding.what.contains(&taker.to_string())) {
            let what = format!("{taker} runs and opens cameras when they are plugged in");
            findings.push(Finding::warning("USB", what, holders::remedy(&taker.name)));
        }
    }
    findings
}

/// What keeps the camera at `port` from being opened, if it is the only one that can be meant. A camera that is not there is left to the
/// driver: it looks for the body under other numbers.
pub fn refusals(host: &Host, port: Option<&str>) -> Vec<Finding> {
    match &wanted(host, port)[..] {
        [camera] => usable(host, camera),
        _ => Vec::new(),
    }
}

fn wanted(host: &Host, port: Option<&str>) -> Vec<UsbCamera> {
    let exact = port.filter(|port| *port != "usb:");
    cameras(host).into_iter().filter(|camera| exact.is_none_or(|port| camera.port == port)).collect()
}

/// A body gets another number whenever it is plugged in or switched on.
fn missing(host: &Host, port: Option<&str>) -> Finding {
    let all: Vec<String> = cameras(host).into_iter().map(|camera| camera.port).collect();
    match (port, &all[..]) {
        (Some(port), [_, ..]) => {
            let remedy = format!("set camera.port to one of {}, or leave it out", all.join(", "));
            Finding::error(port, "there is no camera at this port", remedy)
        }
        (port, _) => {
            let remedy = "switch the camera on, wake it, and check its cable; its battery or adapter may be empty";
            Finding::error(port.unwrap_or("USB"), "there is no camera on USB", remedy)
        }
    }
}

fn mode(camera: &UsbCamera) -> Finding {
    let UsbCamera { id: (vendor, product), port, .. } = camera;
    match camera.id {
        EOS_5D_NORMAL => Finding::ok(port, "an EOS 5D in normal mode (04a9:3101)"),
        EOS_5D_PTP => Finding::error(
            port,
            "an EOS 5D in PTP mode (04a9:3102), in which libgphoto2 cannot release it",
            "in the camera's menu, under Communication, choose PC connection instead of Print/PTP; then plug it in again",
        ),
        _ => Finding::ok(port, format!("{} ({vendor:04x}:{product:04x})", camera.product)),
    }
}

/// Permission and holders.
fn usable(host: &Host, camera: &UsbCamera) -> Vec<Finding> {
    let place = camera.node.display();
    let mut findings = Vec::new();
    if !(host.may_use)(&camera.node) {
        let mode = fs::metadata(&camera.node)
            .map_or("no such file".into(), |node| format!("mode {:o}, group {}", node.mode() & 0o777, node.gid()));
        let what = format!("this user may not read and write the camera's USB device ({mode})");
        let remedy = "install libgphoto2's udev rules (Debian: libgphoto2-6) and add the user to the group plugdev, log in again, \
                      plug the camera in again";
        findings.push(Finding::error(place.to_string(), what, remedy));
    }
    let held = holders::of(host, &camera.node);
    for holder in &held.found {
        let what = format!("the camera is held by {holder}");
        findings.push(Finding::error(place.to_string(), what, holders::remedy(&holder.name)));
    }
    if !any_error(&findings) {
        findings.push(Finding::ok(place, format!("the camera may be used; {}", held.none_in_words())));
    }
    findings
}

fn camera(host: &Host, directory: &Path) -> Option<UsbCamera> {
    let text = |name: &str| fs::read_to_string(directory.join(name)).ok().map(|text| text.trim().to_owned());
    let number = |name: &str| u16::from_str_radix(&text(name)?, 16).ok();
    let place = |name: &str| text(name)?.parse::<u16>().ok();
    let (vendor, product) = (number("idVendor")?, number("idProduct")?);
    if !(vendor == CANON && CANON_CAMERAS.contains(&product) || is_still_image(directory)) {
        return None;
    }
    let (bus, device) = (place("busnum")?, place("devnum")?);
    Some(UsbCamera {
        id: (vendor, product),
        product: text("product").unwrap_or_else(|| "a camera".into()),
        port: format!("usb:{bus:03},{device:03}"),
        node: host.dev.join(format!("bus/usb/{bus:03}/{device:03}")),
    })
}

/// Interfaces are folders of their device's: `1-2:1.0` of `1-2`.
fn is_still_image(directory: &Path) -> bool {
    let interfaces = fs::read_dir(directory).into_iter().flatten().flatten();
    interfaces
        .filter_map(|entry| fs::read_to_string(entry.path().join("bInterfaceClass")).ok())
        .any(|class| class.trim() == STILL_IMAGE)
}
