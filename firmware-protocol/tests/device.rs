//! What the device does: sessions, repeats, ranges, dead-man, and a lossy line between it and a host.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod board;

use board::{Board, INFO};
use firmware_protocol::{
    Answer, DEAD_MAN_MS, Device, DeviceInfo, ErrorCode, Faults, Frame, Hello, Payload, Request, State, Status,
};

const SESSION: u32 = 0xa1b2_c3d4;
const HELLO: Request = Request::Hello(Hello { proto_min: 1, proto_max: 1 });

/// A device and a host's counters; time passes only through `now`.
struct Bench {
    device: Device<Board>,
    seq: u16,
    now: u32,
}

impl Bench {
    fn new() -> Self {
        // Close to the wrap of the clock, which no board may notice.
        let now = u32::MAX - 1000;
        let mut bench = Self { device: Device::new(Board::default(), INFO, now), seq: 0, now };
        assert!(matches!(bench.ask(HELLO), Answer::HelloAck(_)));
        bench
    }

    fn homed() -> Self {
        let mut bench = Self::new();
        assert_eq!(bench.ask(Request::Home { move_id: 1 }), Answer::Accepted);
        bench.device.hal_mut().arrive();
        bench
    }

    fn ask(&mut self, request: Request) -> Answer {
        self.seq = self.seq.wrapping_add(1);
        self.send(&request.to_frame(self.seq, SESSION))
    }

    fn send(&mut self, frame: &Frame) -> Answer {
        Answer::from_frame(&self.device.handle(frame, self.now)).unwrap()
    }

    fn status(&mut self) -> Status {
        match self.ask(Request::Status) {
            Answer::Status(status) => status,
            other => panic!("no status: {other:?}"),
        }
    }

    fn wait(&mut self, ms: u32) {
        self.now = self.now.wrapping_add(ms);
        self.device.tick(self.now);
    }
}

#[test]
fn homing_moving_and_the_lamp_show_in_the_status() {
    let mut bench = Bench::new();
    assert!(!bench.status().homed);
    assert_eq!(bench.ask(Request::Home { move_id: 7 }), Answer::Accepted);
    assert_eq!(bench.status().state, State::Homing);
    bench.device.hal_mut().arrive();
    let status = bench.status();
    assert_eq!((status.state, status.homed, status.position_mdeg), (State::Idle, true, -90_000));

    assert_eq!(bench.ask(Request::MoveTo { target_mdeg: 12_345, move_id: 8 }), Answer::Accepted);
    let status = bench.status();
    assert_eq!((status.state, status.moving, status.move_id), (State::Moving, true, 8));
    bench.device.hal_mut().arrive();
    assert_eq!(bench.status().position_mdeg, 12_345);

    assert_eq!(bench.ask(Request::SetLamp { level_permille: 800, ttl_ms: 2000 }), Answer::Accepted);
    let status = bench.status();
    assert_eq!((status.lamp_permille, bench.device.hal().lamp_permille), (800, 800));
    assert_eq!(status.boot_nonce, INFO.boot_nonce);
}

#[test]
fn requests_out_of_order_or_range_are_refused_with_their_code() {
    let mut bench = Bench::new();
    let far = Request::MoveTo { target_mdeg: 90_001, move_id: 1 };
    assert_eq!(bench.ask(far), Answer::Error(ErrorCode::NotHomed));
    let mut bench = Bench::homed();
    assert_eq!(bench.ask(far), Answer::Error(ErrorCode::OutOfRange));
    let edge = Request::MoveTo { target_mdeg: 90_000, move_id: 2 };
    assert_eq!(bench.ask(edge), Answer::Accepted);
    assert_eq!(bench.ask(edge), Answer::Error(ErrorCode::Busy));
    assert_eq!(bench.ask(Request::Home { move_id: 3 }), Answer::Error(ErrorCode::Busy));
    let bright = Request::SetLamp { level_permille: 1001, ttl_ms: 1000 };
    assert_eq!(bench.ask(bright), Answer::Error(ErrorCode::OutOfRange));
    assert_eq!(bench.device.hal().lamp_permille, 0);

    let odd = |kind, payload: &[u8]| Frame::new(kind, 1000, SESSION, Payload::new(payload).unwrap());
    assert_eq!(bench.send(&odd(0x55, &[])), Answer::Error(ErrorCode::UnknownKind));
    let mut bench = Bench::homed();
    assert_eq!(bench.send(&odd(0x02, &[1, 2, 3])), Answer::Error(ErrorCode::BadLength));
    let other_version = Frame { version: 2, ..Request::Status.to_frame(2000, SESSION) };
    assert_eq!(bench.send(&other_version), Answer::Error(ErrorCode::BadVersion));
}

