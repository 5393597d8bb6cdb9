//! What the controller has stored (`$$`) against what the rig file says. Nothing is ever written to its EEPROM: that is the owner's.

use super::advice::refused;
use crate::devices::arm::ArmError;
use crate::devices::motion::{SWITCH_DEG, told};
use rig_config::GrblLamp;
use std::collections::BTreeMap;
use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// Longest range ($130) that a rig file can ask for, degrees.
const MOST_RANGE_DEG: f64 = 1080.0;
/// Fastest homing ($25), degrees a minute: the fastest arm of a rig file.
const MOST_SPEED: f64 = 60_000.0;
/// Finest steps ($100), steps a degree: no controller makes more than 400 000 steps a second.
const MOST_STEPS: f64 = 100_000.0;
/// Pull-off ($27), degrees: inside the travel, or not farther outside than the switch may be.
const PULL_OFF_DEG: RangeInclusive<f64> = 0.1..=SWITCH_DEG;
/// Spindle speed of the full lamp ($30): reports state whole numbers, so that a smaller one hides a dim lamp.
const FULL_LAMP: RangeInclusive<f64> = 100.0..=100_000.0;

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
    /// Spindle speed of the full output ($30); NaN for a lamp on the coolant output.
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
        let value = value.split_whitespace().next()?.parse().ok().filter(|value: &f64| value.is_finite())?;
        Some((number.parse().ok()?, value))
    };
    lines.iter().filter_map(entry).collect()
}

/// The bits of a setting that is a mask.
fn mask(value: f64) -> Option<u32> {
    (value.fract() == 0.0 && (0.0..65536.0).contains(&value)).then_some(value as u32)
}

/// Settings, and what is wrong with them.
struct Check {
    stored: BTreeMap<u16, f64>,
    wrong: Vec<String>,
}

impl Check {
    /// The value of a setting, which must be there and fit; NaN when it is not. `remedy` says what to send, and why.
    fn demand(&mut self, number: u16, fits: impl FnOnce(f64) -> bool, remedy: impl Display) -> f64 {
        let is = self.stored.get(&number).copied();
        if !is.is_some_and(fits) {
            let is = is.map_or("missing or no number".to_owned(), told);
            self.wrong.push(format!("${number} is {is}, send {remedy}"));
        }
        is.unwrap_or(f64::NAN)
    }

    fn expect(&mut self, number: u16, wanted: f64, why: &str) {
        let fits = |is: f64| (is - wanted).abs() <= 1e-3 * wanted.abs().max(1e-3);
        self.demand(number, fits, format!("${number}={wanted} ({why})"));
    }

    /// `$130` (as it should be when it is wrong), degrees, and where the switch trips, machine degrees.
    fn range(&mut self, [lower, upper]: [f64; 2], zero: f64) -> (f64, f64) {
        let words = "$23=0 if the switch is at the arm's upper end, $23=1 if at its lower";
        let at_lower_end = mask(self.demand(23, |is| mask(is).is_some(), words)).is_some_and(|bits| bits & 1 == 1);
        let needed = zero - lower;
        let most = if at_lower_end { needed + SWITCH_DEG } else { MOST_RANGE_DEG };
        let words = format!(
            "$130={needed}: arm.grbl_zero_deg = {zero} less that is the lower end of arm.travel_deg [{lower}, {upper}] (at most {most})"
        );
        // Three decimals are stored.
        let fits = |is: f64| (needed - 1e-3..=most).contains(&is);
        let range = self.demand(130, fits, words);
        let range = if fits(range) { range } else { needed };
        let above = if at_lower_end { MOST_RANGE_DEG } else { SWITCH_DEG };
        if !(0.0..=above).contains(&(zero - upper)) {
            self.wrong.push(format!(
                "arm.grbl_zero_deg = {zero} must be 0 to {above} degrees above the upper end of arm.travel_deg [{lower}, {upper}]: correct it"
            ));
        }
        (range, if at_lower_end { -range } else { 0.0 })
    }

