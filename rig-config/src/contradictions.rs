//! What no single key shows: keys that contradict each other. Each check runs as soon as the keys it needs are sound by
//! themselves, so that one mistake never hides another.

use crate::Shutter;
use crate::read::Reason;
use std::collections::HashMap;
use std::net::SocketAddr;
use toml::Value;

/// Appends every contradiction to `reasons`, which holds what is wrong with single keys.
pub(crate) fn check(file: &Value, reasons: &mut Vec<Reason>) {
    let view = View { file, refused: reasons.iter().map(|r| r.key.clone()).collect() };
    let mut found = Found(Vec::new());
    drivers(&view, &mut found);
    travel(&view, &mut found);
    plan(&view, &mut found);
    light_circle(&view, &mut found);
    sphere_in_view(&view, &mut found);
    crate::patch::check(&view, &mut found);
    listen(&view, &mut found);
    notify(&view, &mut found);
    reasons.append(&mut found.0);
}

pub(crate) struct Found(Vec<Reason>);

impl Found {
    pub(crate) fn refuse(&mut self, key: impl Into<String>, what: impl Into<String>) {
        self.0.push(Reason { key: key.into(), what: what.into() });
    }
}

/// The file's values, less those refused already.
pub(crate) struct View<'a> {
    file: &'a Value,
    refused: Vec<String>,
}

impl<'a> View<'a> {
    fn raw(&self, path: &str) -> Option<&'a Value> {
        path.split('.').try_fold(self.file, |at, key| at.as_table()?.get(key))
    }

    fn value(&self, path: &str) -> Option<&'a Value> {
        let inside = |key: &String| key.strip_prefix(path).is_some_and(|rest| rest.is_empty() || rest.starts_with('['));
        if self.refused.iter().any(inside) { None } else { self.raw(path) }
    }

    pub(crate) fn number(&self, path: &str) -> Option<f64> {
        as_number(self.value(path)?)
    }

    fn text(&self, path: &str) -> Option<&'a str> {
        self.value(path)?.as_str()
    }

    pub(crate) fn numbers<const N: usize>(&self, path: &str) -> Option<[f64; N]> {
        let all: Option<Vec<f64>> = self.value(path)?.as_array()?.iter().map(as_number).collect();
        all?.try_into().ok()
    }

    /// The sound entries of a list with their indices.
    fn entries(&self, path: &str) -> Vec<(usize, &'a Value)> {
        if self.refused.iter().any(|key| key == path) {
            return Vec::new();
        }
        let items = self.raw(path).and_then(Value::as_array).into_iter().flatten().enumerate();
        items.filter(|(i, _)| !self.refused.contains(&format!("{path}[{i}]"))).collect()
    }
}

fn as_number(value: &Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|i| i as f64))
}

/// Keys that belong to one driver, and the simulation that belongs to the simulated ones.
fn drivers(view: &View, found: &mut Found) {
    let (arm, camera) = (view.text("arm.driver"), view.text("camera.driver"));
    let mut needs = |driver: Option<&str>, name: &str, path: &str, takes: &[&str], required: bool| {
        let Some(driver) = driver else { return };
        let present = view.raw(path).is_some();
        if present && !takes.contains(&driver) {
            let only = takes.join(" or ");
            found
                .refuse(path, format!("has no meaning with {name}.driver = \"{driver}\": remove it, or choose {only}"));
        } else if required && !present && takes.contains(&driver) {
            found.refuse(path, format!("missing: {name}.driver = \"{driver}\" needs it"));
        }
    };
    needs(arm, "arm", "arm.port", &["rigproto", "grbl"], true);
    needs(arm, "arm", "arm.grbl_lamp", &["grbl"], true);
    needs(arm, "arm", "arm.grbl_zero_deg", &["grbl"], true);
    needs(camera, "camera", "camera.model", &["gphoto2"], false);
    needs(camera, "camera", "camera.port", &["gphoto2"], false);
    needs(camera, "camera", "camera.power_hook", &["gphoto2"], false);
    needs(camera, "camera", "camera.directory", &["replay"], true);
    if let Some(port) = view.text("camera.port").filter(|port| !is_camera_port(port)) {
        let words =
            format!("{port:?} is no port of a camera: write `usb:001,005` (BUS,DEVICE) or `ptpip:ADDRESS:PORT`");
        found.refuse("camera.port", words);
    }
    if let Some((0, Value::String(program))) = view.entries("camera.power_hook").first()
        && program.trim().is_empty()
    {
        found.refuse("camera.power_hook[0]", "is no program: name the one that switches the camera's power".to_owned());
    }
    let level = view.number("lamp.level_permille");
    if view.text("arm.grbl_lamp") == Some("coolant") && level.is_some_and(|level| level != 1000.0) {
        found.refuse("lamp.level_permille", "a lamp on the coolant output is on or off: set 1000");
    }
    if camera == Some("simulated") && arm.is_some_and(|arm| arm != "simulated") {
        found.refuse(
            "camera.driver",
            "\"simulated\" photographs the simulated arm: set arm.driver = \"simulated\" as well",
        );
    }
    let simulated = [arm, camera].contains(&Some("simulated"));
    let present = view.raw("simulation").is_some();
    if simulated && !present {
        found.refuse("simulation", "missing: a simulated driver needs the section (scene, seed, speed)");
    } else if present && !simulated && arm.is_some() && camera.is_some() {
        found.refuse("simulation", "no driver is simulated: remove the section, or choose driver = \"simulated\"");
    }
}

