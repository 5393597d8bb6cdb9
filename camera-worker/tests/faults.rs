//! The worker against a body that misbehaves.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod support;

use camera_messages::labels::ImageFormat;
use camera_messages::message::{HandleState, Reply, Request, Step};
use simulated_eos::{Body, BodyOptions, Fault, Moment, PictureKind, Server};
use std::sync::mpsc::channel;
use std::time::Duration;
use support::{TextSensor, Worker, expected, server, shot};

fn jpeg(label: &str) -> camera_messages::message::Shot {
    shot(label, ImageFormat::Jpeg)
}

fn frame(number: u32, label: &str) -> String {
    expected(number, label, "5.6", 100, PictureKind::Jpeg)
}

/// A worker that has taken one picture, of the body that then shows `fault` once.
fn with(fault: Fault) -> (Server, Worker) {
    let server = server(BodyOptions::default());
    let (mut worker, _) = Worker::on(&server);
    assert_eq!(worker.shoot(jpeg("1/8")).0[0].1, frame(1, "1/8"));
    server.faults().inject(fault, 1);
    (server, worker)
}

#[test]
fn a_busy_camera_can_be_asked_again() {
    for moment in [Moment::Setting, Moment::Release] {
        let (_server, mut worker) = with(Fault::Busy(moment));
        let failure = worker.fail(Request::Shoot(jpeg("1/4")));
        assert_eq!(failure.handle, HandleState::Busy, "{failure}");
        let library = failure.library.as_ref().unwrap();
        assert_eq!((library.number, library.name.as_str()), (-110, "GP_ERROR_CAMERA_BUSY"));
        // Not in the number: the library's own words.
        assert!(library.context.as_ref().unwrap().contains("0x2019"), "{failure}");
        assert_eq!(worker.shoot(jpeg("1/4")).0[0].1, frame(2, "1/4"));
    }
}

/// The driver reads back its own memory. Only the file tells, and taking the picture again sets it again.
#[test]
fn an_ignored_setting_shows_in_the_file_alone() {
    let server = server(BodyOptions::default());
    let (mut worker, _) = Worker::on(&server);
    worker.shoot(jpeg("1/8"));
    server.faults().inject(Fault::IgnoredSetting, 4);
    let (files, read_back) = worker.shoot(jpeg("15"));
    assert_eq!(read_back.shutter, "15");
    assert_eq!(files[0].1, frame(2, "1/8"));
    assert_eq!(worker.shoot(jpeg("15")).0[0].1, frame(3, "15"));
}

#[test]
fn a_full_card_is_said_before_the_release() {
    let (server, mut worker) = with(Fault::CardFull);
    let failure = worker.fail(Request::Shoot(jpeg("1/4")));
    assert_eq!((failure.step, failure.handle), (Step::Capture, HandleState::Ready));
    assert!(failure.what.contains("card is full"), "{failure}");
    server.faults().clear();
    assert_eq!(worker.shoot(jpeg("1/4")).0[0].1, frame(2, "1/4"));
}

#[test]
fn a_picture_that_somebody_takes_at_the_body_is_not_taken_for_a_shots() {
    let server = server(BodyOptions::default());
    let (mut worker, _) = Worker::on(&server);
    worker.ask(Request::Idle { seconds: 0.1 });
    server.press_shutter();
    let mut unexpected = Vec::new();
    while unexpected.is_empty() {
        let Reply::Idle { unexpected: files } = worker.ask(Request::Idle { seconds: 0.1 }).0 else { panic!("no idle") };
        unexpected = files;
    }
    assert_eq!((unexpected.len(), unexpected[0].name.as_str()), (1, "IMG_0001.JPG"));
    server.press_shutter();
    let mut reply = worker.ask(Request::Shoot(jpeg("1/4")));
    while let Reply::Failed(failure) = &reply.0 {
        assert_eq!(failure.handle, HandleState::Busy, "{failure}");
        reply = worker.ask(Request::Shoot(jpeg("1/4")));
    }
    assert_eq!(String::from_utf8(reply.1).unwrap(), frame(3, "1/4"));
}

/// libgphoto2 left to itself would never come back from opening this body.
#[test]
fn a_body_with_a_full_card_can_be_opened() {
    let server = server(BodyOptions::default());
    server.faults().inject(Fault::CardFull, 1);
    let (_worker, identity) = Worker::on(&server);
    assert_eq!(identity.available_shots, Some(0));
}

#[test]
fn a_file_announced_twice_is_one_file_of_one_shot() {
    let (_server, mut worker) = with(Fault::Duplicate);
    for number in [2, 3] {
        let (files, _) = worker.shoot(jpeg("1/4"));
        assert_eq!(files.len(), 1);
        assert_eq!(files[0].1, frame(number, "1/4"));
    }
}

