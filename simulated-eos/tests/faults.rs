//! Every fault, seen by a host that writes its packets by hand.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod support;

use simulated_eos::{BodyOptions, Fault, Moment, PictureKind, Server};
use std::time::{Duration, Instant};
use support::{Host, added, expected, read_packet, server, told};

/// A host with its first events read, and the server with `fault` asked for `times` times.
fn with(fault: Fault, times: u32) -> (Server, Host) {
    let server = server(BodyOptions::default());
    let mut host = Host::open(&server);
    host.events();
    server.faults().inject(fault, times);
    (server, host)
}

fn frame(number: u32) -> String {
    expected(number, "1/100", "5.6", 100, PictureKind::Jpeg)
}

fn wait_for_strike(server: &Server) {
    while !server.faults().all_struck() {
        std::thread::yield_now();
    }
}

#[test]
fn busy_concerns_what_it_was_asked_for() {
    let (server, mut host) = with(Fault::Busy(Moment::Release), 2);
    assert_eq!(host.set(0xd102, 0x18), 0x2001);
    assert_eq!([host.press(), host.press(), host.press()], [0x2019, 0x2019, 0x2001]);
    assert!(server.faults().all_struck());
}

#[test]
fn an_ignored_setting_is_acknowledged_and_the_picture_is_taken_without_it() {
    let (_server, mut host) = with(Fault::IgnoredSetting, 1);
    assert_eq!(host.set(0xd102, 0x18), 0x2001);
    assert_eq!(told(&host.events(), 0xd102), None);
    let (handle, _) = host.shoot();
    assert_eq!(String::from_utf8(host.operation(0x1009, &[handle]).2).unwrap(), frame(1));
    assert_eq!(host.set(0xd102, 0x18), 0x2001);
    assert_eq!(told(&host.events(), 0xd102), Some(0x18));
}

#[test]
fn a_wrong_file_is_an_earlier_ones() {
    let (server, mut host) = with(Fault::WrongFile, 1);
    let (first, _) = host.shoot();
    assert_eq!(String::from_utf8(host.operation(0x1009, &[first]).2).unwrap(), frame(1), "there is no earlier one");
    assert!(!server.faults().all_struck());
    let (second, name) = host.shoot();
    assert_eq!(name, "IMG_0002.JPG");
    assert_eq!(String::from_utf8(host.operation(0x1009, &[second]).2).unwrap(), frame(1));
    let (third, _) = host.shoot();
    assert_eq!(String::from_utf8(host.operation(0x1009, &[third]).2).unwrap(), frame(3));
}

#[test]
fn a_late_file_is_announced_after_the_body_is_ready() {
    let late = Duration::from_millis(300);
    let (_server, mut host) = with(Fault::LateFile(late), 1);
    host.press();
    let mut events = Vec::new();
    while !events.contains(&(0xc18b, vec![0, 0, 0, 0])) {
        events.extend(host.events());
    }
    let ready = Instant::now();
    assert_eq!(added(&events), []);
    assert_eq!(added(&host.events_until(0xc181)).len(), 1);
    assert!(ready.elapsed() > late / 2, "{:?}", ready.elapsed());
}

#[test]
fn a_duplicate_is_one_file_announced_twice() {
    let (_server, mut host) = with(Fault::Duplicate, 1);
    host.press();
    let files = added(&host.events_until(0xc181));
    assert_eq!(files.len(), 2);
    assert_eq!(files[0], files[1]);
    assert_eq!(host.operation(0x1006, &[0xffff_ffff, 0x3801, 0]).1, [1]);
}

#[test]
fn a_full_card_offers_no_shots_and_takes_none() {
    let (_server, mut host) = with(Fault::CardFull, 2);
    assert_eq!(told(&host.events(), 0xd11b), Some(0));
    assert_eq!([host.press(), host.press()], [0x200c, 0x200c]);
    assert_eq!(told(&host.events(), 0xd11b), Some(500));
    assert_eq!(host.press(), 0x2001);
}

