//! The driver of an arm that speaks `firmware-protocol` on a serial port.

mod link;
mod words;

use super::Cancel;
use super::arm::{Arm, ArmError, ArmIdentity, ArmStatus};
use super::motion::{allowance, believed, seconds, travel_time_s};
use super::serial::SerialTransport;
use firmware_protocol::{Answer, ErrorCode, HelloAck, Request, Status};
use link::Link;
use std::path::PathBuf;
use std::thread;
use std::time::{Duration, Instant};

/// Time between two looks at a turning motor.
const POLL_PERIOD: Duration = Duration::from_millis(50);
/// Longest time the device keeps the lamp on without being told again: longer than any night, so that only a computer
/// that was forgotten meets it. A computer that dies meets the dead-man.
const LAMP_TTL_MS: u32 = 24 * 3600 * 1000;

/// What the driver needs to know of the arm.
#[derive(Clone, Debug, PartialEq)]
pub struct RigprotoSettings {
    /// Device path, best under /dev/serial/by-id.
    pub port: PathBuf,
    /// Line speed, baud.
    pub baud: u32,
    /// Greatest speed, degrees per second; with the acceleration it bounds the time a move may take.
    pub speed_deg_s: f64,
    /// Acceleration, degrees per second squared.
    pub acceleration_deg_s2: f64,
    /// A target is reached when the status is this close, degrees.
    pub tolerance_deg: f64,
    /// Permitted angles, degrees, lower and upper.
    pub travel_deg: [f64; 2],
    /// Longest time homing may take, seconds.
    pub home_timeout_s: f64,
}

impl RigprotoSettings {
    /// The settings of a rig file's arm on `port`.
    pub fn new(port: PathBuf, arm: &rig_config::Arm) -> Self {
        Self {
            port,
            baud: arm.baud,
            speed_deg_s: arm.speed_deg_s,
            acceleration_deg_s2: arm.acceleration_deg_s2,
            tolerance_deg: arm.tolerance_deg,
            travel_deg: arm.travel_deg,
            home_timeout_s: arm.home_timeout_s,
        }
    }
}

/// An arm after its handshake. Dropping it stops the motor and switches the lamp off.
///
/// After [`ArmError::Rebooted`] it is usable again, from [`Arm::home`] on; after [`ArmError::Port`] it must be opened anew.
pub struct RigprotoArm {
    link: Link,
    settings: RigprotoSettings,
    identity: ArmIdentity,
    move_id: u32,
}

impl RigprotoArm {
    /// Opens the port and shakes hands; motor and lamp are off then.
    ///
    /// # Errors
    /// [`ArmError::Port`], [`ArmError::NoAnswer`] after 3 s of silence, or [`ArmError::Refused`] when the device speaks
    /// another version or its travel is narrower than the rig file's.
    pub fn open(settings: RigprotoSettings) -> Result<Self, ArmError> {
        let (link, ack) = Link::open(SerialTransport::open(&settings.port, settings.baud)?)?;
        check_travel(settings.travel_deg, &ack)?;
        let [major, minor, patch] = ack.firmware;
        let firmware = format!("rig firmware {major}.{minor}.{patch}, protocol {}", ack.proto);
        let identity = ArmIdentity { firmware, boot_nonce: ack.boot_nonce };
        // Not an id that the device may still have from an earlier run, which would prove nothing.
        Ok(Self { link, settings, identity, move_id: rand::random() })
    }

    fn ask(&mut self, request: Request) -> Result<Answer, ArmError> {
        let answer = self.link.ask(request);
        if let Err(ArmError::Rebooted { now, .. }) = answer {
            self.identity.boot_nonce = now;
        }
        answer
    }

    fn command(&mut self, request: Request) -> Result<(), ArmError> {
        match self.ask(request)? {
            Answer::Accepted => Ok(()),
            _ => Err(words::refusal(&request, ErrorCode::UnknownKind)),
        }
    }

    fn look(&mut self) -> Result<Status, ArmError> {
        match self.ask(Request::Status)? {
            Answer::Status(status) => Ok(status),
            _ => Err(words::refusal(&Request::Status, ErrorCode::UnknownKind)),
        }
    }

    fn next_move(&mut self) -> u32 {
        // 0 is what a device states that has moved nothing since its boot.
        self.move_id = self.move_id.wrapping_add(1).max(1);
        self.move_id
    }

    /// Watches a motion until the motor stands, or for `limit` and then stops it; answers with the last status before that. A status
    /// that does not name the motion shows that the device never began it, whatever it acknowledged.
    fn follow(&mut self, request: Request, limit: Duration, cancel: &Cancel) -> Result<Status, ArmError> {
        let started = Instant::now();
        loop {
            if cancel.is_cancelled() {
                self.halt()?;
                return Err(ArmError::Cancelled);
            }
            let status = self.look()?;
            words::no_faults(words::name(&request), status.faults)?;
            if status.move_id != self.move_id {
                self.halt()?;
                let reason =
                    "it acknowledged and did not begin: update its firmware, check for a second program on the port";
                return Err(ArmError::Refused { what: words::name(&request), reason: reason.into() });
            }
            if !status.moving {
                return Ok(status);
            }
            if started.elapsed() > limit {
                self.halt()?;
                return Ok(status);
            }
            thread::sleep(POLL_PERIOD);
        }
    }

