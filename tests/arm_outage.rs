//! A session whose arm is unplugged and comes back under another name: how soon after its return the handshake is done.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod line;
mod support;

use line::arms::{Bench, KINDS, Kind};
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use rigd::cli::daemon;
use rigd::session::state::{SessionState as S, Verb};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};
use support::{Act, Fakes, begin, events, until, wait_for};

/// The requirement: seconds from the port's return to the end of the handshake.
const RECONNECT: Duration = Duration::from_secs(2);
/// Shots at which the cable is pulled: as many recoveries as a session may need.
const PULLS: [usize; 3] = [1, 4, 7];
/// How long a boot loader keeps a board deaf that its opening resets, as measured.
const BOOT_LOADER: Duration = Duration::from_millis(1034);

type Times = Arc<Mutex<Vec<Instant>>>;

/// One session with three outages; the time from each return to the handshake.
fn outages(kind: Kind, seed: u64) -> Vec<Duration> {
    let bench = Arc::new(Bench::new(kind, 20.0, seed));
    let mut rig = support::rig();
    rig.arm = bench.config();
    rig.lamp.soak_s = 0.0;
    rig.plan.stations_deg = (-4..16).map(|n| 5.0 * f64::from(n)).collect();
    let fakes = Fakes::default();
    let (returned, opened) = (Times::default(), Times::default());

    let (cable, returns) = (bench.clone(), returned.clone());
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let boot_loader = if seed.is_multiple_of(2) { Duration::ZERO } else { BOOT_LOADER };
    fakes.on_shot(move |_, count, _| {
        if PULLS.contains(&count) {
            cable.line.hang_up();
            let away = Duration::from_secs_f64(rng.random_range(0.0..3.0));
            let (cable, returns) = (cable.clone(), returns.clone());
            thread::spawn(move || {
                thread::sleep(away);
                let at = cable.line.come_back(boot_loader, cable.reboot());
                returns.lock().unwrap().push(at);
            });
        }
        Act::Good
    });
    let (mut open, _) = daemon::devices(&rig).unwrap();
    let opens = opened.clone();
    let counted = move || open().inspect(|_| opens.lock().unwrap().push(Instant::now()));

    let data = tempfile::tempdir().unwrap();
    let engine = fakes.engine_with_arm(data.path(), rig, Box::new(counted));
    let id = begin(&engine);
    for count in 1..=PULLS.len() {
        until("a recovery", || {
            assert!(!engine.session(&id).unwrap().state.is_final(), "{:?}", engine.session(&id).unwrap().reason);
            events(&engine, &id, "fault.cleared").len() >= count
        });
    }
    until("the session to go on", || fakes.world().shots.len() > PULLS[2] + 3);
    engine.command(&id, Verb::Abort).unwrap();
    wait_for(&engine, &id, S::Aborted);
    let raised = events(&engine, &id, "fault.raised");
    assert_eq!(raised.len(), PULLS.len(), "{raised:?}");
    assert_eq!(bench.pose.get().lamp_permille, 0);

    // The first opening is the session's start.
    let (returned, opened) = (returned.lock().unwrap(), opened.lock().unwrap());
    assert_eq!((returned.len(), opened.len()), (PULLS.len(), PULLS.len() + 1));
    returned.iter().zip(&opened[1..]).map(|(returned, opened)| opened.duration_since(*returned)).collect()
}

/// 21 returns a driver, half of them behind a boot loader.
#[test]
fn an_arm_that_comes_back_is_shaken_hands_with_within_two_seconds() {
    // One driver after the other: more simulated boards at once might not answer in time.
    for kind in KINDS {
        let sessions: Vec<_> = (0..7).map(|seed| thread::spawn(move || outages(kind, seed))).collect();
        let mut times: Vec<Duration> = sessions.into_iter().flat_map(|session| session.join().unwrap()).collect();
        times.sort();
        let (count, worst) = (times.len(), times[times.len() - 1]);
        println!("{kind:?}: {count} returns, handshake done after {:?} (median), {worst:?} (worst)", times[count / 2]);
        assert!(worst < RECONNECT, "{kind:?}: {times:?}");
    }
}
