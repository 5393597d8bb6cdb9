//! The driver of an arm behind GRBL 1.1 or grblHAL: the X axis turns it, one "millimetre" is one degree, the lamp hangs on the spindle
//! or the coolant output.
//!
//! GRBL has no dead-man: when this computer dies the lamp stays on. A soft reset, sent on every way out, switches it off.

mod advice;
mod link;
mod said;
mod settings;

pub use settings::GrblSettings;

use super::Cancel;
use super::arm::{Arm, ArmError, ArmIdentity, ArmStatus};
use super::motion::{allowance, believed, seconds, told, travel_time_s};
use super::serial::SerialTransport;
use advice::refused;
use link::{ANSWER_TIME, Link, Owner};
use rig_config::GrblLamp;
use said::{Outputs, Report, State};
use settings::Stored;
use std::thread;
use std::time::{Duration, Instant};

/// Time between two looks at a turning motor.
const POLL_PERIOD: Duration = Duration::from_millis(100);
/// Reports within which the outputs are stated at least once (grbl: every 10th when idle, every 20th to 30th when busy).
const OUTPUT_REPORTS: usize = 40;
/// Speed at which the switch is sought for a check, degrees per second, and the time between two looks.
const CHECK_SPEED_DEG_S: f64 = 1.0;
const CHECK_PERIOD: Duration = Duration::from_millis(30);
/// Why a report that states the outputs proves no lamp level.
const NO_LAMP: &str = "its reports prove no lamp level: FS: must state a spindle speed from 0 to $30 that A: does not contradict. The lamp \
                       may be on: switch its supply off; send $10=1 (grblHAL: $10=511), build GRBL with VARIABLE_SPINDLE";
/// Why nothing is known of the outputs.
const NO_OUTPUTS: &str = "it never states its outputs (Ov:, A:), so that the lamp may be on: switch its supply off; use GRBL 1.1 with \
                          REPORT_FIELD_OVERRIDES, on grblHAL send $10=511";
/// Slip that the check can tell from its own delays and the switch's play, degrees.
const SLIP_DEG: f64 = 0.3;

/// An arm after its handshake. Dropping it stops the motor and switches the lamp off.
///
/// After [`ArmError::Rebooted`] it is usable again, from [`Arm::home`] on; after [`ArmError::Port`] it must be opened anew.
pub struct GrblArm {
    link: Link,
    settings: GrblSettings,
    stored: Stored,
    firmware: String,
    restarts: u32,
}

