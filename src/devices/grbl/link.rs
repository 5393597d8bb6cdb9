//! Lines and reports on the port: one line in flight, believed only by its own `ok`.

use super::advice;
use super::said::{Report, Said, State};
use crate::devices::Cancel;
use crate::devices::arm::ArmError;
use crate::devices::port_thread::{PortOwner, PortThread};
use crate::devices::serial::{CHUNK, SerialTransport};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Longest wait for a report or for the answer to a short line. The slowest report seen on a busy host took 0.17 s.
pub const ANSWER_TIME: Duration = Duration::from_millis(500);
/// How often a report is asked for before the controller counts as silent.
const TRIES: u32 = 3;
/// Wait for the banner after the port was opened, before a reset is sent: opening resets many boards, whose boot loader takes a second.
/// A slower one is heard after the reset, up to 7 s after the opening.
const BOOT_TIME: Duration = Duration::from_millis(1250);
/// Longest wait for the banner after a reset was sent.
const RESET_TIME: Duration = Duration::from_secs(2);
/// What follows a banner or a bare line end comes within this time.
const REST: Duration = Duration::from_millis(150);
/// Longest line taken in; the rest is noise.
const MAX_LINE: usize = 256;
/// Most lines kept of an answer: grblHAL lists a few hundred settings; the rest is noise.
const MAX_LINES: usize = 1000;
/// Time beyond a job's own limit: a feed that ends in a reset, and the report before each of a line's two tries.
const QUEUE_LIMIT: Duration = Duration::from_secs(10);

const RESET: u8 = 0x18;
const JOG_CANCEL: u8 = 0x85;

/// Handle on the port's thread. Dropping it resets the controller, which stops the motor and switches the lamp off, and closes the port.
pub struct Link(PortThread<Owner>);

impl Link {
    /// Waits until the controller is awake and gives the port to a thread; says who it is.
    ///
    /// # Errors
    /// [`ArmError::NoAnswer`] when no GRBL answers, [`ArmError::Port`] when the port goes away.
    pub fn open(transport: SerialTransport) -> Result<(Self, String), ArmError> {
        let mut owner = Owner::new(transport);
        let banner = owner.wake()?;
        Ok((Self(PortThread::spawn(owner)?), banner))
    }

    /// Runs `work` on the thread that owns the port; `limit` is the longest it may take.
    pub fn with<T: Send + 'static>(
        &self,
        limit: Duration,
        work: impl FnOnce(&mut Owner) -> Result<T, ArmError> + Send + 'static,
    ) -> Result<T, ArmError> {
        self.0.with(limit + QUEUE_LIMIT, work)
    }
}

/// The port and what is known of the controller behind it.
pub struct Owner {
    /// The port, or why it is gone.
    transport: Result<SerialTransport, ArmError>,
    /// Read, not yet taken apart.
    heard: VecDeque<u8>,
    line: Vec<u8>,
    /// Homed since the last reset, alarm or restart: GRBL itself does not say.
    pub homed: bool,
    /// Banners that nobody asked for.
    pub restarts: u32,
}

impl PortOwner for Owner {
    fn feed(&mut self) -> Result<(), ArmError> {
        self.report().map(|_| ())
    }

    fn make_safe(&mut self) {
        // A reset stops the motor and switches spindle and coolant off, whatever the controller was doing.
        let _ = self.send(&[RESET]);
    }
}

impl Owner {
    fn new(transport: SerialTransport) -> Self {
        Self { transport: Ok(transport), heard: VecDeque::new(), line: Vec::new(), homed: false, restarts: 0 }
    }

    /// The banner that an opened port brings, or that a reset brings.
    fn wake(&mut self) -> Result<String, ArmError> {
        // A controller that the opening did not reset answers, and is reset at once.
        self.send(b"?")?;
        let end = Instant::now() + BOOT_TIME;
        while let Some(said) = self.hear(end)? {
            match said {
                Said::Banner(banner) => {
                    self.rest()?;
                    return Ok(banner);
                }
                Said::Report(_) => break,
                _ => {}
            }
        }
        self.reset()
    }

    /// Soft reset: motor stopped, lamp off, not homed. Whatever was said before the banner is stale.
    pub fn reset(&mut self) -> Result<String, ArmError> {
        self.homed = false;
        let started = Instant::now();
        // A controller in ALARM:1 or 2 clears a reset that was pending before the alarm: repeated, it is taken.
        for _ in 0..TRIES {
            self.send(&[RESET])?;
            let end = Instant::now() + RESET_TIME;
            while let Some(said) = self.hear(end)? {
                if let Said::Banner(banner) = said {
                    self.rest()?;
                    return Ok(banner);
                }
            }
        }
        Err(ArmError::NoAnswer { what: "a reset", waited_s: started.elapsed().as_secs_f64() })
    }

    /// Sends a line until it is taken, within `limit`; returns what was said before the `ok`. A line that noise damaged is sent once
    /// more, and so is one whose `ok` does not come though nothing turns: every line this driver sends may be carried out twice.
    pub fn line(
        &mut self,
        what: &'static str,
        text: &str,
        limit: Duration,
        cancel: &Cancel,
    ) -> Result<Vec<String>, ArmError> {
        let mut first = true;
        loop {
            let (trouble, again) = match self.once(what, text, limit, cancel) {
                Ok(Ok(said)) => return Ok(said),
                Ok(Err(code)) if advice::garbled(code) => (advice::error(what, code), true),
                Ok(Err(code)) => return Err(advice::error(what, code)),
                Err(silence @ ArmError::NoAnswer { waited_s, .. }) => {
                    (silence, limit <= ANSWER_TIME || waited_s < limit.as_secs_f64())
                }
                Err(other) => return Err(other),
            };
            // Half a line may lie in its buffer.
            self.send(b"\n")?;
            self.rest()?;
            if !(again && std::mem::take(&mut first)) {
                return Err(trouble);
            }
        }
    }