#[test]
fn a_truncated_transfer_looks_whole() {
    let (_server, mut host) = with(Fault::TruncatedTransfer, 1);
    let (handle, _) = host.shoot();
    let whole = frame(1);
    let (code, _, data) = host.operation(0x1009, &[handle]);
    assert_eq!((code, data.as_slice()), (0x2001, &whole.as_bytes()[..whole.len() / 2]));
    assert_eq!(host.operation(0x1009, &[handle]).2, whole.as_bytes());
}

#[test]
fn a_link_that_drops_at_the_release_leaves_the_picture_on_the_card() {
    let (server, mut host) = with(Fault::LinkDrop(Moment::Release), 1);
    host.send(0x9128, &[2, 0]);
    assert_eq!(host.answer(), None);
    let mut host = Host::open(&server);
    while host.operation(0x1006, &[0xffff_ffff, 0x3801, 0]).1 != [1] {}
    let (_, name) = host.shoot();
    assert_eq!(name, "IMG_0002.JPG");
}

#[test]
fn a_link_that_drops_in_a_transfer_leaves_half_a_file() {
    let (server, mut host) = with(Fault::LinkDrop(Moment::Transfer), 1);
    let (handle, _) = host.shoot();
    host.send(0x1009, &[handle]);
    let whole = frame(1);
    let (kind, start) = read_packet(&mut host.stream).unwrap();
    assert_eq!((kind, u64::from_le_bytes(start[4..12].try_into().unwrap())), (9, whole.len() as u64));
    let (kind, half) = read_packet(&mut host.stream).unwrap();
    assert_eq!((kind, &half[4..]), (10, &whole.as_bytes()[..whole.len() / 2]));
    assert_eq!(read_packet(&mut host.stream), None);
    assert_eq!(Host::open(&server).operation(0x1009, &[handle]).2, whole.as_bytes());
}

#[test]
fn a_changed_port_is_another_one_with_the_same_body() {
    let (server, mut host) = with(Fault::ChangedPort(Moment::Polling), 1);
    let former = server.port();
    host.send(0x9116, &[]);
    while read_packet(&mut host.stream).is_some() {}
    while server.port() == former {
        std::thread::yield_now();
    }
    assert!(std::net::TcpStream::connect(("127.0.0.1", former)).is_err());
    Host::open(&server).shoot();
}

#[test]
fn a_slow_answer_comes_late() {
    let (_server, mut host) = with(Fault::Slow(Moment::Any, Duration::from_millis(200)), 1);
    let begin = Instant::now();
    assert_eq!(host.operation(0x911d, &[]).0, 0x2001);
    assert!(begin.elapsed() >= Duration::from_millis(200));
}

#[test]
fn a_silent_operation_is_answered_on_release_and_others_are_not_kept_waiting() {
    let (server, mut host) = with(Fault::Silent(Moment::Polling), 1);
    host.send(0x9116, &[]);
    host.stream.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
    assert!(host.stream.peek(&mut [0]).is_err(), "it answered");
    wait_for_strike(&server);
    server.faults().release();
    host.stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    assert_eq!(host.answer().unwrap().0, 0x2001);
    server.faults().inject(Fault::Silent(Moment::Polling), 1);
    host.send(0x9116, &[]);
    Host::open(&server).shoot();
}

#[test]
fn a_hanging_body_answers_nobody_until_it_is_switched_off_and_on() {
    let (server, mut host) = with(Fault::Hang(Moment::Release), 1);
    host.send(0x9128, &[2, 0]);
    let mut other = std::net::TcpStream::connect(("127.0.0.1", server.port())).unwrap();
    std::io::Write::write_all(&mut other, &support::packet(1, &[])).unwrap();
    for stream in [&host.stream, &other] {
        stream.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
        assert!(stream.peek(&mut [0]).is_err(), "it answered");
    }
    wait_for_strike(&server);
    server.faults().release();
    for stream in [&mut host.stream, &mut other] {
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        assert_eq!(read_packet(stream), None);
    }
    let (_, name) = Host::open(&server).shoot();
    assert_eq!(name, "IMG_0001.JPG", "it hung before it released");
}
