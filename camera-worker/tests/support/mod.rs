//! A worker process as the daemon sees it, and a simulated camera whose files say how they were taken.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, dead_code, reason = "each test file uses its part")]

pub mod usb;

use camera_messages::frame;
use camera_messages::labels::ImageFormat;
use camera_messages::message::{
    Answer, Call, Failure, FileEntry, Identity, PROTOCOL, ReadBack, Reply, Request, Shot, ShutterWish,
};
use simulated_eos::{Body, BodyOptions, ExposureSettings, Picture, PictureKind, Sensor, Server};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;
use tempfile::TempDir;

/// Its files are text; it says when a shutter opens.
pub struct TextSensor(pub Option<Sender<u32>>);

impl Sensor for TextSensor {
    fn expose(&mut self, settings: &ExposureSettings) -> Vec<Picture> {
        if let Some(opened) = &self.0 {
            opened.send(settings.frame).unwrap();
        }
        let kinds: &[PictureKind] = match settings.format {
            simulated_eos::ImageFormat::Jpeg => &[PictureKind::Jpeg],
            simulated_eos::ImageFormat::Raw => &[PictureKind::Raw],
            simulated_eos::ImageFormat::RawAndJpeg => &[PictureKind::Raw, PictureKind::Jpeg],
        };
        let text =
            |kind| expected(settings.frame, settings.shutter.label, settings.aperture.label, settings.iso.speed, kind);
        kinds.iter().map(|kind| Picture { bytes: text(*kind).into_bytes(), kind: *kind }).collect()
    }
}

/// The file of a frame taken so.
pub fn expected(frame: u32, shutter: &str, aperture: &str, iso: u32, kind: PictureKind) -> String {
    format!("frame {frame} shutter {shutter} aperture {aperture} iso {iso} {kind:?}\n").repeat(20_000)
}

pub fn body(options: BodyOptions) -> Body {
    Body::new(Box::new(TextSensor(None)), options).unwrap()
}

/// A body on a free port.
pub fn server(options: BodyOptions) -> Server {
    Server::start(body(options), 0).unwrap()
}

/// A shot at f/5.6 and ISO 100.
pub fn shot(label: &str, format: ImageFormat) -> Shot {
    Shot { shutter: ShutterWish::Label(label.into()), f_number: 5.6, iso: 100, format }
}

/// A worker with a home of its own, killed at the end.
pub struct Worker {
    pub child: Child,
    requests: Option<ChildStdin>,
    replies: Receiver<(Answer, Vec<u8>)>,
    sent: u64,
    _home: TempDir,
}

impl Drop for Worker {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Worker {
    /// Starts one, without a word.
    pub fn start() -> Self {
        Self::with(&[])
    }

    /// Starts one with these variables in its environment.
    pub fn with(environment: &[(String, String)]) -> Self {
        let home = tempfile::tempdir().unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_camera-worker"))
            .envs(environment.iter().map(|(name, value)| (name, value)))
            .env("HOME", home.path())
            .env("LANG", "C")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (requests, mut output) = (child.stdin.take(), child.stdout.take().unwrap());
        let (sender, replies) = channel();
        std::thread::spawn(move || {
            while let Ok(reply) = frame::read(&mut output) {
                if sender.send(reply).is_err() {
                    return;
                }
            }
        });
        Self { child, requests, replies, sent: 0, _home: home }
    }

    /// Starts one, agrees on the messages, and opens the camera of `server`.
    pub fn on(server: &Server) -> (Self, Identity) {
        let mut worker = Self::start();
        worker.greet();
        let identity = worker.open(server);
        (worker, identity)
    }

    pub fn greet(&mut self) {
        let Reply::Hello { protocol, .. } = self.ask(Request::Hello { protocol: PROTOCOL }).0 else {
            panic!("no hello")
        };
        assert_eq!(protocol, PROTOCOL);
    }

    pub fn open(&mut self, server: &Server) -> Identity {
        self.open_at(Some(server.gphoto2_port()))
    }

    /// Opens the camera at this port, or the only one found.
    pub fn open_at(&mut self, port: Option<String>) -> Identity {
        match self.ask(Request::Open { model: None, port, serial: None }).0 {
            Reply::Identity(identity) => *identity,
            other => panic!("{other:?}"),
        }
    }

    pub fn send(&mut self, request: Request) {
        self.sent += 1;
        let call = Call { number: self.sent, deadline_s: request.deadline_s(), request };
        frame::write(self.requests.as_mut().unwrap(), &call, &[]).unwrap();
    }

    /// The next reply, none if the worker ended. A worker that says nothing for two minutes fails the test.
    pub fn reply(&mut self) -> Option<(Reply, Vec<u8>)> {
        match self.replies.recv_timeout(Duration::from_secs(120)) {
            Ok((answer, blob)) => {
                assert_eq!(answer.number, self.sent, "the answer to another request");
                Some((answer.reply, blob))
            }
            Err(RecvTimeoutError::Disconnected) => None,
            Err(RecvTimeoutError::Timeout) => panic!("the worker does not answer"),
        }
    }

    pub fn ask(&mut self, request: Request) -> (Reply, Vec<u8>) {
        self.send(request);
        self.reply().unwrap()
    }

    /// The files of a shot that succeeds, and what was read back.
    pub fn shoot(&mut self, shot: Shot) -> (Vec<(FileEntry, String)>, ReadBack) {
        let (reply, blob) = self.ask(Request::Shoot(shot));
        let Reply::Files { files, read_back, .. } = reply else { panic!("{reply:?}") };
        let mut rest = blob.as_slice();
        let split = files.into_iter().map(|file| {
            let (bytes, after) = rest.split_at(usize::try_from(file.size).unwrap());
            rest = after;
            (file, String::from_utf8(bytes.to_vec()).unwrap())
        });
        let files = split.collect();
        assert!(rest.is_empty(), "{} bytes of no file", rest.len());
        (files, read_back)
    }

    /// Why a request fails.
    pub fn fail(&mut self, request: Request) -> Failure {
        match self.ask(request).0 {
            Reply::Failed(failure) => failure,
            other => panic!("{other:?}"),
        }
    }

    /// Ends its stdin and waits for its end.
    pub fn end(mut self) -> ExitStatus {
        self.requests = None;
        self.child.wait().unwrap()
    }

    /// Writes what is no frame.
    pub fn send_bytes(&mut self, bytes: &[u8]) {
        std::io::Write::write_all(self.requests.as_mut().unwrap(), bytes).unwrap();
    }
}
