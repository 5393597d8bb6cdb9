//! Whether a calibration still holds. Nothing here refuses: the operator decides, but is told.

use super::file::CalibrationFile;
use crate::store::manifest::Manifest;
use jiff::{SignedDuration, Timestamp};
use rig_config::Rig;

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
                ("[arm]", then.arm != rig.arm),
                ("[lamp]", then.lamp != rig.lamp),
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

fn too_old(rig: &Rig, age: SignedDuration) -> Option<String> {
    let most = rig.calibration.as_ref().map(|calibration| calibration.max_age_days)?;
    let days = age.as_secs_f64() / 86_400.0;
    (days > most).then(|| format!("is {days:.0} days old, more than {most} (calibration.max_age_days): calibrate anew"))
}

/// What has changed, as the devices say when they are opened: firmware of the arm, model (with serial number, where the body tells it) of
/// the camera.
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