/// `usb:`, `usb:001,005`, `ptpip:192.168.1.2`, with one or two ports: what libgphoto2 reaches Canon bodies by.
fn is_camera_port(port: &str) -> bool {
    let number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    match port.split_once(':') {
        Some(("usb", "")) => true,
        Some(("usb", place)) => place.split_once(',').is_some_and(|(bus, device)| number(bus) && number(device)),
        Some(("ptpip", place)) => {
            let mut parts = place.split(':');
            let named = parts.next().is_some_and(|host| !host.is_empty() && !host.contains(char::is_whitespace));
            let ports: Vec<&str> = parts.collect();
            named && ports.len() <= 2 && ports.iter().all(|port| port.parse::<u16>().is_ok())
        }
        _ => false,
    }
}

fn travel(view: &View, found: &mut Found) {
    let Some([lower, upper]) = view.numbers("arm.travel_deg") else { return };
    if lower >= upper {
        found.refuse(
            "arm.travel_deg",
            format!("lower angle {lower} is not below upper angle {upper}: swap or widen them"),
        );
        return;
    }
    if let Some(zero) = view.number("arm.grbl_zero_deg").filter(|zero| *zero < upper) {
        let words = format!(
            "{zero} is below the upper angle {upper} of arm.travel_deg: GRBL's position 0 is the upper end of what it reaches"
        );
        found.refuse("arm.grbl_zero_deg", words);
    }
    let outside = |x: f64| x < lower || x > upper;
    if let Some(park) = view.number("arm.park_deg").filter(|park| outside(*park)) {
        found.refuse("arm.park_deg", format!("{park} is outside arm.travel_deg [{lower}, {upper}]: park inside it"));
    }
    let told = |x: f64| format!("{x} is outside arm.travel_deg [{lower}, {upper}]: move the station inside it");
    for list in STATIONS {
        for (i, station) in view.entries(list) {
            if let Some(x) = as_number(station).filter(|x| outside(*x)) {
                found.refuse(format!("{list}[{i}]"), told(x));
            }
        }
    }
    let board = "calibration.board_station_deg";
    if let Some(x) = view.number(board).filter(|x| outside(*x)) {
        found.refuse(board, told(x));
    }
}

/// Lists of arm angles.
const STATIONS: [&str; 2] = ["plan.stations_deg", "calibration.stations_deg"];
/// Brackets: lists of shutter labels.
const BRACKETS: [&str; 2] = ["plan.exposures", "calibration.exposures"];

/// Labels that are no shutter speed, and entries that say the same twice.
fn plan(view: &View, found: &mut Found) {
    STATIONS.iter().for_each(|list| stations(view, list, found));
    BRACKETS.iter().for_each(|list| bracket(view, list, found));
    let board = "calibration.board_exposure";
    if let Some(Err(reason)) = view.text(board).map(Shutter::from_label) {
        found.refuse(board, reason.to_string());
    }
}

fn stations(view: &View, list: &str, found: &mut Found) {
    let mut seen: HashMap<u64, usize> = HashMap::new();
    for (i, station) in view.entries(list) {
        // Adding zero makes -0 and 0 the same angle.
        let Some(x) = as_number(station).map(|x| x + 0.0) else { continue };
        if let Some(first) = seen.insert(x.to_bits(), i) {
            found.refuse(format!("{list}[{i}]"), format!("{x} is {list}[{first}] again: remove one"));
        }
    }
}

fn bracket(view: &View, list: &str, found: &mut Found) {
    let mut seen: HashMap<u64, usize> = HashMap::new();
    for (i, label) in view.entries(list) {
        let key = format!("{list}[{i}]");
        match label.as_str().map(Shutter::from_label) {
            Some(Err(reason)) => found.refuse(key, reason.to_string()),
            Some(Ok(shutter)) => {
                if let Some(first) = seen.insert(shutter.true_s.to_bits(), i) {
                    let what = format!("`{}` opens as long as {list}[{first}]: remove one", shutter.label);
                    found.refuse(key, what);
                }
            }
            None => {}
        }
    }
}

