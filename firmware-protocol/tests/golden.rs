//! The bytes of version 1, frozen in golden/v1.json and packed there by another language.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use firmware_protocol::{
    Answer, Decoder, ErrorCode, Faults, Frame, Hello, HelloAck, Request, State, Status, VERSION, crc16,
};
use serde_json::Value;
use std::process::Command;

fn golden() -> Value {
    serde_json::from_str(include_str!("../golden/v1.json")).unwrap()
}

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

fn decode_one(wire: &[u8]) -> Frame {
    let mut decoder = Decoder::default();
    let frames: Vec<_> = wire.iter().filter_map(|byte| decoder.push(*byte)).collect();
    assert_eq!((frames.len(), decoder.rejected()), (1, 0));
    frames[0]
}

/// One field as the integer type its message wants; fails if it does not fit.
fn field<T: TryFrom<i64, Error: std::fmt::Debug>>(fields: &Value, name: &str) -> T {
    T::try_from(fields[name].as_i64().unwrap()).unwrap()
}

const STATES: [State; 5] = [State::Idle, State::Homing, State::Moving, State::Stopping, State::Faulted];
const CODES: [ErrorCode; 15] = [
    ErrorCode::BadVersion,
    ErrorCode::BadSession,
    ErrorCode::UnknownKind,
    ErrorCode::BadLength,
    ErrorCode::OutOfRange,
    ErrorCode::NotHomed,
    ErrorCode::Busy,
    ErrorCode::Faulted,
    ErrorCode::HomeFailed,
    ErrorCode::SwitchStuck,
    ErrorCode::StepLoss,
    ErrorCode::HostLost,
    ErrorCode::LampFault,
    ErrorCode::OverTemp,
    ErrorCode::StaleSequence,
];

fn request(message: &str, f: &Value) -> Option<Request> {
    Some(match message {
        "hello" => Request::Hello(Hello { proto_min: field(f, "proto_min"), proto_max: field(f, "proto_max") }),
        "move_to" => Request::MoveTo { target_mdeg: field(f, "target_mdeg"), move_id: field(f, "move_id") },
        "status" => Request::Status,
        "home" => Request::Home { move_id: field(f, "move_id") },
        "stop" => Request::Stop,
        "set_lamp" => Request::SetLamp { level_permille: field(f, "level_permille"), ttl_ms: field(f, "ttl_ms") },
        "clear_fault" => Request::ClearFault,
        _ => return None,
    })
}

fn answer(message: &str, f: &Value) -> Answer {
    match message {
        "hello_ack" => Answer::HelloAck(HelloAck {
            proto: field(f, "proto"),
            firmware: [field(f, "fw_major"), field(f, "fw_minor"), field(f, "fw_patch")],
            caps: field(f, "caps"),
            reset_cause: field(f, "reset_cause"),
            homed: field::<u8>(f, "homed") == 1,
            boot_nonce: field(f, "boot_nonce"),
            uptime_ms: field(f, "uptime_ms"),
            travel_mdeg: [field(f, "travel_min_mdeg"), field(f, "travel_max_mdeg")],
        }),
        "accepted" => Answer::Accepted,
        "status_report" => {
            let flags: u8 = field(f, "flags");
            Answer::Status(Status {
                move_id: field(f, "move_id"),
                boot_nonce: field(f, "boot_nonce"),
                position_mdeg: field(f, "position_mdeg"),
                lamp_permille: field(f, "lamp_permille"),
                faults: Faults(field(f, "faults")),
                state: STATES[field::<usize>(f, "state")],
                homed: flags & 1 != 0,
                moving: flags & 2 != 0,
                at_switch: flags & 4 != 0,
            })
        }
        "error" => Answer::Error(CODES[field::<usize>(f, "code") - 1]),
        other => panic!("golden message {other} is unknown here"),
    }
}

#[test]
fn every_golden_frame_encodes_and_decodes_to_the_same_bytes() {
    let golden = golden();
    let frames = golden["frames"].as_array().unwrap();
    assert!(frames.len() >= 27, "golden frames are added, never removed");
    for entry in frames {
        let name = entry["name"].as_str().unwrap();
        let message = entry["message"].as_str().unwrap();
        let (seq, session) = (field(entry, "seq"), field(entry, "session"));
        let wire = bytes(entry["wire"].as_str().unwrap());
        let frame = decode_one(&wire);
        assert_eq!((frame.version, frame.seq, frame.session), (VERSION, seq, session), "{name}");
        let encoded = match request(message, &entry["fields"]) {
            Some(request) => {
                assert_eq!(Request::from_frame(&frame), Ok(request), "{name}");
                request.to_frame(seq, session)
            }
            None => {
                let answer = answer(message, &entry["fields"]);
                assert_eq!(Answer::from_frame(&frame), Ok(answer), "{name}");
                answer.to_frame(seq, session)
            }
        };
        assert_eq!(encoded.to_wire().as_slice(), wire, "{name}");
    }
}

#[test]
fn crc_matches_the_published_check_values() {
    assert_eq!(crc16(b"123456789"), 0x29b1);
    assert_eq!(crc16(b""), 0xffff);
    assert_eq!(crc16(&[0]), 0xe1f0);
}

#[test]
fn the_python_codec_agrees() {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/check.py");
    match Command::new("python3").arg(script).output() {
        Ok(output) => assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr)),
        Err(error) => eprintln!("skipped: python3 cannot be run ({error})"),
    }
}
