//! What the operator is asked to put before the camera.

use rig_config::Calibration;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A step of a calibration run, in the order in which they come.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Step {
    /// The chessboard, held or laid anew for every view; the last view shows it where the card will lie.
    Board {
        /// The view, from 1.
        view: usize,
        /// Views in all.
        of: usize,
    },
    /// The grey card on the board of the last view.
    Card,
    /// The balls.
    Balls,
    /// Moves of the arm with bursts after them; nobody is asked for anything.
    Settle,
    /// Nothing more.
    Done,
}

impl Step {
    /// Name for messages.
    pub fn name(self) -> String {
        match self {
            Self::Board { view, of } => format!("board, view {view} of {of}"),
            Self::Card => "card".into(),
            Self::Balls => "balls".into(),
            Self::Settle => "settle".into(),
            Self::Done => "done".into(),
        }
    }

    /// What to do, in words.
    pub fn instruction(self, calibration: &Calibration) -> String {
        let Calibration { board_columns, board_rows, card_side_mm, balls, ball_radius_mm, .. } = calibration;
        match self {
            Self::Board { view, of } if view < of => format!(
                "View {view} of {of}: put the chessboard ({board_columns}x{board_rows} inner corners) where the sample will be, whole in the \
                 frame, tilted by 20 to 30 degrees, each time in another direction; then shoot."
            ),
            Self::Board { view, .. } => format!(
                "View {view}, the last: lay the chessboard where the grey card is to lie, facing camera and lamp; it must not move until \
                 the card has been shot; then shoot."
            ),
            Self::Card => format!(
                "Lay the grey card (at least {card_side_mm} mm a side) flat on the board, over its middle, without moving the board; then shoot."
            ),
            Self::Balls => format!(
                "Take board and card away and put up the {balls} balls (radius {ball_radius_mm} mm) where the sample will be, side by side, none \
                 before another and none in another's shadow; then shoot."
            ),
            Self::Settle | Self::Done => "Nothing more to place.".into(),
        }
    }
}
