//! The simulated arm: the firmware's own handler behind a PTY, on a board that moves in simulated mechanics.
//!
//! Motion may run faster than real; the protocol's clocks (dead-man, lamp time) always keep real time.

mod board;
mod faults;
pub(crate) mod motion;
pub(crate) mod pty;

pub use faults::ArmFaults;

use super::pose::{SharedPose, Swing};
use super::ringing::Ringing;
use board::{Board, Mechanics, to_mdeg};
use firmware_protocol::{Decoder, Device, DeviceInfo, Hal, caps};
use pty::Pty;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Time between two looks at motor and clocks while the motor turns.
const MOVING_TICK: Duration = Duration::from_millis(5);
/// The same while it stands.
const IDLE_TICK: Duration = Duration::from_millis(50);

/// The arm to simulate.
#[derive(Clone, Debug)]
pub struct ArmConfig {
    /// Greatest speed, degrees per second; homing takes half of it.
    pub speed_deg_s: f64,
    /// Acceleration, degrees per second squared.
    pub acceleration_deg_s2: f64,
    /// Permitted angles, degrees, lower and upper; the home switch is at the lower.
    pub travel_deg: [f64; 2],
    /// How many times faster than real the motor turns.
    pub speed: f64,
    /// How the arm swings after a move; none: it does not.
    pub ringing: Option<Ringing>,
    /// Where the true pose is written.
    pub pose: SharedPose,
}

impl ArmConfig {
    /// The arm of a rig file, as fast as its simulation says (real time if it has none).
    pub fn from_rig(rig: &rig_config::Rig, pose: SharedPose) -> Self {
        Self {
            speed_deg_s: rig.arm.speed_deg_s,
            acceleration_deg_s2: rig.arm.acceleration_deg_s2,
            travel_deg: rig.arm.travel_deg,
            speed: rig.simulation.as_ref().map_or(1.0, |simulation| simulation.speed),
            ringing: rig.simulation.as_ref().filter(|s| s.ringing).map(|s| Ringing::of_seed(s.seed)),
            pose,
        }
    }
}

