//! The daemon put together: devices, store, engine and HTTP of one rig, in this process; before a simulated rig an operator as well.

pub(super) mod notify;
mod operator;
mod secret;
mod supervisor;
pub(super) mod tls;
mod tokens;

use super::error::bad_input;
use super::logging;
use crate::devices::arm::{Arm, ArmError};
use crate::devices::camera::{Camera, CameraError};
use crate::devices::gphoto2::{Gphoto2Camera, Gphoto2Settings, KnownBody, WorkerCommand, remedies};
use crate::devices::grbl::{GrblArm, GrblSettings};
use crate::devices::inspect::{self, Host};
use crate::devices::replay::ReplayCamera;
use crate::devices::rigproto::{RigprotoArm, RigprotoSettings};
use crate::http::{self, HttpState, Tokens};
use crate::notify::{Notifier, Patience};
use crate::session::bench::{OpenArm, OpenCamera, Remedy};
use crate::session::engine::{self, EngineParts};
use crate::session::handle::EngineHandle;
use crate::session::processing::PipelineProcessing;
use crate::sim::arm::{ArmConfig, SimulatedArm};
use crate::sim::camera::{CameraFaults, SimulatedCamera};
use crate::sim::pose::SharedPose;
use crate::store::Store;
use anyhow::Context;
use jiff::Timestamp;
use operator::Operator;
use rig_config::{ArmDriver, CameraDriver, Rig, Server};
use std::net::TcpListener as StdListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

/// Open requests get this long to end when the daemon does.
const HTTP_GRACE: Duration = Duration::from_secs(5);

/// A running daemon.
pub struct Daemon {
    /// Where it listens: `http://127.0.0.1:PORT`, https with a certificate.
    pub url: String,
    engine: EngineHandle,
    notifier: Notifier,
    shutdown: CancellationToken,
    http: JoinHandle<Result<(), http::ServeError>>,
}

impl Daemon {
    /// Opens the store, starts the engine and serves the rig's address, or the `handed` listener of whoever started this program.
    /// `rig_text` is the rig file, for the manifests, and `file` where it was read.
    ///
    /// # Errors
    /// A driver this version lacks, a data directory that another daemon holds, an address that is taken, or one beyond loopback
    /// without tokens, nobody at the other end of `[notify]`.
    pub async fn start(
        rig: Rig,
        rig_text: String,
        file: Option<&Path>,
        handed: Option<StdListener>,
    ) -> anyhow::Result<Self> {
        let (pose, operator, body) = (SharedPose::default(), Operator::default(), KnownBody::default());
        if let Some(missing) = missing_drivers(&rig) {
            return Err(bad_input(missing));
        }
        let speed = rig.simulation.as_ref().map_or(1.0, |s| s.speed);
        let parts = EngineParts {
            open_arm: arm_factory(&rig, &pose)?,
            open_camera: camera_factory(&rig, &pose, &operator, &body)?,
            remedies: camera_remedies(&rig, &body),
            store: Store::open(&rig.storage.data, rig.storage.reserve_bytes)?.with_index(),
            processing: Box::new(PipelineProcessing::new(&rig)),
            rig: rig.clone(),
            rig_text,
            speed,
        };
        let tokens = tokens::load(&rig.server)?;
        let (targets, since) = (notify::targets(&rig).map_err(bad_input)?, Timestamp::now());
        let tls = tls::load(&rig.server).map_err(bad_input)?;
        let listener = listener(handed, &rig.server, &tokens).await?;
        let scheme = if tls.is_some() { "https" } else { "http" };
        let url = format!("{scheme}://{}", listener.local_addr()?);
        let engine = engine::start(parts)?;
        operator.serve(engine.clone());
        let notifier = Notifier::start(engine.clone(), &rig.name, targets, since, Patience::default())?;
        let shutdown = CancellationToken::new();
        let state = HttpState {
            engine: engine.clone(),
            rig: Arc::new(rig),
            rig_file: file.map(Arc::from),
            log: logging::tail(),
            tokens: Arc::new(tokens),
            notifications: notifier.counts(),
            shutdown: shutdown.clone(),
        };
        let http = tokio::spawn(http::serve(listener, tls, state));
        supervisor::started(&url, &engine);
        Ok(Self { url, engine, notifier, shutdown, http })
    }

