//! How a device answers and how it keeps itself safe.

use crate::frame::{Frame, VERSION};
use crate::hal::{Hal, Motor};
use crate::message::{Answer, ErrorCode, Faults, Hello, HelloAck, MAX_LAMP_PERMILLE, Request, State, Status};

/// Silence of the host after which motor and lamp are switched off, milliseconds. Lamp out and arm at rest take less than 2 s where the
/// motor brakes within half a second.
pub const DEAD_MAN_MS: u32 = 1500;

/// What the device knows of itself from the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceInfo {
    /// Firmware version: major, minor, patch.
    pub firmware: [u8; 3],
    /// Abilities, bits of `caps`.
    pub caps: u16,
    /// Why the board last started, in its own numbers.
    pub reset_cause: u8,
    /// Another number after every boot: from a counter in non-volatile memory or a noise source.
    pub boot_nonce: u32,
    /// Permitted angles, millidegrees, lower and upper.
    pub travel_mdeg: [i32; 2],
}

struct Lamp {
    since_ms: u32,
    level_permille: u16,
    ttl_ms: u32,
}

/// The device behind the wire: motor standing, lamp off and no session when new.
///
/// `now_ms` is a millisecond clock that may wrap; call [`Device::tick`] at least every 50 ms.
pub struct Device<H> {
    hal: H,
    info: DeviceInfo,
    started_ms: u32,
    session: Option<u32>,
    heard_ms: u32,
    last_answer: Option<Frame>,
    lamp: Lamp,
    faults: Faults,
    move_id: u32,
    state: State,
}

impl<H: Hal> Device<H> {
    /// A device that has just booted.
    pub fn new(hal: H, info: DeviceInfo, now_ms: u32) -> Self {
        let mut device = Self {
            hal,
            info,
            started_ms: now_ms,
            session: None,
            heard_ms: now_ms,
            last_answer: None,
            lamp: Lamp { since_ms: now_ms, level_permille: 0, ttl_ms: 0 },
            faults: Faults::default(),
            move_id: 0,
            state: State::Idle,
        };
        device.set_lamp(now_ms, 0, 0);
        device
    }

    /// The board.
    pub fn hal(&self) -> &H {
        &self.hal
    }

    /// The board, for whoever drives it between ticks.
    pub fn hal_mut(&mut self) -> &mut H {
        &mut self.hal
    }

    /// Looks at the clocks and the motor: dead-man, lamp time, faults, end of motion.
    pub fn tick(&mut self, now_ms: u32) {
        let motor = self.hal.motor();
        if !motor.moving {
            self.state = State::Idle;
        }
        self.latch(motor.faults, now_ms);
        if self.session.is_some() && now_ms.wrapping_sub(self.heard_ms) >= DEAD_MAN_MS {
            self.latch(Faults::HOST_LOST, now_ms);
        }
        if self.lamp.level_permille > 0 && now_ms.wrapping_sub(self.lamp.since_ms) >= self.lamp.ttl_ms {
            self.set_lamp(now_ms, 0, 0);
        }
    }

    /// Answers a frame. A repeated sequence number gets the first answer again and executes nothing.
    pub fn handle(&mut self, frame: &Frame, now_ms: u32) -> Frame {
        self.tick(now_ms);
        let answer = |answer: Answer| answer.to_frame(frame.seq, frame.session);
        if frame.version != VERSION {
            return answer(Answer::Error(ErrorCode::BadVersion));
        }
        let request = Request::from_frame(frame);
        let own = self.session == Some(frame.session);
        if let (Ok(Request::Hello(hello)), false) = (request, own) {
            return match self.open(hello, frame.session, now_ms) {
                Ok(()) => self.remember(answer(self.hello_ack(now_ms))),
                Err(code) => answer(Answer::Error(code)),
            };
        }
        if !own {
            return answer(Answer::Error(ErrorCode::BadSession));
        }
        self.heard_ms = now_ms;
        if let Some(last) = self.last_answer {
            match frame.seq.wrapping_sub(last.seq) {
                0 => return last,
                // Sequence numbers count up; the farther half of the circle lies in the past.
                0x8000.. => return answer(Answer::Error(ErrorCode::StaleSequence)),
                _ => {}
            }
        }
        let outcome = request.and_then(|request| self.execute(request, now_ms)).unwrap_or_else(Answer::Error);
        self.remember(answer(outcome))
    }

    fn remember(&mut self, answer: Frame) -> Frame {
        self.last_answer = Some(answer);
        answer
    }

