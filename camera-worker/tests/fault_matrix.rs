//! Faults of camera and arm at every step of a bracket, through the real libgphoto2: a session completes with each frame correct, or ends
//! interrupted with the arm parked, the lamp off and everything shot so far intact. No wrong frame is ever accepted.
//!
//! The short form takes every fault once, at steps that differ; the long form (`-- --ignored`) every fault at every step.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod rig;

use firmware_protocol::DEAD_MAN_MS;
use rig::{Cable, Rigged, shipped};
use rig_config::{Rig, Shutter};
use rigd::devices::Cancel;
use rigd::devices::camera::{Camera, Shot};
use rigd::numerics::image::Image;
use rigd::pipeline::decode::decode;
use rigd::pipeline::fit::OnProgress;
use rigd::session::adaptive::Weighed;
use rigd::session::handle::SessionSnapshot;
use rigd::session::plan::StartRequest;
use rigd::session::processing::{Bracket, FitJob, Judged, Next, OpenBracket, Processing, StepJob};
use rigd::session::state::SessionState;
use rigd::sim::arm::ArmFaults;
use rigd::sim::camera::{CameraFaults, SimulatedCamera};
use rigd::sim::pose::{Pose, SharedPose};
use serde_json::{Value, json};
use simulated_eos::{Fault, Moment};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

const ANGLES_DEG: [f64; 2] = [-20.0, 50.0];
const EXPOSURES: [&str; 5] = ["1/40", "1/8", "0.6", "1.3", "3.2"];
const STEPS: usize = ANGLES_DEG.len() * EXPOSURES.len();
const PARK_DEG: f64 = -7.5;
/// Frames before the first, a middle and the last one.
const FRAMES: [usize; 3] = [0, 4, STEPS - 1];
/// Kinds of operations that a fault can strike.
const MOMENTS: [Moment; 4] = [Moment::Setting, Moment::Release, Moment::Transfer, Moment::Polling];

/// Frames are what is looked at here.
struct NoProcessing;

impl Processing for NoProcessing {
    fn least_exposures(&self) -> usize {
        1
    }
    fn develop(&mut self, _: &Bracket) -> Result<Value, String> {
        Ok(Value::Null)
    }
    fn judge(&mut self, _: &StepJob) -> Result<Judged, String> {
        Err("no calibration here".into())
    }
    fn meter(&mut self, _: &OpenBracket) -> Result<Next, String> {
        Err("no adaptive session here".into())
    }
    fn weigh(&mut self, _: &FitJob, _: OnProgress<'_>) -> Result<Weighed, String> {
        Err("no adaptive session here".into())
    }
    fn fit(&mut self, _: &FitJob, _: OnProgress<'_>) -> Result<Value, String> {
        Ok(json!({}))
    }
}

fn small() -> Rig {
    let mut rig = shipped();
    (rig.camera.width, rig.camera.height) = (144, 96);
    (rig.camera.focal_px, rig.camera.principal_px) = ([1650.0; 2], [72.0, 48.0]);
    rig.arm.park_deg = PARK_DEG;
    rig.lamp.soak_s = 1.0;
    rig
}

