//! What stands before the simulated camera, and the handle by which an operator changes it.

mod balls;
mod board;
mod patch;

pub use balls::{BALL_RADIUS_MM, Balls};
pub use board::{BOARD, CARD_REFLECTANCE, Flat, Print};
pub use patch::Patch;

use std::sync::{Arc, Mutex, PoisonError};

/// What stands on the stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Placed {
    /// The sampled ball.
    #[default]
    Sample,
    /// The chessboard, held another way for every number.
    Board {
        /// Which way: views of different numbers differ.
        view: usize,
    },
    /// The grey card, laid on the board as it was held for that view.
    Card {
        /// The board's view.
        on: usize,
    },
    /// The three calibration balls.
    Balls,
}

/// The shared stage: an operator writes it, the camera reads it.
#[derive(Clone, Debug, Default)]
pub struct StageHandle(Arc<Mutex<Placed>>);

impl StageHandle {
    /// What stands there now.
    pub fn get(&self) -> Placed {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Clears the stage and places something else.
    pub fn place(&self, what: Placed) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = what;
    }
}
