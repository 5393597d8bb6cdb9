//! What a capture rig is: one TOML file, read to validated types with units, refused with every reason at once.
//!
//! [`Rig::read`] is the only way in: the text is checked against the schema of [`raw`](self) keys (unknown keys, types, missing
//! keys, bounds), then for contradictions between keys, and only a file without any reason for refusal becomes a [`Rig`].
mod check;
mod contradictions;
mod patch;
mod raw;
pub mod read;
pub mod rig;
pub mod shutter;

pub use raw::json_schema;
pub use read::{ReadError, Reason};
pub use rig::*;
pub use shutter::{Shutter, ShutterError};

/// The rig files that come with the program: name and text.
pub const SHIPPED: &[(&str, &str)] = &[
    ("zheng-2008", include_str!("../rigs/zheng-2008.toml")),
    ("simulated", include_str!("../rigs/simulated.toml")),
    ("simulated-calibration", include_str!("../rigs/simulated-calibration.toml")),
];
