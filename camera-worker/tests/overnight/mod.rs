//! The daemon's program between a simulated camera, a simulated arm and somebody who plays service manager.

mod faults;

use crate::daemon::{Daemon, shipped};
use faults::Faults;
use rig_config::Rig;
use rigd::sim::arm::{ArmConfig, SimulatedArm};
use rigd::sim::camera::{CameraFaults, SimulatedCamera};
use rigd::sim::eos::EosSensor;
use rigd::sim::pose::SharedPose;
use serde_json::Value;
use simulated_eos::{Body, BodyOptions, Server};
use std::fmt;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

/// How many times faster than real camera and arm are.
pub const SPEED: f64 = 40.0;
/// After so long without a ping systemd would end the daemon.
pub const WATCHDOG: Duration = Duration::from_secs(10);
const JSON: (&str, &str) = ("content-type", "application/json");
const LOOK: Duration = Duration::from_millis(100);

/// What became of a night.
pub struct Story {
    frames: u64,
    refused: u64,
    faults: Vec<String>,
    pub longest_silence: Duration,
    /// While frames are shot: time that those so far take by the plan's own estimate, hours, and bytes of memory.
    memory: Vec<(f64, f64)>,
    /// Most memory while the material is fitted, bytes.
    fitting_bytes: f64,
}

impl Story {
    /// Growth of the resident memory after the first hour, bytes an hour; none of a shorter night.
    pub fn growth_an_hour(&self) -> Option<f64> {
        let most = |from: f64, to: f64| {
            let within = self.memory.iter().filter(|(hour, _)| (from..to).contains(hour));
            within.map(|(_, bytes)| *bytes).reduce(f64::max)
        };
        let end = self.memory.last()?.0;
        Some((most(1.0, f64::INFINITY)? - most(0.0, 1.0)?) / (end - 1.0))
    }
}

impl fmt::Display for Story {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (hours, bytes) = self.memory.last().copied().unwrap_or_default();
        let silence = self.longest_silence.as_secs_f64();
        write!(
            f,
            "{} frames of {hours:.2} h, {} frames and brackets shot again, longest time between two pings {silence:.1} s, \
             {:.1} MB at the end of shooting, {:.0} MB fitting; {} faults: {}",
            self.frames,
            self.refused,
            bytes / 1e6,
            self.fitting_bytes / 1e6,
            self.faults.len(),
            self.faults.join(", ")
        )
    }
}

pub struct Night {
    pub daemon: Daemon,
    pub pose: SharedPose,
    manager: UnixDatagram,
    arm: SimulatedArm,
    camera: Server,
    stations: usize,
}

impl Night {
    /// A daemon that is ready, with a plan of so many stations.
    pub fn begin(stations: usize) -> Self {
        let mut truth = Rig::from_toml(shipped(), "simulated.toml").unwrap();
        (truth.camera.width, truth.camera.height) = (144, 96);
        (truth.camera.focal_px, truth.camera.principal_px) = ([1650.0; 2], [72.0, 48.0]);
        let simulation = truth.simulation.clone().unwrap();
        let pose = SharedPose::default();
        let arm = SimulatedArm::spawn(ArmConfig::from_rig(&truth, pose.clone())).unwrap();
        let sensor = EosSensor::new(SimulatedCamera::new(&truth, &simulation, pose.clone(), CameraFaults::default()));
        let options = BodyOptions { speed: SPEED, card_files: 2500, ..BodyOptions::default() };
        let camera = Server::start(Body::new(Box::new(sensor), options).unwrap(), 0).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let manager = UnixDatagram::bind(folder.path().join("notify")).unwrap();
        manager.set_read_timeout(Some(LOOK)).unwrap();
        let config = rig_file(&arm, &camera, stations);
        let (notify, data) = (folder.path().join("notify"), folder.path().join("data"));
        let daemon = Daemon::start_as(folder, &config, &data, |command| supervised(command, &notify));
        Self { daemon, pose, manager, arm, camera, stations }
    }

    /// One session to its end, with faults drawn by a seed, one in `every` frames on average.
    pub fn shoot(&mut self, seed: u64, every: f64) -> Story {
        let mut faults = Faults::new(seed, every, self.camera.faults(), self.arm.faults());
        let location = self.begin_another("{}");
        let planned_h = self.planned_hours();
        let mut story = Story {
            frames: 0,
            refused: 0,
            faults: Vec::new(),
            longest_silence: Duration::ZERO,
            memory: Vec::new(),
            fitting_bytes: 0.0,
        };
        let mut heard = Instant::now();
        loop {
            if self.pinged() {
                heard = Instant::now();
            }
            story.longest_silence = story.longest_silence.max(heard.elapsed());
            let now = self.session(&location);
            story.frames = now["frames_committed"].as_u64().unwrap();
            story.refused = now["refused"].as_u64().unwrap();
            let share = story.frames as f64 / (10 * self.stations) as f64;
            match now["state"].as_str().unwrap() {
                "completed" => break,
                "preflight" => {}
                "running" => story.memory.push((share * planned_h, self.resident_bytes())),
                "fitting" => story.fitting_bytes = story.fitting_bytes.max(self.resident_bytes()),
                other => panic!("{other}: {}; {story}", now["reason"]),
            }
            faults.strike(story.frames, &mut story.faults);
        }
        assert_eq!(story.frames, 10 * self.stations as u64, "{story}");
        self.verify(&location);
        story
    }

