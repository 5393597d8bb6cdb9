//! What a capture rig is: one TOML file, read to validated types with units, refused with every reason at once.
pub mod rig;
pub mod shutter;

pub use rig::*;
pub use shutter::Shutter;
