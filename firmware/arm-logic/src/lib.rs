//! What the light arm's motor, home switch and lamp do, on any microcontroller: integers only, no allocation.
//!
//! * [`Settings`]: the arm as its builder describes it; [`Mechanics`]: the same checked, in steps and microseconds.
//! * [`Pins`]: the few wires a board offers.
//! * [`rig`]: the arm that is built.
//! * [`Arm`]: steps along ramps, homing, the check for lost steps; it is the `Hal` of `firmware_protocol::Device`.
//!
//! A board calls [`Arm::poll`] when it asked to be called and gives every received frame to the device.
#![no_std]

mod arm;
mod homing;
mod mechanics;
mod pins;
mod ramp;
pub mod rig;
mod switch;

pub use arm::Arm;
pub use mechanics::{Mechanics, Settings};
pub use pins::Pins;
pub use ramp::{Pace, Ramp};
