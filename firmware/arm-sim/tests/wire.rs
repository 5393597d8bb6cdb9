//! The firmware over a real serial line's bytes: frames through a pseudo terminal, time advanced by the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod bench;

use arm_logic::Mechanics;
use arm_sim::{Board, Pty};
use bench::{FAST, INFO, count, start};
use firmware_protocol::{
    Answer, DEAD_MAN_MS, Decoder, DeviceInfo, ErrorCode, Faults, Hello, HelloAck, Request, State, Status, caps,
};
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::time::Duration;

const SESSION: u32 = 0xa1b2_c3d4;
const HELLO: Request = Request::Hello(Hello { proto_min: 1, proto_max: 1 });
/// A kernel slower than this is broken; nothing is measured by it.
const PATIENCE: Duration = Duration::from_secs(10);

/// A board, a line and a host.
struct Rig {
    board: Board,
    pty: Pty,
    port: File,
    decoder: Decoder,
    seq: u16,
}

impl Rig {
    /// Where the arm stands at the start, steps above the edge.
    fn new(above_edge: i64) -> Self {
        let pty = Pty::open().unwrap();
        let port = OpenOptions::new().read(true).write(true).open(pty.path()).unwrap();
        let board = start(above_edge + i64::from(count(FAST.edge_mdeg)), 1500);
        let mut rig = Self { board, pty, port, decoder: Decoder::default(), seq: 0 };
        rig.hello();
        rig
    }

    fn homed() -> Self {
        let mut rig = Self::new(700);
        rig.done(Request::Home { move_id: 1 });
        assert!(rig.status().homed);
        rig
    }

    fn hello(&mut self) -> HelloAck {
        match self.ask(HELLO) {
            Answer::HelloAck(ack) => ack,
            other => panic!("no acknowledgement: {other:?}"),
        }
    }

    fn status(&mut self) -> Status {
        match self.ask(Request::Status) {
            Answer::Status(status) => status,
            other => panic!("no status: {other:?}"),
        }
    }

    /// Starts a motion and polls until it is over.
    fn done(&mut self, request: Request) -> Status {
        assert_eq!(self.ask(request), Answer::Accepted);
        for _ in 0..1000 {
            self.board.advance(100_000);
            let status = self.status();
            if !status.moving {
                return status;
            }
        }
        panic!("still moving: {:?}", self.status());
    }

    fn ask(&mut self, request: Request) -> Answer {
        self.seq = self.seq.wrapping_add(1);
        let frame = request.to_frame(self.seq, SESSION);
        self.send(frame.to_wire().as_slice());
        self.serve();
        let answer = self.receive();
        assert_eq!((answer.seq, answer.session), (self.seq, SESSION));
        Answer::from_frame(&answer).unwrap()
    }

    fn send(&mut self, bytes: &[u8]) {
        self.port.write_all(bytes).unwrap();
    }

    /// The board's main loop until it has answered a frame.
    fn serve(&mut self) {
        let mut buffer = [0; 256];
        loop {
            let count = self.pty.read(&mut buffer, PATIENCE);
            assert!(count > 0, "the line carries nothing");
            let answers: Vec<_> = buffer[..count].iter().filter_map(|byte| self.board.hear(*byte)).collect();
            for answer in &answers {
                self.pty.write(answer.as_slice());
            }
            if !answers.is_empty() {
                return;
            }
        }
    }

    fn receive(&mut self) -> firmware_protocol::Frame {
        let mut byte = [0];
        loop {
            self.port.read_exact(&mut byte).unwrap();
            if let Some(frame) = self.decoder.push(byte[0]) {
                return frame;
            }
        }
    }

    fn reboot(self, boot_nonce: u32) -> Self {
        let Self { board, pty, port, .. } = self;
        let info = DeviceInfo { boot_nonce, ..INFO };
        let board = Board::new(board.power_off(), Mechanics::new(FAST).unwrap(), info);
        Self { board, pty, port, decoder: Decoder::default(), seq: 0 }
    }
}

