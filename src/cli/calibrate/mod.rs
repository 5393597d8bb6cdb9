//! `rigd calibrate`: the calibration steps on photographs in a folder.
pub mod camera;
pub mod lights;
pub mod response;

/// Calibrate from photographs in a folder.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum Calibrate {
    /// Focal length, principal point and distortion from photographs of a chessboard.
    Camera(camera::Args),
    /// Camera response and true shutter times from one bracket.
    Response(response::Args),
    /// Light positions from frames of balls, intensities from radiance of a grey card.
    Lights(lights::Args),
}

/// Runs the step.
pub fn run(step: &Calibrate) -> anyhow::Result<()> {
    match step {
        Calibrate::Camera(args) => camera::run(args),
        Calibrate::Response(args) => response::run(args),
        Calibrate::Lights(args) => lights::run(args),
    }
}