    /// Homing must end within `arm.home_timeout_s`.
    fn homing(&mut self, range: f64, timeout_s: f64) {
        let search_s = |speed: f64| 1.5 * range / speed * 60.0 + 15.0;
        let least = (90.0 * range / (timeout_s - 15.0)).ceil();
        let words = if (1.0..=MOST_SPEED).contains(&least) {
            format!("$25={least} at least, or set arm.home_timeout_s higher: homing seeks as far as 1.5 x $130")
        } else {
            format!(
                "$25=900 and set arm.home_timeout_s to at least {:.0}: homing seeks as far as 1.5 x $130",
                search_s(900.0).ceil()
            )
        };
        self.demand(25, |is| is > 0.0 && is <= MOST_SPEED && search_s(is) <= timeout_s, words);
    }
}

impl Stored {
    /// Reads and checks the answer to `$$`.
    ///
    /// # Errors
    /// [`ArmError::Refused`] with every setting that contradicts the rig file or is out of all reason, and what to send.
    pub fn check(lines: &[String], settings: &GrblSettings) -> Result<Self, ArmError> {
        let mut check = Check { stored: numbers(lines), wrong: Vec::new() };
        let arm = &settings.arm;
        check.expect(1, 255.0, "keeps the motor holding between exposures");
        check.expect(13, 0.0, "reports millimetres, which stand for degrees");
        check.expect(21, 0.0, "noise on the switch's cable would end every night");
        check.expect(22, 1.0, "homing");
        check.expect(32, 0.0, "laser mode ties the output to motion");
        check.expect(110, arm.speed_deg_s * 60.0, "arm.speed_deg_s, degrees a minute");
        check.expect(120, arm.acceleration_deg_s2, "arm.acceleration_deg_s2");
        let states_position = |is: f64| mask(is).is_some_and(|bits| bits & 1 == 1);
        check.demand(10, states_position, "$10=1 (grblHAL: $10=511; reports the machine position)");
        let least = arm.tolerance_deg.recip();
        let words = format!(
            "$100={:.3} or more: steps a degree, a turn's steps x microsteps x gear / 360; a step must not exceed arm.tolerance_deg = {}",
            (1e3 * least).ceil() / 1e3,
            arm.tolerance_deg
        );
        check.demand(100, |is| is >= least && is <= MOST_STEPS, words);
        let (range, switch_deg) = check.range(arm.travel_deg, settings.zero_deg);
        check.homing(range, arm.home_timeout_s);
        let words = format!(
            "$27=3 (degrees back from the switch after homing, {} to {})",
            PULL_OFF_DEG.start(),
            PULL_OFF_DEG.end()
        );
        let pull_off_deg = check.demand(27, |is| PULL_OFF_DEG.contains(&is), words);
        let mut spindle_max = f64::NAN;
        if settings.lamp == GrblLamp::Spindle {
            let words = format!("$30=1000 (full lamp, {} to {})", FULL_LAMP.start(), FULL_LAMP.end());
            spindle_max = check.demand(30, |is| FULL_LAMP.contains(&is), words);
        }
        if !check.wrong.is_empty() {
            let reason = format!("its settings do not fit the rig file: {}", check.wrong.join("; "));
            return Err(refused("the handshake", reason));
        }
        Ok(Self { spindle_max, switch_deg, pull_off_deg })
    }

    /// Sense of the way from the switch into the travel.
    pub fn away(&self) -> f64 {
        if self.switch_deg < 0.0 { 1.0 } else { -1.0 }
    }