/// A running simulated arm; it ends when dropped.
#[derive(Debug)]
pub struct SimulatedArm {
    port: PathBuf,
    faults: ArmFaults,
    moves: Arc<AtomicU32>,
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl SimulatedArm {
    /// Opens a PTY and starts the device on a thread of its own.
    ///
    /// # Errors
    /// What the system said when no PTY or thread could be had.
    pub fn spawn(config: ArmConfig) -> io::Result<Self> {
        let pty = Pty::open()?;
        let port = pty.path().to_owned();
        let (faults, moves, end) = (ArmFaults::default(), Arc::default(), Arc::default());
        let mut bench = Bench::new(config, pty, faults.clone(), Arc::clone(&moves));
        let stop: Arc<AtomicBool> = Arc::clone(&end);
        let run = move || {
            while !stop.load(Ordering::SeqCst) {
                bench.turn();
            }
        };
        let thread = thread::Builder::new().name("simulated-arm".into()).spawn(run)?;
        Ok(Self { port, faults, moves, end, thread: Some(thread) })
    }

    /// The device file to open.
    pub fn port(&self) -> &Path {
        &self.port
    }

    /// What can go wrong with it.
    pub fn faults(&self) -> ArmFaults {
        self.faults.clone()
    }

    /// Moves and homings that the device really began.
    pub fn moves_started(&self) -> u32 {
        self.moves.load(Ordering::SeqCst)
    }
}

impl Drop for SimulatedArm {
    fn drop(&mut self) {
        self.end.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Everything the device's thread owns.
struct Bench {
    device: Device<Board>,
    decoder: Decoder,
    info: DeviceInfo,
    pty: Option<Pty>,
    faults: ArmFaults,
    moves: Arc<AtomicU32>,
    pose: SharedPose,
    speed: f64,
    started: Instant,
    last: Instant,
}

impl Bench {
    fn new(config: ArmConfig, pty: Pty, faults: ArmFaults, moves: Arc<AtomicU32>) -> Self {
        let ArmConfig { speed_deg_s, acceleration_deg_s2, travel_deg, speed, ringing, pose } = config;
        let board = Board::new(Mechanics { speed_deg_s, acceleration_deg_s2, travel_deg, ringing });
        let info = DeviceInfo {
            firmware: [0, 1, 0],
            caps: caps::DIMMING | caps::DEAD_MAN | caps::REBOOT_DETECT,
            reset_cause: 0,
            boot_nonce: rand::random(),
            travel_mdeg: travel_deg.map(to_mdeg),
        };
        pose.set(board.pose());
        let now = Instant::now();
        let device = Device::new(board, info, 0);
        let decoder = Decoder::default();
        Self { device, decoder, info, pty: Some(pty), faults, moves, pose, speed, started: now, last: now }
    }

    /// One round: faults, physics, the device's clocks, and whatever the host sent.
    fn turn(&mut self) {
        let frozen = self.inject();
        let now = Instant::now();
        let dt_s = now.duration_since(self.last).as_secs_f64() * self.speed;
        self.last = now;
        if !frozen {
            self.device.hal_mut().advance(dt_s);
            let now_ms = self.now_ms();
            self.device.tick(now_ms);
        }
        self.show();
        let wait = if self.device.hal().motor().moving { MOVING_TICK } else { IDLE_TICK };
        let mut buffer = [0; 256];
        match &mut self.pty {
            Some(pty) if !frozen => {
                let count = pty.read(&mut buffer, wait);
                self.hear(buffer.get(..count).unwrap_or_default());
            }
            _ => thread::sleep(wait),
        }
    }

    /// Carries out the injected faults; true while the controller is frozen.
    fn inject(&mut self) -> bool {
        let mut wishes = self.faults.wishes();
        let board = self.device.hal_mut();
        board.stall(wishes.stalled);
        board.slip(std::mem::take(&mut wishes.slip_deg));
        board.slip_on_shaft(std::mem::take(&mut wishes.shaft_deg));
        if wishes.unplug {
            self.pty = None;
        }
        let (reboot, frozen) = (std::mem::take(&mut wishes.reboot), wishes.frozen);
        drop(wishes);
        if reboot {
            let mut board = self.device.hal().clone();
            board.power_cycle();
            self.info.boot_nonce = self.info.boot_nonce.wrapping_add(1);
            self.device = Device::new(board, self.info, self.now_ms());
            self.decoder = Decoder::default();
        }
        frozen
    }

    fn hear(&mut self, bytes: &[u8]) {
        for byte in bytes {
            let Some(frame) = self.decoder.push(*byte) else { continue };
            let answer = self.device.handle(&frame, self.now_ms()).to_wire();
            // The pose is true before the host can know of the change.
            self.show();
            self.answer(answer.as_slice());
        }
    }

    fn answer(&mut self, wire: &[u8]) {
        let mut wishes = self.faults.wishes();
        let mut bytes: Vec<u8> = (0..std::mem::take(&mut wishes.noise_bytes)).map(|_| rand::random()).collect();
        let noise = bytes.len();
        if wishes.drop_answers > 0 {
            wishes.drop_answers -= 1;
        } else {
            bytes.extend_from_slice(wire);
        }
        if wishes.garble_answers > 0 {
            wishes.garble_answers -= 1;
            if let Some(byte) = bytes.get_mut(noise + wire.len() / 2) {
                *byte ^= 0x10;
            }
        }
        drop(wishes);
        if let Some(pty) = &mut self.pty {
            pty.write(&bytes);
        }
    }

    fn show(&self) {
        let board = self.device.hal();
        let swinging = board.swing().and_then(|(ringing, since_s)| {
            let before = Duration::try_from_secs_f64(since_s / self.speed).ok()?;
            Some(Swing { ringing, stopped: self.last.checked_sub(before)?, speed: self.speed })
        });
        match swinging {
            Some(swing) => self.pose.set_swinging(board.pose(), swing),
            None => self.pose.set(board.pose()),
        }
        self.moves.store(self.device.hal().moves_started(), Ordering::SeqCst);
    }

    fn now_ms(&self) -> u32 {
        // The firmware's clock wraps as well.
        self.started.elapsed().as_millis() as u32
    }
}
