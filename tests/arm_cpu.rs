//! What an arm in trouble costs: a hang-up, an absent port, a silent one, one that babbles at full speed. In a program of its own, so that
//! its processor time is that of engine and drivers alone.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod line;
mod support;

use line::Weather;
use line::arms::{Bench, KINDS, Kind};
use nix::time::ClockId;
use rigd::cli::daemon;
use rigd::session::handle::EngineHandle;
use rigd::session::state::{SessionState as S, Verb};
use std::fs;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};
use support::{Act, Fakes, begin, events, until, wait_for};

/// The requirement: share of a core, in any phase.
const SHARE: f64 = 0.02;
/// Threads that play cable and boards.
const BENCH: [&str; 3] = [line::THREAD, "simulated-arm", "simulated-grbl"];

/// Processor time of this process so far, less that of the threads that play cable and boards, which live throughout.
fn processor_time() -> Duration {
    let own = |directory: &fs::DirEntry| {
        let name = fs::read_to_string(directory.path().join("comm")).unwrap_or_default();
        BENCH.iter().any(|bench| name.trim() == &bench[..bench.len().min(15)])
    };
    let nanoseconds = |directory: fs::DirEntry| -> u64 {
        let text = fs::read_to_string(directory.path().join("schedstat")).unwrap();
        text.split_whitespace().next().unwrap().parse().unwrap()
    };
    let bench: u64 = fs::read_dir("/proc/self/task").unwrap().flatten().filter(own).map(nanoseconds).sum();
    let all: Duration = ClockId::CLOCK_PROCESS_CPUTIME_ID.now().unwrap().into();
    all.saturating_sub(Duration::from_nanos(bench))
}

/// A session whose camera holds its second shot, as in a long exposure, until the sender is told.
struct Rigged {
    bench: Bench,
    engine: EngineHandle,
    id: String,
    shutter: SyncSender<()>,
    _data: tempfile::TempDir,
}

fn rigged(kind: Kind) -> Rigged {
    let bench = Bench::new(kind, 20.0, 5);
    let mut rig = support::rig();
    rig.arm = bench.config();
    rig.lamp.soak_s = 0.0;
    rig.plan.stations_deg = (-16..16).map(|n| 5.0 * f64::from(n)).collect();
    let (shutter, closed) = sync_channel(1);
    let fakes = Fakes::default();
    fakes.on_shot(move |_, count, _| {
        if count == 1 {
            closed.recv().unwrap();
        }
        Act::Good
    });
    let (open, _) = daemon::devices(&rig).unwrap();
    let data = tempfile::tempdir().unwrap();
    let engine = fakes.engine_with_arm(data.path(), rig, open);
    let id = begin(&engine);
    until("the first frame", || engine.session(&id).unwrap().frames_committed == 1);
    Rigged { bench, engine, id, shutter, _data: data }
}

fn phase(name: &str, seconds: f64) {
    let (cpu, wall) = (processor_time(), Instant::now());
    thread::sleep(Duration::from_secs_f64(seconds));
    let share = (processor_time() - cpu).as_secs_f64() / wall.elapsed().as_secs_f64();
    println!("{name}: {:.2} % of a core", 100.0 * share);
    assert!(share < SHARE, "{name}: {share}");
}

/// Both drivers at once: each alone costs less.
#[test]
fn arms_in_trouble_cost_less_than_a_fiftieth_of_a_core() {
    let rigs = KINDS.map(rigged);
    let weather = |weather: Weather| rigs.iter().for_each(|rig| rig.bench.line.weather(weather));
    phase("idle", 1.0);
    weather(Weather { babble: true, ..Weather::default() });
    phase("answers among babble", 4.0);
    for rig in &rigs {
        let heard = rig.bench.line.noise_sent();
        assert!(heard > 40_000, "only {heard} bytes of babble");
    }
    weather(Weather { drop: 1.0, ..Weather::default() });
    for rig in &rigs {
        rig.bench.line.hang_up();
        rig.shutter.send(()).unwrap();
    }
    phase("absent", 3.0);
    for rig in &rigs {
        rig.bench.line.come_back(Duration::ZERO, || {});
    }
    phase("silent", 8.0);
    weather(Weather { drop: 1.0, babble: true, ..Weather::default() });
    phase("babbling", 5.0);
    for rig in &rigs {
        assert_eq!(events(&rig.engine, &rig.id, "fault.cleared").len(), 0);
    }
    weather(Weather::default());
    for rig in &rigs {
        until("the recovery", || !events(&rig.engine, &rig.id, "fault.cleared").is_empty());
        rig.engine.command(&rig.id, Verb::Abort).unwrap();
        wait_for(&rig.engine, &rig.id, S::Aborted);
    }
}