impl GrblArm {
    /// Opens the port, waits for the banner, reads who it is and what it has stored; motor and lamp are off then.
    ///
    /// # Errors
    /// [`ArmError::Port`], [`ArmError::NoAnswer`] when no GRBL answers, [`ArmError::Refused`] with all stored settings that
    /// contradict the rig file.
    pub fn open(settings: GrblSettings) -> Result<Self, ArmError> {
        let (link, banner) = Link::open(SerialTransport::open(&settings.port, settings.arm.baud)?)?;
        let ask = |line: &'static str| {
            link.with(2 * ANSWER_TIME, move |owner| owner.line("the handshake", line, ANSWER_TIME, &Cancel::default()))
        };
        let version = ask("$I")?.into_iter().find_map(|line| {
            let version = line.strip_prefix("[VER:")?.strip_suffix(']')?.trim_end_matches(':').to_owned();
            Some(version)
        });
        let stored = Stored::check(&ask("$$")?, &settings)?;
        let firmware =
            format!("{} {}", if banner.starts_with("Grbl ") { "GRBL" } else { "grblHAL" }, version.unwrap_or_default());
        Ok(Self { link, settings, stored, firmware, restarts: 0 })
    }

    /// Runs `work` on the port's thread and keeps count of restarts.
    fn with<T: Send + 'static>(
        &mut self,
        limit: Duration,
        work: impl FnOnce(&mut Owner) -> Result<T, ArmError> + Send + 'static,
    ) -> Result<T, ArmError> {
        let result = self.link.with(limit, work);
        if let Err(ArmError::Rebooted { now, .. }) = result {
            self.restarts = now;
        }
        result
    }

    fn line(&mut self, what: &'static str, text: String, limit: Duration, cancel: &Cancel) -> Result<(), ArmError> {
        let cancel = cancel.clone();
        self.with(2 * limit + ANSWER_TIME, move |owner| owner.line(what, &text, limit, &cancel).map(|_| ()))
    }

    /// A report and whether the arm is homed.
    fn look(&mut self) -> Result<(Report, bool), ArmError> {
        self.with(4 * ANSWER_TIME, |owner| Ok((owner.report()?, owner.homed)))
    }

    /// A report of a homed arm whose position can be believed; else the motor is stopped, and the arm is no longer homed.
    fn stand(&mut self) -> Result<Report, ArmError> {
        let (report, _) = self.look()?;
        if let Err(fault) = self.believed(&report) {
            self.halt()?;
            return Err(fault);
        }
        Ok(report)
    }

    fn believed(&self, report: &Report) -> Result<f64, ArmError> {
        believed(self.settings.zero_deg + report.position_deg, self.settings.arm.travel_deg)
    }

    /// The lamp's level by a report that states the outputs, permille; none when it proves nothing.
    fn lamp_permille(&self, report: &Report, outputs: Outputs) -> Option<u16> {
        if self.settings.lamp == GrblLamp::Coolant {
            return Some(1000 * u16::from(outputs.coolant));
        }
        let full = self.stored.spindle_max;
        // Stated as a whole number, which may be up to half above $30.
        let speed = report.spindle.filter(|speed| (0.0..=full + 0.5).contains(speed))?;
        if speed > 0.0 {
            return Some((1000.0 * speed / full).round().clamp(1.0, 1000.0) as u16);
        }
        (!outputs.spindle).then_some(0)
    }

    fn arm_status(&self, report: &Report, homed: bool, lamp_permille: u16) -> ArmStatus {
        ArmStatus {
            angle_deg: self.settings.zero_deg + report.position_deg,
            homed: homed && report.state != State::Alarm && self.believed(report).is_ok(),
            moving: matches!(report.state, State::Moving | State::Slowing),
            lamp_permille,
            faults: 0,
        }
    }

    /// `!`, then a reset: what a motor was told is gone, and where it stands is not trusted.
    fn halt(&mut self) -> Result<(), ArmError> {
        self.with(ANSWER_TIME, Owner::hold)?;
        let limit = allowance(self.settings.arm.speed_deg_s / self.settings.arm.acceleration_deg_s2);
        let started = Instant::now();
        while matches!(self.look()?.0.state, State::Moving | State::Slowing) && started.elapsed() < limit {
            thread::sleep(POLL_PERIOD);
        }
        self.with(Duration::from_secs(10), |owner| owner.reset().map(|_| ()))
    }

    /// Turns a homed arm to a machine position; returns the report there.
    fn turn(&mut self, to_deg: f64, cancel: &Cancel) -> Result<Report, ArmError> {
        let from = self.stand()?.position_deg;
        self.line("to move", format!("G21G90G53G0X{to_deg:.3}"), ANSWER_TIME, cancel)?;
        let arm = &self.settings.arm;
        let limit = allowance(travel_time_s((to_deg - from).abs(), arm.speed_deg_s, arm.acceleration_deg_s2));
        let started = Instant::now();
        loop {
            if cancel.is_cancelled() {
                self.halt()?;
                return Err(ArmError::Cancelled);
            }
            let report = self.stand()?;
            match report.state {
                State::Idle => break,
                State::Moving if started.elapsed() < limit => thread::sleep(POLL_PERIOD),
                State::Moving | State::Slowing => {
                    self.halt()?;
                    return Err(self.not_arrived(&report, to_deg, started));
                }
                _ => return Err(refused("to move", "it holds, sleeps or is locked: press its reset, then home it")),
            }
        }
        // Idle may have been said before the motion began; this line is taken when nothing is left to do.
        self.line("to move", "G4P0.01".into(), limit, cancel)?;
        let there = self.stand()?;
        let off = (there.position_deg - to_deg).abs();
        if there.state != State::Idle || off > self.settings.arm.tolerance_deg + 0.0005 {
            return Err(self.not_arrived(&there, to_deg, started));
        }
        Ok(there)
    }

    fn not_arrived(&self, report: &Report, to_deg: f64, started: Instant) -> ArmError {
        let zero = self.settings.zero_deg;
        ArmError::NotArrived {
            angle_deg: zero + report.position_deg,
            target_deg: zero + to_deg,
            waited_s: started.elapsed().as_secs_f64(),
        }
    }

    /// Where the switch trips when it is approached slowly, less where it should: what was lost since the last homing, degrees.
    /// None when it does not trip within a degree beyond. At full speed the arm turns inside its travel only.
    fn slip(&mut self, cancel: &Cancel) -> Result<Option<f64>, ArmError> {
        let switch = self.stored.switch_deg;
        let [lower, upper] = self.settings.arm.travel_deg.map(|angle| angle - self.settings.zero_deg);
        let start = self.stored.home_deg().max(lower).min(upper);
        let before = self.turn(start, cancel)?;
        let beyond = switch - self.stored.away() * (1.0 + SLIP_DEG);
        if before.at_switch {
            return Ok(None);
        }
        self.line("to home", format!("$J=G21G90G53X{beyond:.3}F{}", 60.0 * CHECK_SPEED_DEG_S), ANSWER_TIME, cancel)?;
        let limit = allowance((beyond - start).abs() / CHECK_SPEED_DEG_S);
        let started = Instant::now();
        let found = loop {
            if cancel.is_cancelled() {
                self.halt()?;
                return Err(ArmError::Cancelled);
            }
            let report = self.stand()?;
            if report.at_switch {
                break Some(report.position_deg - switch);
            }
            if report.state == State::Idle || started.elapsed() > limit {
                break None;
            }
            thread::sleep(CHECK_PERIOD);
        };
        self.with(ANSWER_TIME, Owner::end_jog)?;
        self.line("to home", "G4P0.01".into(), limit, cancel)?;
        Ok(found)
    }

    fn seek_home(&mut self, cancel: &Cancel) -> Result<ArmStatus, ArmError> {
        let limit = seconds(self.settings.arm.home_timeout_s);
        let (flag, home_deg) = (cancel.clone(), self.stored.home_deg());
        self.with(2 * limit + Duration::from_secs(10), move |owner| {
            owner.homed = false;
            owner.line("to home", "$H", limit, &flag)?;
            // An `ok` alone proves nothing: after homing it counts from the switch.
            let report = owner.report()?;
            owner.homed = report.state == State::Idle && (report.position_deg - home_deg).abs() <= SLIP_DEG;
            Ok(())
        })?;
        let status = self.status()?;
        if !status.homed || status.moving {
            let reason = format!(
                "after homing it must stand at {} degrees, $27 from its switch, and says {}: update its firmware; GRBL must be built \
                 without HOMING_FORCE_SET_ORIGIN (config.h)",
                self.settings.zero_deg + home_deg,
                told(status.angle_deg)
            );
            return Err(refused("to home", reason));
        }
        Ok(status)
    }
}

