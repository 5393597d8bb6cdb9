//! Calibration as a run of the engine: what the operator is asked for, what is shot, what was measured, and what a session makes of it.
mod exposure;
pub mod file;
pub(in crate::session) mod measure;
pub mod plan;
pub mod progress;
mod radiance;
pub mod sample;
pub mod settle;
pub mod stale;
pub mod step;
