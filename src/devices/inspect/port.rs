//! The arm's serial port.

use super::{Finding, Host, any_error, holders};
use std::fs;
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Whether `port` is there, may be used, and is free. Nothing is opened.
pub fn look(host: &Host, port: &Path) -> Vec<Finding> {
    let place = port.display();
    let metadata = match fs::metadata(port) {
        Ok(metadata) => metadata,
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let remedy = format!(
                "check the arm's cable and power, and arm.port in the rig file{}; {}",
                number(port),
                others(host)
            );
            return vec![Finding::error(place, "there is no such device", remedy)];
        }
        Err(error) => return vec![Finding::error(place, error.to_string(), "check arm.port in the rig file")],
    };
    let mut findings = Vec::new();
    if !(host.may_use)(port) {
        let (mode, group) = (metadata.mode() & 0o777, metadata.gid());
        let what = format!("this user may not read and write it (mode {mode:o}, group {group})");
        let remedy = "add the user to the group dialout (`sudo usermod -aG dialout $USER`) and log in again";
        findings.push(Finding::error(place.to_string(), what, remedy));
    }
    let held = holders::of(host, port);
    for holder in &held.found {
        findings.push(Finding::error(place.to_string(), format!("held by {holder}"), holders::remedy(&holder.name)));
    }
    let waiting = holders::port_takers(host).into_iter().filter(|taker| is_usb(port) && !held.found.contains(taker));
    for taker in waiting {
        let what = format!("{taker} runs and opens serial ports when they are plugged in");
        findings.push(Finding::warning(place.to_string(), what, holders::remedy(&taker.name)));
    }
    if !any_error(&findings) {
        findings.push(Finding::ok(place, format!("is there and may be used; {}", held.none_in_words())));
    }
    findings
}

/// The advice for a port that is named by a plain number.
fn number(port: &Path) -> &'static str {
    if port.file_name().and_then(|name| name.to_str()).is_some_and(is_usb_name) {
        ": a port plugged in again may get another number, so name it as under /dev/serial/by-id"
    } else {
        ""
    }
}

/// Ports of this kind are those that other programs look for.
fn is_usb(port: &Path) -> bool {
    let port = port.canonicalize().unwrap_or_else(|_| port.to_path_buf());
    port.file_name().and_then(|name| name.to_str()).is_some_and(is_usb_name)
}

fn is_usb_name(name: &str) -> bool {
    name.starts_with("ttyUSB") || name.starts_with("ttyACM")
}

/// The serial ports there are, in words; by-id names stay when a device is plugged in again.
fn others(host: &Host) -> String {
    let list = |folder: &Path, wanted: fn(&str) -> bool| {
        let names = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let wanted = |path: &std::path::PathBuf| path.file_name().and_then(|name| name.to_str()).is_some_and(wanted);
        let mut found: Vec<String> = names.filter(wanted).map(|path| path.display().to_string()).collect();
        found.sort();
        found
    };
    let mut found = list(&host.dev.join("serial/by-id"), |_| true);
    if found.is_empty() {
        found = list(&host.dev, is_usb_name);
    }
    if found.is_empty() { "no USB serial port is there".into() } else { format!("there are {}", found.join(", ")) }
}
