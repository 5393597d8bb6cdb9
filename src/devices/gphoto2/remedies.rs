//! What brings back a camera that a new worker does not: a reset of its USB device, a configured command that switches its power.

use super::KnownBody;
use crate::devices::Cancel;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// Longest time a command may take.
const LIMIT: Duration = Duration::from_secs(60);
const LOOK: Duration = Duration::from_millis(50);

/// Resets the USB device that the camera was last seen as, by the program `usbreset` (Debian: usbutils).
///
/// # Errors
/// In words: no USB camera, no such program, or what it said.
pub fn reset_usb(body: &KnownBody, cancel: &Cancel) -> Result<(), String> {
    let port = body.last_port().unwrap_or_default();
    let device = usb_device(&port).ok_or_else(|| format!("the camera is not on USB (port {port:?})"))?;
    run(Command::new("usbreset").arg(device), "usbreset (package usbutils)", cancel)
}

/// Runs the rig file's `camera.power_hook`.
///
/// # Errors
/// In words: it could not be started, failed, or took longer than a minute.
pub fn switch_power(hook: &[String], cancel: &Cancel) -> Result<(), String> {
    let Some((program, arguments)) = hook.split_first() else { return Err("camera.power_hook is empty".into()) };
    run(Command::new(program).args(arguments), "camera.power_hook", cancel)
}

/// `usb:001,005` as usbreset wants it: `001/005`.
fn usb_device(port: &str) -> Option<String> {
    let (bus, device) = port.strip_prefix("usb:")?.split_once(',')?;
    let number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    (number(bus) && number(device)).then(|| format!("{bus}/{device}"))
}

/// Runs it to its end, its limit, or the caller's cancel: the lamp is on meanwhile.
fn run(command: &mut Command, name: &str, cancel: &Cancel) -> Result<(), String> {
    let started = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    let mut child: Child = started.map_err(|error| format!("{name} cannot be started: {error}"))?;
    let end = Instant::now() + LIMIT;
    while Instant::now() < end && !cancel.is_cancelled() {
        match child.try_wait() {
            Ok(Some(status)) if status.success() => return Ok(()),
            Ok(Some(status)) => return Err(format!("{name} ended with {status}")),
            Ok(None) => thread::sleep(LOOK),
            Err(error) => return Err(format!("{name}: {error}")),
        }
    }
    let _ = child.kill();
    let _ = child.wait();
    if cancel.is_cancelled() {
        return Err(format!("{name} was broken off"));
    }
    Err(format!("{name} took longer than {} s", LIMIT.as_secs()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_usb_port_names_a_device() {
        assert_eq!(usb_device("usb:001,005").as_deref(), Some("001/005"));
        for port in ["", "usb:", "usb:1", "usb:1,", "usb:1,x", "usb:../..,1", "ptpip:127.0.0.1:15740"] {
            assert_eq!(usb_device(port), None, "{port}");
        }
    }

    #[test]
    fn a_hook_is_believed_by_its_status() {
        let cancel = Cancel::default();
        let hook = |words: &[&str]| switch_power(&words.iter().map(|w| (*w).to_owned()).collect::<Vec<_>>(), &cancel);
        assert_eq!(hook(&["true"]), Ok(()));
        assert!(hook(&["false"]).is_err_and(|why| why.contains("ended with")));
        assert!(hook(&["/no/such/program"]).is_err_and(|why| why.contains("cannot be started")));
        assert!(hook(&[]).is_err());
        cancel.cancel();
        assert!(hook(&["sleep", "50"]).is_err_and(|why| why.contains("broken off")));
    }
}
