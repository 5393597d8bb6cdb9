//! The few wires a device needs from its board.

use crate::message::Faults;

/// What the motor and its switch do now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Motor {
    /// Counted angle, millidegrees.
    pub position_mdeg: i32,
    /// True while steps are being made, ramps included.
    pub moving: bool,
    /// True once a homing found the switch; false again when one starts and after a boot.
    pub homed: bool,
    /// True while the home switch is pressed.
    pub at_switch: bool,
    /// Faults the board sees now; a failed homing stays here until [`Hal::clear_faults`].
    pub faults: Faults,
}

/// Motor, switch and lamp. Every call returns at once; [`Hal::motor`] tells what became of it.
pub trait Hal {
    /// What the motor does now.
    fn motor(&self) -> Motor;
    /// Starts turning to an absolute angle, millidegrees, inside the travel of `DeviceInfo`.
    fn start_move(&mut self, target_mdeg: i32);
    /// Starts looking for the home switch; gives up with `Faults::HOME_FAILED` after a bounded search.
    fn start_home(&mut self);
    /// Slows down along the ramp and holds.
    fn decelerate(&mut self);
    /// Sets the lamp, permille of full; 0 is off.
    fn set_lamp(&mut self, permille: u16);
    /// Forgets the faults of the past; those that persist show again in the next [`Hal::motor`].
    fn clear_faults(&mut self);
}
