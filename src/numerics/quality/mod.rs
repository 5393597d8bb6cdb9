//! Do the frames of a bracket show one scene, each under its own exposure time and all under one light? Judged on samples of the
//! frames, before any response is known.

mod compare;
mod look;
mod transfer;

pub use compare::{Compared, Doubt, brighter, compare, expected_error};
pub use look::Look;
pub use transfer::Transfers;
