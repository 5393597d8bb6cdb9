//! Requests and answers on the port: one request on the line at a time, sent again until its answer comes.

use super::words;
use crate::devices::arm::ArmError;
use crate::devices::port_thread::{PortOwner, PortThread};
use crate::devices::serial::{CHUNK, SerialTransport};
use firmware_protocol::{Answer, Decoder, ErrorCode, Frame, Hello, HelloAck, Request, VERSION};
use std::time::{Duration, Instant};

/// Longest wait for an answer before the frame is sent again.
const ANSWER_TIME: Duration = Duration::from_millis(250);
/// How often a frame is sent before the line counts as silent.
const TRIES: u32 = 3;
/// How often `Hello` is sent: a board that a port's opening resets is deaf for more than a second.
const HELLO_TRIES: u32 = 12;
/// Longest wait for the thread: one feed and one request, both with all their tries, and a margin.
const ASK_LIMIT: Duration = Duration::from_secs(9);

/// Handle on the port's thread. Dropping it stops the motor, switches the lamp off and closes the port.
pub struct Link(PortThread<Owner>);

impl Link {
    /// Shakes hands over `transport` and gives it to a thread.
    pub fn open(transport: SerialTransport) -> Result<(Self, HelloAck), ArmError> {
        let mut owner = Owner::new(transport);
        let ack = owner.hello()?;
        owner.boot_nonce = ack.boot_nonce;
        Ok((Self(PortThread::spawn(owner)?), ack))
    }

    /// One request and its answer; a device error becomes [`ArmError::Refused`]. Returns within nine seconds, whatever happens.
    pub fn ask(&self, request: Request) -> Result<Answer, ArmError> {
        self.0.with(ASK_LIMIT, move |owner| owner.serve(request))
    }
}

struct Owner {
    /// The port, or why it is gone.
    transport: Result<SerialTransport, ArmError>,
    decoder: Decoder,
    session: u32,
    seq: u16,
    boot_nonce: u32,
}

impl PortOwner for Owner {
    fn feed(&mut self) -> Result<(), ArmError> {
        self.serve(Request::Status).map(|_| ())
    }

    fn make_safe(&mut self) {
        // Should both be lost, the dead-man does the same.
        let _ = self.exchange(Request::Stop, TRIES);
        let _ = self.exchange(Request::SetLamp { level_permille: 0, ttl_ms: 0 }, TRIES);
    }
}

impl Owner {
    fn new(transport: SerialTransport) -> Self {
        Self {
            transport: Ok(transport),
            decoder: Decoder::default(),
            // Session 0 means none.
            session: rand::random::<u32>().max(1),
            seq: rand::random(),
            boot_nonce: 0,
        }
    }

    /// One request, and a new handshake when the device is silent or knows no session.
    fn serve(&mut self, request: Request) -> Result<Answer, ArmError> {
        let lost = match self.exchange(request, TRIES) {
            Ok(Answer::Error(code @ ErrorCode::BadSession)) => words::refusal(&request, code),
            Err(silent @ ArmError::NoAnswer { .. }) => silent,
            Ok(Answer::Error(code)) => return Err(words::refusal(&request, code)),
            Ok(Answer::Status(status)) => {
                self.same_boot(status.boot_nonce)?;
                return Ok(Answer::Status(status));
            }
            other => return other,
        };
        let ack = self.hello().map_err(|error| if is_silence(&error) { lost.clone() } else { error })?;
        self.same_boot(ack.boot_nonce)?;
        Err(lost)
    }

    fn same_boot(&mut self, now: u32) -> Result<(), ArmError> {
        let was = std::mem::replace(&mut self.boot_nonce, now);
        if was == now { Ok(()) } else { Err(ArmError::Rebooted { was, now }) }
    }

    fn hello(&mut self) -> Result<HelloAck, ArmError> {
        let request = Request::Hello(Hello { proto_min: VERSION, proto_max: VERSION });
        match self.exchange(request, HELLO_TRIES)? {
            Answer::HelloAck(ack) if ack.proto == VERSION => Ok(ack),
            Answer::HelloAck(_) => Err(words::refusal(&request, ErrorCode::BadVersion)),
            Answer::Error(code) => Err(words::refusal(&request, code)),
            _ => Err(words::refusal(&request, ErrorCode::UnknownKind)),
        }
    }

    /// Sends one frame until its answer comes. Repeats carry the same sequence number, so the device acts once.
    fn exchange(&mut self, request: Request, tries: u32) -> Result<Answer, ArmError> {
        self.seq = self.seq.wrapping_add(1);
        let frame = request.to_frame(self.seq, self.session);
        let started = Instant::now();
        for _ in 0..tries {
            match self.send_and_hear(&frame) {
                Ok(Some(answer)) => {
                    return Answer::from_frame(&answer).map_err(|_| words::refusal(&request, ErrorCode::UnknownKind));
                }
                Ok(None) => {}
                Err(gone) => {
                    // Closed at once, so that the system can give the name to the device when it comes back.
                    self.transport = Err(gone.clone());
                    return Err(gone);
                }
            }
        }
        Err(ArmError::NoAnswer { what: words::name(&request), waited_s: started.elapsed().as_secs_f64() })
    }

    fn send_and_hear(&mut self, frame: &Frame) -> Result<Option<Frame>, ArmError> {
        let transport = self.transport.as_mut().map_err(|gone| gone.clone())?;
        transport.write(frame.to_wire().as_slice())?;
        let sent = Instant::now();
        let mut buffer = [0; CHUNK];
        while sent.elapsed() < ANSWER_TIME {
            let count = transport.read(&mut buffer)?;
            let mut answer = None;
            for byte in buffer.iter().take(count) {
                let heard = self.decoder.push(*byte);
                answer = answer.or(heard.filter(|heard| (heard.seq, heard.session) == (frame.seq, frame.session)));
            }
            if answer.is_some() {
                return Ok(answer);
            }
        }
        Ok(None)
    }
}

fn is_silence(error: &ArmError) -> bool {
    matches!(error, ArmError::NoAnswer { .. })
}
