//! The camera worker as a child process: one request at a time, each with a deadline that is kept by killing it.

use camera_messages::frame;
use camera_messages::message::{Answer, Call, Failure, PROTOCOL, Reply, Request};
use std::io::{self, BufReader};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

/// How often a waiting call looks whether its caller gave up.
const LOOK: Duration = Duration::from_millis(50);
/// How long a worker that was told to close may take to end.
const END: Duration = Duration::from_secs(2);
/// How long a worker that was killed may take to die.
const DEATH: Duration = Duration::from_secs(1);
/// How often one that is to end is looked at.
const ENDING: Duration = Duration::from_millis(10);

/// How the worker is started.
#[derive(Clone, Debug, PartialEq)]
pub struct WorkerCommand {
    /// The program.
    pub program: PathBuf,
    /// Directory for libgphoto2's settings: its HOME. Made if it is not there.
    pub home: PathBuf,
    /// Variables of its environment besides: `IOLIBS` says where libgphoto2 looks for its port drivers.
    pub environment: Vec<(String, String)>,
}

/// Why a call has no reply.
#[derive(Debug, thiserror::Error)]
pub enum WorkerError {
    /// It could not be started.
    #[error(
        "the camera worker {program} cannot be started ({reason}): build it with `cargo build --release -p camera-worker` and put it beside rigd"
    )]
    Start {
        /// The program.
        program: String,
        /// What the operating system said.
        reason: String,
    },
    /// It ended, or said what is no reply.
    #[error(
        "the camera worker failed ({0}): look at cable and camera, switch it off and on; if this repeats, start camera-worker by hand"
    )]
    Lost(String),
    /// It was killed at the call's deadline.
    #[error("the camera did not answer within {0:.0} s")]
    Deadline(f64),
    /// It was killed because the caller gave up.
    #[error("the call was given up")]
    GivenUp,
    /// The camera or its driver refused.
    #[error(transparent)]
    Failed(#[from] Failure),
}

/// A running worker; killed when dropped.
pub struct Worker {
    child: Child,
    requests: Option<ChildStdin>,
    replies: Receiver<Result<(Answer, Vec<u8>), String>>,
    /// Requests sent so far.
    sent: u64,
}

impl Worker {
    /// Starts the program and agrees on the messages, unless the caller has given up.
    pub fn start(command: &WorkerCommand, given_up: &dyn Fn() -> bool) -> Result<Self, WorkerError> {
        let failed = |error: io::Error| WorkerError::Start {
            program: command.program.display().to_string(),
            reason: error.to_string(),
        };
        std::fs::create_dir_all(&command.home).map_err(failed)?;
        let home = command.home.canonicalize().map_err(failed)?;
        let mut child = Command::new(&command.program)
            .envs(command.environment.iter().map(|(name, value)| (name, value)))
            .env("HOME", home)
            .env("LANG", "C")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(failed)?;
        let lost = || WorkerError::Lost("it has no pipes".into());
        let requests = child.stdin.take().ok_or_else(lost)?;
        let mut output = BufReader::new(child.stdout.take().ok_or_else(lost)?);
        let (send, replies) = sync_channel(1);
        let read = move || {
            loop {
                let reply = frame::read(&mut output).map_err(|error| error.to_string());
                let over = reply.is_err();
                if send.send(reply).is_err() || over {
                    return;
                }
            }
        };
        thread::Builder::new().name("camera-replies".into()).spawn(read).map_err(failed)?;
        let mut worker = Self { child, requests: Some(requests), replies, sent: 0 };
        match worker.call(Request::Hello { protocol: PROTOCOL }, given_up)? {
            (Reply::Hello { protocol: PROTOCOL, .. }, _) => Ok(worker),
            (other, _) => Err(WorkerError::Lost(format!(
                "it speaks other messages ({other:?}): build it from the sources this program is built from"
            ))),
        }
    }

