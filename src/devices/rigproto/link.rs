//! The thread that owns the port: one request on the line at a time, and a status request whenever nobody asks,
//! so that the device's dead-man stays fed through an exposure of any length.

use super::words;
use crate::devices::arm::ArmError;
use crate::devices::serial::SerialTransport;
use firmware_protocol::{Answer, Decoder, ErrorCode, Frame, Hello, HelloAck, Request, VERSION};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

/// Longest wait for an answer before the frame is sent again.
const ANSWER_TIME: Duration = Duration::from_millis(250);
/// How often a frame is sent before the line counts as silent.
const TRIES: u32 = 3;
/// How often `Hello` is sent: a board that a port's opening resets is deaf for more than a second.
const HELLO_TRIES: u32 = 12;
/// Silence after which the thread asks for a status by itself.
const FEED_PERIOD: Duration = Duration::from_millis(250);
/// Longest wait for the thread: one feed and one request, both with all their tries, and a margin.
const ASK_LIMIT: Duration = Duration::from_secs(9);
/// Longest wait for the thread to stop the motor, switch the lamp off and close the port.
const END_LIMIT: Duration = Duration::from_secs(3);

struct Job {
    request: Request,
    reply: SyncSender<Result<Answer, ArmError>>,
}

/// Handle on the thread. Dropping it stops the motor, switches the lamp off and closes the port.
pub struct Link {
    inbox: Option<SyncSender<Job>>,
    ended: Receiver<()>,
}

impl Link {
    /// Shakes hands over `transport` and gives it to a thread.
    pub fn open(transport: SerialTransport) -> Result<(Self, HelloAck), ArmError> {
        let mut owner = Owner::new(transport);
        let ack = owner.hello()?;
        owner.boot_nonce = ack.boot_nonce;
        let (inbox, jobs) = sync_channel(1);
        let (end, ended) = sync_channel::<()>(1);
        let run = move || {
            owner.run(&jobs);
            drop(owner);
            drop(end);
        };
        match thread::Builder::new().name("arm".into()).spawn(run) {
            Ok(_) => Ok((Self { inbox: Some(inbox), ended }, ack)),
            Err(_) => Err(ArmError::Gone),
        }
    }

    /// One request and its answer; a device error becomes [`ArmError::Refused`]. Returns within nine seconds, whatever happens.
    pub fn ask(&self, request: Request) -> Result<Answer, ArmError> {
        let inbox = self.inbox.as_ref().ok_or(ArmError::Gone)?;
        let (reply, answer) = sync_channel(1);
        // Full means that the thread still hangs in a call that was given up.
        inbox.try_send(Job { request, reply }).map_err(|_| ArmError::Gone)?;
        answer.recv_timeout(ASK_LIMIT).unwrap_or(Err(ArmError::Gone))
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.inbox = None;
        let _ = self.ended.recv_timeout(END_LIMIT);
    }
}

struct Owner {
    /// The port, or why it is gone.
    transport: Result<SerialTransport, ArmError>,
    decoder: Decoder,
    session: u32,
    seq: u16,
    boot_nonce: u32,
    /// What went wrong while nobody asked: the next one who asks must hear it.
    unheard: Option<ArmError>,
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
            unheard: None,
        }
    }

    fn run(&mut self, jobs: &Receiver<Job>) {
        loop {
            match jobs.recv_timeout(FEED_PERIOD) {
                Ok(job) => {
                    let result = self.unheard.take().map_or_else(|| self.serve(job.request), Err);
                    let _ = job.reply.send(result);
                }
                Err(RecvTimeoutError::Timeout) => self.feed(),
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        // On every way out; should both be lost, the dead-man does the same.
        let _ = self.exchange(Request::Stop, TRIES);
        let _ = self.exchange(Request::SetLamp { level_permille: 0, ttl_ms: 0 }, TRIES);
    }

    fn feed(&mut self) {
        // A silent device is found again by the next request; a lost port stays lost. Only these would be forgotten.
        if let Err(error @ (ArmError::Rebooted { .. } | ArmError::Refused { .. })) = self.serve(Request::Status) {
            self.unheard = Some(error);
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
            Answer::HelloAck(ack) => Ok(ack),
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
        let mut buffer = [0; 256];
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