    /// Starts the session that is asked for; where it is.
    pub fn begin_another(&self, asked: &str) -> String {
        let started = self.daemon.call("POST", "/v1/sessions", &[JSON], asked);
        assert_eq!(started.status, 202, "{}", started.text);
        started.header("location").unwrap().to_owned()
    }

    fn planned_hours(&self) -> f64 {
        let planned = self.daemon.call("POST", "/v1/sessions?dry_run=true", &[JSON], "{}").json();
        planned["estimated_s"].as_f64().unwrap() / 3600.0
    }

    pub fn wait_until_it_moves(&self, location: &str) {
        let begin = Instant::now();
        let mut last = self.pose.get();
        loop {
            std::thread::sleep(Duration::from_millis(2));
            let now = self.pose.get();
            if now.lamp_permille > 0 && now.angle_deg != last.angle_deg {
                return;
            }
            last = now;
            let late = begin.elapsed() > Duration::from_secs(60);
            assert!(!late, "it never moves with the lamp lit: {now:?}, {}", self.session(location));
        }
    }

    /// The lamp is out and the arm stands.
    pub fn is_safe(&self) -> bool {
        let before = self.pose.get();
        std::thread::sleep(Duration::from_millis(50));
        let now = self.pose.get();
        now.lamp_permille == 0 && now.angle_deg == before.angle_deg
    }

    fn session(&self, location: &str) -> Value {
        self.daemon.get(location).json()
    }

    fn pinged(&self) -> bool {
        let mut bytes = [0; 4096];
        self.manager.recv(&mut bytes).is_ok_and(|length| bytes[..length].starts_with(b"WATCHDOG=1"))
    }

    fn resident_bytes(&self) -> f64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.daemon.pid())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
        line.trim().trim_end_matches(" kB").parse::<f64>().unwrap() * 1024.0
    }

    /// Every file is what the journal says.
    fn verify(&self, location: &str) {
        let directory = self.daemon.directory(location);
        let output = Command::new(crate::daemon::program()).arg("verify").arg(&directory).output().unwrap();
        let told = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{told}");
        println!("{}", told.trim());
    }
}

fn supervised<'a>(command: &'a mut Command, notify: &Path) -> &'a mut Command {
    command
        .args(["--listen", "127.0.0.1:0"])
        .env("NOTIFY_SOCKET", notify)
        .env("WATCHDOG_USEC", WATCHDOG.as_micros().to_string())
}

/// The shipped simulated rig as if it were a real one: its own waits are short, for they pass in real time.
fn rig_file(arm: &SimulatedArm, camera: &Server, stations: usize) -> String {
    let step = 220.0 / stations as f64;
    let angles: Vec<String> = (0..stations).map(|i| format!("{:.2}", -75.0 + step * i as f64)).collect();
    let (real, _) = shipped().split_once("[simulation]").unwrap();
    let exchanges = [
        ("[arm]\n", format!("[arm]\nport = \"{}\"\n", arm.port().display())),
        ("[camera]\n", format!("[camera]\nport = \"{}\"\n", camera.gphoto2_port())),
        ("settle_s = 0.5", "settle_s = 0.01".into()),
        ("soak_s = 5.0", "soak_s = 0.2".into()),
        ("width = 288", "width = 144".into()),
        ("height = 192", "height = 96".into()),
        ("focal_px = [3300.0, 3300.0]", "focal_px = [1650.0, 1650.0]".into()),
        ("principal_px = [144.0, 96.0]", "principal_px = [72.0, 48.0]".into()),
        (
            "stations_deg = [-55.0, -20.0, 15.0, 50.0, 85.0, 115.0, 140.0]",
            format!("stations_deg = [{}]", angles.join(", ")),
        ),
    ];
    let mut text = real.replacen("driver = \"simulated\"", "driver = \"rigproto\"", 1);
    text = text.replacen("driver = \"simulated\"", "driver = \"gphoto2\"", 1);
    for (from, to) in exchanges {
        assert_eq!(text.matches(from).count(), 1, "{from}");
        text = text.replace(from, &to);
    }
    text
}
