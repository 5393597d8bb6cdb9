//! The worker with the distribution's libgphoto2 against the simulated body: what works.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod support;

use camera_messages::labels::ImageFormat;
use camera_messages::message::{Driver, HandleState, PROTOCOL, Reply, Request, ShutterWish, Step};
use simulated_eos::{BodyOptions, PictureKind, Release};
use support::{Worker, expected, server, shot};

#[test]
fn it_says_what_camera_it_is_and_what_can_be_set() {
    let server = server(BodyOptions { serial: "0456102345".into(), ..BodyOptions::default() });
    let (_worker, identity) = Worker::on(&server);
    assert_eq!(identity.model, "Canon EOS 5D Mark II");
    assert_eq!((identity.driver, identity.port), (Driver::Ptp2, server.gphoto2_port()));
    assert_eq!(identity.serial.as_deref(), Some("0456102345"));
    let thirds: Vec<i32> = identity.shutters.iter().map(|shutter| shutter.thirds).collect();
    assert_eq!(thirds, (-39..=15).rev().collect::<Vec<_>>());
    assert_eq!(identity.apertures.iter().find(|aperture| aperture.f_number == 5.6).unwrap().label, "5.6");
    assert_eq!((identity.isos[0].iso, identity.isos.len()), (100, 19));
    assert_eq!(identity.formats.len(), 3);
    assert_eq!(identity.targets, ["Internal RAM", "Memory card"]);
    assert_eq!((identity.available_shots, identity.battery.as_deref()), (Some(500), Some("100%")));
}

#[test]
fn a_bracket_of_ten_shots_is_taken_as_asked() {
    for release in [Release::Buttons, Release::Command] {
        let server = server(BodyOptions { release, ..BodyOptions::default() });
        let (mut worker, _) = Worker::on(&server);
        let bracket = ["1/100", "1/50", "1/25", "1/10", "1/5", "0.4", "1", "2.5", "6", "15"];
        for (frame, label) in (1..).zip(bracket) {
            let (files, read_back) = worker.shoot(shot(label, ImageFormat::Jpeg));
            let [(entry, bytes)] = files.try_into().unwrap();
            assert_eq!(entry.place.name, format!("IMG_{frame:04}.JPG"));
            assert_eq!(entry.place.folder, "/store_00020001/DCIM/100EOS5D");
            assert_eq!(bytes, expected(frame, label, "5.6", 100, PictureKind::Jpeg));
            assert_eq!(read_back.shutter, if label == "6" { "6.3" } else { label });
        }
        assert_eq!(worker.ask(Request::Close).0, Reply::Closed);
        assert!(worker.end().success());
    }
}

#[test]
fn raw_and_jpeg_come_both_and_all_settings_are_made() {
    let server = server(BodyOptions::default());
    let (mut worker, _) = Worker::on(&server);
    let mut wanted = shot("1/8", ImageFormat::RawAndJpeg);
    wanted.shutter = ShutterWish::Thirds(12);
    (wanted.f_number, wanted.iso) = (8.0, 400);
    let (files, read_back) = worker.shoot(wanted);
    let names: Vec<&str> = files.iter().map(|(entry, _)| entry.place.name.as_str()).collect();
    assert_eq!(names, ["IMG_0001.CR2", "IMG_0001.JPG"]);
    assert_eq!(files[0].1, expected(1, "15", "8", 400, PictureKind::Raw));
    assert_eq!(files[1].1, expected(1, "15", "8", 400, PictureKind::Jpeg));
    assert_eq!((read_back.aperture.as_deref(), read_back.iso.as_str()), (Some("8"), "400"));
    let (files, _) = worker.shoot(shot("1/8", ImageFormat::Raw));
    assert_eq!(files.len(), 1);
    assert_eq!(files[0].1, expected(2, "1/8", "5.6", 100, PictureKind::Raw));
}

#[test]
fn what_the_camera_does_not_offer_is_refused_before_it_is_touched() {
    let server = server(BodyOptions::default());
    let (mut worker, _) = Worker::on(&server);
    let good = shot("1/8", ImageFormat::Jpeg);
    let mut wrongs = vec![shot("bulb", ImageFormat::Jpeg), shot("1/16000", ImageFormat::Jpeg)];
    wrongs.push(camera_messages::message::Shot { f_number: 1.4, ..good.clone() });
    wrongs.push(camera_messages::message::Shot { iso: 12800, ..good.clone() });
    for wrong in wrongs {
        let failure = worker.fail(Request::Shoot(wrong));
        assert_eq!((failure.step, failure.handle), (Step::Set, HandleState::Ready), "{failure}");
    }
    let reset = worker.fail(Request::Reset);
    assert_eq!((reset.step, reset.handle), (Step::Reset, HandleState::Ready));
    assert_eq!(worker.shoot(good).0[0].0.place.name, "IMG_0001.JPG");
}

#[test]
fn it_keeps_the_camera_awake_between_shots() {
    let server = server(BodyOptions::default());
    let (mut worker, _) = Worker::on(&server);
    assert_eq!(worker.ask(Request::Idle { seconds: 0.3 }).0, Reply::Idle { unexpected: vec![] });
    for seconds in [-1.0, 3601.0, 1e300] {
        assert_eq!(worker.fail(Request::Idle { seconds }).handle, HandleState::Ready);
    }
    worker.shoot(shot("1/8", ImageFormat::Jpeg));
}

#[test]
fn it_wants_to_be_greeted_in_its_own_version() {
    let mut worker = Worker::start();
    assert_eq!(worker.fail(Request::Close).step, Step::Handshake);
    let (reply, _) = worker.ask(Request::Hello { protocol: PROTOCOL + 1 });
    assert!(matches!(reply, Reply::Hello { protocol: PROTOCOL, .. }));
    assert_eq!(worker.fail(Request::Close).step, Step::Handshake);
    worker.greet();
    assert_eq!(worker.fail(Request::Shoot(shot("1", ImageFormat::Raw))).handle, HandleState::Dead, "nothing is open");
    assert_eq!(worker.ask(Request::Close).0, Reply::Closed);
    worker.send_bytes(&[0xff; 40]);
    assert!(!worker.end().success());
}
