//! What the controller has stored (`$$`) against what the rig file says. Nothing is ever written to its EEPROM: that is the owner's.

use super::advice::refused;
use crate::devices::arm::ArmError;
use rig_config::GrblLamp;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// What the driver needs to know of the arm.
#[derive(Clone, Debug, PartialEq)]
pub struct GrblSettings {
    /// Device path, best under /dev/serial/by-id.
    pub port: PathBuf,
    /// The output the lamp hangs on.
    pub lamp: GrblLamp,
    /// The arm's angle at machine position 0, degrees.
    pub zero_deg: f64,
    /// The rest of the rig file's section.
    pub arm: rig_config::Arm,
}

/// The stored settings that the driver computes with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stored {
    /// Spindle speed of the full output ($30).
    pub spindle_max: f64,
    /// Where the limit switch trips, machine degrees.
    pub switch_deg: f64,
    /// Distance from the switch after homing ($27), degrees.
    pub pull_off_deg: f64,
}

/// Lines of `$$` to numbers.
fn numbers(lines: &[String]) -> BTreeMap<u16, f64> {
    let entry = |line: &String| {
        let (number, value) = line.strip_prefix('$')?.split_once('=')?;
        // Older builds explain each value in brackets behind it.
        let value = value.split_whitespace().next()?;
        Some((number.parse().ok()?, value.parse().ok()?))
    };
    lines.iter().filter_map(entry).collect()
}

impl Stored {
    /// Reads and checks the answer to `$$`.
    ///
    /// # Errors
    /// [`ArmError::Refused`] with every setting that contradicts the rig file, and what to send.
    pub fn check(lines: &[String], settings: &GrblSettings) -> Result<Self, ArmError> {
        let stored = numbers(lines);
        let get = |number: u16| stored.get(&number).copied().unwrap_or(f64::NAN);
        let mut wrong = Vec::new();
        let mut expect = |number: u16, wanted: f64, why: &str| {
            let is = get(number);
            if is.is_nan() || (is - wanted).abs() > 1e-3 * wanted.abs().max(1e-3) {
                wrong.push(format!("${number} is {is}, send ${number}={wanted} ({why})"));
            }
        };
        let arm = &settings.arm;
        expect(1, 255.0, "keeps the motor holding between exposures");
        expect(13, 0.0, "reports millimetres, which stand for degrees");
        expect(21, 0.0, "noise on the switch's cable would end every night");
        expect(22, 1.0, "homing");
        expect(32, 0.0, "laser mode ties the output to motion");
        expect(110, arm.speed_deg_s * 60.0, "arm.speed_deg_s, degrees a minute");
        expect(120, arm.acceleration_deg_s2, "arm.acceleration_deg_s2");
        let mut demand = |holds: bool, words: String| {
            if !holds {
                wrong.push(words);
            }
        };
        demand(get(10) as u32 & 1 == 1, format!("$10 is {}, send $10=1 (reports the machine position)", get(10)));
        let step_deg = get(100).recip();
        demand(
            step_deg <= arm.tolerance_deg,
            format!(
                "$100 is {}: a step of {step_deg} degrees is coarser than arm.tolerance_deg = {}",
                get(100),
                arm.tolerance_deg
            ),
        );
        let ([lower, upper], zero, range) = (arm.travel_deg, settings.zero_deg, get(130));
        demand(
            zero - range <= lower && upper <= zero,
            format!(
                "$130 is {range}: with arm.grbl_zero_deg = {zero} the controller reaches [{}, {zero}] degrees, arm.travel_deg is [{lower}, {upper}]",
                zero - range
            ),
        );
        let search_s = 1.5 * range / get(25) * 60.0 + 15.0;
        demand(
            search_s <= arm.home_timeout_s,
            format!("homing may seek for {search_s:.0} s ($130, $25): set arm.home_timeout_s to at least that"),
        );
        if settings.lamp == GrblLamp::Spindle {
            demand(get(30) > 0.0, format!("$30 is {}, send $30=1000 (full lamp)", get(30)));
        }
        if !wrong.is_empty() {
            let reason = format!("its settings do not fit the rig file: {}", wrong.join("; "));
            return Err(refused("the handshake", reason));
        }
        let switch_deg = if get(23) as u32 & 1 == 1 { -range } else { 0.0 };
        Ok(Self { spindle_max: get(30), switch_deg, pull_off_deg: get(27) })
    }
}