impl Arm for GrblArm {
    fn identity(&self) -> ArmIdentity {
        ArmIdentity { firmware: self.firmware.clone(), boot_nonce: self.restarts }
    }

    /// An arm that was homed already first shows what it lost since: [`ArmError::StepsLost`], after homing.
    fn home(&mut self, cancel: &Cancel) -> Result<ArmStatus, ArmError> {
        let before = self.status()?;
        if before.moving {
            self.halt()?;
        }
        let slip = if before.homed && !before.moving { Some(self.slip(cancel)?) } else { None };
        let status = self.seek_home(cancel)?;
        match slip {
            Some(slip_deg) if slip_deg.is_none_or(|slip| slip.abs() > SLIP_DEG) => {
                Err(ArmError::StepsLost { slip_deg })
            }
            _ => Ok(status),
        }
    }

    fn move_to(&mut self, angle_deg: f64, cancel: &Cancel) -> Result<ArmStatus, ArmError> {
        let [lower, upper] = self.settings.arm.travel_deg;
        if !(lower..=upper).contains(&angle_deg) {
            let reason =
                format!("{angle_deg} degrees is outside arm.travel_deg [{lower}, {upper}]: choose another angle");
            return Err(refused("to move", reason));
        }
        if !self.look()?.1 {
            return Err(refused("to move", "it does not know its position: home it first"));
        }
        self.turn(angle_deg - self.settings.zero_deg, cancel)?;
        self.status()
    }

    fn prove_position(&mut self, cancel: &Cancel) -> Result<(), ArmError> {
        self.home(cancel).map(|_| ())
    }

    fn set_lamp(&mut self, permille: u16) -> Result<ArmStatus, ArmError> {
        let line = match self.settings.lamp {
            _ if permille > 1000 => {
                return Err(refused("to set the lamp", format!("{permille} permille is more than 1000")));
            }
            GrblLamp::Spindle if permille == 0 => "M5".to_owned(),
            GrblLamp::Spindle => format!("M3S{:.3}", f64::from(permille) / 1000.0 * self.stored.spindle_max),
            GrblLamp::Coolant if permille == 0 => "M9".to_owned(),
            GrblLamp::Coolant if permille == 1000 => "M8".to_owned(),
            GrblLamp::Coolant => {
                let reason = format!("{permille} permille: a lamp on the coolant output is on (1000) or off (0)");
                return Err(refused("to set the lamp", reason));
            }
        };
        self.line("to set the lamp", line, ANSWER_TIME, &Cancel::default())?;
        let status = self.status()?;
        if status.lamp_permille != permille {
            let check = if self.settings.lamp == GrblLamp::Spindle { "$30 and $31" } else { "the coolant output" };
            let reason = format!("{permille} permille asked, {} set: check {check}", status.lamp_permille);
            return Err(refused("to set the lamp", reason));
        }
        Ok(status)
    }

    /// From a report that states the outputs and proves the lamp's level; an override that noise on the line has set is refused.
    fn status(&mut self) -> Result<ArmStatus, ArmError> {
        let mut lacking = NO_OUTPUTS;
        for _ in 0..OUTPUT_REPORTS {
            let (report, homed) = self.look()?;
            let Some(outputs) = report.outputs else { continue };
            if !outputs.plain {
                let reason = "its overrides are not at 100 %: noise on the line has set them; shield the cable".into();
                return Err(ArmError::Locked { reason });
            }
            if let Some(lamp_permille) = self.lamp_permille(&report, outputs) {
                return Ok(self.arm_status(&report, homed, lamp_permille));
            }
            lacking = NO_LAMP;
        }
        Err(refused("a status request", lacking))
    }

    /// An arm that stands keeps its home; one that moves is reset, which also switches the lamp off.
    fn stop(&mut self) -> Result<ArmStatus, ArmError> {
        if !matches!(self.look()?.0.state, State::Idle | State::Alarm) {
            self.halt()?;
        }
        self.status()
    }
}
