//! A session written by hand: manifest, journal with its chain, calibration-free plan, result. Whoever reads it cannot have helped to make it.
#![allow(dead_code, reason = "each test file uses its part")]

use rigd::store::exr::{Planes, write_planes};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

pub const ID: &str = "01a22e82-5b49-7799-b9ed-cbbea8fa6367";
/// What no reader may take for something else than text.
pub const HOSTILE: &str = "</title><script>alert('1')</script>\"><img src=x onerror=alert(2)> & \u{202e}dlrow\u{0}\u{1b}[31m (\\) %PDF \u{4e2d}\u{1f600}";
pub const SIZE: usize = 24;

/// A session to write.
pub struct Written {
    pub name: String,
    pub reason: String,
    pub records: Vec<Value>,
    pub fitted: bool,
}

impl Default for Written {
    fn default() -> Self {
        Self { name: "marble ball".into(), reason: "the frame is black".into(), records: Vec::new(), fitted: true }
    }
}

/// Stations of the plan, degrees, in shooting order: out, back and out again.
pub fn stations() -> Vec<f64> {
    [0, 3, 6, 9, 10, 7, 4, 1, 2, 5, 8, 11].map(|k: i32| -50.0 + 10.0 * f64::from(k)).to_vec()
}

pub fn plan(name: &str) -> Value {
    let stations: Vec<Value> =
        stations().iter().map(|angle| json!({"angle_deg": angle, "light_position_mm": [angle, 0.0, 900.0]})).collect();
    json!({
        "name": name, "stations": stations, "frames": 24, "estimated_s": 100.0, "estimated_bytes": 1000,
        "exposures": [{"label": "1/8", "true_s": 0.125}, {"label": "1", "true_s": 1.0}],
    })
}

/// How bright the lamp is at a station: it loses 3 % over the session.
pub fn brightness(station: usize) -> f64 {
    1.0 - 0.03 * station as f64 / 11.0
}

/// Records of a whole session: every station shot, one frame refused first, one arm lost.
fn course(written: &Written) -> Vec<(f64, Value)> {
    let mut all = vec![(0.0, json!({"type": "session.state", "state": "preflight"}))];
    all.push((1.0, json!({"type": "lamp.steady", "frames": 4, "spread": 0.0012})));
    all.push((1.5, json!({"type": "ambient.measured", "level": 1.0, "bright": 2.0, "share": 0.0031})));
    for (station, angle) in stations().iter().enumerate() {
        let begin = 10.0 + 600.0 * station as f64;
        all.push((begin, json!({"type": "arm.moved", "station": station, "angle_deg": angle})));
        if station == 3 {
            all.push((begin + 1.0, json!({"type": "frame.rejected", "station": 3, "exposure": 0, "attempt": 1, "shutter": "1/8", "reason": written.reason})));
            all.push((begin + 2.0, json!({"type": "fault.raised", "device": "arm", "reason": written.reason})));
            all.push((begin + 3.0, json!({"type": "camera.recovery", "rung": "power", "reason": written.reason})));
        }
        for exposure in 0..2 {
            all.push((begin + 20.0 * (exposure as f64 + 1.0), json!({
                "type": "frame.committed", "station": station, "exposure": exposure, "attempt": 1, "bracket": station + 1,
                "file": format!("{station:03}-{exposure:02}.jpg"), "bytes": 1000, "blake3": "00", "shutter": "1/8", "true_s": 0.125,
                "angle_deg": angle, "taken": null,
            })));
        }
        let (sin, cos) = f64::to_radians(*angle).sin_cos();
        let now = 0.18 * brightness(station);
        all.push((begin + 50.0, json!({
            "type": "station.developed", "station": station,
            "exposures": [
                {"frame": "a", "nominal": "1/8", "power_of_two_s": 0.125, "estimated_s": 0.12625, "sigma_relative": 0.0021, "reference": false},
                {"frame": "b", "nominal": "1", "power_of_two_s": 1.0, "estimated_s": 1.0, "sigma_relative": null, "reference": true},
            ],
            "patch": {"radiance": [now * cos, now * cos, now * cos], "sigma": [2e-4, 2e-4, 2e-4], "expected": [cos, cos, cos], "aside": [sin / cos, 0.1]},
        })));
    }
    all
}

/// Writes it below `data`; returns its directory.
pub fn write(data: &Path, written: &Written) -> PathBuf {
    let directory = data.join("sessions").join(ID);
    std::fs::create_dir_all(directory.join("frames")).unwrap();
    let rig = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated").unwrap().1;
    let rig = format!(
        "{rig}\n[reference_patch]\ncenter_mm = [-60.0, -30.0, 960.0]\nnormal = [0.34, 0.0, -0.94]\ndiameter_mm = 12.0\n"
    );
    let manifest = json!({
        "format": 1, "id": ID, "name": written.name, "started": "2026-11-30T20:00:00Z", "software": format!("rigd {}", written.name),
        "simulated": true, "plan": plan(&written.name), "rig_file": rig, "arm": written.name, "camera": "Canon EOS 5D", "idempotency": null,
    });
    std::fs::write(directory.join("manifest.json"), manifest.to_string()).unwrap();
    let mut records = course(written);
    let end = 7300.0;
    if written.fitted {
        records.push((end, json!({"type": "fit.finished", "error": null, "mean_relative_error": 0.0123})));
        write_result(&directory.join("result"), written);
    }
    records.extend(written.records.iter().map(|record| (end + 1.0, record.clone())));
    records.push((end + 2.0, json!({"type": "session.state", "state": "completed", "reason": null})));
    std::fs::write(directory.join("journal.jsonl"), chained(&records)).unwrap();
    directory
}

