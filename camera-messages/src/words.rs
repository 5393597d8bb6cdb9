//! What a driver's reports mean, and what to do.

use crate::message::{Driver, HandleState};

/// Which driver has this name in libgphoto2's list of abilities; none for one that drives no Canon.
pub fn driver(id: &str) -> Option<Driver> {
    match id {
        "PTP" => Some(Driver::Ptp2),
        "canon" => Some(Driver::Canon),
        _ => None,
    }
}

/// Why a camera cannot be used, and what to do; none if it can.
pub fn refusal(model: &str, driver: Option<Driver>, can_capture: bool, can_configure: bool) -> Option<String> {
    if model == "Canon EOS 5D (PTP mode)" {
        return Some(
            "the EOS 5D is in PTP mode, in which it cannot be released by the host: set its menu item Communication to \
             `PC connection`, unplug it and plug it in again"
                .into(),
        );
    }
    if driver.is_none() {
        return Some(format!("{model} is driven by neither `ptp2` nor `canon`: use a Canon EOS"));
    }
    match (can_capture, can_configure) {
        (true, true) => None,
        (false, _) => Some(format!(
            "libgphoto2 cannot release {model}: set its menu item Communication to `PC connection` if it has one, or use another body"
        )),
        (true, false) => Some(format!("libgphoto2 cannot set shutter and aperture of {model}: use another body")),
    }
}

/// Of several cameras found none is chosen.
pub fn which_camera(found: &[(String, String)]) -> String {
    if found.is_empty() {
        return "no camera was found: check that it is switched on and plugged in, and that its battery is charged"
            .into();
    }
    let names: Vec<String> = found.iter().map(|(model, port)| format!("{model} at {port}")).collect();
    format!("several cameras were found: name the model or the port of one ({})", names.join(", "))
}

/// None of the cameras found is the one; each with its port and serial number.
pub fn other_bodies(wanted: &str, found: &[(String, Option<String>)]) -> String {
    let other = |(port, serial): &(String, Option<String>)| match serial {
        Some(serial) => format!("{serial} at {port}"),
        None => format!("one without at {port}"),
    };
    let others: Vec<String> = found.iter().map(other).collect();
    format!("no camera has the serial number {wanted}, but {}: connect the right one", others.join(", "))
}

/// Name and number of an error by the name that the crate has for it (gphoto2 3.4.1, src/error.rs; libgphoto2, gphoto2-result.h).
pub fn error_code(kind: &str) -> (&'static str, i32) {
    match kind {
        "BadParameters" => ("GP_ERROR_BAD_PARAMETERS", -2),
        "NoMemory" => ("GP_ERROR_NO_MEMORY", -3),
        "UnknownPort" => ("GP_ERROR_UNKNOWN_PORT", -5),
        "NotSupported" => ("GP_ERROR_NOT_SUPPORTED", -6),
        "Io" => ("GP_ERROR_IO", -7),
        "FixedLimitExceeded" => ("GP_ERROR_FIXED_LIMIT_EXCEEDED", -8),
        "Timeout" => ("GP_ERROR_TIMEOUT", -10),
        "IoRead" => ("GP_ERROR_IO_READ", -34),
        "IoWrite" => ("GP_ERROR_IO_WRITE", -35),
        "IoUsbClearHalt" => ("GP_ERROR_IO_USB_CLEAR_HALT", -51),
        "IoUsbFind" => ("GP_ERROR_IO_USB_FIND", -52),
        "IoUsbClaim" => ("GP_ERROR_IO_USB_CLAIM", -53),
        "IoLock" => ("GP_ERROR_IO_LOCK", -60),
        "CorruptedData" => ("GP_ERROR_CORRUPTED_DATA", -102),
        "FileExists" => ("GP_ERROR_FILE_EXISTS", -103),
        "ModelNotFound" => ("GP_ERROR_MODEL_NOT_FOUND", -105),
        "DirectoryNotFound" => ("GP_ERROR_DIRECTORY_NOT_FOUND", -107),
        "FileNotFound" => ("GP_ERROR_FILE_NOT_FOUND", -108),
        "CameraBusy" => ("GP_ERROR_CAMERA_BUSY", -110),
        "CameraError" => ("GP_ERROR_CAMERA_ERROR", -113),
        "OsFailure" => ("GP_ERROR_OS_FAILURE", -114),
        "NoSpace" => ("GP_ERROR_NO_SPACE", -115),
        _ => ("GP_ERROR", -1),
    }
}