/// The lamp's circle is horizontal; its nearest point must stay outside the object.
fn light_circle(view: &View, found: &mut Found) {
    let centers = (view.numbers::<3>("lamp.circle_center_mm"), view.numbers::<3>("object.center_mm"));
    let (Some(circle), Some(object)) = centers else { return };
    let radii = (view.number("lamp.circle_radius_mm"), view.number("object.radius_mm"));
    let (Some(circle_radius), Some(radius)) = radii else { return };
    let in_plane = (circle[0] - object[0]).hypot(circle[2] - object[2]);
    let nearest = (circle_radius - in_plane).abs().hypot(circle[1] - object[1]);
    if nearest <= radius {
        let what = format!(
            "the light's circle comes within {nearest:.1} mm of the object's centre, inside its radius of {radius} mm: \
             enlarge the circle or move it"
        );
        found.refuse("lamp.circle_radius_mm", what);
    }
}

/// The object lies in front of the camera, and its whole outline in the frame (the distortion left out).
fn sphere_in_view(view: &View, found: &mut Found) {
    let (Some([x, y, z]), Some(radius)) = (view.numbers("object.center_mm"), view.number("object.radius_mm")) else {
        return;
    };
    if z <= radius {
        let what =
            format!("z = {z} mm does not put the whole object (radius {radius} mm) before the camera: increase z");
        found.refuse("object.center_mm", what);
        return;
    }
    let optics = (view.numbers::<2>("camera.focal_px"), view.numbers::<2>("camera.principal_px"));
    let (Some(focal), Some(principal)) = optics else { return };
    for (axis, offset, size_key) in [(0, x, "width"), (1, y, "height")] {
        let Some(size) = view.number(&format!("camera.{size_key}")) else { continue };
        // Planes through the other axis that touch the sphere bound the outline exactly.
        let (middle, half) = (offset.atan2(z), (radius / offset.hypot(z)).asin());
        let edges = [middle - half, middle + half].map(|angle| principal[axis] + focal[axis] * angle.tan());
        if edges[0] < 0.0 || edges[1] > size {
            let what = format!(
                "the object's outline spans {} {:.0} to {:.0} px, outside the camera's view of 0 to {size} px: move the object, \
                 or correct camera.focal_px, camera.principal_px or camera.{size_key}",
                ["x", "y"][axis],
                edges[0],
                edges[1]
            );
            found.refuse("object.center_mm", what);
        }
    }
}

fn listen(view: &View, found: &mut Found) {
    for (key, other) in [("server.certificate", "server.key"), ("server.key", "server.certificate")] {
        if view.raw(key).is_some() && view.raw(other).is_none() {
            found.refuse(other, format!("missing: {key} needs it"));
        }
    }
    let Some(text) = view.text("server.listen") else { return };
    match text.parse::<SocketAddr>() {
        Err(_) => {
            found.refuse("server.listen", format!("`{text}` is no ADDRESS:PORT: write for example 127.0.0.1:7040"))
        }
        Ok(address) if !address.ip().is_loopback() && view.text("server.tokens").is_none() => {
            let what = "is no loopback address, and anyone there could move the arm: name a file of tokens in server.tokens, or write 127.0.0.1";
            found.refuse("server.listen", format!("{} {what}", address.ip()));
        }
        Ok(_) => {}
    }
}

/// Somebody is told, and no secret stands in the file itself: it is copied into every manifest.
fn notify(view: &View, found: &mut Found) {
    if view.value("notify").is_none_or(|section| !section.is_table()) {
        return;
    }
    let files = ["notify.webhook_file", "notify.ntfy_file"];
    if files.iter().chain(&["notify.mail_to"]).all(|key| view.raw(key).is_none()) {
        found.refuse("notify", "names nobody: add webhook_file, ntfy_file or mail_to, or remove the section");
    }
    for key in files {
        if view.text(key).is_some_and(|path| path.contains("://")) {
            let what = "is an address: write it into a file that only rigd may read, and name that file here, because the rig file is \
                        copied into every session";
            found.refuse(key, what);
        }
    }
    if view.text("notify.mail_to").is_some_and(|to| !is_mail_address(to)) {
        found.refuse("notify.mail_to", "is no e-mail address: write NAME@HOST and nothing else");
    }
}

/// `NAME@HOST` in signs that stand for nothing else in a mail's head or on a command line.
fn is_mail_address(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_graphic() && !"<>,;:\"()[]\\".contains(c);
    let parts: Vec<&str> = text.split('@').collect();
    text.chars().all(plain) && !text.starts_with('-') && parts.len() == 2 && parts.iter().all(|part| !part.is_empty())
}
