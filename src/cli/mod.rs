//! Commands: the composition root. The only place that knows both the simulated and the real devices.
pub mod bench;
pub mod calibrate;
pub mod config;
pub mod daemon;
pub mod demo;
pub mod doctor;
pub mod error;
pub mod fit;
pub mod merge;
pub mod queue;
pub mod relight;
pub mod safe;
pub mod serve;
pub mod session;
pub mod simulate;
pub mod study;
mod target;
pub mod verify;
