//! Whether a calibration still holds. Nothing here refuses: the operator decides, but is told.

use super::file::CalibrationFile;
use crate::session::quality::Optics;
use crate::store::manifest::Manifest;
use jiff::{SignedDuration, Timestamp};
use rig_config::{Arm, Rig};

/// What has changed since the calibration was made, as far as rig file and clock tell.
pub fn warnings(rig: &Rig, file: &CalibrationFile, manifest: &Manifest) -> Vec<String> {
    let name = format!("calibration {}", file.version);
    let mut warnings = Vec::new();
    match file.made.parse::<Timestamp>() {
        Ok(made) => warnings.extend(too_old(rig, Timestamp::now().duration_since(made)).map(|w| format!("{name} {w}"))),
        Err(_) => warnings.push(format!("{name} does not say when it was made: calibrate anew")),
    }
    match Rig::from_toml(&manifest.rig_file, "the calibration's rig file") {
        Ok(then) => {
            let changed = [
                ("[arm]", then.arm != without_waits(&rig.arm, &then.arm)),
                ("[lamp]", then.lamp != rig.lamp.waiting_like(&then.lamp)),
                ("[camera]", then.camera != rig.camera),
            ];
            for (section, _) in changed.iter().filter(|(_, changed)| *changed) {
                warnings.push(format!("{section} of the rig file has changed since {name}: calibrate anew"));
            }
        }
        Err(_) => warnings.push(format!("{name} was made with a rig file that cannot be compared: calibrate anew")),
    }
    warnings
}

/// The arm with the times and the park position that it had then: nothing that was measured depends on them, nor on the lamp's
/// own waits, which a session takes from its own rig file.
fn without_waits(arm: &Arm, then: &Arm) -> Arm {
    let Arm { settle_s, home_timeout_s, park_deg, .. } = *then;
    Arm { settle_s, home_timeout_s, park_deg, ..arm.clone() }
}

fn too_old(rig: &Rig, age: SignedDuration) -> Option<String> {
    let most = rig.calibration.as_ref().map(|calibration| calibration.max_age_days)?;
    let days = age.as_secs_f64() / 86_400.0;
    let old = if days < 2.0 { format!("{:.1} hours", 24.0 * days) } else { format!("{days:.0} days") };
    (days > most).then(|| {
        let unit = if most == 1.0 { "day" } else { "days" };
        format!("is {old} old, more than {most} {unit} (calibration.max_age_days): calibrate anew")
    })
}

/// What has changed, as the devices say when they are opened: firmware of the arm, model of the camera.
pub fn other_devices(file: &CalibrationFile, arm: &str, camera: &str) -> Vec<String> {
    let mut warnings = Vec::new();
    for (device, then, now) in [("arm", &file.arm, arm), ("camera", &file.camera_model, camera)] {
        if let Some(then) = then.as_deref().filter(|then| *then != now) {
            warnings.push(format!(
                "the {device} is `{now}`, calibration {} was made with `{then}`: calibrate anew",
                file.version
            ));
        }
    }
    warnings
}

/// What has changed, as a frame says: another body, or a lens that was zoomed.
pub fn other_optics(file: &CalibrationFile, now: &Optics) -> Vec<String> {
    let Optics { body_serial, focal_mm } = &file.optics;
    let mut warnings = Vec::new();
    if let (Some(then), Some(now)) = (body_serial, &now.body_serial)
        && then != now
    {
        warnings
            .push(format!("the camera's serial number is {now}, calibration {} was made with {then}", file.version));
    }
    if let (Some(then), Some(now)) = (focal_mm, now.focal_mm)
        && then != &now
    {
        warnings.push(format!("the lens is set to {now} mm, calibration {} was made at {then} mm", file.version));
    }
    warnings.into_iter().map(|warning| format!("{warning}: calibrate anew")).collect()
}
