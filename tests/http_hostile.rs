//! Hostile requests while a session runs: each is refused or its connection closed, and the session shoots on as if nobody had asked.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod daemon;

use daemon::{Daemon, shipped};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::time::Duration;

/// A test that hangs shall fail; no limit of the daemon's is as long.
const PATIENCE: Duration = Duration::from_secs(100);
/// More than the daemon takes at a time.
const MANY: usize = 600;
/// Time after which a connection that asks nothing more is closed.
const IDLE: Duration = Duration::from_secs(20);

/// What came back: a status, or the connection's end without one.
fn answer(socket: TcpStream) -> Option<u16> {
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut line = Vec::new();
    match BufReader::new(socket).read_until(b'\n', &mut line) {
        Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => panic!("no answer in {PATIENCE:?}"),
        _ => String::from_utf8_lossy(&line).split(' ').nth(1).and_then(|status| status.parse().ok()),
    }
}

fn send(daemon: &Daemon, bytes: &[u8]) -> Option<u16> {
    let mut socket = daemon.connect();
    // The daemon may have closed before the end of it.
    let _ = socket.write_all(bytes);
    answer(socket)
}

/// A POST with a JSON body and further headers.
fn post(path: &str, headers: &str, body: &[u8]) -> Vec<u8> {
    let length = body.len();
    let head = format!("POST {path} HTTP/1.1\r\nhost: localhost\r\ncontent-length: {length}\r\n{headers}\r\n");
    [head.as_bytes(), body].concat()
}

fn get(target: &str, headers: &str) -> Vec<u8> {
    format!("GET {target} HTTP/1.1\r\nhost: localhost\r\n{headers}\r\n").into_bytes()
}

const JSON: &str = "content-type: application/json\r\n";

/// Classes of requests, each with what may be answered; none stands for a closed connection.
type Class = (&'static str, Vec<Vec<u8>>, &'static [Option<u16>]);

