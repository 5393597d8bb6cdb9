//! The simulated EOS 5D Mark II on a port of its own.

use crate::cli::error::{bad_input, print_line};
use crate::cli::simulate::arm::Link;
use crate::sim::arm::{ArmConfig, SimulatedArm};
use crate::sim::camera::{CameraFaults, SimulatedCamera};
use crate::sim::eos::EosSensor;
use crate::sim::pose::{Pose, SharedPose};
use anyhow::Context;
use rig_config::{Rig, Simulation};
use simulated_eos::{Body, BodyOptions, Server};
use std::path::Path;
use tokio::signal::unix::{SignalKind, signal};

/// Serves until a signal ends it. With `arm_link` the simulated arm carries the lamp, else it stands at `station`.
pub(super) fn serve(
    rig: &Rig,
    simulation: &Simulation,
    station: Option<usize>,
    port: u16,
    arm_link: Option<&Path>,
) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        // Listening before anyone can know the port, so that no signal comes too early.
        let mut interrupt = signal(SignalKind::interrupt())?;
        let mut terminate = signal(SignalKind::terminate())?;
        let pose = pose_at(rig, station)?;
        let arm = arm_link.map(|_| SimulatedArm::spawn(ArmConfig::from_rig(rig, pose.clone()))).transpose();
        let arm = arm.context("no PTY can be had")?;
        let link =
            arm_link.zip(arm.as_ref()).map(|(link, arm)| Link::make(link, arm.port(), "--arm-link")).transpose()?;
        let camera = SimulatedCamera::new(rig, simulation, pose, CameraFaults::default());
        let options = BodyOptions { speed: simulation.speed, ..BodyOptions::default() };
        let body = Body::new(Box::new(EosSensor::new(camera)), options)?;
        let server = Server::start(body, port)
            .map_err(|e| bad_input(format!("cannot serve on port {port}: {e}; 0 takes any free one")))?;
        print_line(server.gphoto2_port())?;
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        }
        drop(link);
        Ok(())
    })
}

fn pose_at(rig: &Rig, station: Option<usize>) -> anyhow::Result<SharedPose> {
    let stations = &rig.plan.stations_deg;
    let n = station.unwrap_or(0);
    let last = stations.len().saturating_sub(1);
    let angle_deg =
        *stations.get(n).ok_or_else(|| bad_input(format!("--station {n}: the plan has stations 0 to {last}")))?;
    let pose = SharedPose::default();
    pose.set(Pose { angle_deg, lamp_permille: rig.lamp.level_permille });
    Ok(pose)
}