    /// Opens a session: whatever the last host left running is stopped, and the fault its silence latched is over.
    fn open(&mut self, hello: Hello, session: u32, now_ms: u32) -> Result<(), ErrorCode> {
        if !(hello.proto_min..=hello.proto_max).contains(&VERSION) {
            return Err(ErrorCode::BadVersion);
        }
        if session == 0 {
            return Err(ErrorCode::BadSession);
        }
        self.make_safe(now_ms);
        self.faults = self.faults.without(Faults::HOST_LOST);
        self.session = Some(session);
        self.heard_ms = now_ms;
        Ok(())
    }

    fn execute(&mut self, request: Request, now_ms: u32) -> Result<Answer, ErrorCode> {
        match request {
            Request::Hello(_) => return Ok(self.hello_ack(now_ms)),
            Request::Status => return Ok(Answer::Status(self.status())),
            Request::MoveTo { target_mdeg, move_id } => self.start_move(target_mdeg, move_id)?,
            Request::Home { move_id } => self.start_home(move_id)?,
            Request::Stop => self.stop(),
            Request::SetLamp { level_permille: 0, .. } => self.set_lamp(now_ms, 0, 0),
            Request::SetLamp { level_permille, ttl_ms } => self.light(now_ms, level_permille, ttl_ms)?,
            Request::ClearFault => {
                self.faults = Faults::default();
                self.hal.clear_faults();
            }
        }
        Ok(Answer::Accepted)
    }

    fn start_move(&mut self, target_mdeg: i32, move_id: u32) -> Result<(), ErrorCode> {
        let motor = self.ready_to_turn()?;
        if !motor.homed {
            return Err(ErrorCode::NotHomed);
        }
        let [lower, upper] = self.info.travel_mdeg;
        if !(lower..=upper).contains(&target_mdeg) {
            return Err(ErrorCode::OutOfRange);
        }
        self.hal.start_move(target_mdeg);
        (self.state, self.move_id) = (State::Moving, move_id);
        Ok(())
    }

    fn start_home(&mut self, move_id: u32) -> Result<(), ErrorCode> {
        self.ready_to_turn()?;
        self.hal.start_home();
        (self.state, self.move_id) = (State::Homing, move_id);
        Ok(())
    }

    fn ready_to_turn(&self) -> Result<Motor, ErrorCode> {
        let motor = self.hal.motor();
        match (self.faults.is_empty(), motor.moving) {
            (false, _) => Err(ErrorCode::Faulted),
            (true, true) => Err(ErrorCode::Busy),
            (true, false) => Ok(motor),
        }
    }

    fn light(&mut self, now_ms: u32, level_permille: u16, ttl_ms: u32) -> Result<(), ErrorCode> {
        if level_permille > MAX_LAMP_PERMILLE {
            return Err(ErrorCode::OutOfRange);
        }
        if !self.faults.is_empty() {
            return Err(ErrorCode::Faulted);
        }
        self.set_lamp(now_ms, level_permille, ttl_ms);
        Ok(())
    }

    fn set_lamp(&mut self, now_ms: u32, level_permille: u16, ttl_ms: u32) {
        self.lamp = Lamp { since_ms: now_ms, level_permille, ttl_ms };
        self.hal.set_lamp(level_permille);
    }

    fn stop(&mut self) {
        if self.hal.motor().moving {
            self.hal.decelerate();
            self.state = State::Stopping;
        }
    }

    fn latch(&mut self, faults: Faults, now_ms: u32) {
        if !self.faults.contains(faults) {
            self.faults = self.faults.union(faults);
            self.make_safe(now_ms);
        }
    }

    fn make_safe(&mut self, now_ms: u32) {
        self.stop();
        self.set_lamp(now_ms, 0, 0);
    }

    /// What a status request is answered with.
    pub fn status(&self) -> Status {
        let motor = self.hal.motor();
        Status {
            move_id: self.move_id,
            boot_nonce: self.info.boot_nonce,
            position_mdeg: motor.position_mdeg,
            lamp_permille: self.lamp.level_permille,
            faults: self.faults,
            state: if self.faults.is_empty() { self.state } else { State::Faulted },
            homed: motor.homed,
            moving: motor.moving,
            at_switch: motor.at_switch,
        }
    }

    fn hello_ack(&self, now_ms: u32) -> Answer {
        Answer::HelloAck(HelloAck {
            proto: VERSION,
            firmware: self.info.firmware,
            caps: self.info.caps,
            reset_cause: self.info.reset_cause,
            homed: self.hal.motor().homed,
            boot_nonce: self.info.boot_nonce,
            uptime_ms: now_ms.wrapping_sub(self.started_ms),
            travel_mdeg: self.info.travel_mdeg,
        })
    }
}
