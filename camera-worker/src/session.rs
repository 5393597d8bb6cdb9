//! From request to reply.

use crate::camera::OpenCamera;
use crate::library::{self, refused};
use camera_messages::message::{Failure, HandleState, PROTOCOL, Reply, Request, Step};
use gphoto2::Context;
use std::time::Duration;

const LONGEST_IDLE: Duration = Duration::from_secs(3600);

/// What the worker holds between requests.
#[derive(Default)]
pub(crate) struct Session {
    greeted: bool,
    /// One for the whole process: the crate never gives its memory back.
    context: Option<Context>,
    camera: Option<OpenCamera>,
    /// The open camera answers no more. It is closed by the next request, since that may take long or never end.
    dead: bool,
}

impl Session {
    /// The reply, and the bytes that go with it.
    pub(crate) fn answer(&mut self, request: Request) -> (Reply, Vec<u8>) {
        match self.reply(request) {
            Ok(reply) => reply,
            Err(failure) => {
                self.dead |= failure.handle == HandleState::Dead;
                (Reply::Failed(failure), Vec::new())
            }
        }
    }

    fn reply(&mut self, request: Request) -> Result<(Reply, Vec<u8>), Failure> {
        let plain = |reply| Ok((reply, Vec::new()));
        match request {
            Request::Hello { protocol } => {
                self.greeted = protocol == PROTOCOL;
                plain(Reply::Hello { protocol: PROTOCOL, version: env!("CARGO_PKG_VERSION").into() })
            }
            _ if !self.greeted => {
                Err(refused(Step::Handshake, format!("the first request must be `hello` with protocol {PROTOCOL}")))
            }
            Request::Open { model, port, serial } => {
                self.camera = None;
                let context = self.context()?;
                let camera = OpenCamera::open(&context, model, port, serial)?;
                let identity = Box::new(camera.identity().clone());
                self.camera = Some(camera);
                self.dead = false;
                plain(Reply::Identity(identity))
            }
            Request::Shoot(shot) => self.camera(Step::Set)?.shoot(&shot),
            Request::Idle { seconds } => {
                let time = Duration::try_from_secs_f64(seconds).ok().filter(|time| *time <= LONGEST_IDLE);
                let time = time.ok_or_else(|| refused(Step::Idle, format!("{seconds} s is not from 0 to an hour")))?;
                let unexpected = self.camera(Step::Idle)?.idle(time)?;
                plain(Reply::Idle { unexpected })
            }
            Request::Reset => Err(refused(
                Step::Reset,
                "a reset of the USB device is not supported: open the camera anew; if that fails, switch it off and on",
            )),
            Request::Close => {
                self.camera = None;
                plain(Reply::Closed)
            }
        }
    }

    fn camera(&mut self, step: Step) -> Result<&mut OpenCamera, Failure> {
        let closed =
            || Failure { handle: HandleState::Dead, ..refused(step, "no usable camera is open: open one first") };
        self.camera.as_mut().filter(|_| !self.dead).ok_or_else(closed)
    }

    fn context(&mut self) -> Result<Context, Failure> {
        if self.context.is_none() {
            library::listen_to_errors();
            self.context = Some(Context::new().map_err(|error| library::failure(Step::Open, &error))?);
        }
        self.context.clone().ok_or_else(|| refused(Step::Open, "libgphoto2 has no context"))
    }
}