#[test]
fn a_late_file_is_waited_for() {
    let (_server, mut worker) = with(Fault::LateFile(Duration::from_millis(1500)));
    assert_eq!(worker.shoot(jpeg("1/4")).0[0].1, frame(2, "1/4"));
    assert_eq!(worker.shoot(jpeg("1/5")).0[0].1, frame(3, "1/5"));
}

#[test]
fn half_a_file_is_not_handed_over() {
    let (_server, mut worker) = with(Fault::TruncatedTransfer);
    let failure = worker.fail(Request::Shoot(jpeg("1/4")));
    assert_eq!((failure.step, failure.handle), (Step::Download, HandleState::Ready), "{failure}");
    assert_eq!(worker.shoot(jpeg("1/4")).0[0].1, frame(3, "1/4"));
}

#[test]
fn after_a_dropped_link_the_camera_is_dead_until_it_is_opened_anew() {
    for (moment, next) in [(Moment::Setting, 2), (Moment::Release, 3), (Moment::Transfer, 3), (Moment::Polling, 2)] {
        let (server, mut worker) = with(Fault::LinkDrop(moment));
        let failure = worker.fail(Request::Shoot(jpeg("1/4")));
        assert_eq!(failure.handle, HandleState::Dead, "{moment:?}: {failure}");
        assert!(failure.library.is_some(), "{moment:?}: {failure}");
        assert_eq!(worker.fail(Request::Shoot(jpeg("1/4"))).handle, HandleState::Dead, "{moment:?}");
        worker.open(&server);
        assert_eq!(worker.shoot(jpeg("1/4")).0[0].1, frame(next, "1/4"), "{moment:?}");
    }
}

#[test]
fn a_camera_that_comes_back_elsewhere_is_opened_there() {
    let (server, mut worker) = with(Fault::ChangedPort(Moment::Release));
    let former = server.port();
    assert_eq!(worker.fail(Request::Shoot(jpeg("1/4"))).handle, HandleState::Dead);
    while server.port() == former {
        std::thread::yield_now();
    }
    worker.open(&server);
    assert_eq!(worker.shoot(jpeg("1/4")).0[0].1, frame(3, "1/4"));
}

#[test]
fn a_camera_that_answers_no_more_is_dead_until_it_is_switched_off_and_on() {
    let (server, mut worker) = with(Fault::Hang(Moment::Release));
    assert_eq!(worker.fail(Request::Shoot(jpeg("1/4"))).handle, HandleState::Dead);
    let open = Request::Open { model: None, port: Some(server.gphoto2_port()), serial: None };
    let failure = worker.fail(open);
    assert_eq!(failure.handle, HandleState::Dead);
    server.faults().release();
    worker.open(&server);
    assert_eq!(worker.shoot(jpeg("1/4")).0[0].1, frame(2, "1/4"));
}

#[test]
fn a_worker_killed_in_mid_exposure_is_replaced_and_its_picture_is_not_taken_for_the_next_ones() {
    let (opened, shutter) = channel();
    let options = BodyOptions { speed: 16.0, ..BodyOptions::default() };
    let server = Server::start(Body::new(Box::new(TextSensor(Some(opened))), options).unwrap(), 0).unwrap();
    let (mut worker, _) = Worker::on(&server);
    worker.send(Request::Shoot(jpeg("15")));
    assert_eq!(shutter.recv().unwrap(), 1);
    worker.child.kill().unwrap();
    assert_eq!(worker.reply(), None);
    let (mut worker, _) = Worker::on(&server);
    let mut reply = worker.ask(Request::Shoot(jpeg("1/4")));
    while let Reply::Failed(failure) = &reply.0 {
        assert_eq!(failure.handle, HandleState::Busy, "{failure}");
        reply = worker.ask(Request::Shoot(jpeg("1/4")));
    }
    assert_eq!(String::from_utf8(reply.1).unwrap(), frame(2, "1/4"));
}

#[test]
fn a_camera_that_is_not_there_is_said_in_words() {
    let mut worker = Worker::start();
    worker.greet();
    let nowhere = |model: Option<&str>| Request::Open {
        model: model.map(str::to_owned),
        port: Some("ptpip:127.0.0.1:1:1".into()),
        serial: None,
    };
    let failure = worker.fail(nowhere(None));
    assert_eq!(failure.handle, HandleState::Dead);
    assert!(failure.library.is_some() && failure.what.contains("connection failed"), "{failure}");
    let failure = worker.fail(nowhere(Some("Canon EOS 5D Mark IIII")));
    assert_eq!((failure.step, failure.handle), (Step::Open, HandleState::Dead));
    assert_eq!(failure.library.as_ref().unwrap().name, "GP_ERROR_MODEL_NOT_FOUND");
    assert!(failure.what.contains("does not know this model"), "{failure}");
    let failure = worker.fail(Request::Open { model: Some("Canon EOS 5D Mark IIII".into()), port: None, serial: None });
    assert!(failure.what.contains("no camera was found"), "{failure}");
}