#[test]
fn a_session_opens_homes_and_moves_to_the_very_step() {
    let mut rig = Rig::new(1500);
    let ack = rig.hello();
    assert_eq!((ack.homed, ack.travel_mdeg), (false, FAST.travel_mdeg));
    assert_ne!(ack.caps & caps::STEP_LOSS_CHECK, 0);
    assert_eq!(rig.ask(Request::MoveTo { target_mdeg: 0, move_id: 1 }), Answer::Error(ErrorCode::NotHomed));

    assert_eq!(rig.ask(Request::Home { move_id: 2 }), Answer::Accepted);
    let status = rig.status();
    assert_eq!((status.state, status.moving, status.homed), (State::Homing, true, false));
    while rig.status().moving {
        rig.board.advance(100_000);
    }
    let status = rig.status();
    assert_eq!((status.state, status.homed, status.move_id), (State::Idle, true, 2));
    assert_eq!(status.position_mdeg, FAST.edge_mdeg + FAST.clear_mdeg);

    let home = rig.board.world().place;
    let status = rig.done(Request::MoveTo { target_mdeg: 12_345, move_id: 3 });
    // 40 steps a degree: 12.345 degrees are 493.8 steps.
    assert_eq!((status.position_mdeg, status.move_id), (12_350, 3));
    assert_eq!(rig.board.world().place - home, 494 + 77 * 40);
    let beyond = Request::MoveTo { target_mdeg: 90_001, move_id: 4 };
    assert_eq!(rig.ask(beyond), Answer::Error(ErrorCode::OutOfRange));
}

#[test]
fn a_move_under_way_is_busy_and_stops_on_its_ramp() {
    let mut rig = Rig::homed();
    assert_eq!(rig.ask(Request::MoveTo { target_mdeg: 80_000, move_id: 2 }), Answer::Accepted);
    rig.board.advance(1_000_000);
    assert_eq!(rig.ask(Request::MoveTo { target_mdeg: 0, move_id: 3 }), Answer::Error(ErrorCode::Busy));
    let before = rig.board.world().place;
    let status = rig.done(Request::Stop);
    // 90 deg/s at 180 deg/s^2 brake within 22.5 degrees, 900 steps, and the step under way.
    let braked = rig.board.world().place - before;
    assert!((899..=901).contains(&braked), "{braked} steps");
    assert_eq!((status.state, status.homed, status.faults), (State::Idle, true, Faults::default()));
    assert_eq!(rig.done(Request::MoveTo { target_mdeg: 0, move_id: 4 }).position_mdeg, 0);
}

#[test]
fn a_silent_host_costs_lamp_and_motion() {
    let mut rig = Rig::homed();
    rig.done(Request::MoveTo { target_mdeg: -70_000, move_id: 2 });
    assert_eq!(rig.ask(Request::SetLamp { level_permille: 750, ttl_ms: 60_000 }), Answer::Accepted);
    assert_eq!(rig.ask(Request::MoveTo { target_mdeg: 90_000, move_id: 3 }), Answer::Accepted);
    // The move alone would take 160 / 90 + 90 / 180 s: the silence ends it.
    rig.board.advance(1_000_000);
    assert_eq!(rig.board.world().lamp_permille, 750);
    rig.board.advance((DEAD_MAN_MS - 1000) * 1000 - 1000);
    assert_eq!(rig.board.world().lamp_permille, 750);
    rig.board.advance(2000);
    assert_eq!(rig.board.world().lamp_permille, 0);
    // 90 deg/s at 180 deg/s^2: at rest half a second later.
    rig.board.advance(500_000);
    let status = rig.status();
    assert_eq!((status.state, status.faults, status.homed), (State::Faulted, Faults::HOST_LOST, true));
    assert!(!status.moving && status.position_mdeg < 80_000, "{status:?}");
    assert_eq!(rig.ask(Request::MoveTo { target_mdeg: 0, move_id: 4 }), Answer::Error(ErrorCode::Faulted));
    assert_eq!(rig.ask(Request::ClearFault), Answer::Accepted);
    assert_eq!(rig.done(Request::MoveTo { target_mdeg: 0, move_id: 5 }).position_mdeg, 0);
}

