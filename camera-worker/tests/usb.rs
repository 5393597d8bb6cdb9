//! The worker with the distribution's libgphoto2 and the simulated body on USB.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod support;

use camera_messages::labels::ImageFormat;
use camera_messages::message::{Driver, Reply, Request};
use simulated_eos::{BodyOptions, PictureKind, Release};
use support::usb::Usb;
use support::{Worker, body, expected, server, shot};

fn worker_on(usb: &Usb) -> Worker {
    let mut worker = Worker::with(&usb.environment());
    worker.greet();
    worker
}

#[test]
fn it_finds_the_camera_by_itself() {
    let usb = Usb::new(vec![body(BodyOptions { serial: "0456102345".into(), ..BodyOptions::default() })]);
    let mut worker = worker_on(&usb);
    let identity = worker.open_at(None);
    assert_eq!(identity.model, "Canon EOS 5D Mark II");
    assert_eq!((identity.driver, identity.port.as_str()), (Driver::Ptp2, "usb:001,005"));
    assert_eq!(identity.serial.as_deref(), Some("0456102345"));
    assert_eq!(worker.ask(Request::Close).0, Reply::Closed);
    assert_eq!(worker.open_at(Some("usb:001,005".into())), identity);
}

#[test]
fn its_bracket_is_byte_for_byte_that_of_ptp_ip() {
    for release in [Release::Buttons, Release::Command] {
        let options = BodyOptions { release, ..BodyOptions::default() };
        let (usb, server) = (Usb::new(vec![body(options.clone())]), server(options));
        let (mut over_usb, mut over_ip) = (worker_on(&usb), Worker::on(&server).0);
        over_usb.open_at(None);
        for (frame, label) in (1..).zip(["1/100", "1/50", "1/25", "1/10", "1/5", "0.4", "1", "2.5", "6", "15"]) {
            let taken = over_usb.shoot(shot(label, ImageFormat::Jpeg));
            assert_eq!(taken, over_ip.shoot(shot(label, ImageFormat::Jpeg)));
            assert_eq!(taken.0[0].1, expected(frame, label, "5.6", 100, PictureKind::Jpeg));
        }
        let raw = over_usb.shoot(shot("1/8", ImageFormat::RawAndJpeg));
        assert_eq!(raw, over_ip.shoot(shot("1/8", ImageFormat::RawAndJpeg)));
        assert!(over_usb.end().success());
    }
}
