//! Messages as frames: kinds and fields, little-endian, one after another.

use super::{Answer, ErrorCode, Faults, Hello, HelloAck, Request, State, Status, kind};
use crate::frame::{Frame, Payload};

impl Request {
    /// The request as a frame.
    pub fn to_frame(&self, seq: u16, session: u32) -> Frame {
        let (kind, payload) = match *self {
            Self::Hello(hello) => (kind::HELLO, [hello.proto_min, hello.proto_max].into()),
            Self::MoveTo { target_mdeg, move_id } => {
                (kind::MOVE_TO, pack::<8>(&[&target_mdeg.to_le_bytes(), &move_id.to_le_bytes()]))
            }
            Self::Status => (kind::STATUS, [].into()),
            Self::Home { move_id } => (kind::HOME, move_id.to_le_bytes().into()),
            Self::Stop => (kind::STOP, [].into()),
            Self::SetLamp { level_permille, ttl_ms } => {
                (kind::SET_LAMP, pack::<6>(&[&level_permille.to_le_bytes(), &ttl_ms.to_le_bytes()]))
            }
            Self::ClearFault => (kind::CLEAR_FAULT, [].into()),
        };
        Frame::new(kind, seq, session, payload)
    }

    /// Reads a request; `UnknownKind` or `BadLength` if it is none.
    pub fn from_frame(frame: &Frame) -> Result<Self, ErrorCode> {
        let mut fields = Fields(frame.payload.as_slice());
        let request = match frame.kind {
            kind::HELLO => Self::Hello(Hello { proto_min: fields.u8()?, proto_max: fields.u8()? }),
            kind::MOVE_TO => Self::MoveTo { target_mdeg: fields.i32()?, move_id: fields.u32()? },
            kind::STATUS => Self::Status,
            kind::HOME => Self::Home { move_id: fields.u32()? },
            kind::STOP => Self::Stop,
            kind::SET_LAMP => Self::SetLamp { level_permille: fields.u16()?, ttl_ms: fields.u32()? },
            kind::CLEAR_FAULT => Self::ClearFault,
            _ => return Err(ErrorCode::UnknownKind),
        };
        fields.end(request)
    }
}

impl Answer {
    /// The answer as a frame.
    pub fn to_frame(&self, seq: u16, session: u32) -> Frame {
        let (kind, payload) = match self {
            Self::HelloAck(ack) => (kind::HELLO_ACK, ack.to_payload()),
            Self::Accepted => (kind::ACCEPTED, [].into()),
            Self::Status(status) => (kind::STATUS_REPORT, status.to_payload()),
            Self::Error(code) => (kind::ERROR, [*code as u8].into()),
        };
        Frame::new(kind, seq, session, payload)
    }

    /// Reads an answer; `UnknownKind`, `BadLength` or `OutOfRange` (a state or code not known here) if it is none.
    pub fn from_frame(frame: &Frame) -> Result<Self, ErrorCode> {
        let mut fields = Fields(frame.payload.as_slice());
        let answer = match frame.kind {
            kind::HELLO_ACK => Self::HelloAck(HelloAck::from_fields(&mut fields)?),
            kind::ACCEPTED => Self::Accepted,
            kind::STATUS_REPORT => Self::Status(Status::from_fields(&mut fields)?),
            kind::ERROR => Self::Error(ErrorCode::from_u8(fields.u8()?).ok_or(ErrorCode::OutOfRange)?),
            _ => return Err(ErrorCode::UnknownKind),
        };
        fields.end(answer)
    }
}

impl HelloAck {
    fn to_payload(self) -> Payload {
        pack::<24>(&[
            &[self.proto],
            &self.firmware,
            &self.caps.to_le_bytes(),
            &[self.reset_cause, u8::from(self.homed)],
            &self.boot_nonce.to_le_bytes(),
            &self.uptime_ms.to_le_bytes(),
            &self.travel_mdeg[0].to_le_bytes(),
            &self.travel_mdeg[1].to_le_bytes(),
        ])
    }

    fn from_fields(fields: &mut Fields) -> Result<Self, ErrorCode> {
        Ok(Self {
            proto: fields.u8()?,
            firmware: fields.take()?,
            caps: fields.u16()?,
            reset_cause: fields.u8()?,
            homed: fields.u8()? != 0,
            boot_nonce: fields.u32()?,
            uptime_ms: fields.u32()?,
            travel_mdeg: [fields.i32()?, fields.i32()?],
        })
    }
}

const FLAG_HOMED: u8 = 1 << 0;
const FLAG_MOVING: u8 = 1 << 1;
const FLAG_AT_SWITCH: u8 = 1 << 2;

impl Status {
    fn to_payload(self) -> Payload {
        let flag = |on: bool, bit: u8| if on { bit } else { 0 };
        let flags =
            flag(self.homed, FLAG_HOMED) | flag(self.moving, FLAG_MOVING) | flag(self.at_switch, FLAG_AT_SWITCH);
        pack::<18>(&[
            &self.move_id.to_le_bytes(),
            &self.boot_nonce.to_le_bytes(),
            &self.position_mdeg.to_le_bytes(),
            &self.lamp_permille.to_le_bytes(),
            &self.faults.0.to_le_bytes(),
            &[self.state as u8, flags],
        ])
    }

    fn from_fields(fields: &mut Fields) -> Result<Self, ErrorCode> {
        let (move_id, boot_nonce, position_mdeg) = (fields.u32()?, fields.u32()?, fields.i32()?);
        let (lamp_permille, faults) = (fields.u16()?, Faults(fields.u16()?));
        let (state, flags) = (State::from_u8(fields.u8()?).ok_or(ErrorCode::OutOfRange)?, fields.u8()?);
        Ok(Self {
            move_id,
            boot_nonce,
            position_mdeg,
            lamp_permille,
            faults,
            state,
            homed: flags & FLAG_HOMED != 0,
            moving: flags & FLAG_MOVING != 0,
            at_switch: flags & FLAG_AT_SWITCH != 0,
        })
    }
}

impl State {
    fn from_u8(state: u8) -> Option<Self> {
        [Self::Idle, Self::Homing, Self::Moving, Self::Stopping, Self::Faulted]
            .into_iter()
            .find(|known| *known as u8 == state)
    }
}

/// Fields one after another; `N` is the sum of their lengths, as the golden bytes check.
fn pack<const N: usize>(fields: &[&[u8]]) -> Payload {
    let mut bytes = [0; N];
    for (to, from) in bytes.iter_mut().zip(fields.iter().copied().flatten()) {
        *to = *from;
    }
    bytes.into()
}

/// Takes fields off the front of a payload.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], ErrorCode> {
        let (field, rest) = self.0.split_first_chunk().ok_or(ErrorCode::BadLength)?;
        self.0 = rest;
        Ok(*field)
    }
    fn u8(&mut self) -> Result<u8, ErrorCode> {
        self.take().map(|[byte]| byte)
    }
    fn u16(&mut self) -> Result<u16, ErrorCode> {
        self.take().map(u16::from_le_bytes)
    }
    fn u32(&mut self) -> Result<u32, ErrorCode> {
        self.take().map(u32::from_le_bytes)
    }
    fn i32(&mut self) -> Result<i32, ErrorCode> {
        self.take().map(i32::from_le_bytes)
    }
    fn end<T>(self, message: T) -> Result<T, ErrorCode> {
        if self.0.is_empty() { Ok(message) } else { Err(ErrorCode::BadLength) }
    }
}
