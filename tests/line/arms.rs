//! Both kinds of arm at the end of such a line.
#![allow(dead_code, clippy::unwrap_used)]

use super::Line;
use rig_config::{Arm as ArmConfig, ArmDriver, GrblLamp};
use rigd::devices::arm::{Arm, ArmError};
use rigd::devices::grbl::{GrblArm, GrblSettings};
use rigd::devices::rigproto::{RigprotoArm, RigprotoSettings};
use rigd::sim::arm::{ArmConfig as BoardConfig, SimulatedArm};
use rigd::sim::grbl::{GrblConfig, SimulatedGrbl};
use rigd::sim::pose::SharedPose;
use std::path::PathBuf;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    Rigproto,
    Grbl,
}

pub const KINDS: [Kind; 2] = [Kind::Rigproto, Kind::Grbl];
const TRAVEL_DEG: [f64; 2] = [-90.0, 90.0];
const ZERO_DEG: f64 = 93.0;

pub enum Board {
    Rigproto(SimulatedArm),
    Grbl(SimulatedGrbl),
}

/// A board, its true pose, and the line to it.
pub struct Bench {
    pub line: Line,
    pub pose: SharedPose,
    pub board: Board,
}

/// The rig file's section for an arm of this kind on `port`.
pub fn config(kind: Kind, port: PathBuf) -> ArmConfig {
    let driver = match kind {
        Kind::Rigproto => ArmDriver::Rigproto { port },
        Kind::Grbl => ArmDriver::Grbl { port, lamp: GrblLamp::Spindle, zero_deg: ZERO_DEG },
    };
    ArmConfig {
        driver,
        baud: 115_200,
        speed_deg_s: 30.0,
        acceleration_deg_s2: 100.0,
        travel_deg: TRAVEL_DEG,
        tolerance_deg: 0.03,
        settle_s: 0.0,
        park_deg: 0.0,
        home_timeout_s: 60.0,
    }
}

/// Opens the arm of a rig file's section.
pub fn open(arm: &ArmConfig) -> Result<Box<dyn Arm>, ArmError> {
    match &arm.driver {
        ArmDriver::Rigproto { port } => Ok(Box::new(RigprotoArm::open(RigprotoSettings::new(port.clone(), arm))?)),
        ArmDriver::Grbl { port, lamp, zero_deg } => {
            let settings = GrblSettings { port: port.clone(), lamp: *lamp, zero_deg: *zero_deg, arm: arm.clone() };
            Ok(Box::new(GrblArm::open(settings)?))
        }
        ArmDriver::Simulated => Err(ArmError::Gone),
    }
}

impl Bench {
    /// Motion runs `speed` times faster than real.
    pub fn new(kind: Kind, speed: f64, seed: u64) -> Self {
        let pose = SharedPose::default();
        let board = board(kind, speed, pose.clone());
        let line = match &board {
            Board::Rigproto(arm) => Line::new(arm.port(), 0, seed),
            Board::Grbl(arm) => Line::new(arm.port(), b'\n', seed),
        };
        Self { line, pose, board }
    }

    pub fn config(&self) -> ArmConfig {
        let kind = if matches!(self.board, Board::Grbl(_)) { Kind::Grbl } else { Kind::Rigproto };
        config(kind, self.line.port())
    }

    pub fn open(&self) -> Result<Box<dyn Arm>, ArmError> {
        open(&self.config())
    }

    /// What restarts the board.
    pub fn reboot(&self) -> Box<dyn FnMut() + Send> {
        match &self.board {
            Board::Rigproto(arm) => {
                let faults = arm.faults();
                Box::new(move || faults.reboot())
            }
            Board::Grbl(arm) => {
                let faults = arm.faults();
                Box::new(move || faults.reboot())
            }
        }
    }

    /// Moves and homings that the board really began; GRBL's cannot tell.
    pub fn moves(&self) -> Option<u32> {
        match &self.board {
            Board::Rigproto(arm) => Some(arm.moves_started()),
            Board::Grbl(_) => None,
        }
    }
}

/// A board without a line.
pub fn board(kind: Kind, speed: f64, pose: SharedPose) -> Board {
    match kind {
        Kind::Rigproto => {
            let config = BoardConfig {
                speed_deg_s: 30.0,
                acceleration_deg_s2: 100.0,
                travel_deg: TRAVEL_DEG,
                speed,
                pose,
                ringing: None,
            };
            Board::Rigproto(SimulatedArm::spawn(config).unwrap())
        }
        Kind::Grbl => {
            // What the owner of a stock controller must have entered.
            let settings = [(1, 255.0), (10, 1.0), (13, 0.0), (20, 0.0), (21, 0.0), (22, 1.0), (23, 0.0), (25, 900.0)];
            let more = [(27, 3.0), (30, 1000.0), (32, 0.0), (100, 44.444), (110, 1800.0), (120, 100.0), (130, 200.0)];
            let settings = settings.into_iter().chain(more).collect();
            Board::Grbl(SimulatedGrbl::spawn(GrblConfig { settings, zero_deg: ZERO_DEG, speed, pose }).unwrap())
        }
    }
}
