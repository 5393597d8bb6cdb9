//! The body over TCP, with packets written by hand.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod support;

use simulated_eos::{Body, BodyOptions, ExposureSettings, Picture, PictureKind, Release, Sensor, Server};
use std::io::Write;
use std::net::TcpStream;
use std::time::{Duration, Instant};
use support::{Host, TextSensor, added, expected, packet, read_packet, server, told, u32_at};

#[test]
fn a_shot_is_set_taken_announced_and_handed_over() {
    let server = server(BodyOptions::default());
    let mut host = Host::open(&server);
    let state = host.events();
    assert_eq!(told(&state, 0xd102), Some(0x6d));
    assert!(state.iter().any(|(code, payload)| *code == 0xc18a && u32_at(payload, 0) == 0xd102));
    assert_eq!(told(&state, 0xd11b), Some(500));
    assert_eq!(host.set(0xd102, 0x18), 0x2001);
    assert_eq!(host.set(0xd101, 0x38), 0x2001);
    assert_eq!(host.set(0xd103, 0x50), 0x2001);
    assert_eq!(told(&host.events(), 0xd102), Some(0x18));
    assert_eq!(host.press(), 0x2001);
    let events = host.events_until(0xc181);
    let [(handle, name)] = added(&events).try_into().unwrap();
    assert_eq!(name, "IMG_0001.JPG");
    assert_eq!(told(&events, 0xd11b), Some(499));
    let file = expected(1, "15", "8", 200, PictureKind::Jpeg);
    let (code, params, data) = host.operation(0x1009, &[handle]);
    assert_eq!((code, params, String::from_utf8(data).unwrap()), (0x2001, vec![file.len() as u32], file.clone()));
    let (_, _, part) = host.operation(0x101b, &[handle, 6, 10]);
    assert_eq!(part, &file.as_bytes()[6..16]);
    let (_, _, beyond) = host.operation(0x101b, &[handle, u32::MAX, u32::MAX]);
    assert_eq!(beyond, b"");
}

#[test]
fn raw_and_jpeg_are_two_files_of_one_number() {
    let server = server(BodyOptions::default());
    let mut host = Host::open(&server);
    let both: Vec<u8> = [2, 0x10, 6, 0, 4, 0x10, 1, 0, 3].iter().flat_map(|word: &u32| word.to_le_bytes()).collect();
    assert_eq!(host.set_bytes(0xd120, &both), 0x2001);
    host.events();
    host.press();
    let files = added(&host.events_until(0xc181));
    assert_eq!(files.iter().map(|(_, name)| name.as_str()).collect::<Vec<_>>(), ["IMG_0001.CR2", "IMG_0001.JPG"]);
    let (_, _, info) = host.operation(0x1008, &[files[0].0]);
    assert_eq!(info[4..6], [0x03, 0xb1]);
    let (_, _, raw) = host.operation(0x1009, &[files[0].0]);
    assert_eq!(String::from_utf8(raw).unwrap(), expected(1, "1/100", "5.6", 100, PictureKind::Raw));
}

#[test]
fn a_file_for_the_host_waits_in_memory_until_it_was_taken() {
    let server = server(BodyOptions::default());
    let mut host = Host::open(&server);
    host.set(0xd11c, 4);
    assert_eq!(told(&host.events(), 0xd11b), Some(0), "the host has not said what room it has");
    host.operation(0x911a, &[0x0fff_ffff, 0x1000, 1]);
    assert_eq!(told(&host.events(), 0xd11b), Some(1000));
    host.press();
    let events = host.events_until(0xc186);
    let handle = u32_at(&events.iter().find(|(code, _)| *code == 0xc186).unwrap().1, 0);
    let (_, _, data) = host.operation(0x101b, &[handle, 0, 1 << 20]);
    assert_eq!(String::from_utf8(data).unwrap(), expected(1, "1/100", "5.6", 100, PictureKind::Jpeg));
    assert_eq!(host.operation(0x9117, &[handle]).0, 0x2001);
    assert_eq!(host.operation(0x101b, &[handle, 0, 9]).0, 0x2009);
    let (_, params, _) = host.operation(0x1006, &[0xffff_ffff, 0x3801, 0]);
    assert_eq!(params, [0], "nothing is on the card");
}

#[test]
fn a_body_that_releases_by_command_says_how_it_went() {
    let options = BodyOptions { release: Release::Command, card_files: 1, ..BodyOptions::default() };
    let server = server(options);
    let mut host = Host::open(&server);
    assert_eq!(host.operation(0x9128, &[2, 0]).0, 0x2005);
    let (code, params, _) = host.operation(0x910f, &[]);
    assert_eq!((code, params), (0x2001, vec![0]));
    host.events_until(0xc181);
    let (code, params, _) = host.operation(0x910f, &[]);
    assert_eq!((code, params), (0x2001, vec![7]), "the card takes one file");
}

#[test]
fn an_exposure_lasts_its_true_time_and_the_body_is_busy_meanwhile() {
    let server = server(BodyOptions { speed: 20.0, ..BodyOptions::default() });
    let mut host = Host::open(&server);
    host.set(0xd102, 0x18);
    host.events();
    let begin = Instant::now();
    host.press();
    assert_eq!(host.press(), 0x2019);
    assert_eq!(host.set(0xd102, 0x6d), 0x2019);
    assert!(host.events().contains(&(0xc18b, vec![1, 0, 0, 0])));
    host.events_until(0xc181);
    // A dial of 15 is 16 s, here at twentyfold speed; a loaded machine only makes it longer.
    assert!(begin.elapsed() >= Duration::from_millis(800), "{:?}", begin.elapsed());
    assert_eq!(host.set(0xd102, 0x6d), 0x2001);
}