#[test]
fn only_the_open_session_is_obeyed() {
    let mut bench = Bench::homed();
    let stale = Request::MoveTo { target_mdeg: 1, move_id: 9 }.to_frame(50, SESSION + 1);
    assert_eq!(bench.send(&stale), Answer::Error(ErrorCode::BadSession));
    assert_eq!(bench.device.hal().moves, 0);
    assert_eq!(bench.send(&HELLO.to_frame(0, 0)), Answer::Error(ErrorCode::BadSession));
    let newer = Request::Hello(Hello { proto_min: 2, proto_max: 3 });
    assert_eq!(bench.send(&newer.to_frame(0, 77)), Answer::Error(ErrorCode::BadVersion));
    bench.status();
}

#[test]
fn a_new_session_finds_motor_and_lamp_off() {
    let mut bench = Bench::homed();
    bench.ask(Request::SetLamp { level_permille: 1000, ttl_ms: 60_000 });
    bench.ask(Request::MoveTo { target_mdeg: 0, move_id: 9 });
    assert!(matches!(bench.send(&HELLO.to_frame(0, 77)), Answer::HelloAck(_)));
    let board = bench.device.hal();
    assert_eq!((board.lamp_permille, board.motor.moving), (0, false));
    let stop = Request::Stop.to_frame(bench.seq + 1, SESSION);
    assert_eq!(bench.send(&stop), Answer::Error(ErrorCode::BadSession));
}

#[test]
fn a_repeated_or_old_sequence_number_executes_nothing() {
    let mut bench = Bench::homed();
    let first = Request::MoveTo { target_mdeg: 1000, move_id: 2 }.to_frame(100, SESSION);
    assert_eq!(bench.send(&first), Answer::Accepted);
    bench.device.hal_mut().arrive();
    assert_eq!(bench.send(&first), Answer::Accepted);
    assert_eq!(bench.device.hal().moves, 1);
    let second = Request::MoveTo { target_mdeg: 2000, move_id: 3 }.to_frame(101, SESSION);
    assert_eq!(bench.send(&second), Answer::Accepted);
    bench.device.hal_mut().arrive();
    assert_eq!(bench.send(&first), Answer::Error(ErrorCode::StaleSequence));
    assert_eq!((bench.device.hal().moves, bench.device.hal().motor.position_mdeg), (2, 2000));
}

#[test]
fn a_silent_host_costs_motor_and_lamp_exactly_at_the_dead_man_time() {
    let mut bench = Bench::homed();
    bench.ask(Request::SetLamp { level_permille: 1000, ttl_ms: 60_000 });
    bench.ask(Request::MoveTo { target_mdeg: 0, move_id: 9 });
    bench.wait(DEAD_MAN_MS - 1);
    assert_eq!((bench.device.hal().lamp_permille, bench.device.hal().motor.moving), (1000, true));
    bench.wait(1);
    assert_eq!((bench.device.hal().lamp_permille, bench.device.hal().motor.moving), (0, false));

    let status = bench.status();
    assert_eq!((status.state, status.faults, status.homed), (State::Faulted, Faults::HOST_LOST, true));
    let refused = Answer::Error(ErrorCode::Faulted);
    assert_eq!(bench.ask(Request::MoveTo { target_mdeg: 0, move_id: 10 }), refused);
    assert_eq!(bench.ask(Request::Home { move_id: 10 }), refused);
    assert_eq!(bench.ask(Request::SetLamp { level_permille: 1, ttl_ms: 1000 }), refused);
    assert_eq!(bench.ask(Request::SetLamp { level_permille: 0, ttl_ms: 0 }), Answer::Accepted);
    assert_eq!(bench.ask(Request::ClearFault), Answer::Accepted);
    assert_eq!(bench.ask(Request::MoveTo { target_mdeg: 0, move_id: 11 }), Answer::Accepted);
}

