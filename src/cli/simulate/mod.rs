//! `rigd simulate arm|camera`: the simulated devices by themselves.
pub mod arm;
pub mod camera;