    /// Where it stands after homing, machine degrees.
    pub fn home_deg(&self) -> f64 {
        self.switch_deg + self.away() * self.pull_off_deg
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;
    use rig_config::{Arm, ArmDriver};

    fn settings(lamp: GrblLamp, zero_deg: f64) -> GrblSettings {
        let port = PathBuf::from("/dev/none");
        let driver = ArmDriver::Grbl { port: port.clone(), lamp, zero_deg };
        let arm = Arm {
            driver,
            baud: 115_200,
            speed_deg_s: 30.0,
            acceleration_deg_s2: 100.0,
            travel_deg: [-90.0, 90.0],
            tolerance_deg: 0.03,
            settle_s: 0.5,
            park_deg: 0.0,
            home_timeout_s: 60.0,
        };
        GrblSettings { port, lamp, zero_deg, arm }
    }

    /// A good set with one line replaced, or left out when the value is empty.
    fn lines(number: u16, value: &str) -> Vec<String> {
        let good = "1=255 10=1 13=0 20=0 21=0 22=1 23=0 25=900 27=3 30=1000 32=0 100=44.444 110=1800 120=100 130=200";
        let stored = good.split(' ').filter_map(|line| {
            let (known, usual) = line.split_once('=')?;
            let value = if known == number.to_string() { value } else { usual };
            (!value.is_empty()).then(|| format!("${known}={value}"))
        });
        stored.collect()
    }

    fn check(number: u16, value: &str, lamp: GrblLamp, zero_deg: f64) -> Result<Stored, String> {
        Stored::check(&lines(number, value), &settings(lamp, zero_deg)).map_err(|error| error.to_string())
    }

    #[test]
    fn every_number_out_of_reason_is_refused_with_the_line_to_send() {
        assert!(check(0, "", GrblLamp::Spindle, 93.0).is_ok());
        let senseless = ["", "nan", "inf", "-inf", "1e300", "-1", "x"];
        let close = [
            (10, &["0", "2", "1.5", "4294967295.7"][..], "$10=1"),
            (23, &["0.5"], "$23=0"),
            (25, &["0", "300", "60001"], "$25=400"),
            (27, &["0", "-60", "350", "10.1", "1e-9"], "$27=3"),
            (30, &["0", "1", "99", "100001"], "$30=1000"),
            (100, &["0", "1e-300", "33"], "$100=33.334"),
            (130, &["150", "182.9", "1081"], "$130=183"),
            (110, &["600"], "$110=1800"),
        ];
        for (number, values, line) in close {
            for value in values.iter().chain(&senseless) {
                let said = check(number, value, GrblLamp::Spindle, 93.0).expect_err(value);
                assert!(said.contains(&format!("send {line}")) && said.len() < 400, "${number}={value}: {said}");
                assert_eq!(said.matches("send ").count(), 1, "${number}={value}: {said}");
            }
        }
    }

    #[test]
    fn the_switch_lies_at_the_end_of_the_travel() {
        let upper = check(27, "10", GrblLamp::Spindle, 100.0).unwrap();
        assert_eq!((upper.switch_deg, upper.away(), upper.home_deg()), (0.0, -1.0, -10.0));
        assert!(check(27, "3", GrblLamp::Spindle, 100.1).unwrap_err().contains("arm.grbl_zero_deg = 100.1"));
        assert!(check(27, "3", GrblLamp::Spindle, 89.0).unwrap_err().contains("arm.grbl_zero_deg = 89"));
        let mut at_lower = lines(23, "1");
        assert!(
            Stored::check(&at_lower, &settings(GrblLamp::Spindle, 93.0)).unwrap_err().to_string().contains("$130=183")
        );
        at_lower.retain(|line| !line.starts_with("$130"));
        at_lower.push("$130=190".into());
        let lower = Stored::check(&at_lower, &settings(GrblLamp::Spindle, 93.0)).unwrap();
        assert_eq!((lower.switch_deg, lower.away(), lower.home_deg()), (-190.0, 1.0, -187.0));
    }

    #[test]
    fn a_lamp_on_the_coolant_output_asks_for_no_spindle() {
        assert!(check(30, "", GrblLamp::Coolant, 93.0).is_ok());
    }
}