#[test]
fn a_host_that_falls_silent_during_homing_leaves_a_standing_arm() {
    let mut rig = Rig::new(6000);
    assert_eq!(rig.ask(Request::Home { move_id: 1 }), Answer::Accepted);
    // 6000 steps at 45 deg/s take 3.3 s: the silence ends the first pass.
    rig.board.advance(DEAD_MAN_MS * 1000 - 1000);
    let before = rig.board.world().place;
    rig.board.advance(2_000_000);
    let braked = before - rig.board.world().place;
    // 45 deg/s at 180 deg/s^2: 5.625 degrees, 225 steps; and at most 2 ms at 1800 steps/s before.
    assert!((225..=230).contains(&braked), "{braked} steps");
    let status = rig.status();
    assert_eq!((status.moving, status.homed, status.faults), (false, false, Faults::HOST_LOST));
}

#[test]
fn the_lamp_ends_with_its_own_time() {
    let mut rig = Rig::new(700);
    assert_eq!(rig.ask(Request::SetLamp { level_permille: 300, ttl_ms: 1200 }), Answer::Accepted);
    rig.board.advance(1_198_000);
    assert_eq!(rig.board.world().lamp_permille, 300);
    rig.board.advance(3000);
    assert_eq!((rig.board.world().lamp_permille, rig.status().lamp_permille), (0, 0));
    assert!(rig.status().faults.is_empty());
}

#[test]
fn lost_steps_end_the_move_switch_the_lamp_off_and_ask_for_homing() {
    let mut rig = Rig::homed();
    rig.done(Request::MoveTo { target_mdeg: 50_000, move_id: 2 });
    rig.ask(Request::SetLamp { level_permille: 1000, ttl_ms: 600_000 });
    rig.board.world_mut().slip(113);
    let status = rig.done(Request::MoveTo { target_mdeg: -88_000, move_id: 3 });
    assert_eq!((status.state, status.faults, status.homed), (State::Faulted, Faults::STEP_LOSS, false));
    assert_eq!(rig.board.world().lamp_permille, 0);
    rig.ask(Request::ClearFault);
    assert_eq!(rig.ask(Request::MoveTo { target_mdeg: 0, move_id: 4 }), Answer::Error(ErrorCode::NotHomed));
    assert!(rig.done(Request::Home { move_id: 5 }).homed);
}

#[test]
fn a_stuck_and_a_missing_switch_are_told_apart() {
    for (level, fault) in [(true, Faults::SWITCH_STUCK), (false, Faults::HOME_FAILED)] {
        let mut rig = Rig::new(700);
        rig.board.world_mut().stuck = Some(level);
        rig.board.advance(100_000);
        let status = rig.done(Request::Home { move_id: 1 });
        assert_eq!((status.state, status.faults, status.homed), (State::Faulted, fault, false));
        rig.board.world_mut().stuck = None;
        // Nobody mends a switch within the time it takes to be believed.
        rig.board.advance(100_000);
        rig.ask(Request::ClearFault);
        assert!(rig.done(Request::Home { move_id: 2 }).homed);
    }
}

#[test]
fn a_reboot_shows_in_the_nonce_and_forgets_position_session_and_lamp() {
    let mut rig = Rig::homed();
    rig.ask(Request::SetLamp { level_permille: 1000, ttl_ms: 600_000 });
    let before = rig.status().boot_nonce;
    let mut rig = rig.reboot(before ^ 0x5555);
    assert_eq!((rig.board.world().lamp_permille, rig.board.world().enabled), (0, false));
    assert_eq!(rig.ask(Request::Status), Answer::Error(ErrorCode::BadSession));
    let ack = rig.hello();
    assert_eq!((ack.boot_nonce, ack.homed), (before ^ 0x5555, false));
    assert!(rig.done(Request::Home { move_id: 1 }).homed);
}

#[test]
fn noise_on_the_line_costs_at_most_the_frame_it_hits() {
    let mut rig = Rig::homed();
    let mut random = 0x5eed_u64;
    for turn in 0..300u64 {
        let noise: Vec<u8> = (0..turn % 90)
            .map(|_| {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (random >> 56) as u8
            })
            .collect();
        rig.send(&noise);
        let status = rig.status();
        assert_eq!((status.position_mdeg, status.move_id, status.lamp_permille), (-77_000, 1, 0), "turn {turn}");
    }
    let mut spoiled =
        Request::MoveTo { target_mdeg: 0, move_id: 9 }.to_frame(9999, SESSION).to_wire().as_slice().to_vec();
    spoiled[5] ^= 0x10;
    rig.send(&spoiled);
    let status = rig.status();
    assert_eq!((status.moving, status.move_id), (false, 1));
}
