//! The daemon put together: devices, store, engine and HTTP of one rig, in this process; before a simulated rig an operator as well.

mod operator;

use super::error::bad_input;
use crate::devices::arm::{Arm, ArmError};
use crate::devices::camera::Camera;
use crate::devices::replay::ReplayCamera;
use crate::devices::rigproto::{RigprotoArm, RigprotoSettings};
use crate::http::{self, HttpState};
use crate::session::bench::{OpenArm, OpenCamera};
use crate::session::engine::{self, EngineParts};
use crate::session::handle::EngineHandle;
use crate::session::processing::PipelineProcessing;
use crate::sim::arm::{ArmConfig, SimulatedArm};
use crate::sim::camera::{CameraFaults, SimulatedCamera};
use crate::sim::pose::SharedPose;
use crate::store::Store;
use anyhow::Context;
use operator::Operator;
use rig_config::{ArmDriver, CameraDriver, Rig};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

/// Open requests get this long to end when the daemon does.
const HTTP_GRACE: Duration = Duration::from_secs(5);

/// A running daemon.
pub struct Daemon {
    /// Where it listens: `http://127.0.0.1:PORT`.
    pub url: String,
    engine: EngineHandle,
    shutdown: CancellationToken,
    http: JoinHandle<Result<(), http::ServeError>>,
}

impl Daemon {
    /// Opens the store, starts the engine and serves the rig's address. `rig_text` is the rig file, for the manifests.
    ///
    /// # Errors
    /// A driver this version lacks, a data directory that another daemon holds, an address that is taken.
    pub async fn start(rig: Rig, rig_text: String) -> anyhow::Result<Self> {
        let (pose, operator) = (SharedPose::default(), Operator::default());
        let speed = rig.simulation.as_ref().map_or(1.0, |s| s.speed);
        let parts = EngineParts {
            open_arm: arm_factory(&rig, &pose)?,
            open_camera: camera_factory(&rig, &pose, &operator)?,
            store: Store::open(&rig.storage.data, rig.storage.reserve_bytes).map_err(bad_input)?,
            processing: Box::new(PipelineProcessing::new(&rig)),
            rig: rig.clone(),
            rig_text,
            speed,
        };
        let listen = rig.server.listen;
        let listener = bind(listen).await?;
        let url = format!("http://{}", listener.local_addr()?);
        let engine = engine::start(parts)?;
        operator.serve(engine.clone());
        let shutdown = CancellationToken::new();
        let state = HttpState { engine: engine.clone(), rig: Arc::new(rig), shutdown: shutdown.clone() };
        let http = tokio::spawn(http::serve(listener, state));
        Ok(Self { url, engine, shutdown, http })
    }

    /// Ends the daemon: the engine cleans up (arm parked, lamp off) while open requests are answered.
    pub async fn stop(self) -> anyhow::Result<()> {
        let engine = self.engine;
        let clean_up = tokio::task::spawn_blocking(move || engine.shutdown());
        self.shutdown.cancel();
        let http = tokio::time::timeout(HTTP_GRACE, self.http).await;
        // Whatever became of HTTP: the lamp comes first.
        clean_up.await?.context("clean-up at the end")?;
        if let Ok(ended) = http {
            ended??;
        }
        Ok(())
    }
}

async fn bind(listen: SocketAddr) -> anyhow::Result<TcpListener> {
    if !listen.ip().is_loopback() {
        return Err(bad_input(http::ServeError::NotLoopback(listen.ip())));
    }
    TcpListener::bind(listen)
        .await
        .map_err(|e| bad_input(format!("cannot listen on {listen}: {e}; choose another with --listen 127.0.0.1:0")))
}

const NO_GRBL: &str = "arm.driver = \"grbl\" is not available in this version: use \"rigproto\" or \"simulated\"";
const NO_GPHOTO2: &str =
    "camera.driver = \"gphoto2\" is not available in this version: use \"replay\" or \"simulated\"";

/// What this version cannot drive of a rig whose file is sound: [`Daemon::start`] refuses it.
pub fn missing_drivers(rig: &Rig) -> Vec<&'static str> {
    let arm = matches!(rig.arm.driver, ArmDriver::Grbl { .. }).then_some(NO_GRBL);
    let camera = matches!(rig.camera.driver, CameraDriver::Gphoto2 { .. }).then_some(NO_GPHOTO2);
    arm.into_iter().chain(camera).collect()
}

fn arm_factory(rig: &Rig, pose: &SharedPose) -> anyhow::Result<OpenArm> {
    let settings = |port: PathBuf| RigprotoSettings::new(port, &rig.arm);
    let open = |settings: &RigprotoSettings| -> Result<Box<dyn Arm>, ArmError> {
        Ok(Box::new(RigprotoArm::open(settings.clone())?))
    };
    match &rig.arm.driver {
        ArmDriver::Rigproto { port } => {
            let settings = settings(port.clone());
            Ok(Box::new(move || open(&settings)))
        }
        ArmDriver::Grbl { .. } => Err(bad_input(NO_GRBL)),
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

fn camera_factory(rig: &Rig, pose: &SharedPose, operator: &Operator) -> anyhow::Result<OpenCamera> {
    match (&rig.camera.driver, &rig.simulation) {
        (CameraDriver::Gphoto2 { .. }, _) => Err(bad_input(NO_GPHOTO2)),
        (CameraDriver::Replay { directory }, _) => {
            let (directory, exposures) = (directory.clone(), rig.plan.exposures.len());
            Ok(Box::new(move || Ok(Box::new(ReplayCamera::open(&directory, exposures)?) as Box<dyn Camera>)))
        }
        (CameraDriver::Simulated, Some(simulation)) => {
            let (rig, simulation, pose, operator) = (rig.clone(), simulation.clone(), pose.clone(), operator.clone());
            Ok(Box::new(move || {
                let camera = SimulatedCamera::new(&rig, &simulation, pose.clone(), CameraFaults::default());
                Ok(Box::new(operator.attend(camera)) as Box<dyn Camera>)
            }))
        }
        (CameraDriver::Simulated, None) => Err(bad_input("simulation: missing: a simulated driver needs the section")),
    }
}