/// Lines of a journal, each with the hash of the one before.
pub fn chained(records: &[(f64, Value)]) -> String {
    let (mut text, mut prev) = (String::new(), Value::Null);
    let begin: jiff::Timestamp = "2026-11-30T20:00:00Z".parse().unwrap();
    for (index, (second, record)) in records.iter().enumerate() {
        let mut record = record.clone();
        record["seq"] = json!(index + 1);
        record["time"] = json!((begin + jiff::SignedDuration::from_secs_f64(*second)).to_string());
        record["session"] = json!(ID);
        record["simulated"] = json!(true);
        record["prev"] = prev;
        let line = record.to_string();
        prev = json!(blake3::hash(line.as_bytes()).to_hex().to_string());
        text += &(line + "\n");
    }
    text
}

/// Errors of the lights: the second is left out.
pub const LIGHTS: [f64; 3] = [0.0111, 0.0456, 0.0135];

/// A result of one ball with two materials.
pub fn write_result(directory: &Path, written: &Written) {
    std::fs::create_dir_all(directory).unwrap();
    let parameter = |value: f64, error: Option<f64>, flag: &str, reason: Option<&str>| json!({"value": value, "standard_error": error, "identified": flag, "reason": reason});
    let sound = |value: f64| parameter(value, Some(0.000_32), "identified", None);
    let material = |open: Value| {
        json!({
            "share": 0.625, "rho_d": [sound(0.61), sound(0.52), sound(0.412_347)],
            "rho_s": [sound(0.05), parameter(0.051, Some(0.02), "weak", Some(&written.reason)), sound(0.05)], "beta": open,
        })
    };
    let unidentified = parameter(0.987_654, None, "unidentified", Some("no sample within 2 beta of the half vector"));
    let file = json!({
        "format": 1, "model": "ward", "gauge": "max gamma = 1", "materials": [material(sound(0.0625)), material(unidentified)],
        "size": [SIZE, SIZE],
        "provenance": {"software": written.name, "images": [written.reason], "simulated": true, "calibration": written.name},
    });
    let lights: Vec<Value> = LIGHTS
        .iter()
        .enumerate()
        .map(|(i, error)| json!({"image": format!("radiance/{i:02}.exr {}", written.name), "left_out": i == 1, "samples": 1000 + i, "mean_relative_error": error}))
        .collect();
    let report = json!({
        "pixels": 4321, "samples": 54_321, "materials": 2, "model": "ward", "lobe": "coloured", "light_gains": null, "solver": "varpro",
        "weights": "exact", "objective": "noise-cauchy", "mean_relative_error": 0.0123, "highlight_relative_error": 0.0234,
        "left_out_relative_error": 0.0456, "left_out_highlight_relative_error": null, "left_out": [1], "lights": lights, "cost": 1234.5,
        "reduced_chi2": 0.876, "iterations": 15, "termination": "converged",
        "seconds": {"load": 0.1, "observe": 0.2, "initialise": 0.3, "fit": 0.4, "total": 1.0}, "cpu_seconds": 1.75, "cosine_cutoff": 0.15,
        "unusable_samples": 7,
        "candidates": [{"materials": 2, "model": "ward", "lobe": "coloured", "light_gains": false, "left_out_relative_error": 0.0345,
            "left_out_highlight_relative_error": null, "bic": 1.0, "taken": true, "reason": written.reason}],
        "warnings": [format!("a warning of the fit: {}", written.reason)], "notes": [written.reason],
    });
    std::fs::write(directory.join("material.json"), file.to_string()).unwrap();
    std::fs::write(directory.join("report.json"), report.to_string()).unwrap();
    let inside = |i: usize| (i % SIZE).abs_diff(SIZE / 2).pow(2) + (i / SIZE).abs_diff(SIZE / 2).pow(2) < 80;
    let plane = |value: f32| {
        (0..SIZE * SIZE).map(|i| if inside(i) { value * (i % SIZE) as f32 / SIZE as f32 } else { 0.0 }).collect()
    };
    let planes = |names: &[&str], value: f32| Planes {
        origin: (0, 0),
        full: (SIZE, SIZE),
        size: (SIZE, SIZE),
        channels: names.iter().map(|name| ((*name).to_owned(), plane(value))).collect(),
    };
    write_planes(&directory.join("weights.exr"), planes(&["material_1", "material_2"], 1.0), "").unwrap();
    write_planes(&directory.join("residual.exr"), planes(&["R", "G", "B"], 0.08), "").unwrap();
}
