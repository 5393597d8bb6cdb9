//! A rig that loses its power: a disk that keeps only what was forced to it, and sessions that live through cuts.
#![allow(dead_code, missing_docs, clippy::unwrap_used, clippy::expect_used, clippy::panic)]

pub mod disk;
pub mod known;
pub mod lives;
pub mod processing;
pub mod turns;
