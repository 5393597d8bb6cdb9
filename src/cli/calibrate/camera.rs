//! `rigd calibrate camera`: intrinsics, distortion and board poses from a folder of chessboard photographs.

use super::files;
use crate::cli::error::{bad_input, print_line};
use crate::cli::target::Target;
use crate::pipeline::calibration::camera::{Board, CameraCalibration, Photograph, calibrate_camera};
use std::path::PathBuf;

/// Measure the camera on photographs of a chessboard.
///
/// Every JPEG, PNG and BMP file of the folder is taken for a photograph of the board. Those that do not serve are left out and listed
/// with the reason.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Folder of photographs of one board, all by one camera, unzoomed and unfocused between.
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
    /// Inner corners of the board, where four squares meet: a board of 10x7 squares has 9x6.
    #[arg(long, value_name = "COLUMNSxROWS", value_parser = corners)]
    board: (usize, usize),
    /// Side of a square, mm.
    #[arg(long, value_name = "MM")]
    square_mm: f64,
    /// Write the calibration to this file.
    #[arg(long, value_name = "FILE.json")]
    out: Option<PathBuf>,
    /// Print the calibration as JSON and nothing else.
    #[arg(long)]
    json: bool,
}

fn corners(text: &str) -> Result<(usize, usize), String> {
    let parsed = text.split_once('x').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
    parsed.ok_or_else(|| "give inner corners as COLUMNSxROWS, for example 9x6".into())
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let target = Target::optional(args.out.as_deref(), "json", &[])?;
    let board = Board { columns: args.board.0, rows: args.board.1, square_mm: args.square_mm };
    let files = files::pictures(&args.folder).map_err(bad_input)?;
    let photographs: Vec<Photograph<'_>> = files.iter().map(|(name, bytes)| Photograph { name, bytes }).collect();
    let found = calibrate_camera(&photographs, &board)
        .map_err(|error| bad_input(format!("{}: {error}", args.folder.display())))?;
    let json = serde_json::to_string_pretty(&found)?;
    if let Some(target) = target {
        target.write_text(&json)?;
    }
    Ok(print_line(if args.json { json } else { summary(&found).trim_end().to_owned() })?)
}

/// What a person wants to know, a line each.
fn summary(found: &CameraCalibration) -> String {
    let used = found.views.iter().filter(|view| view.rejected.is_none()).count();
    let ([fx, fy], [cx, cy]) = (found.focal_px, found.principal_px);
    let ([sfx, sfy], [scx, scy]) = (found.sigma.focal_px, found.sigma.principal_px);
    let mut text = format!(
        "{used} of {} photographs used, {}x{} pixels, reprojection {:.3} px rms\n\
         focal length    {fx:.2} +- {sfx:.2}, {fy:.2} +- {sfy:.2} px\n\
         principal point {cx:.2} +- {scx:.2}, {cy:.2} +- {scy:.2} px\n",
        found.views.len(),
        found.width,
        found.height,
        found.rms_px
    );
    for (i, name) in ["k1", "k2", "p1", "p2", "k3"].iter().enumerate() {
        if !found.held.iter().any(|held| held == name) {
            text += &format!("{name}              {:.6} +- {:.6}\n", found.distortion[i], found.sigma.distortion[i]);
        }
    }
    for decision in &found.decisions {
        text += &format!("{}: {}\n", decision.parameters, decision.reason);
    }
    for view in &found.views {
        text += &match (&view.rejected, view.rms_px, view.pose) {
            (None, Some(rms), Some(pose)) => {
                let [x, y, z] = pose.translation_mm;
                format!("{}: {rms:.3} px rms, board at ({x:.1}, {y:.1}, {z:.1}) mm\n", view.name)
            }
            (reason, ..) => format!("{}: LEFT OUT: {}\n", view.name, reason.as_deref().unwrap_or("not used")),
        };
    }
    for warning in &found.warnings {
        text += &format!("warning: {warning}\n");
    }
    text
}
