//! The thread that owns the port: one line in flight, and a status report whenever nobody asks, so that a restart or an alarm during an
//! exposure is heard.

use super::advice;
use super::said::{Report, Said};
use crate::devices::Cancel;
use crate::devices::arm::ArmError;
use crate::devices::serial::SerialTransport;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

/// Longest wait for a report or for the answer to a short line. The slowest report seen on a busy host took 0.17 s.
pub const ANSWER_TIME: Duration = Duration::from_millis(500);
/// How often a report is asked for before the controller counts as silent.
const TRIES: u32 = 3;
/// Longest wait for the banner after the port was opened: opening resets many boards, whose boot loader takes a second.
const BOOT_TIME: Duration = Duration::from_secs(3);
/// Longest wait for the banner after a reset was sent.
const RESET_TIME: Duration = Duration::from_secs(2);
/// What follows a banner or a bare line end comes within this time.
const REST: Duration = Duration::from_millis(150);
/// Silence after which the thread asks for a report by itself: grbl's manual advises at most five a second.
const FEED_PERIOD: Duration = Duration::from_millis(250);
/// Longest line taken in; the rest is noise.
const MAX_LINE: usize = 256;
/// Longest wait for the thread to reset the controller and close the port.
const END_LIMIT: Duration = Duration::from_secs(3);
/// The line that a bracket of jobs may add to a job's own limit: one feed with all its tries.
const QUEUE_LIMIT: Duration = Duration::from_secs(3);

const RESET: u8 = 0x18;
const JOG_CANCEL: u8 = 0x85;

type Job = Box<dyn FnOnce(&mut Owner) + Send>;

/// Handle on the thread. Dropping it resets the controller, which stops the motor and switches the lamp off, and closes the port.
pub struct Link {
    inbox: Option<SyncSender<Job>>,
    ended: Receiver<()>,
}

impl Link {
    /// Waits for the controller's banner and gives the port to a thread; says who it is.
    ///
    /// # Errors
    /// [`ArmError::NoAnswer`] when no GRBL answers, [`ArmError::Port`] when the port goes away.
    pub fn open(transport: SerialTransport) -> Result<(Self, String), ArmError> {
        let mut owner = Owner::new(transport);
        let banner = owner.wake()?;
        let (inbox, jobs) = sync_channel(1);
        let (end, ended) = sync_channel::<()>(1);
        let run = move || {
            owner.run(&jobs);
            drop(owner);
            drop(end);
        };
        thread::Builder::new().name("arm".into()).spawn(run).map_err(|_| ArmError::Gone)?;
        Ok((Self { inbox: Some(inbox), ended }, banner))
    }

    /// Runs `work` on the thread that owns the port; `limit` is the longest it may take.
    pub fn with<T: Send + 'static>(
        &self,
        limit: Duration,
        work: impl FnOnce(&mut Owner) -> Result<T, ArmError> + Send + 'static,
    ) -> Result<T, ArmError> {
        let inbox = self.inbox.as_ref().ok_or(ArmError::Gone)?;
        let (reply, answer) = sync_channel(1);
        let job = move |owner: &mut Owner| {
            let result = owner.unheard.take().map_or_else(|| work(owner), Err);
            let _ = reply.send(result);
        };
        // Full means that the thread still hangs in a call that was given up.
        inbox.try_send(Box::new(job)).map_err(|_| ArmError::Gone)?;
        answer.recv_timeout(limit + QUEUE_LIMIT).unwrap_or(Err(ArmError::Gone))
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.inbox = None;
        let _ = self.ended.recv_timeout(END_LIMIT);
    }
}

/// The port and what is known of the controller behind it.
pub struct Owner {
    /// The port, or why it is gone.
    transport: Result<SerialTransport, ArmError>,
    line: Vec<u8>,
    /// Homed since the last reset, alarm or restart: GRBL itself does not say.
    pub homed: bool,
    /// Banners that nobody asked for.
    pub restarts: u32,
    /// What went wrong while nobody asked: the next one who asks must hear it.
    unheard: Option<ArmError>,
}

