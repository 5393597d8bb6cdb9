//! The daemon's driver with its worker and the simulated body on USB: deadlines, and bodies found by their serial numbers.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod support;

use camera_messages::message::Request;
use rig_config::Shutter;
use rigd::devices::Cancel;
use rigd::devices::camera::{Camera, CameraError, Shot};
use rigd::devices::gphoto2::{Gphoto2Camera, Gphoto2Settings, KnownBody, Worker, WorkerCommand, WorkerError};
use simulated_eos::{BodyOptions, Fault, Moment, PictureKind};
use std::time::{Duration, Instant};
use support::usb::Usb;
use support::{body, expected};
use tempfile::TempDir;

/// How much later than at its deadline a call may end.
const MARGIN: Duration = Duration::from_secs(2);

/// A driver for bodies with these serial numbers, whose first is meant.
struct Bench {
    usb: Usb,
    settings: Gphoto2Settings,
    _home: TempDir,
}

impl Bench {
    fn new(serials: &[&str]) -> Self {
        let options = |serial: &&str| BodyOptions { serial: (*serial).to_owned(), ..BodyOptions::default() };
        let usb = Usb::new(serials.iter().map(|serial| body(options(serial))).collect());
        let home = tempfile::tempdir().unwrap();
        let worker = WorkerCommand {
            program: env!("CARGO_BIN_EXE_camera-worker").into(),
            home: home.path().into(),
            environment: usb.environment(),
        };
        let settings = Gphoto2Settings { worker, model: None, port: Some(usb.port()), body: KnownBody::default() };
        Self { usb, settings, _home: home }
    }

    fn open(&self) -> Result<Gphoto2Camera, CameraError> {
        Gphoto2Camera::open(self.settings.clone(), &Cancel::default())
    }
}

fn shoot(camera: &mut Gphoto2Camera) -> Result<String, CameraError> {
    let shutter = Shutter::from_label("1/100").unwrap();
    let shot = Shot { station: 0, exposure: 0, shutter, f_number: 5.6, iso: 100 };
    camera.shoot(&shot, &Cancel::default()).map(|frame| String::from_utf8(frame.bytes).unwrap())
}

fn frame(number: u32) -> String {
    expected(number, "1/100", "5.6", 100, PictureKind::Jpeg)
}

/// A call that hangs inside libgphoto2 ends with its process at the deadline, and the body is free for the next worker, which
/// only one host at a time can claim.
#[test]
fn a_call_that_never_returns_ends_at_its_deadline() {
    let hang = |moment| {
        let bench = Bench::new(&["1"]);
        let mut camera = bench.open().unwrap();
        assert_eq!(shoot(&mut camera).unwrap(), frame(1));
        bench.usb.faults().inject(Fault::UsbNoReturn(moment), 1);
        let begin = Instant::now();
        let error = shoot(&mut camera).unwrap_err();
        let took = begin.elapsed();
        let CameraError::Deadline { deadline_s, .. } = error else { panic!("{moment:?}: {error}") };
        let deadline = Duration::from_secs_f64(deadline_s);
        println!("{moment:?}: {took:.2?} of {deadline:.2?}");
        assert!(took >= deadline && took <= deadline + MARGIN, "{moment:?}: {took:?} of {deadline:?}");
        assert!(bench.usb.hosts().is_empty(), "{moment:?}: a worker was left behind");
        let mut camera = bench.open().unwrap();
        // The hanging shot may have opened the shutter.
        let next = shoot(&mut camera).unwrap();
        assert!(next == frame(2) || next == frame(3), "{moment:?}: {}", next.lines().next().unwrap());
    };
    std::thread::scope(|scope| {
        for moment in [Moment::Setting, Moment::Release, Moment::Polling, Moment::Transfer] {
            scope.spawn(move || hang(moment));
        }
        scope.spawn(opening_hangs);
    });
}

