//! `rigd calibrate`: calibrations of a running daemon, and the single steps on photographs in a folder.
pub mod camera;
mod files;
pub mod lights;
pub mod response;
pub mod run;
pub mod settle;

/// Calibrate the rig of a running daemon, or from photographs in a folder.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum Calibrate {
    /// The rig of a running daemon, step by step: board, card, balls.
    Run(run::Run),
    /// The settle time of the arm of a running daemon: how long it swings after a move.
    Settle(settle::Settle),
    /// Calibrations of a running daemon, newest first.
    List(run::List),
    /// One of them as JSON.
    Show(run::Show),
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
        Calibrate::Run(args) => run::run(args),
        Calibrate::Settle(args) => settle::run(args),
        Calibrate::List(daemon) => run::list(daemon),
        Calibrate::Show(args) => run::show(args),
        Calibrate::Camera(args) => camera::run(args),
        Calibrate::Response(args) => response::run(args),
        Calibrate::Lights(args) => lights::run(args),
    }
}
