//! Studies: how fast, how accurate and how stable the solvers are, on scenes of known truth.

pub mod forward;
pub mod scene;
pub mod score;
