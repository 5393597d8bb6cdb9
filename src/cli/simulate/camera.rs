//! `rigd simulate camera`: the simulated camera by itself, shooting a rig's plan into a folder, or on a loopback port for anyone's
//! libgphoto2.

mod eos;

use crate::cli::error::{bad_input, print_json, print_line};
use crate::cli::progress::Progress;
use crate::devices::Cancel;
use crate::devices::camera::{Camera, Shot};
use crate::sim::camera::{CameraFaults, SimulatedCamera};
use crate::sim::pose::{Pose, SharedPose};
use anyhow::Context;
use rig_config::{Rig, Scene, Simulation};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

/// Shoots the rig file's plan, arm and camera simulated, as fast as it goes; with --serve waits for others to shoot.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Rig file: geometry, sensor, plan and simulated world.
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// New or empty folder for the frames, SSS-EE.jpg (station, exposure); with --station also exposures.toml.
    #[arg(long, value_name = "DIR", required_unless_present = "serve")]
    out: Option<PathBuf>,
    /// Serve an EOS 5D Mark II over PTP/IP on this loopback port (0: any) until SIGINT or SIGTERM; prints the port as libgphoto2
    /// spells it. The lamp stands at --station (the first if left out), and exposures last as the rig file's simulation.speed says.
    #[arg(long, value_name = "PORT", conflicts_with = "out")]
    serve: Option<u16>,
    /// Serve the arm as well, whose lamp then lights the scene: a link to its PTY. For `rigd serve` with both.
    #[arg(long, value_name = "PATH", requires = "serve", conflicts_with = "out")]
    arm_link: Option<PathBuf>,
    /// Shoot another object than the rig file names.
    #[arg(long, value_enum)]
    scene: Option<SceneName>,
    /// Shoot this station of the plan only, from 0.
    #[arg(long, value_name = "N")]
    station: Option<usize>,
    /// Print the folder and the number of frames as JSON and nothing else.
    #[arg(long, conflicts_with = "serve")]
    json: bool,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum SceneName {
    Marble,
    Wood,
}

/// Reads the rig file and shoots.
pub fn run(args: Args) -> anyhow::Result<()> {
    let rig = Rig::read(&args.config)?;
    let Some(mut simulation) = rig.simulation.clone() else {
        return Err(bad_input(format!(
            "{}: no [simulation] section: add one with scene, seed and speed",
            args.config.display()
        )));
    };
    if let Some(scene) = args.scene {
        simulation.scene = match scene {
            SceneName::Marble => Scene::Marble,
            SceneName::Wood => Scene::Wood,
        };
    }
    match (args.serve, args.out) {
        (Some(port), _) => eos::serve(&rig, &simulation, args.station, port, args.arm_link.as_deref()),
        (None, Some(out)) => {
            let progress = Progress::counted_unless(args.json, "frames");
            let frames = shoot_plan(&rig, simulation, args.station, &out, &progress)?;
            if args.json {
                return print_json(&serde_json::json!({ "out": out, "frames": frames }));
            }
            Ok(print_line(format!("{frames} frames in {}", out.display()))?)
        }
        (None, None) => Err(bad_input("give --out DIR or --serve PORT")),
    }
}

/// Shoots every exposure of the plan's stations, or of `station` alone, into `out`, and tells `progress`; returns the number of frames.
pub fn shoot_plan(
    rig: &Rig,
    simulation: Simulation,
    station: Option<usize>,
    out: &Path,
    progress: &Progress,
) -> anyhow::Result<usize> {
    let plan = &rig.plan;
    let stations = match station {
        Some(n) if n < plan.stations_deg.len() => n..n + 1,
        Some(n) => {
            return Err(bad_input(format!(
                "--station {n}: the plan has stations 0 to {}",
                plan.stations_deg.len() - 1
            )));
        }
        None => 0..plan.stations_deg.len(),
    };
    make_empty(out)?;
    let pose = SharedPose::default();
    let at_once = Simulation { speed: f64::INFINITY, ..simulation };
    let mut camera = SimulatedCamera::new(rig, &at_once, pose.clone(), CameraFaults::default());
    let (all, mut shot_frames) = (stations.len() * plan.exposures.len(), 0);
    let mut list = String::new();
    for station in stations {
        pose.set(Pose { angle_deg: plan.stations_deg[station], lamp_permille: rig.lamp.level_permille });
        for (exposure, shutter) in plan.exposures.iter().enumerate() {
            let shot = Shot {
                station,
                exposure,
                shutter: shutter.clone(),
                f_number: rig.camera.f_number,
                iso: rig.camera.iso,
            };
            let frame = camera.shoot(&shot, &Cancel::default())?;
            let name = format!("{station:03}-{exposure:02}.jpg");
            write_file(&out.join(&name), &frame.bytes)?;
            write!(list, "[[frame]]\nfile = \"{name}\"\ntime_s = {:?}\n\n", shutter.true_s)?;
            shot_frames += 1;
            progress.count(shot_frames, all);
        }
    }
    progress.end();
    if station.is_some() {
        write_file(&out.join("exposures.toml"), list.as_bytes())?;
    }
    Ok(shot_frames)
}

/// Frames of another plan among the new ones would be played as if they belonged to it.
fn make_empty(out: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(out).with_context(|| format!("{}: the folder cannot be made", out.display()))?;
    if fs::read_dir(out).with_context(|| format!("{}: the folder cannot be read", out.display()))?.next().is_some() {
        return Err(bad_input(format!("{}: the folder is not empty: give a new one", out.display())));
    }
    Ok(())
}

fn write_file(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    fs::write(path, bytes).with_context(|| format!("{}: the file cannot be written", path.display()))
}
