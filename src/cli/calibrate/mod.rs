//! `rigd calibrate`: the calibration steps on photographs in a folder.
pub mod lights;

/// Calibrate from photographs in a folder.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum Calibrate {
    /// Light positions from frames of balls, intensities from radiance of a grey card.
    Lights(lights::Args),
}

/// Runs the step.
pub fn run(step: &Calibrate) -> anyhow::Result<()> {
    match step {
        Calibrate::Lights(args) => lights::run(args),
    }
}