fn opening_hangs() {
    let bench = Bench::new(&["1"]);
    bench.usb.faults().inject(Fault::UsbNoReturn(Moment::Any), 1);
    let mut worker = Worker::start(&bench.settings.worker, &|| false).unwrap();
    let open = Request::Open { model: None, port: None, serial: None };
    let deadline = Duration::from_secs_f64(open.deadline_s());
    let begin = Instant::now();
    let error = worker.call(open, &|| false).unwrap_err();
    let took = begin.elapsed();
    println!("opening: {took:.2?} of {deadline:.2?}");
    assert!(matches!(error, WorkerError::Deadline(_)), "{error}");
    assert!(took >= deadline && took <= deadline + MARGIN, "{took:?}");
    assert!(bench.usb.hosts().is_empty(), "a worker was left behind");
    assert_eq!(shoot(&mut bench.open().unwrap()).unwrap(), frame(1));
}

#[test]
fn a_body_under_another_number_is_found_by_its_serial_number() {
    let bench = Bench::new(&["1"]);
    let mut camera = bench.open().unwrap();
    bench.usb.faults().inject(Fault::ChangedPort(Moment::Release), 1);
    let error = shoot(&mut camera).unwrap_err();
    assert!(matches!(error, CameraError::Unusable { .. }), "{error}");
    assert_eq!(bench.usb.port(), "usb:001,006");
    let mut camera = bench.open().unwrap();
    assert_eq!(camera.offers().port, "usb:001,006");
    assert_eq!(shoot(&mut camera).unwrap(), frame(2));
}

/// Where the body was, there is another one now.
#[test]
fn another_body_at_the_former_port_is_not_taken_for_it() {
    let bench = Bench::new(&["1", "2"]);
    let mut camera = bench.open().unwrap();
    assert_eq!(shoot(&mut camera).unwrap(), frame(1));
    bench.usb.bus.plug(0, 9);
    bench.usb.bus.plug(1, 5);
    let error = shoot(&mut camera).unwrap_err();
    assert!(matches!(error, CameraError::Unusable { .. }), "{error}");
    let mut camera = bench.open().unwrap();
    assert_eq!((camera.offers().port.as_str(), camera.offers().serial.as_deref()), ("usb:001,009", Some("1")));
    assert_eq!(shoot(&mut camera).unwrap(), frame(2));
    drop(camera);
    bench.usb.bus.unplug(0);
    let error = bench.open().err().unwrap().to_string();
    assert!(error.contains("no camera has the serial number 1, but 2 at usb:001,005"), "{error}");
}

/// What a result code of the port means for the camera, and that it can be opened anew.
#[test]
fn result_codes_of_the_port_are_told_in_words() {
    let bench = Bench::new(&["1"]);
    for (result, told) in
        [(-53, "another program holds it"), (-52, "it is not at this port"), (-7, "the connection failed")]
    {
        bench.usb.faults().inject(Fault::UsbOpen(result), 1);
        let error = bench.open().err().unwrap().to_string();
        assert!(error.contains(told), "{result}: {error}");
    }
    let mut camera = bench.open().unwrap();
    let setting = Moment::Setting;
    for (fault, told) in [
        (Fault::UsbWrite(setting, -7), "the connection failed"),
        (Fault::UsbWrite(setting, -10), "the connection failed"),
        (Fault::UsbWrite(setting, -52), "it is not at this port"),
        (Fault::UsbRead(setting, -7), "the connection failed"),
        (Fault::UsbRead(setting, -10), "the connection failed"),
        // libgphoto2 2.5.30 makes an I/O error of every failure to read a response (camlibs/ptp2/usb.c, ptp_usb_getresp).
        (Fault::UsbRead(setting, -52), "the connection failed"),
    ] {
        bench.usb.faults().inject(fault, 1);
        let error = shoot(&mut camera).unwrap_err();
        assert!(matches!(error, CameraError::Unusable { .. }), "{fault:?}: {error}");
        assert!(error.to_string().contains(told), "{fault:?}: {error}");
        camera = bench.open().unwrap();
    }
    assert_eq!(shoot(&mut camera).unwrap(), frame(1));
}