/// What an error leaves of the open camera. Only a busy one is worth trying again as it is; what the library refuses by itself leaves
/// it usable; after all else, even a plain -1, later calls have been seen to fail for ever.
pub fn handle_state(number: i32) -> HandleState {
    match number {
        -110 => HandleState::Busy,
        -2 | -6 | -103 | -105 | -107 | -108 => HandleState::Ready,
        _ => HandleState::Dead,
    }
}

/// What to do about an error.
pub fn advice(number: i32) -> &'static str {
    match number {
        -110 => "it is busy: try again in half a second",
        -53 => {
            "another program holds it, often the desktop's: run `gio mount -s gphoto2` and disable gvfs-gphoto2-volume-monitor"
        }
        -52 | -5 => "it is not at this port: check cable, power and port",
        -105 => "libgphoto2 does not know this model: spell it as `gphoto2 --list-cameras` does",
        -7 | -10 | -34 | -35 => "the connection failed: check its cable, switch it off and on",
        -3 | -115 => "its card may be full: put in an empty one",
        -2 | -6 => "it does not take this",
        _ => "switch it off and on",
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_body_in_the_wrong_mode_is_refused_with_the_remedy() {
        let words = refusal("Canon EOS 5D (PTP mode)", Some(Driver::Ptp2), false, false).unwrap();
        assert!(words.contains("PC connection"), "{words}");
        assert!(refusal("Canon EOS 5D (PTP mode)", Some(Driver::Ptp2), true, true).is_some());
        assert_eq!(refusal("Canon EOS 5D (normal mode)", Some(Driver::Canon), true, true), None);
        assert_eq!(refusal("Canon EOS 5D Mark II", Some(Driver::Ptp2), true, true), None);
        assert!(refusal("Canon EOS 30D", Some(Driver::Ptp2), false, true).unwrap().contains("release"));
        assert!(refusal("Canon EOS 30D", Some(Driver::Ptp2), true, false).unwrap().contains("set"));
        assert!(refusal("Nikon D70", driver("sierra"), true, true).unwrap().contains("neither"));
    }

    #[test]
    fn one_of_several_cameras_is_not_guessed() {
        assert!(which_camera(&[]).contains("no camera"));
        let both = [("A".to_owned(), "usb:001,002".to_owned()), ("B".to_owned(), "usb:001,003".to_owned())];
        assert!(which_camera(&both).contains("A at usb:001,002, B at usb:001,003"));
    }

    #[test]
    fn other_bodies_are_told_by_their_serial_numbers() {
        let found = [("usb:001,005".to_owned(), Some("2".to_owned())), ("usb:001,006".to_owned(), None)];
        let told = "no camera has the serial number 1, but 2 at usb:001,005, one without at usb:001,006: connect the right one";
        assert_eq!(other_bodies("1", &found), told);
    }

    #[test]
    fn only_busy_is_worth_trying_again_as_it_is() {
        assert_eq!(handle_state(error_code("CameraBusy").1), HandleState::Busy);
        assert_eq!(handle_state(error_code("BadParameters").1), HandleState::Ready);
        for kind in ["Io", "Timeout", "Other", "IoUsbFind", "NoMemory", "NewKind"] {
            assert_eq!(handle_state(error_code(kind).1), HandleState::Dead, "{kind}");
        }
    }
}