    fn halt(&mut self) -> Result<Status, ArmError> {
        self.command(Request::Stop)?;
        let limit = allowance(self.settings.speed_deg_s / self.settings.acceleration_deg_s2);
        let started = Instant::now();
        loop {
            let status = self.look()?;
            if !status.moving {
                return Ok(status);
            }
            if started.elapsed() > limit {
                let reason = format!("the motor still turns after {:.1} s: cut its power", limit.as_secs_f64());
                return Err(ArmError::Refused { what: words::name(&Request::Stop), reason });
            }
            thread::sleep(POLL_PERIOD);
        }
    }

    /// Where the arm says it stands, if it is homed and that can be believed.
    fn believed(&self, what: &'static str, status: &Status) -> Result<f64, ArmError> {
        if !status.homed {
            return Err(words::not_homed(what));
        }
        believed(to_deg(status.position_mdeg), self.settings.travel_deg)
    }

    /// An arm whose position is not believed counts as not homed.
    fn arm_status(&self, status: &Status) -> ArmStatus {
        ArmStatus {
            angle_deg: to_deg(status.position_mdeg),
            homed: self.believed("a status request", status).is_ok(),
            moving: status.moving,
            lamp_permille: status.lamp_permille,
            faults: status.faults.0,
        }
    }
}

impl Arm for RigprotoArm {
    fn identity(&self) -> ArmIdentity {
        self.identity.clone()
    }

    fn home(&mut self, cancel: &Cancel) -> Result<ArmStatus, ArmError> {
        let before = self.look()?;
        if before.moving {
            self.halt()?;
        }
        if !before.faults.is_empty() {
            // Homing finds the position again, which is the cure of what is latched; what persists latches again.
            self.command(Request::ClearFault)?;
        }
        let request = Request::Home { move_id: self.next_move() };
        self.command(request)?;
        let limit = seconds(self.settings.home_timeout_s);
        let status = self.follow(request, limit, cancel)?;
        if status.moving || !status.homed {
            let reason = format!("not homed after {:.1} s: check the home switch", limit.as_secs_f64());
            return Err(ArmError::Refused { what: words::name(&request), reason });
        }
        self.believed(words::name(&request), &status)?;
        Ok(self.arm_status(&status))
    }

    fn move_to(&mut self, angle_deg: f64, cancel: &Cancel) -> Result<ArmStatus, ArmError> {
        let [lower, upper] = self.settings.travel_deg;
        if !(lower..=upper).contains(&angle_deg) {
            let reason =
                format!("{angle_deg} degrees is outside arm.travel_deg [{lower}, {upper}]: choose another angle");
            return Err(ArmError::Refused { what: "to move", reason });
        }
        let before = self.look()?;
        words::no_faults("to move", before.faults)?;
        let distance = (angle_deg - self.believed("to move", &before)?).abs();
        let request = Request::MoveTo { target_mdeg: to_mdeg(angle_deg), move_id: self.next_move() };
        self.command(request)?;
        let limit = allowance(travel_time_s(distance, self.settings.speed_deg_s, self.settings.acceleration_deg_s2));
        let started = Instant::now();
        let status = self.follow(request, limit, cancel)?;
        let stands_deg = self.believed("to move", &status)?;
        let error_deg = (stands_deg - angle_deg).abs();
        // The wire counts whole millidegrees: half of one is no deviation.
        if status.moving || error_deg > self.settings.tolerance_deg + 0.0005 {
            return Err(ArmError::NotArrived {
                angle_deg: stands_deg,
                target_deg: angle_deg,
                waited_s: started.elapsed().as_secs_f64(),
            });
        }
        Ok(self.arm_status(&status))
    }

    fn set_lamp(&mut self, permille: u16) -> Result<ArmStatus, ArmError> {
        let request = Request::SetLamp { level_permille: permille, ttl_ms: LAMP_TTL_MS };
        self.command(request)?;
        let status = self.look()?;
        if status.lamp_permille != permille {
            words::no_faults(words::name(&request), status.faults)?;
            let reason = format!("{permille} permille asked, {} set: check the lamp", status.lamp_permille);
            return Err(ArmError::Refused { what: words::name(&request), reason });
        }
        Ok(self.arm_status(&status))
    }

    fn status(&mut self) -> Result<ArmStatus, ArmError> {
        self.look().map(|status| self.arm_status(&status))
    }

    fn stop(&mut self) -> Result<ArmStatus, ArmError> {
        self.halt().map(|status| self.arm_status(&status))
    }
}

/// A move the firmware would refuse must show before anything turns.
fn check_travel(travel_deg: [f64; 2], ack: &HelloAck) -> Result<(), ArmError> {
    let ([lower, upper], [least, most]) = (travel_deg.map(to_mdeg), ack.travel_mdeg);
    if least <= lower && upper <= most {
        return Ok(());
    }
    let reason = format!(
        "arm.travel_deg {travel_deg:?} of the rig file exceeds the firmware's [{}, {}]: correct one of them",
        to_deg(least),
        to_deg(most)
    );
    Err(ArmError::Refused { what: "the handshake", reason })
}

fn to_mdeg(angle_deg: f64) -> i32 {
    // Saturates; the device refuses what is outside its travel.
    (angle_deg * 1000.0).round() as i32
}

fn to_deg(angle_mdeg: i32) -> f64 {
    f64::from(angle_mdeg) / 1000.0
}
