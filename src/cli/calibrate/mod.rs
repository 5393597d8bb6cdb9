//! `rigd calibrate`: the calibration steps on photographs in a folder.
pub mod response;

/// Calibrate from photographs in a folder.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum Calibrate {
    /// Camera response and true shutter times from one bracket.
    Response(response::Args),
}

/// Runs the step.
pub fn run(step: &Calibrate) -> anyhow::Result<()> {
    match step {
        Calibrate::Response(args) => response::run(args),
    }
}