impl Owner {
    fn new(transport: SerialTransport) -> Self {
        Self { transport: Ok(transport), line: Vec::new(), homed: false, restarts: 0, unheard: None }
    }

    fn run(&mut self, jobs: &Receiver<Job>) {
        loop {
            match jobs.recv_timeout(FEED_PERIOD) {
                Ok(job) => job(self),
                Err(RecvTimeoutError::Timeout) => self.feed(),
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        // On every way out: a reset stops the motor and switches spindle and coolant off, whatever the controller was doing.
        let _ = self.send(&[RESET]);
    }

    fn feed(&mut self) {
        if self.unheard.is_none()
            && let Err(error) = self.report()
            && !matches!(error, ArmError::Port { .. } | ArmError::NoAnswer { .. })
        {
            self.unheard = Some(error);
        }
    }

    /// The banner that an opened port brings, or that a reset brings.
    fn wake(&mut self) -> Result<String, ArmError> {
        let end = Instant::now() + BOOT_TIME;
        while let Some(said) = self.hear(end)? {
            if let Said::Banner(banner) = said {
                self.rest()?;
                return Ok(banner);
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
    /// more: every line this driver sends may be carried out twice.
    pub fn line(
        &mut self,
        what: &'static str,
        text: &str,
        limit: Duration,
        cancel: &Cancel,
    ) -> Result<Vec<String>, ArmError> {
        match self.once(what, text, limit, cancel)? {
            Ok(said) => return Ok(said),
            Err(code) if !advice::garbled(code) => return Err(advice::error(what, code)),
            Err(_) => {}
        }
        self.send(b"\n")?;
        self.rest()?;
        self.once(what, text, limit, cancel)?.map_err(|code| advice::error(what, code))
    }

    /// One try: what was said before the `ok`, or the number of the error.
    fn once(
        &mut self,
        what: &'static str,
        text: &str,
        limit: Duration,
        cancel: &Cancel,
    ) -> Result<Result<Vec<String>, u8>, ArmError> {
        self.send(format!("{text}\n").as_bytes())?;
        let started = Instant::now();
        let mut said = Vec::new();
        loop {
            if cancel.is_cancelled() {
                self.reset()?;
                return Err(ArmError::Cancelled);
            }
            let end = (started + limit).min(Instant::now() + ANSWER_TIME);
            match self.hear_sound(what, end)? {
                Some(Said::Ok) => return Ok(Ok(said)),
                Some(Said::Error(code)) => return Ok(Err(code)),
                Some(Said::Other(line)) => said.push(line),
                Some(_) => {}
                None if started.elapsed() < limit => {}
                None => {
                    // Half a line may lie in its buffer.
                    self.send(b"\n")?;
                    self.rest()?;
                    return Err(ArmError::NoAnswer { what, waited_s: started.elapsed().as_secs_f64() });
                }
            }
        }
    }

    /// The status report, asked for anew when it is lost.
    pub fn report(&mut self) -> Result<Report, ArmError> {
        let started = Instant::now();
        for _ in 0..TRIES {
            self.send(b"?")?;
            let end = Instant::now() + ANSWER_TIME;
            while let Some(said) = self.hear_sound("a status request", end)? {
                if let Said::Report(report) = said {
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
        let transport = self.transport.as_mut().map_err(|gone| gone.clone())?;
        let mut byte = [0];
        while Instant::now() < end {
            match transport.read(&mut byte) {
                Ok(0) => {}
                Ok(_) if byte[0] == b'\n' => {
                    let line = std::mem::take(&mut self.line);
                    if !line.trim_ascii().is_empty() {
                        return Ok(Some(Said::of(&String::from_utf8_lossy(&line))));
                    }
                }
                Ok(_) => {
                    if self.line.len() >= MAX_LINE {
                        self.line.clear();
                    }
                    self.line.push(byte[0]);
                }
                Err(gone) => return Err(self.lose(gone)),
            }
        }
        Ok(None)
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
