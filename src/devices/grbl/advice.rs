//! What GRBL's numbers mean to the person at the bench (doc/csv of grbl 1.1).

use crate::devices::arm::ArmError;

/// A refused line.
pub fn error(what: &'static str, code: u8) -> ArmError {
    let reason = match code {
        5 => "homing is switched off: send $22=1",
        8 => "it was not idle: stop it first",
        9 => "it is locked: home it first",
        10 => "soft limits need homing: send $22=1, or $20=0",
        15 => "the target is outside its travel: compare $130 with arm.travel_deg",
        7 => "its stored settings were lost and it restored its defaults: enter them again",
        1..=3 | 11 | 20 | 33 | 36 => "the line arrived damaged, twice: shield the cable, keep it away from the motor's",
        _ => return refused(what, format!("error:{code}: see grbl's list of error codes")),
    };
    refused(what, format!("error:{code}: {reason}"))
}

/// A lock; the controller was reset afterwards and must be homed, which cures every lock but one that homing itself met.
pub fn alarm(what: &'static str, code: u8) -> ArmError {
    let reason = match code {
        8 => {
            return refused(
                what,
                "ALARM:8: the home switch does not open: check the switch, its cable and the pull-off $27",
            );
        }
        9 => {
            let reason = "ALARM:9: the home switch was not found: check switch, cable and a blocked arm. A stock GRBL seeks the Z switch first: \
                          build it with HOMING_CYCLE_0 for X alone (config.h)";
            return refused(what, reason);
        }
        2 => "the target is outside its travel: compare $130 with arm.travel_deg and arm.grbl_zero_deg",
        3 => "it was reset while the motor turned: check its supply",
        6 | 7 => "homing was broken off",
        // Any other number is an unknown fault: as bad as a limit switch hit in motion.
        _ => "it ran onto a limit switch, or the switch's cable caught noise: a free arm needs $21=0",
    };
    ArmError::Locked { reason: format!("ALARM:{code}: {reason}") }
}

/// Any refusal.
pub fn refused(what: &'static str, reason: impl Into<String>) -> ArmError {
    ArmError::Refused { what, reason: reason.into() }
}

/// True for an error that noise on the line makes: the same line is worth sending again.
pub fn garbled(code: u8) -> bool {
    matches!(code, 1 | 2 | 3 | 11 | 20 | 33 | 36)
}