    /// One request and its reply. After any error but [`WorkerError::Failed`] the worker is dead.
    pub fn call(&mut self, request: Request, given_up: &dyn Fn() -> bool) -> Result<(Reply, Vec<u8>), WorkerError> {
        let deadline_s = request.deadline_s();
        let requests = self.requests.as_mut().ok_or_else(|| WorkerError::Lost("it was ended".into()))?;
        self.sent += 1;
        let call = Call { number: self.sent, deadline_s, request };
        frame::write(requests, &call, &[]).map_err(|e| WorkerError::Lost(e.to_string()))?;
        let end = Instant::now() + Duration::try_from_secs_f64(deadline_s).unwrap_or(Duration::from_secs(3600));
        loop {
            match self.replies.recv_timeout(LOOK) {
                Ok(Ok((Answer { number, .. }, _))) if number != self.sent => {
                    self.kill();
                    return Err(WorkerError::Lost(format!(
                        "it answered request {number} when {} was asked",
                        self.sent
                    )));
                }
                Ok(Ok((Answer { reply: Reply::Failed(failure), .. }, _))) => return Err(failure.into()),
                Ok(Ok((answer, blob))) => return Ok((answer.reply, blob)),
                Ok(Err(reason)) => return Err(WorkerError::Lost(reason)),
                Err(RecvTimeoutError::Disconnected) => return Err(WorkerError::Lost("it has ended".into())),
                Err(RecvTimeoutError::Timeout) if given_up() => {
                    self.kill();
                    return Err(WorkerError::GivenUp);
                }
                Err(RecvTimeoutError::Timeout) if Instant::now() < end => {}
                Err(RecvTimeoutError::Timeout) => {
                    self.kill();
                    return Err(WorkerError::Deadline(deadline_s));
                }
            }
        }
    }

    /// Kills it and sees it dead. What hangs in the kernel dies only when the kernel lets go of it: it is left behind.
    fn kill(&mut self) {
        self.requests = None;
        let _ = self.child.kill();
        self.has_ended_within(DEATH);
    }

    fn has_ended_within(&mut self, time: Duration) -> bool {
        let end = Instant::now() + time;
        while matches!(self.child.try_wait(), Ok(None)) {
            if Instant::now() >= end {
                return false;
            }
            thread::sleep(ENDING);
        }
        true
    }
}

impl Drop for Worker {
    /// It ends with its input; what hangs is killed.
    fn drop(&mut self) {
        self.requests = None;
        if !self.has_ended_within(END) {
            self.kill();
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// A program that says these answers whatever it is asked.
    fn says(answers: &[(u64, Reply)], dir: &std::path::Path) -> WorkerCommand {
        let mut bytes = Vec::new();
        for (number, reply) in answers {
            frame::write(&mut bytes, &Answer { number: *number, reply: reply.clone() }, &[]).unwrap();
        }
        let said = dir.join("said");
        std::fs::write(&said, bytes).unwrap();
        WorkerCommand {
            program: concat!(env!("CARGO_MANIFEST_DIR"), "/tests/worker/says").into(),
            home: dir.join("home"),
            environment: vec![("SAYS".into(), said.display().to_string())],
        }
    }

    fn hello() -> Reply {
        Reply::Hello { protocol: PROTOCOL, version: String::new() }
    }

    #[test]
    fn a_reply_said_twice_answers_no_second_request() {
        let dir = tempfile::tempdir().unwrap();
        let never = || false;
        let twice = says(&[(1, hello()), (1, hello()), (2, Reply::Closed)], dir.path());
        let error = Worker::start(&twice, &never).unwrap().call(Request::Close, &never).unwrap_err();
        assert!(matches!(&error, WorkerError::Lost(reason) if reason.contains("request 1 when 2")), "{error}");
        let once = says(&[(1, hello()), (2, Reply::Closed)], dir.path());
        assert_eq!(Worker::start(&once, &never).unwrap().call(Request::Close, &never).unwrap().0, Reply::Closed);
    }
}
