//! rigd drives a light arm and a camera, merges brackets to radiance and fits a relightable material.
//!
//! Modules are layered: each imports only from those listed below it here (ARCHITECTURE.md; `tests/layers.rs` enforces it).
pub mod cli;
pub mod devices;
pub mod document;
pub mod http;
pub mod notify;
pub mod numerics;
pub mod pipeline;
pub mod session;
pub mod sim;
pub mod store;
pub mod study;
