//! A simulated GRBL 1.1h controller behind a PTY.

mod machine;

use super::arm::pty::Pty;
use super::pose::SharedPose;
use machine::Machine;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Time between two looks at the motor.
const TICK: Duration = Duration::from_millis(2);

/// The controller to simulate.
#[derive(Clone, Debug)]
pub struct GrblConfig {
    /// The stored settings, as `$$` lists them.
    pub settings: BTreeMap<u16, f64>,
    /// The arm's angle at machine position 0, degrees.
    pub zero_deg: f64,
    /// How many times faster than real the motor turns.
    pub speed: f64,
    /// Where the true pose is written.
    pub pose: SharedPose,
}

/// Wishes not yet carried out, and states that last.
#[derive(Debug, Default)]
struct Injected {
    noise: Vec<u8>,
    swallow: u32,
    frozen: bool,
    stalled: bool,
    slip_deg: f64,
    reboot: bool,
    hit_limit: bool,
    unplug: bool,
}

/// Handle that injects faults; each takes effect within a few milliseconds.
#[derive(Clone, Debug, Default)]
pub struct GrblFaults(Arc<Mutex<Injected>>);

impl GrblFaults {
    /// These bytes arrive at the controller before whatever the host sends next.
    pub fn noise_before_next(&self, bytes: &[u8]) {
        self.wishes().noise = bytes.to_vec();
    }

    /// The controller's next `count` outputs are lost.
    pub fn swallow(&self, count: u32) {
        self.wishes().swallow = count;
    }

    /// Hangs the controller. `false` lets it go on.
    pub fn freeze(&self, frozen: bool) {
        self.wishes().frozen = frozen;
    }

    /// Blocks the motor. `false` frees it.
    pub fn stall(&self, stalled: bool) {
        self.wishes().stalled = stalled;
    }

    /// Turns the arm by `degrees` without the controller noticing.
    pub fn lose_steps(&self, degrees: f64) {
        self.wishes().slip_deg += degrees;
    }

    /// Cuts and restores the controller's power.
    pub fn reboot(&self) {
        self.wishes().reboot = true;
    }

    /// ALARM:1, and silence until a reset.
    pub fn hit_limit(&self) {
        self.wishes().hit_limit = true;
    }

    /// Pulls the cable for good.
    pub fn unplug(&self) {
        self.wishes().unplug = true;
    }

    fn wishes(&self) -> MutexGuard<'_, Injected> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A running controller; it ends when dropped.
#[derive(Debug)]
pub struct SimulatedGrbl {
    port: PathBuf,
    faults: GrblFaults,
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl SimulatedGrbl {
    /// Opens a PTY and starts the controller on a thread of its own.
    ///
    /// # Errors
    /// What the system said when no PTY or thread could be had.
    pub fn spawn(config: GrblConfig) -> io::Result<Self> {
        let pty = Pty::open()?;
        let port = pty.path().to_owned();
        let (faults, end) = (GrblFaults::default(), Arc::new(AtomicBool::new(false)));
        let (wishes, stop) = (faults.clone(), Arc::clone(&end));
        let thread =
            thread::Builder::new().name("simulated-grbl".into()).spawn(move || run(config, pty, &wishes, &stop))?;
        Ok(Self { port, faults, end, thread: Some(thread) })
    }

    /// The device file to open.
    pub fn port(&self) -> &Path {
        &self.port
    }

    /// What can go wrong with it.
    pub fn faults(&self) -> GrblFaults {
        self.faults.clone()
    }
}

impl Drop for SimulatedGrbl {
    fn drop(&mut self) {
        self.end.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn run(config: GrblConfig, pty: Pty, faults: &GrblFaults, end: &AtomicBool) {
    let mut machine = Machine::new(config.settings);
    let mut pty = Some(pty);
    let mut last = Instant::now();
    let mut buffer = [0; 256];
    while !end.load(Ordering::SeqCst) {
        let frozen = inject(&mut machine, &mut pty, faults);
        let now = Instant::now();
        let dt_s = now.duration_since(last).as_secs_f64() * config.speed;
        last = now;
        let Some(open) = pty.as_mut().filter(|_| !frozen) else {
            thread::sleep(TICK);
            continue;
        };
        machine.advance(dt_s);
        let count = open.read(&mut buffer, TICK);
        if count > 0 {
            let noise = std::mem::take(&mut faults.wishes().noise);
            machine.hear(&noise);
            machine.hear(buffer.get(..count).unwrap_or_default());
        }
        // The pose is true before the host can know of the change.
        config.pose.set(machine.pose(config.zero_deg));
        let said = machine.take_output();
        let mut wishes = faults.wishes();
        if said.is_empty() {
            continue;
        }
        if wishes.swallow > 0 {
            wishes.swallow -= 1;
            continue;
        }
        drop(wishes);
        open.write(&said);
    }
}

/// Carries out the injected faults; true while the controller is frozen.
fn inject(machine: &mut Machine, pty: &mut Option<Pty>, faults: &GrblFaults) -> bool {
    let mut wishes = faults.wishes();
    machine.stall(wishes.stalled);
    machine.slip(std::mem::take(&mut wishes.slip_deg));
    if std::mem::take(&mut wishes.reboot) {
        machine.power_cycle();
    }
    if std::mem::take(&mut wishes.hit_limit) {
        machine.hit_limit();
    }
    if wishes.unplug {
        *pty = None;
    }
    wishes.frozen
}
