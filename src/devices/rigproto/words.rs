//! What the wire's numbers mean to the person at the bench.

use crate::devices::arm::ArmError;
use firmware_protocol::{ErrorCode, Faults, Request};

/// The request as error messages name it.
pub fn name(request: &Request) -> &'static str {
    match request {
        Request::Hello(_) => "the handshake",
        Request::MoveTo { .. } => "to move",
        Request::Status => "a status request",
        Request::Home { .. } => "to home",
        Request::Stop => "to stop",
        Request::SetLamp { .. } => "to set the lamp",
        Request::ClearFault => "to clear its faults",
    }
}

/// The device's refusal of `request`, with what to do about it.
pub fn refusal(request: &Request, code: ErrorCode) -> ArmError {
    let reason = advice(code).to_owned();
    match code {
        // A silence of the host is its own fault, not the bench's: homed anew the arm serves again.
        ErrorCode::HostLost | ErrorCode::Faulted => ArmError::Locked { reason },
        _ => ArmError::Refused { what: name(request), reason },
    }
}

/// The arm does not know where it is.
pub fn not_homed(what: &'static str) -> ArmError {
    ArmError::Refused { what, reason: advice(ErrorCode::NotHomed).to_owned() }
}

/// The latched faults as an error of `what`; `Ok` when there are none.
pub fn no_faults(what: &'static str, faults: Faults) -> Result<(), ArmError> {
    if faults.is_empty() {
        return Ok(());
    }
    if faults == Faults::HOST_LOST {
        return Err(ArmError::Locked { reason: advice(ErrorCode::HostLost).to_owned() });
    }
    let known = [
        (Faults::HOME_FAILED, ErrorCode::HomeFailed),
        (Faults::SWITCH_STUCK, ErrorCode::SwitchStuck),
        (Faults::STEP_LOSS, ErrorCode::StepLoss),
        (Faults::HOST_LOST, ErrorCode::HostLost),
        (Faults::LAMP_FAULT, ErrorCode::LampFault),
        (Faults::OVER_TEMP, ErrorCode::OverTemp),
    ];
    let mut words: Vec<String> =
        known.iter().filter(|(bit, _)| faults.contains(*bit)).map(|(_, code)| advice(*code).to_owned()).collect();
    let unknown = known.iter().fold(faults, |rest, (bit, _)| rest.without(*bit));
    if !unknown.is_empty() {
        words.push(format!("fault bits {:#06x} that this program does not know: update it", unknown.0));
    }
    Err(ArmError::Refused { what, reason: words.join("; ") })
}

fn advice(code: ErrorCode) -> &'static str {
    match code {
        ErrorCode::BadVersion => "its firmware speaks another protocol version: install the matching firmware",
        ErrorCode::BadSession => "another program took the arm over: end that program, then home again",
        ErrorCode::UnknownKind | ErrorCode::BadLength => "its firmware does not know this request: update the firmware",
        ErrorCode::OutOfRange => "the value is outside the device's range: compare arm.travel_deg with the firmware's",
        ErrorCode::NotHomed => "it does not know its position: home it first",
        ErrorCode::Busy => "the motor still turns: stop it first",
        ErrorCode::Faulted => "a fault is latched: home the arm to clear it",
        ErrorCode::HomeFailed => "the home switch was not found: check the switch, its cable and a blocked arm",
        ErrorCode::SwitchStuck => "the home switch does not open: check the switch and its cable",
        ErrorCode::StepLoss => "steps were lost: check for a blocked arm, lower the acceleration, then home again",
        ErrorCode::HostLost => {
            "it heard nothing for 1.5 s and made itself safe: home again (was this computer asleep?)"
        }
        ErrorCode::LampFault => "the lamp draws no or too much current: check the bulb",
        ErrorCode::OverTemp => "motor driver or lamp is too hot: let it cool and check the fan",
        ErrorCode::StaleSequence => "it saw a newer request already: check for a second program on the port",
    }
}