    /// One try: what was said before the `ok`, or the number of the error.
    fn once(
        &mut self,
        what: &'static str,
        text: &str,
        limit: Duration,
        cancel: &Cancel,
    ) -> Result<Result<Vec<String>, u8>, ArmError> {
        // Whatever was said before this report answers earlier lines: a doubled `ok` must not be taken for this one's.
        self.report()?;
        self.send(format!("{text}\n").as_bytes())?;
        let started = Instant::now();
        let mut said = Vec::new();
        let (mut asked, mut stands) = (false, false);
        loop {
            if cancel.is_cancelled() {
                self.reset()?;
                return Err(ArmError::Cancelled);
            }
            let end = (started + limit).min(Instant::now() + ANSWER_TIME);
            match self.hear_sound(what, end)? {
                Some(Said::Ok) => {
                    if asked {
                        // A late report must not answer the next question.
                        self.rest()?;
                    }
                    return Ok(Ok(said));
                }
                Some(Said::Error(code)) => return Ok(Err(code)),
                Some(Said::Other(line)) if said.len() < MAX_LINES => said.push(line),
                Some(Said::Report(report)) => stands = matches!(report.state, State::Idle | State::Alarm),
                Some(_) => {}
                // While it works at a long line it says so; one that stands has lost the line, or its `ok` was lost.
                None if started.elapsed() < limit && !stands => {
                    asked = true;
                    self.send(b"?")?;
                }
                None => return Err(ArmError::NoAnswer { what, waited_s: started.elapsed().as_secs_f64() }),
            }
        }
    }

    /// The status report, asked for anew when it is lost.
    pub fn report(&mut self) -> Result<Report, ArmError> {
        let started = Instant::now();
        for attempt in 0..TRIES {
            self.send(b"?")?;
            let end = Instant::now() + ANSWER_TIME;
            while let Some(said) = self.hear_sound("a status request", end)? {
                if let Said::Report(report) = said {
                    if attempt > 0 {
                        // A late answer to the first must not be the next one's.
                        self.rest()?;
                    }
                    return Ok(report);
                }
            }
        }
        Err(ArmError::NoAnswer { what: "a status request", waited_s: started.elapsed().as_secs_f64() })
    }

    /// `!`: the motor slows down and holds.
    pub fn hold(&mut self) -> Result<(), ArmError> {
        self.send(b"!")
    }

    /// Ends a jog where it is.
    pub fn end_jog(&mut self) -> Result<(), ArmError> {
        self.send(&[JOG_CANCEL])
    }

    /// The next line; an alarm or an unasked banner is an error, after which the controller is ready for homing again.
    fn hear_sound(&mut self, what: &'static str, end: Instant) -> Result<Option<Said>, ArmError> {
        match self.hear(end)? {
            Some(Said::Banner(_)) => {
                let was = self.restarts;
                self.restarts = was.wrapping_add(1);
                self.homed = false;
                self.rest()?;
                Err(ArmError::Rebooted { was, now: self.restarts })
            }
            Some(Said::Alarm(code)) => {
                // Silent until it is reset (alarms 1 and 2), locked until it is homed (all).
                self.reset()?;
                Err(advice::alarm(what, code))
            }
            other => Ok(other),
        }
    }

    /// The next line before `end`.
    fn hear(&mut self, end: Instant) -> Result<Option<Said>, ArmError> {
        let mut chunk = [0; CHUNK];
        loop {
            if let Some(said) = self.next_line() {
                return Ok(Some(said));
            }
            if Instant::now() >= end {
                return Ok(None);
            }
            let transport = self.transport.as_mut().map_err(|gone| gone.clone())?;
            match transport.read(&mut chunk) {
                Ok(count) => self.heard.extend(chunk.iter().take(count)),
                Err(gone) => return Err(self.lose(gone)),
            }
        }
    }

    /// The first line of what was read.
    fn next_line(&mut self) -> Option<Said> {
        while let Some(byte) = self.heard.pop_front() {
            if byte == b'\n' {
                let line = std::mem::take(&mut self.line);
                if !line.trim_ascii().is_empty() {
                    return Some(Said::of(&String::from_utf8_lossy(&line)));
                }
            } else {
                if self.line.len() >= MAX_LINE {
                    self.line.clear();
                }
                self.line.push(byte);
            }
        }
        None
    }

    /// Takes in and forgets what is on its way.
    fn rest(&mut self) -> Result<(), ArmError> {
        let end = Instant::now() + REST;
        while self.hear(end)?.is_some() {}
        self.line.clear();
        Ok(())
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), ArmError> {
        let transport = self.transport.as_mut().map_err(|gone| gone.clone())?;
        transport.write(bytes).map_err(|gone| self.lose(gone))
    }

    /// Closed at once, so that the system can give the name to the device when it comes back.
    fn lose(&mut self, gone: ArmError) -> ArmError {
        self.transport = Err(gone.clone());
        self.homed = false;
        gone
    }
}