    /// Ends the daemon: the engine cleans up (arm parked, lamp off) while open requests are answered.
    pub async fn stop(self) -> anyhow::Result<()> {
        supervisor::ending();
        let engine = self.engine;
        let clean_up = tokio::task::spawn_blocking(move || engine.shutdown());
        self.shutdown.cancel();
        let http = tokio::time::timeout(HTTP_GRACE, self.http).await;
        // Whatever became of HTTP: the lamp comes first.
        let cleaned = clean_up.await?;
        let notifier = self.notifier;
        tokio::task::spawn_blocking(move || notifier.end()).await?;
        cleaned.context("clean-up at the end")?;
        if let Ok(ended) = http {
            ended??;
        }
        Ok(())
    }
}

async fn listener(handed: Option<StdListener>, server: &Server, tokens: &Tokens) -> anyhow::Result<TcpListener> {
    let listen = server.listen;
    let listener = match handed {
        Some(handed) => {
            handed.set_nonblocking(true)?;
            TcpListener::from_std(handed)?
        }
        None => {
            http::may_serve(listen.ip(), tokens).map_err(bad_input)?;
            // What holds data directory or address may soon let go: no bad input, so that the service manager tries again.
            let taken = || format!("cannot listen on {listen}: choose another with --listen 127.0.0.1:0");
            TcpListener::bind(listen).await.with_context(taken)?
        }
    };
    let address = listener.local_addr()?;
    http::may_serve(address.ip(), tokens).map_err(bad_input)?;
    if !address.ip().is_loopback() && server.tls.is_none() {
        tracing::warn!(%address, "tokens cross the network unencrypted: name server.certificate, or listen on loopback behind a proxy with TLS");
    }
    Ok(listener)
}

/// What keeps this build from driving a rig whose file is sound: [`Daemon::start`] refuses it.
pub fn missing_drivers(rig: &Rig) -> Option<String> {
    let CameraDriver::Gphoto2 { .. } = rig.camera.driver else { return None };
    match camera_worker() {
        Ok(program) if program.is_file() => None,
        Ok(program) => Some(format!(
            "camera.driver = \"gphoto2\" needs {}: build it with `cargo build --release -p camera-worker` (Debian: libgphoto2-dev, \
             libclang-dev, pkg-config) and put it beside rigd",
            program.display()
        )),
        Err(error) => Some(error.to_string()),
    }
}

/// The program beside this one that drives a camera through libgphoto2.
fn camera_worker() -> std::io::Result<PathBuf> {
    Ok(std::env::current_exe()?.with_file_name("camera-worker"))
}

/// The rig's arm and camera, for whoever looks at them without a daemon.
///
/// # Errors
/// No PTY for a simulated arm; a rig that lacks its `[simulation]`.
pub fn devices(rig: &Rig) -> anyhow::Result<(OpenArm, OpenCamera)> {
    let pose = SharedPose::default();
    let camera = camera_factory(rig, &pose, &Operator::default(), &KnownBody::default())?;
    Ok((arm_factory(rig, &pose)?, camera))
}

/// Refuses a port that is not there, may not be used or is held: opening it would disturb whoever talks to the arm.
fn check_port(port: &Path) -> Result<(), ArmError> {
    match inspect::refusal(&inspect::port::look(&Host::this(), port)) {
        Some(reason) => Err(ArmError::Port { port: port.display().to_string(), reason }),
        None => Ok(()),
    }
}

/// Refuses a camera that may not be used or is held.
fn check_camera(port: Option<&str>) -> Result<(), CameraError> {
    if port.is_some_and(|port| !port.starts_with("usb:")) {
        return Ok(());
    }
    match inspect::refusal(&inspect::usb::refusals(&Host::this(), port)) {
        Some(reason) => Err(CameraError::Unusable { reason }),
        None => Ok(()),
    }
}

