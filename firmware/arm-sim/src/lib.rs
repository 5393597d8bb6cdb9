//! The firmware's logic on simulated mechanics, behind a pseudo terminal.
//!
//! * [`World`]: the arm itself, its switch and lamp, and what can go wrong with them; the board's pins reach into it.
//! * [`Board`]: device, decoder and world as a microcontroller's main loop ties them together.
//! * [`Pty`]: the serial line.
//!
//! Time is a number that the caller advances, so tests run as fast as the processor and always alike.

mod board;
mod pty;
mod world;

pub use board::Board;
pub use pty::Pty;
pub use world::World;
