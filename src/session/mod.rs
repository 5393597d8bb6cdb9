//! One acquisition: plan (data), state machine, engine (owner of arm and camera), frame checks, fitting worker.
pub mod engine;
pub mod handle;
pub mod plan;
pub mod quality;
pub mod state;
pub mod worker;
