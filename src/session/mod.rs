//! One acquisition: plan (data), state machine, engine (owner of arm and camera), frame checks, fitting worker.
mod acquire;
pub mod adaptive;
pub mod bench;
mod book;
pub mod budget;
pub mod calibration;
pub mod crop;
pub mod engine;
pub mod handle;
pub mod index;
mod lamp;
mod ledger;
mod live;
mod order;
pub mod plan;
pub mod preflight;
pub mod processing;
pub mod quality;
pub mod queue;
mod refit;
pub mod report;
pub mod retention;
mod room;
pub mod shadow;
pub mod state;
pub mod verify;
mod verifying;
pub mod witness;
mod work;
mod worker;

/// Program and version, as manifests and images name it.
pub const SOFTWARE: &str = concat!("rigd ", env!("CARGO_PKG_VERSION"));