/// A fault that a test can bring about, and how often it strikes.
#[derive(Clone, Copy, Debug)]
enum Trouble {
    Camera(Fault, u32),
    /// Of a camera on USB.
    Usb(Fault, u32),
    /// Its USB link drops, and opening it again fails with this result so many times.
    Unopenable(i32, u32),
    /// It vanishes from the USB bus for good.
    Gone,
    /// Name and what it does.
    Arm(&'static str, fn(&ArmFaults)),
    /// Its cable is pulled for good.
    Unplugged,
}

/// Everything the list names, where it can strike.
fn troubles() -> Vec<Trouble> {
    let slow = Duration::from_millis(2600);
    let mut all = Vec::new();
    for moment in MOMENTS {
        all.push(Trouble::Camera(Fault::Busy(moment), 1));
        all.push(Trouble::Camera(Fault::Slow(moment, slow), 1));
        all.push(Trouble::Camera(Fault::LinkDrop(moment), 1));
        all.push(Trouble::Camera(Fault::Silent(moment), 1));
    }
    for moment in [Moment::Setting, Moment::Release] {
        all.push(Trouble::Camera(Fault::Hang(moment), 1));
        all.push(Trouble::Camera(Fault::ChangedPort(moment), 1));
        all.push(Trouble::Camera(Fault::Busy(moment), 4));
    }
    all.push(Trouble::Camera(Fault::IgnoredSetting, 4));
    all.push(Trouble::Camera(Fault::WrongFile, 1));
    all.push(Trouble::Camera(Fault::LateFile(Duration::from_millis(700)), 1));
    all.push(Trouble::Camera(Fault::Duplicate, 1));
    all.push(Trouble::Camera(Fault::CardFull, 1));
    all.push(Trouble::Camera(Fault::CardFull, 1000));
    all.push(Trouble::Camera(Fault::TruncatedTransfer, 1));
    all.push(Trouble::Camera(Fault::TruncatedTransfer, 1000));
    all.push(Trouble::Arm("reboot", ArmFaults::reboot));
    all.push(Trouble::Unplugged);
    all.push(Trouble::Arm("noise", |arm| arm.noise(300)));
    all.push(Trouble::Arm("lost answers", |arm| arm.drop_answers(2)));
    all.push(Trouble::Arm("garbled answers", |arm| arm.garble_answers(2)));
    all
}

/// What USB shows at an operation of this kind. The longest first.
fn usb_troubles_at(moment: Moment) -> Vec<Trouble> {
    let once = [
        Fault::UsbNoReturn(moment),
        Fault::UsbHalt(moment),
        Fault::UsbShortResponse(moment),
        Fault::LinkDrop(moment),
        Fault::ChangedPort(moment),
        // GP_ERROR_IO, _TIMEOUT, _IO_READ, _IO_USB_FIND, and _IO_WRITE, after which libgphoto2 tries once more.
        Fault::UsbRead(moment, -7),
        Fault::UsbRead(moment, -10),
        Fault::UsbRead(moment, -34),
        Fault::UsbRead(moment, -52),
        Fault::UsbWrite(moment, -7),
        Fault::UsbWrite(moment, -10),
        Fault::UsbWrite(moment, -35),
    ];
    let twice = Trouble::Usb(Fault::UsbWrite(moment, -35), 2);
    once.into_iter().map(|fault| Trouble::Usb(fault, 1)).chain([twice]).collect()
}

/// What USB shows only at some operation or at none.
fn usb_troubles_apart() -> Vec<Trouble> {
    vec![
        // libgphoto2 waits 20 s for what is missing.
        Trouble::Usb(Fault::UsbShortData(Moment::Transfer), 1),
        Trouble::Usb(Fault::Silent(Moment::Release), 1),
        // GP_ERROR_IO_USB_CLAIM and _FIND while it is opened again: once, and for good.
        Trouble::Unopenable(-53, 1),
        Trouble::Unopenable(-53, 1000),
        Trouble::Unopenable(-52, 1),
        Trouble::Unopenable(-52, 1000),
        Trouble::Gone,
    ]
}

/// Told before anything moves or shines.
#[test]
fn a_card_without_room_refuses_a_session() {
    let rigged = Rigged::new(small(), Box::new(NoProcessing), Cable::PtpIp);
    rigged.camera.inject(Fault::CardFull, 1000);
    let ended = rigged.run(&StartRequest::default());
    let reason = ended.reason.unwrap_or_default();
    assert!(reason.contains("takes 0 more shots") && reason.contains("needs 70"), "{:?}: {reason}", ended.state);
    assert_eq!((ended.state, ended.frames_committed), (SessionState::Failed, 0));
    assert_eq!(rigged.pose.get().lamp_permille, 0);
}

/// A session of two stations during which `trouble` strikes once `frames` frames are committed.
fn survive(trouble: Trouble, frames: usize) {
    let on_usb = matches!(trouble, Trouble::Usb(..) | Trouble::Unopenable(..) | Trouble::Gone);
    let cable = if on_usb { Cable::Usb } else { Cable::PtpIp };
    let rigged = Rigged::new(small(), Box::new(NoProcessing), cable);
    let request = StartRequest {
        stations_deg: Some(ANGLES_DEG.to_vec()),
        exposures: Some(EXPOSURES.map(str::to_owned).to_vec()),
        ..StartRequest::default()
    };
    let id = rigged.engine.start(&request, None).unwrap().snapshot.id;
    let begin = Instant::now();
    let there = |now: &SessionSnapshot| now.state == SessionState::Running && now.frames_committed >= frames;
    while let now = rigged.engine.session(&id).unwrap()
        && !there(&now)
    {
        assert!(!now.state.is_final(), "{trouble:?}: the session ended before its fault: {:?}", now.reason);
        assert!(begin.elapsed() < Duration::from_secs(300), "{trouble:?}: frame {frames} never came");
        std::thread::sleep(Duration::from_millis(2));
    }
    match trouble {
        Trouble::Camera(fault, times) | Trouble::Usb(fault, times) => {
            rigged.camera.inject(fault, times);
            if matches!(fault, Fault::Silent(_) | Fault::Hang(_)) {
                // Somebody switches the body off and on in the end.
                let faults = rigged.camera.clone();
                std::thread::spawn(move || {
                    std::thread::sleep(Duration::from_secs(8));
                    faults.release();
                });
            }
        }
        Trouble::Unopenable(result, times) => {
            rigged.camera.inject(Fault::UsbOpen(result), times);
            rigged.camera.inject(Fault::LinkDrop(Moment::Any), 1);
        }
        Trouble::Gone => rigged.usb().bus.unplug(0),
        Trouble::Arm(name, strike) => {
            println!("arm: {name}");
            strike(&rigged.arm);
        }
        Trouble::Unplugged => rigged.unplug_arm(),
    }
    let ended = rigged.ended(&id);
    let told = format!("{trouble:?} after {frames} frames: {:?} ({:?})", ended.state, ended.reason);
    println!("{told}, {:.1} s", begin.elapsed().as_secs_f64());
    assert!(matches!(ended.state, SessionState::Completed | SessionState::Interrupted), "{told}");
    if ended.state == SessionState::Completed {
        assert_eq!(ended.frames_committed, STEPS, "{told}");
    } else {
        assert!(ended.frames_committed >= frames, "{told}: frames were lost");
    }
    if matches!(trouble, Trouble::Usb(..)) && frames < EXPOSURES.len() {
        // The second station has every kind of operation once more.
        assert!(rigged.camera.all_struck(), "{told}: the fault never struck");
    }
    if on_usb {
        let hosts = rigged.usb().hosts();
        assert!(hosts.len() <= 1, "{told}: workers were left behind: {hosts:?}");
    }
    // A board that hears nobody any more makes itself safe: its dead-man.
    let dark = Instant::now() + Duration::from_millis(u64::from(DEAD_MAN_MS) + 2000);
    while rigged.pose.get().lamp_permille != 0 {
        assert!(Instant::now() < dark, "{told}: the lamp is on");
        std::thread::sleep(Duration::from_millis(20));
    }
    let pose = rigged.pose.get();
    if !matches!(trouble, Trouble::Unplugged) {
        assert!((pose.angle_deg - PARK_DEG).abs() < 0.1, "{told}: not parked but at {}", pose.angle_deg);
    }
    every_frame_is_right(&rigged, &id, &told);
}

/// Each frame that counts shows what the planned light and time give: compared with a picture taken in peace.
fn every_frame_is_right(rigged: &Rigged, id: &str, told: &str) {
    let pose = SharedPose::default();
    let mut simulation = rigged.truth.simulation.clone().unwrap();
    simulation.speed = f64::INFINITY;
    let mut peace = SimulatedCamera::new(&rigged.truth, &simulation, pose.clone(), CameraFaults::default());
    let mut last: BTreeMap<(usize, usize), (Value, String)> = BTreeMap::new();
    for frame in rigged.events(id, "frame.committed") {
        let place = (frame["station"].as_u64().unwrap() as usize, frame["exposure"].as_u64().unwrap() as usize);
        // A station that is shot again, because the arm failed, begins anew: its frames of before count no more.
        last.retain(|former, (bracket, _)| former.0 != place.0 || *bracket == frame["bracket"]);
        last.insert(place, (frame["bracket"].clone(), frame["file"].as_str().unwrap().to_owned()));
    }
    assert_eq!(last.len(), rigged.engine.session(id).unwrap().frames_committed, "{told}");
    for ((station, exposure), (_, file)) in last {
        pose.set(Pose { angle_deg: ANGLES_DEG[station], lamp_permille: rigged.truth.lamp.level_permille });
        let shutter = Shutter::from_label(EXPOSURES[exposure]).unwrap();
        let camera = &rigged.truth.camera;
        let shot = Shot { station, exposure, shutter, f_number: camera.f_number, iso: camera.iso };
        let expected = peace.shoot(&shot, &Cancel::default()).unwrap();
        let bytes = std::fs::read(rigged.directory(id).join("frames").join(&file)).unwrap();
        let difference = mean_difference(&decode(&bytes).unwrap(), &decode(&expected.bytes).unwrap());
        // Noise of two frames is below one level on average; another exposure or light is at least ten away somewhere bright.
        assert!(difference < 1.0, "{told}: {file} is {difference:.2} levels from what was planned");
    }
}

fn mean_difference(a: &Image<[u8; 3]>, b: &Image<[u8; 3]>) -> f64 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let of = |(a, b): (&[u8; 3], &[u8; 3])| (0..3).map(|c| f64::from(a[c].abs_diff(b[c]))).sum::<f64>();
    a.pixels.iter().zip(&b.pixels).map(of).sum::<f64>() / (3 * a.pixels.len()) as f64
}

