//! The light arm as the session sees it.

use super::Cancel;

/// Who answered the handshake.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ArmIdentity {
    /// Firmware name and version as the device reports it.
    pub firmware: String,
    /// Changes with every boot of the device.
    pub boot_nonce: u32,
}

/// What the device last said of itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmStatus {
    /// Angle of the arm, degrees, as counted by the device.
    pub angle_deg: f64,
    /// True after a successful homing since the device's last boot.
    pub homed: bool,
    /// True while the motor turns.
    pub moving: bool,
    /// Lamp level, permille of full.
    pub lamp_permille: u16,
    /// Latched faults, as the device words them; 0 when none.
    pub faults: u16,
}

/// Why an arm call failed. Every message says what happened and what to do at the bench.
#[derive(Clone, Debug, thiserror::Error)]
pub enum ArmError {
    /// The port could not be opened, or it hung up.
    #[error("serial port {port}: {reason}")]
    Port {
        /// Device path.
        port: String,
        /// What the operating system said, and what to do.
        reason: String,
    },
    /// No valid answer within the time allowed, after all retries.
    #[error("the arm did not answer {what} within {waited_s:.1} s: check power and cable, then start again")]
    NoAnswer {
        /// The request.
        what: &'static str,
        /// Total time waited, seconds.
        waited_s: f64,
    },
    /// The device restarted in the middle of the work: position and lamp state are lost.
    #[error("the arm rebooted (boot nonce {was:#010x} became {now:#010x}): check its supply; it must be homed again")]
    Rebooted {
        /// Nonce at the handshake.
        was: u32,
        /// Nonce now.
        now: u32,
    },
    /// The device locked itself or was disturbed: position and lamp state are lost, and homing cures it.
    #[error("the arm is locked ({reason})")]
    Locked {
        /// What it said, and what to do at the bench if it comes again.
        reason: String,
    },
    /// The device refused or reported a fault.
    #[error("the arm refused {what}: {reason}")]
    Refused {
        /// The request.
        what: &'static str,
        /// The device's reason in words, and what to do.
        reason: String,
    },
    /// The motor stopped elsewhere, or too late.
    #[error(
        "the arm is at {angle_deg:.3} degrees, not at {target_deg:.3}, after {waited_s:.1} s: check for a blocked arm"
    )]
    NotArrived {
        /// Where the status says the arm is.
        angle_deg: f64,
        /// Where it was sent.
        target_deg: f64,
        /// Time waited, seconds.
        waited_s: f64,
    },
    /// Homing again found the arm elsewhere than counted; it is homed now, but what was shot since the last homing is not to be trusted.
    #[error(
        "the arm had lost steps ({}): check for a blocked arm, lower the acceleration",
        slip_deg.map_or("its switch was not where it should be".to_owned(), |slip| format!("{slip:+.2} degrees"))
    )]
    StepsLost {
        /// Counted less true angle, degrees; none when the switch was not met at all.
        slip_deg: Option<f64>,
    },
    /// The caller's [`Cancel`] was set; the motor was told to stop.
    #[error("the move was cancelled and the motor stopped")]
    Cancelled,
    /// Another program of this process holds the device, or its thread ended.
    #[error("the arm's driver has ended: restart the daemon")]
    Gone,
}

/// A light arm with a lamp. Calls block until the device's own status proves the outcome, never on its acknowledgement alone.
pub trait Arm: Send {
    /// Who answered the handshake.
    fn identity(&self) -> ArmIdentity;
    /// Finds the home switch; returns when the status says homed.
    fn home(&mut self, cancel: &Cancel) -> Result<ArmStatus, ArmError>;
    /// Turns to an absolute angle; returns when the status says the motor stands at the target.
    fn move_to(&mut self, angle_deg: f64, cancel: &Cancel) -> Result<ArmStatus, ArmError>;
    /// Sets the lamp; returns when the status says so.
    fn set_lamp(&mut self, permille: u16) -> Result<ArmStatus, ArmError>;
    /// Proves that the counted angle is the true one, where the device does not watch over that itself; the arm may turn to do so.
    ///
    /// # Errors
    /// [`ArmError::StepsLost`] when it was not; the arm is homed then.
    fn prove_position(&mut self, _cancel: &Cancel) -> Result<(), ArmError> {
        Ok(())
    }
    /// Asks for the status.
    fn status(&mut self) -> Result<ArmStatus, ArmError>;
    /// Stops the motor; returns when the status says it stands.
    fn stop(&mut self) -> Result<ArmStatus, ArmError>;
}
