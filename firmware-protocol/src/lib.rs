//! The light arm's words on the wire, and the device's behaviour, for firmware and simulator alike.
//!
//! * [`Frame`]: what travels, `00 COBS(version kind seq session payload crc) 00`; [`Decoder`] takes bytes in and gives frames out.
//! * [`Request`], [`Answer`]: what a frame means. Kinds and codes are append-only; the payload of a kind never changes.
//! * [`Device`]: how a device answers, written once over the few wires a [`Hal`] offers.
//!
//! A firmware in C needs no line of this crate: `golden/v1.json` freezes the bytes and `golden/check.py` packs them by hand.
//!
//! Version policy: the version byte names the frame's layout. A device answers a frame of another version with
//! [`ErrorCode::BadVersion`]; a host offers the range it speaks in `Hello`. New abilities become new kinds.
#![no_std]

mod decoder;
mod device;
mod frame;
mod hal;
mod message;

pub use decoder::Decoder;
pub use device::{DEAD_MAN_MS, Device, DeviceInfo};
pub use frame::{Frame, FrameError, MAX_PAYLOAD, MAX_WIRE, Payload, VERSION, Wire, crc16};
pub use hal::{Hal, Motor};
pub use message::{Answer, ErrorCode, Faults, Hello, HelloAck, MAX_LAMP_PERMILLE, Request, State, Status, caps};