#[test]
fn a_press_on_the_body_makes_a_file_nobody_asked_for() {
    let server = server(BodyOptions { speed: f64::MIN_POSITIVE, ..BodyOptions::default() });
    assert!(server.press_shutter());
    assert!(!server.press_shutter(), "this exposure never ends");
    let server = support::server(BodyOptions::default());
    let mut host = Host::open(&server);
    host.events();
    assert!(server.press_shutter());
    assert_eq!(added(&host.events_until(0xc181)).remove(0).1, "IMG_0001.JPG");
}

#[test]
fn files_and_numbers_outlive_every_connection() {
    let server = server(BodyOptions::default());
    let (first, _) = Host::open(&server).shoot();
    let mut former = Host::open(&server);
    former.press();
    let mut host = Host::open(&server);
    assert_eq!(read_packet(&mut former.stream), None, "a new command connection ends the former one");
    let (_, name) = {
        let mut shot = host.press();
        while shot == 0x2019 {
            shot = host.press();
        }
        added(&host.events_until(0xc181)).pop().unwrap()
    };
    assert_eq!(name, "IMG_0003.JPG");
    let (_, params, _) = host.operation(0x1006, &[0xffff_ffff, 0x3801, 0]);
    assert_eq!(params, [3]);
    assert_eq!(host.operation(0x100b, &[first]).0, 0x2001);
    assert_eq!(host.operation(0x1009, &[first]).0, 0x2009);
}

#[test]
fn wrong_operations_are_answered_not_obeyed() {
    let server = server(BodyOptions::default());
    let mut host = Host::connect(&server);
    assert_eq!(host.operation(0x1001, &[]).0, 0x2001, "who it is, it says without a session");
    assert_eq!(host.operation(0x1004, &[]).0, 0x2003);
    assert_eq!(host.operation(0x1002, &[1]).0, 0x2001);
    assert_eq!(host.operation(0x9999, &[]).0, 0x2005);
    assert_eq!(host.operation(0x1005, &[77]).0, 0x2008);
    assert_eq!(host.operation(0x1007, &[77, 0, 0]).0, 0x2008);
    assert_eq!(host.operation(0x1008, &[]).0, 0x2009);
    assert_eq!(host.operation(0x1015, &[0xd101]).0, 0x200a);
    assert_eq!(host.set(0xd102, 0x3c), 0x201c);
    assert_eq!(host.operation(0x9110, &[]).0, 0x2006, "no data came");
    assert_eq!(host.operation(0x1003, &[]).0, 0x2001);
    assert_eq!(host.operation(0x1004, &[]).0, 0x2003);
}

#[test]
fn nonsense_ends_its_connection_and_nothing_else() {
    let server = server(BodyOptions::default());
    let wrongs: [Vec<u8>; 8] = [
        b"GET / HTTP/1.1\r\n\r\n".to_vec(),
        vec![0xff; 100],
        vec![0; 100],
        packet(6, &[1, 0, 0, 0]),
        packet(99, &[]),
        packet(12, &[0; 40]),
        [packet(1, &[]), packet(9, &[0xff; 12])].concat(),
        [packet(1, &[]), packet(6, &[2, 0, 0, 0, 0x10, 0x91, 1, 0, 0, 0]), packet(9, &[0xff; 12])].concat(),
    ];
    for wrong in wrongs {
        let mut stream = TcpStream::connect(("127.0.0.1", server.port())).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        stream.write_all(&wrong).unwrap();
        while read_packet(&mut stream).is_some() {}
    }
    Host::open(&server).shoot();
}

#[test]
fn an_event_connection_answers_pings() {
    let server = server(BodyOptions::default());
    let mut stream = TcpStream::connect(("127.0.0.1", server.port())).unwrap();
    stream.write_all(&packet(3, &[1, 0, 0, 0])).unwrap();
    assert_eq!(read_packet(&mut stream), Some((4, vec![])));
    stream.write_all(&packet(13, &[])).unwrap();
    assert_eq!(read_packet(&mut stream), Some((14, vec![])));
}

#[test]
fn a_server_that_is_dropped_ends_its_connections_and_frees_its_port() {
    let first = server(BodyOptions::default());
    let mut host = Host::open(&first);
    let port = first.port();
    drop(first);
    assert_eq!(read_packet(&mut host.stream), None);
    let body = Body::new(Box::new(TextSensor), BodyOptions::default()).unwrap();
    assert_eq!(Server::start(body, port).unwrap().port(), port);
}

#[test]
fn a_sensor_that_fails_makes_no_file_and_hangs_nobody() {
    struct Broken;
    impl Sensor for Broken {
        fn expose(&mut self, _settings: &ExposureSettings) -> Vec<Picture> {
            panic!("as planned")
        }
    }
    let server = Server::start(Body::new(Box::new(Broken), BodyOptions::default()).unwrap(), 0).unwrap();
    let mut host = Host::open(&server);
    host.events();
    assert_eq!(host.press(), 0x2001);
    let idle = (0xc18b, vec![0, 0, 0, 0]);
    while !host.events().contains(&idle) {}
    assert_eq!(host.press(), 0x2002);
}
