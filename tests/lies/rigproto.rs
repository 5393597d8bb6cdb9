//! A board that speaks our protocol.

use super::Board;
use firmware_protocol::{Answer, Decoder, Faults, HelloAck, Request, State, Status, VERSION};
use std::sync::{Arc, Mutex};

/// Commands obeyed and questions answered at once, as the protocol asks; then `lie` spoils the status.
pub struct Rigproto<L> {
    decoder: Decoder,
    status: Status,
    pub proto: u8,
    /// Acknowledges motions and does not make them.
    pub ignores: bool,
    heard: Arc<Mutex<Vec<String>>>,
    lie: L,
}

impl<L: FnMut(&mut Status, u32)> Rigproto<L> {
    pub fn new(heard: Arc<Mutex<Vec<String>>>, lie: L) -> Self {
        let status = Status {
            move_id: 1,
            boot_nonce: 7,
            position_mdeg: 0,
            lamp_permille: 0,
            faults: Faults::default(),
            state: State::Idle,
            homed: true,
            moving: false,
            at_switch: false,
        };
        Self { decoder: Decoder::default(), status, proto: VERSION, ignores: false, heard, lie }
    }

    fn answer(&mut self, request: Request) -> Answer {
        self.heard.lock().unwrap().push(format!("{request:?}"));
        match request {
            Request::Hello(_) => {
                return Answer::HelloAck(HelloAck {
                    proto: self.proto,
                    firmware: [1, 0, 0],
                    caps: 15,
                    reset_cause: 0,
                    homed: true,
                    boot_nonce: 7,
                    uptime_ms: 1000,
                    travel_mdeg: [-360_000, 360_000],
                });
            }
            Request::Status => {
                let moves = self.heard.lock().unwrap().iter().filter(|line| line.starts_with("MoveTo")).count();
                let mut status = self.status;
                (self.lie)(&mut status, moves as u32);
                return Answer::Status(status);
            }
            Request::MoveTo { target_mdeg, move_id } if !self.ignores => {
                (self.status.position_mdeg, self.status.move_id) = (target_mdeg, move_id);
            }
            Request::Home { move_id } if !self.ignores => {
                (self.status.position_mdeg, self.status.move_id) = (-90_000, move_id);
            }
            Request::SetLamp { level_permille, .. } => self.status.lamp_permille = level_permille,
            _ => {}
        }
        Answer::Accepted
    }
}

impl<L: FnMut(&mut Status, u32) + Send> Board for Rigproto<L> {
    fn hear(&mut self, byte: u8) -> Vec<u8> {
        let Some(frame) = self.decoder.push(byte) else { return Vec::new() };
        let answer = self.answer(Request::from_frame(&frame).unwrap());
        answer.to_frame(frame.seq, frame.session).to_wire().as_slice().to_vec()
    }
}