#[test]
fn any_frame_of_the_session_feeds_the_dead_man_and_no_other_does() {
    let mut bench = Bench::homed();
    bench.ask(Request::SetLamp { level_permille: 1000, ttl_ms: 60_000 });
    for _ in 0..5 {
        bench.wait(DEAD_MAN_MS - 1);
        bench.status();
    }
    assert_eq!(bench.device.hal().lamp_permille, 1000);
    bench.wait(DEAD_MAN_MS - 1);
    bench.send(&Request::Status.to_frame(1, SESSION + 1));
    bench.wait(1);
    assert_eq!(bench.device.hal().lamp_permille, 0);
}

#[test]
fn the_lamp_ends_with_its_own_time_while_the_host_talks() {
    let mut bench = Bench::homed();
    bench.ask(Request::SetLamp { level_permille: 1000, ttl_ms: 2000 });
    bench.wait(1000);
    bench.status();
    bench.wait(999);
    assert_eq!(bench.device.hal().lamp_permille, 1000);
    bench.wait(1);
    assert_eq!((bench.device.hal().lamp_permille, bench.status().lamp_permille), (0, 0));
    assert!(bench.status().faults.is_empty());
}

#[test]
fn a_fault_of_the_board_stops_everything_until_cleared() {
    let mut bench = Bench::homed();
    bench.ask(Request::SetLamp { level_permille: 1000, ttl_ms: 60_000 });
    bench.ask(Request::MoveTo { target_mdeg: 0, move_id: 9 });
    bench.device.hal_mut().fail(Faults::OVER_TEMP);
    bench.wait(1);
    assert_eq!((bench.device.hal().lamp_permille, bench.device.hal().motor.moving), (0, false));
    assert!(bench.status().faults.contains(Faults::OVER_TEMP));
    assert!(matches!(bench.send(&HELLO.to_frame(0, 77)), Answer::HelloAck(_)));
    let status = bench.send(&Request::Status.to_frame(1, 77));
    assert!(matches!(status, Answer::Status(status) if status.faults == Faults::OVER_TEMP), "only the silence is over");
}

/// A line that loses, doubles and delays frames, and a device that reboots: no move is done twice, and what a
/// fresh status proves is what the host last had acknowledged.
#[test]
fn no_move_is_done_twice_over_a_bad_line() {
    let mut state = 0x5eed_u64;
    let mut random = |bound: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % bound
    };
    for run in 0..200u32 {
        let mut bench = Bench::homed();
        let mut late: Vec<Frame> = Vec::new();
        let (mut acknowledged, mut done) = (-90_000, 0);
        for step in 0..50u32 {
            if random(100) == 0 {
                let info = DeviceInfo { boot_nonce: INFO.boot_nonce + 1 + run, ..INFO };
                bench.device = Device::new(Board::default(), info, bench.now);
                // The old session's frames move nothing after a boot.
                for frame in late.drain(..) {
                    assert_eq!(bench.send(&frame), Answer::Error(ErrorCode::BadSession));
                }
                bench.ask(HELLO);
                bench.ask(Request::Home { move_id: 1 });
                bench.device.hal_mut().arrive();
                (acknowledged, done) = (-90_000, 0);
            }
            let target_mdeg = i32::try_from(random(180_000)).unwrap() - 90_000;
            bench.seq = bench.seq.wrapping_add(1);
            let frame = Request::MoveTo { target_mdeg, move_id: step + 2 }.to_frame(bench.seq, SESSION);
            let mut heard = false;
            for _ in 0..3 {
                if random(4) == 0 {
                    continue;
                }
                heard |= bench.send(&frame) == Answer::Accepted && random(4) != 0;
                bench.device.hal_mut().arrive();
                if random(5) == 0 {
                    late.push(frame);
                }
                if !late.is_empty() && random(3) == 0 {
                    let old = late.remove(0);
                    bench.send(&old);
                    bench.device.hal_mut().arrive();
                }
                if heard {
                    break;
                }
            }
            let status = bench.status();
            let taken = status.move_id == step + 2;
            assert!(taken || !heard, "acknowledged and not done");
            if taken {
                acknowledged = target_mdeg;
                done += 1;
            }
            assert_eq!(status.position_mdeg, acknowledged);
            assert_eq!(bench.device.hal().moves, done);
        }
    }
}