/// Sessions at one time: they mostly wait. libgphoto2 gives a PTP/IP camera 2 s, which many sessions at once might use up.
const TOGETHER: usize = 6;
const TOGETHER_ON_USB: usize = 6;

/// Survives them all, some at a time.
fn survive_all(cases: Vec<(Trouble, usize)>, together: usize) {
    // The tests of this file side by side would be too many for a simulated arm to answer in time.
    static ALONE: Mutex<()> = Mutex::new(());
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..together {
            scope.spawn(|| {
                while let Some((trouble, frames)) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    survive(*trouble, *frames);
                }
            });
        }
    });
    println!("{} combinations", cases.len());
}

#[test]
fn every_fault_once() {
    let cases = troubles().into_iter().enumerate().map(|(i, trouble)| (trouble, 1 + i % 9)).collect();
    survive_all(cases, TOGETHER);
}

/// At frames and kinds of operations that differ.
#[test]
fn every_fault_of_usb_once() {
    let at = (0..usb_troubles_at(Moment::Any).len()).map(|kind| usb_troubles_at(MOMENTS[kind % MOMENTS.len()])[kind]);
    let cases = at.chain(usb_troubles_apart()).enumerate().map(|(i, trouble)| (trouble, FRAMES[i % FRAMES.len()]));
    survive_all(cases.collect(), TOGETHER_ON_USB);
}

#[test]
#[ignore = "seven minutes on a quiet machine: cargo test -p camera-worker --test fault_matrix -- --ignored --nocapture"]
fn every_fault_at_every_step() {
    let cases: Vec<(Trouble, usize)> =
        troubles().into_iter().flat_map(|trouble| (0..STEPS).map(move |frames| (trouble, frames))).collect();
    assert!(cases.len() >= 300, "only {} combinations", cases.len());
    survive_all(cases, TOGETHER);
}

#[test]
#[ignore = "minutes: cargo test -p camera-worker --test fault_matrix usb_at_every_step -- --ignored --nocapture"]
fn every_fault_of_usb_at_every_step() {
    let troubles = MOMENTS.into_iter().flat_map(usb_troubles_at).chain(usb_troubles_apart());
    let cases = troubles.flat_map(|trouble| (0..STEPS).map(move |frames| (trouble, frames))).collect();
    survive_all(cases, TOGETHER_ON_USB);
}
