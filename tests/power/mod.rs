//! A rig that loses its power: a disk that keeps only what was forced to it, devices that fail, and sessions that live through it.
#![allow(dead_code, missing_docs, clippy::unwrap_used, clippy::expect_used, clippy::panic)]

pub mod clock;
pub mod course;
pub mod disk;
pub mod faults;
pub mod known;
pub mod lives;
mod paced;
pub mod processing;
mod state;
pub mod turns;
