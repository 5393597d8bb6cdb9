//! Arm and camera: looked at, then opened if nothing speaks against it. The motor is never turned and the lamp never switched on.

use crate::cli::daemon;
use crate::devices::Cancel;
use crate::devices::gphoto2::{Gphoto2Camera, Gphoto2Settings, KnownBody};
use crate::devices::inspect::{self, Finding, Host, any_error};
use crate::session::bench::{OpenArm, OpenCamera};
use rig_config::{ArmDriver, CameraDriver, Rig};
use std::path::PathBuf;

/// The arm; `open` is not called when it is held or may not be used.
pub fn arm(host: &Host, rig: &Rig, open: Option<&mut OpenArm>) -> Vec<Finding> {
    let (mut findings, place) = match &rig.arm.driver {
        ArmDriver::Rigproto { port } | ArmDriver::Grbl { port, .. } => {
            (inspect::port::look(host, port), port.display().to_string())
        }
        ArmDriver::Simulated => (Vec::new(), "simulated arm".into()),
    };
    if let Some(open) = open
        && !any_error(&findings)
    {
        findings.push(match open() {
            Ok(arm) => Finding::ok(place, format!("the arm answers: {}", arm.identity().firmware)),
            Err(error) => {
                let remedy = "check the arm's power and cable, and arm.driver and arm.baud in the rig file";
                Finding::error(place, error.to_string(), remedy)
            }
        });
    }
    findings
}

/// A camera that is no gphoto2 one: opened, as there is nothing to look at.
pub fn plain_camera(rig: &Rig, open: &mut OpenCamera) -> Finding {
    let place = match &rig.camera.driver {
        CameraDriver::Replay { directory } => directory.display().to_string(),
        _ => "simulated camera".into(),
    };
    match open(&Cancel::default()) {
        Ok(camera) => Finding::ok(place, format!("the camera answers: {}", camera.identity().model)),
        Err(error) => Finding::error(place, error.to_string(), "correct camera.directory in the rig file"),
    }
}

/// The camera behind libgphoto2, its worker, and the room on its card for `frames` shots.
pub fn gphoto2(host: &Host, rig: &Rig, frames: usize, may_open: bool) -> anyhow::Result<Vec<Finding>> {
    let home = Home::make()?;
    let mut settings = daemon::gphoto2_settings(rig, &KnownBody::default())?;
    settings.worker.home.clone_from(&home.0);
    let mut findings = vec![inspect::worker(&settings.worker)];
    if settings.port.as_ref().is_none_or(|port| port.starts_with("usb:")) {
        findings.extend(inspect::usb::look(host, settings.port.as_deref()));
    }
    if may_open && !any_error(&findings) {
        findings.push(opened(settings, frames));
    }
    Ok(findings)
}

fn opened(settings: Gphoto2Settings, frames: usize) -> Finding {
    match Gphoto2Camera::open(settings, &Cancel::default()) {
        Ok(camera) => {
            let offers = camera.offers();
            let shots = offers.available_shots.and_then(|shots| usize::try_from(shots).ok());
            match shots {
                Some(shots) if shots < frames => {
                    let what =
                        format!("the card of the {} takes {shots} more shots, the plan has {frames}", offers.model);
                    Finding::error(&offers.port, what, "put an empty card in: rigd deletes nothing on a camera")
                }
                _ => Finding::ok(&offers.port, format!("the camera answers: {}", offers.model)),
            }
        }
        Err(error) => {
            let remedy = "switch the camera off and on, read its display, and check camera.model and camera.port";
            Finding::error("camera", error.to_string(), remedy)
        }
    }
}

/// A home for libgphoto2's settings that is gone afterwards: the daemon's own is left alone.
struct Home(PathBuf);

impl Home {
    fn make() -> std::io::Result<Self> {
        let path = std::env::temp_dir().join(format!("rigd-doctor-{}", uuid::Uuid::now_v7()));
        // Refused where someone else was there first.
        std::fs::create_dir(&path)?;
        Ok(Self(path))
    }
}

impl Drop for Home {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