fn arm_factory(rig: &Rig, pose: &SharedPose) -> anyhow::Result<OpenArm> {
    let settings = |port: PathBuf| RigprotoSettings::new(port, &rig.arm);
    let open = |settings: &RigprotoSettings| -> Result<Box<dyn Arm>, ArmError> {
        Ok(Box::new(RigprotoArm::open(settings.clone())?))
    };
    match &rig.arm.driver {
        ArmDriver::Rigproto { port } => {
            let settings = settings(port.clone());
            Ok(Box::new(move || {
                check_port(&settings.port)?;
                open(&settings)
            }))
        }
        ArmDriver::Grbl { port, lamp, zero_deg } => {
            let settings = GrblSettings { port: port.clone(), lamp: *lamp, zero_deg: *zero_deg, arm: rig.arm.clone() };
            Ok(Box::new(move || {
                check_port(&settings.port)?;
                Ok(Box::new(GrblArm::open(settings.clone())?) as Box<dyn Arm>)
            }))
        }
        ArmDriver::Simulated => {
            let arm = SimulatedArm::spawn(ArmConfig::from_rig(rig, pose.clone())).context("no PTY can be had")?;
            let settings = settings(arm.port().to_owned());
            Ok(Box::new(move || {
                // The simulated board lives as long as this factory does.
                let _board = &arm;
                open(&settings)
            }))
        }
    }
}

fn camera_factory(rig: &Rig, pose: &SharedPose, operator: &Operator, body: &KnownBody) -> anyhow::Result<OpenCamera> {
    match (&rig.camera.driver, &rig.simulation) {
        (CameraDriver::Gphoto2 { .. }, _) => {
            let settings = gphoto2_settings(rig, body)?;
            Ok(Box::new(move |cancel| {
                check_camera(settings.port.as_deref())?;
                Ok(Box::new(Gphoto2Camera::open(settings.clone(), cancel)?) as Box<dyn Camera>)
            }))
        }
        (CameraDriver::Replay { directory }, _) => {
            let (directory, exposures) = (directory.clone(), rig.plan.exposures.len());
            Ok(Box::new(move |_| Ok(Box::new(ReplayCamera::open(&directory, exposures)?) as Box<dyn Camera>)))
        }
        (CameraDriver::Simulated, Some(simulation)) => {
            let (rig, simulation, pose, operator) = (rig.clone(), simulation.clone(), pose.clone(), operator.clone());
            Ok(Box::new(move |_| {
                let camera = SimulatedCamera::new(&rig, &simulation, pose.clone(), CameraFaults::default());
                Ok(Box::new(operator.attend(camera)) as Box<dyn Camera>)
            }))
        }
        (CameraDriver::Simulated, None) => Err(bad_input("simulation: missing: a simulated driver needs the section")),
    }
}

/// Directory for libgphoto2's settings, beside the sessions.
const CAMERA_HOME: &str = "camera-home";

pub(super) fn gphoto2_settings(rig: &Rig, body: &KnownBody) -> anyhow::Result<Gphoto2Settings> {
    let CameraDriver::Gphoto2 { model, port, .. } = &rig.camera.driver else {
        return Err(bad_input("camera.driver is not \"gphoto2\""));
    };
    let program = camera_worker().context("this program's own path is not known")?;
    let home = rig.storage.data.join(CAMERA_HOME);
    let worker = WorkerCommand { program, home, environment: Vec::new() };
    Ok(Gphoto2Settings { worker, model: model.clone(), port: port.clone(), body: body.clone() })
}

/// A reset of the USB device, and the rig file's command for its power.
fn camera_remedies(rig: &Rig, body: &KnownBody) -> Vec<Remedy> {
    let CameraDriver::Gphoto2 { power_hook, .. } = &rig.camera.driver else { return Vec::new() };
    let body = body.clone();
    let mut all = vec![Remedy { name: "usb reset", apply: Box::new(move |cancel| remedies::reset_usb(&body, cancel)) }];
    if let Some(hook) = power_hook.clone() {
        all.push(Remedy { name: "power hook", apply: Box::new(move |cancel| remedies::switch_power(&hook, cancel)) });
    }
    all
}
