//! Do the frames of a bracket show one scene, each under its own exposure time and all under one light, and where does that light
//! stand? Judged on samples of the frames, before any response is known.

mod compare;
mod light;
mod look;
mod patch;
mod transfer;

pub use compare::{Compared, Doubt, brighter, compare, expected_error, relative_exposure};
pub use light::{Ball, Light, Place, between};
pub use look::Look;
pub use patch::{PatchLevel, patch_change};
pub use transfer::Transfers;