fn sizes() -> Vec<Class> {
    let large = format!(r#"{{"name": "{}"}}"#, "x".repeat(200_000));
    let many: String = (0..200).map(|i| format!("x-{i}: y\r\n")).collect();
    let deep = |open: &str, close: &str| format!(r#"{{"name": {}1{}}}"#, open.repeat(20_000), close.repeat(20_000));
    vec![
        // Closed before all of it was sent, the answer may be lost on its way.
        ("oversized body", vec![post("/v1/sessions", JSON, large.as_bytes())], &[Some(413), None]),
        (
            "oversized headers",
            vec![
                get("/livez", &format!("x: {}\r\n", "y".repeat(100_000))),
                get("/livez", &many),
                get(&format!("/{}", "a".repeat(100_000)), ""),
                get(&format!("/v1/sessions?page_token={}", "a".repeat(100_000)), ""),
            ],
            &[Some(431), Some(414), None],
        ),
        (
            "deep JSON",
            vec![
                post("/v1/sessions", JSON, deep("[", "]").as_bytes()),
                post("/v1/sessions", JSON, deep(r#"{"a":"#, "}").as_bytes()),
            ],
            &[Some(400), Some(413)],
        ),
        (
            "huge numbers",
            vec![
                post("/v1/sessions", JSON, br#"{"stations_deg": [1e999]}"#),
                post("/v1/sessions", JSON, br#"{"stations_deg": [1e308, -1e308]}"#),
                post("/v1/sessions", JSON, format!(r#"{{"stations_deg": [{}]}}"#, "9".repeat(5000)).as_bytes()),
                get("/v1/sessions?max_page_size=99999999999999999999", ""),
            ],
            &[Some(400), Some(422)],
        ),
    ]
}

fn paths(session: &str) -> Vec<Class> {
    let of = |target: &str| get(&target.replace("ID", session), "");
    vec![
        (
            "path traversal in ids",
            [
                "/v1/sessions/..",
                "/v1/sessions/../../../etc/passwd",
                "/v1/sessions/..%2f..%2fetc%2fpasswd/frames",
                "/v1/sessions/%2e%2e",
            ]
            .map(of)
            .into(),
            &[Some(404), Some(400)],
        ),
        (
            "path traversal in files",
            [
                "/page.js/../../Cargo.toml",
                "/..%2fCargo.toml",
                "/../page.js",
                "/v1/sessions/ID/result/..%2fmanifest.json",
                "/v1/sessions/ID/frames/..%2fmanifest.json",
                "/v1/sessions/ID/frames/..%2f..%2f..%2f..%2fetc%2fpasswd",
                "/v1/sessions/ID/result/..%2f..%2f..%2f..%2fetc%2fpasswd",
                "/v1/sessions/ID/result//etc/passwd",
                "/v1/sessions/ID/result/manifest.json%00.png",
            ]
            .map(of)
            .into(),
            &[Some(404), Some(400)],
        ),
        (
            "encoded slashes",
            [
                "/v1%2fsessions",
                "/v1/sessions%2fID",
                "/v1/sessions/ID%2fframes",
                "/v1/sessions/%2f",
                "/%2flivez",
                "/v1/sessions/ID%5cframes",
            ]
            .map(of)
            .into(),
            &[Some(404)],
        ),
        ("bad UTF-8 in paths", ["/v1/sessions/%ff", "/v1/sessions/ID/result/%c3%28"].map(of).into(), &[Some(400)]),
    ]
}

fn headers(session: &str) -> Vec<Class> {
    let raw = |text: &str| text.replace('\n', "\r\n").into_bytes();
    let abort = format!("/v1/sessions/{session}/abort");
    let ranges = format!("range: bytes={}\r\n", vec!["0-"; 4000].join(","));
    vec![
        (
            "header abuse",
            vec![
                raw("GET /livez HTTP/1.1\nhost: localhost\nx y: z\n\n"),
                raw("GET /livez HTTP/1.1\nhost: localhost\n: z\n\n"),
                raw("GET /livez HTTP/1.1\nhost: localhost\nx: a\n folded\n\n"),
                b"GET /livez HTTP/1.1\r\nhost: localhost\r\nx: \x00\r\n\r\n".to_vec(),
                post("/v1/sessions", &format!("{JSON}idempotency-key: a b\r\n"), b"{}"),
                get(&format!("/v1/sessions/{session}/events"), "last-event-id: -1\r\n"),
            ],
            &[Some(400)],
        ),
        (
            "duplicate content-length",
            vec![
                raw("POST /v1/sessions HTTP/1.1\nhost: localhost\ncontent-length: 2\ncontent-length: 3\n\n{}x"),
                raw("POST /v1/sessions HTTP/1.1\nhost: localhost\ncontent-length: 2, 3\n\n{}x"),
                raw("POST /v1/sessions HTTP/1.1\nhost: localhost\ncontent-length: +2\n\n{}"),
                raw("POST /v1/sessions HTTP/1.1\nhost: localhost\ncontent-length: -1\n\n"),
            ],
            &[Some(400)],
        ),
        (
            "bad chunking",
            vec![
                raw(
                    "POST /v1/sessions HTTP/1.1\nhost: localhost\ncontent-type: application/json\ntransfer-encoding: chunked\n\nzz\n{}\n0\n\n",
                ),
                raw(
                    "POST /v1/sessions HTTP/1.1\nhost: localhost\ncontent-type: application/json\ntransfer-encoding: chunked\n\nffffffffffffffffff\n{}\n",
                ),
                raw("POST /v1/sessions HTTP/1.1\nhost: localhost\ntransfer-encoding: gzip\n\n{}"),
                raw(
                    "POST /v1/sessions HTTP/1.1\nhost: localhost\ncontent-type: application/json\ntransfer-encoding: chunked\ncontent-length: 2\n\n2\n[]\n0\n\n",
                ),
            ],
            &[Some(400), Some(422), None],
        ),
        (
            "wrong content types",
            [
                "",
                "content-type: text/plain\r\n",
                "content-type: application/x-www-form-urlencoded\r\n",
                "content-type: multipart/form-data\r\n",
                "content-type: application/jsonp\r\n",
            ]
            .map(|kind| post("/v1/sessions", kind, b"{}"))
            .into(),
            &[Some(415)],
        ),
        ("bad UTF-8 in bodies", vec![post("/v1/sessions", JSON, b"{\"name\": \"\xff\xfe\"}")], &[Some(400)]),
        (
            "Host header abuse",
            [
                "evil.example",
                "127.0.0.1.evil.example",
                "127.0.0.1@evil.example",
                "localhost\nhost: localhost",
                "",
                "127.0.0.1:7040:80",
            ]
            .map(|name| raw(&format!("GET /v1/rig HTTP/1.1\nhost: {name}\n\n")))
            .into_iter()
            .chain([
                raw("GET /v1/rig HTTP/1.1\n\n"),
                raw("GET http://evil.example/v1/rig HTTP/1.1\nhost: localhost\n\n"),
            ])
            .collect(),
            &[Some(400), Some(421)],
        ),
        (
            "cross-origin POST",
            ["http://evil.example", "http://localhost:1", "null", "https://localhost.evil.example"]
                .map(|origin| post(&abort, &format!("origin: {origin}\r\n"), b""))
                .into(),
            &[Some(403)],
        ),
        (
            "method override",
            ["x-http-method-override", "x-http-method", "x-method-override"]
                .map(|name| get(&abort, &format!("{name}: POST\r\n")))
                .into_iter()
                .chain([get(&format!("{abort}?_method=POST"), "")])
                .collect(),
            &[Some(405)],
        ),
        // No part of anything is ever served, so that no range can multiply it.
        (
            "Range abuse",
            vec![get(&format!("/v1/sessions/{session}/result/preview.png"), &ranges), get("/nowhere", &ranges)],
            &[Some(409), Some(404)],
        ),
        (
            "unknown methods",
            ["BREW", "PROPFIND", "TRACE", "get", "DELETE", "OPTIONS", "X-Y"]
                .map(|method| raw(&format!("{method} {abort} HTTP/1.1\nhost: localhost\n\n")))
                .into(),
            &[Some(405)],
        ),
        (
            "other protocols",
            vec![
                b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".to_vec(),
                b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03".repeat(20),
                raw("GET /livez HTTP/9.9\nhost: localhost\n\n"),
                b"\0\xff\r\n\r\n".to_vec(),
            ],
            &[Some(400), Some(505), None],
        ),
    ]
}

/// Requests that take their time; the daemon ends each by itself.
fn slow(daemon: &Daemon) -> Vec<(&'static str, TcpStream, &'static [Option<u16>])> {
    let begun = |bytes: &[u8]| {
        let mut socket = daemon.connect();
        socket.write_all(bytes).unwrap();
        socket
    };
    vec![
        ("slow headers", begun(b"GET /livez HTTP/1.1\r\nhost: loc"), &[None, Some(408)]),
        ("slow body", begun(&post("/v1/sessions", JSON, &[b' '; 2000])[..110]), &[Some(408)]),
    ]
}

/// One byte a moment keeps no connection open for longer than its limit; the bytes of a slow client go on until it is told.
fn trickle(mut socket: &TcpStream, byte: u8) {
    for _ in 0..400 {
        if socket.write_all(&[byte]).is_err() {
            return;
        }
        std::thread::sleep(Duration::from_millis(100));
    }
}

#[test]
fn a_session_goes_on_undisturbed_by_hostile_requests() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    // Long enough for the slow ones.
    let daemon = Daemon::start_with(folder, &shipped().replace("speed = 40.0", "speed = 8.0"), &data);
    let started = daemon.call("POST", "/v1/sessions", &[("content-type", "application/json")], "{}");
    assert_eq!(started.status, 202, "{}", started.text);
    let location = started.header("location").unwrap().to_owned();
    let session = location.rsplit('/').next().unwrap();
    let committed = || daemon.get(&location).json()["frames_committed"].as_u64().unwrap();
    let mut classes = 0;

    std::thread::scope(|scope| {
        for (class, socket, allowed) in slow(&daemon) {
            classes += 1;
            let writer = socket.try_clone().unwrap();
            scope.spawn(move || trickle(&writer, b'x'));
            scope.spawn(move || assert!(allowed.contains(&answer(socket)), "{class}"));
        }
        let before = committed();
        for (class, requests, allowed) in [sizes(), paths(session), headers(session)].into_iter().flatten() {
            classes += 1;
            for request in requests {
                let status = send(&daemon, &request);
                let shown = String::from_utf8_lossy(&request[..request.len().min(120)]).into_owned();
                assert!(allowed.contains(&status), "{class}: {status:?} to {shown}");
            }
        }
        classes += 2;
        half_open(&daemon);
        many_connections(&daemon);
        held_connections(&daemon);
        while committed() < before + 5 {
            std::thread::sleep(Duration::from_millis(50));
        }
    });
    assert!(classes >= 20, "{classes} classes");

    daemon.wait_for_end(&location);
    let ended = daemon.get(&location).json();
    assert_eq!((&ended["state"], &ended["frames_committed"]), (&"completed".into(), &70.into()), "{ended}");
    let journal = std::fs::read_to_string(daemon.directory(&location).join("journal.jsonl")).unwrap();
    for trouble in ["fault.raised", "frame.rejected"] {
        assert!(!journal.contains(trouble), "{trouble}");
    }
    assert_eq!(
        daemon.get("/v1/sessions").json()["sessions"].as_array().map(Vec::len),
        Some(1),
        "a request got through"
    );
}

/// Clients that stop talking in the middle, and say so or do not.
fn half_open(daemon: &Daemon) {
    for part in [&b"GET /livez HTTP/1.1\r\n"[..], b"", &post("/v1/sessions", JSON, b"{}")[..99]] {
        let mut socket = daemon.connect();
        socket.write_all(part).unwrap();
        socket.shutdown(Shutdown::Write).unwrap();
        let status = answer(socket);
        assert!(status.is_none_or(|status| (400..500).contains(&status)), "{status:?}");
    }
}

/// Clients that ask and hold their connections, more of them than are taken at a time: each is answered, and so would Stop be.
fn held_connections(daemon: &Daemon) {
    let held: Vec<TcpStream> = (0..MANY)
        .map(|number| {
            let mut socket = daemon.connect();
            socket.write_all(b"GET /livez HTTP/1.1\r\nhost: localhost\r\n\r\n").unwrap();
            socket.set_read_timeout(Some(IDLE / 2)).unwrap();
            let mut first = [0; 12];
            socket.read_exact(&mut first).unwrap_or_else(|error| panic!("connection {number}: {error}"));
            assert_eq!(&first, b"HTTP/1.1 200");
            socket
        })
        .collect();
    assert_eq!(daemon.get("/livez").status, 200);
    drop(held);
}

/// More connections than are taken at a time, silent and talking: once they are gone, everyone is served again.
fn many_connections(daemon: &Daemon) {
    let mut all: Vec<TcpStream> = (0..MANY).map(|_| daemon.connect()).collect();
    for socket in all.iter_mut().step_by(2) {
        socket.write_all(b"GET /livez HTTP/1.1\r\nhost: localhost\r\n\r\n").unwrap();
    }
    let mut first = [0; 12];
    all[0].set_read_timeout(Some(PATIENCE)).unwrap();
    all[0].read_exact(&mut first).unwrap();
    assert_eq!(&first, b"HTTP/1.1 200");
    drop(all);
    assert_eq!(daemon.get("/livez").status, 200);
}
