//! The daemon's HTTP surface from outside: the real binary, a real socket, the simulated rig.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod daemon;

use daemon::{Answer, Daemon};
use serde_json::{Value, json};
use std::io::{Read, Write};

const OBJ: (&str, &str) = ("content-type", "model/obj");
const JSON: (&str, &str) = ("content-type", "application/json");
/// A plan of six frames, which the simulated rig shoots in a moment; fewer than three exposures give no response.
const SMALL: &str = r#"{"stations_deg": [-20, 15], "exposures": ["1/20", "1/40", "1/100"]}"#;

fn assert_problem(answer: &Answer, status: u16, path: &str) {
    assert_eq!(answer.status, status, "{path}: {}", answer.text);
    assert_eq!(answer.header("content-type"), Some("application/problem+json"), "{path}");
    let body = answer.json();
    assert_eq!(body["status"], status, "{path}");
    assert_eq!(body["instance"], path);
    for key in ["type", "title", "detail"] {
        assert!(body[key].as_str().is_some_and(|text| !text.is_empty()), "{path}: no {key} in {body}");
    }
}

#[test]
fn every_refusal_is_a_problem() {
    let daemon = Daemon::start();
    let nobody = "/v1/sessions/01a208e9-cbda-76fb-b465-63318274b666";
    let large = format!(r#"{{"name": "{}"}}"#, "x".repeat(70_000));
    type Case<'a> = (&'a str, &'a str, &'a [(&'a str, &'a str)], &'a str, u16);
    let cases: &[Case] = &[
        ("GET", "/nowhere", &[], "", 404),
        ("DELETE", "/livez", &[], "", 405),
        ("PUT", "/v1/sessions", &[], "", 405),
        ("GET", "/livez", &[("host", "rebound.example")], "", 421),
        ("GET", "/v1/sessions?page_token=x", &[], "", 400),
        ("GET", "/v1/sessions?max_page_size=0", &[], "", 400),
        ("GET", "/v1/sessions?max_page_size=many", &[], "", 400),
        ("GET", "/v1/sessions?pagetoken=x", &[], "", 400),
        ("GET", "/v1/sessions/none", &[], "", 404),
        ("GET", "/v1/sessions/..%2f..%2fetc%2fpasswd", &[], "", 404),
        ("GET", "/v1/sessions/%ff", &[], "", 400),
        ("GET", nobody, &[], "", 404),
        ("POST", "/v1/sessions", &[], SMALL, 415),
        ("POST", "/v1/sessions", &[JSON], "{", 400),
        ("POST", "/v1/sessions", &[JSON], "[]", 422),
        ("POST", "/v1/sessions", &[JSON], r#"{"stations": "all"}"#, 422),
        ("POST", "/v1/sessions", &[JSON], r#"{"stations_deg": ["a"]}"#, 422),
        ("POST", "/v1/sessions", &[JSON], &large, 413),
        ("POST", "/v1/sessions?dryrun=true", &[JSON], SMALL, 400),
        ("POST", "/v1/sessions?dry_run=yes", &[JSON], SMALL, 400),
        ("POST", "/v1/sessions", &[JSON, ("idempotency-key", "")], SMALL, 400),
        ("POST", "/v1/sessions", &[JSON], r#"{"stations_deg": [900, -900], "exposures": ["1/90"]}"#, 422),
        ("POST", "/v1/sessions", &[JSON], r#"{"exposures": ["1/20", "1/100"]}"#, 422),
        ("POST", "/v1/meshes", &[], "v 0 0 0", 415),
        ("POST", "/v1/meshes", &[JSON], "{}", 415),
        ("POST", "/v1/meshes?format=obj", &[OBJ], "v 0 0 0", 400),
        ("POST", "/v1/meshes", &[OBJ], "v 0 0 0", 422),
        ("POST", "/v1/meshes", &[("content-type", "model/gltf-binary")], "glTF", 422),
        ("GET", "/v1/meshes/teapot", &[], "", 404),
    ];
    for (method, target, headers, body, status) in cases {
        let answer = daemon.call(method, target, headers, body);
        assert_problem(&answer, *status, target.split('?').next().unwrap());
        assert_eq!(answer.header("allow").is_some(), *status == 405, "{target}: Allow");
    }
    for rest in [
        "/fit",
        "/verify",
        "/plan",
        "/events",
        "/frames",
        "/frames/000-00.jpg",
        "/material",
        "/result/preview.png",
        "/texture",
        "/response",
        "/lights",
        "/surface",
        "/surface/0",
    ] {
        assert_problem(&daemon.get(&format!("{nobody}{rest}")), 404, &format!("{nobody}{rest}"));
    }
    for verb in ["pause", "resume", "stop", "abort", "verify"] {
        let path = format!("{nobody}/{verb}");
        assert_problem(&daemon.call("POST", &path, &[], ""), 404, &path);
    }
    let reasons =
        daemon.call("POST", "/v1/sessions", &[JSON], r#"{"stations_deg": [900, -900], "exposures": ["1/90"]}"#).json();
    assert_eq!(reasons["reasons"].as_array().map(Vec::len), Some(3), "each mistake is a reason: {reasons}");
    assert_eq!(daemon.get("/v1/sessions").json()["sessions"], json!([]), "no refused request left a session behind");
}

/// The document is 3.1, its references resolve, every operation says how it refuses, and what needs no input answers as declared.
#[test]
fn the_openapi_document_is_true_to_the_daemon() {
    let daemon = Daemon::start();
    let spec = daemon.get("/openapi.json").json();
    assert!(spec["openapi"].as_str().unwrap().starts_with("3.1"));
    for reference in references(&spec) {
        assert!(spec.pointer(reference.trim_start_matches('#')).is_some(), "{reference} leads nowhere");
    }
    for (path, item) in spec["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap() {
            let responses = operation["responses"].as_object().unwrap();
            for (status, response) in responses.iter().filter(|(status, _)| status.as_str() >= "400") {
                let body = &response["content"]["application/problem+json"]["schema"]["$ref"];
                assert_eq!(body, "#/components/schemas/Problem", "{method} {path} {status}");
            }
            if method == "get" && !path.contains('{') {
                let answer = daemon.get(path);
                let declared = &responses[&answer.status.to_string()]["content"];
                let kind = answer.header("content-type").unwrap();
                assert!(declared.get(kind).is_some(), "{path}: {kind} is not declared");
            }
        }
    }
    assert_eq!(spec["components"]["schemas"]["StartRequest"]["properties"]["stations_deg"]["items"]["maximum"], 170.0);
}

fn references(value: &Value) -> Vec<String> {
    match value {
        Value::Array(items) => items.iter().flat_map(references).collect(),
        Value::Object(fields) => {
            let own = fields.get("$ref").and_then(Value::as_str).map(str::to_owned);
            own.into_iter().chain(fields.values().flat_map(references)).collect()
        }
        _ => Vec::new(),
    }
}

#[test]
fn the_rig_is_taken_by_one_session_at_a_time() {
    let daemon = Daemon::start();
    let dry = daemon.call("POST", "/v1/sessions?dry_run=true", &[JSON], SMALL);
    assert_eq!((dry.status, &dry.json()["frames"]), (200, &json!(6)), "{}", dry.text);
    let key = ("idempotency-key", "one");
    let first = daemon.call("POST", "/v1/sessions", &[JSON, key], "{}");
    assert_eq!(first.status, 202, "{}", first.text);
    let location = first.header("location").unwrap().to_owned();
    let id = first.json()["id"].as_str().unwrap().to_owned();
    assert_eq!(location, format!("/v1/sessions/{id}"));
    let again = daemon.call("POST", "/v1/sessions", &[JSON, key], "{}");
    assert_eq!((again.status, again.header("location")), (202, Some(location.as_str())));
    assert_problem(&daemon.call("POST", "/v1/sessions", &[JSON, key], SMALL), 422, "/v1/sessions");
    let busy = daemon.call("POST", "/v1/sessions", &[JSON], SMALL);
    assert_problem(&busy, 409, "/v1/sessions");
    assert_eq!(busy.json()["running"], id.as_str());
    let none = daemon.get(&format!("{location}/material"));
    assert_problem(&none, 409, &format!("{location}/material"));
    assert!(none.json()["current_state"].is_string());

    assert_eq!(daemon.call("POST", &format!("{location}/abort"), &[], "").status, 202);
    daemon.wait_for_end(&location);
    assert_eq!(daemon.get(&location).json()["state"], "aborted");
    let wrong = daemon.call("POST", &format!("{location}/pause"), &[], "");
    assert_problem(&wrong, 409, &format!("{location}/pause"));
    assert_eq!((&wrong.json()["current_state"], &wrong.json()["allowed"]), (&json!("aborted"), &json!([])));
    let metrics = daemon.get("/metrics").text;
    assert!(metrics.contains(r#"rigd_sessions_total{state="aborted"} 1"#), "{metrics}");
    assert!(
        metrics.contains("rigd_build_info{") && metrics.ends_with("# EOF\n") && !metrics.contains(&id),
        "{metrics}"
    );
}

#[test]
fn a_reconnecting_client_misses_no_event() {
    let daemon = Daemon::start();
    let started = daemon.call("POST", "/v1/sessions", &[JSON], SMALL);
    let location = started.header("location").unwrap().to_owned();
    let events = format!("{location}/events");

    // A client that goes away in the middle of an event changes nothing.
    let mut rude = daemon.open(&events, &[]);
    let mut some = [0; 60];
    rude.read_exact(&mut some).unwrap();
    drop(rude);

    // One client takes three events a connection, another all in one.
    let (mut ids, mut connections) = (Vec::new(), 0);
    loop {
        let last = ids.last().map_or("0".to_owned(), u64::to_string);
        let (status, part) = daemon.events(&events, &[("last-event-id", &last)], 3);
        connections += 1;
        if status == 204 {
            break;
        }
        assert_eq!(status, 200);
        ids.extend(part);
    }
    assert!(connections > 1);
    let whole = daemon.events(&events, &[], usize::MAX).1;
    assert_eq!(ids, whole, "pieces and whole differ");
    assert_eq!(whole, (1..=whole.len() as u64).collect::<Vec<_>>(), "ids are the journal's");
    assert_eq!(daemon.get(&location).json()["last_seq"], json!(whole.len()));
    assert_eq!(daemon.events(&format!("{events}?after=2"), &[], usize::MAX).1, whole[2..]);
    assert_eq!(daemon.events(&format!("{events}?after=2"), &[("last-event-id", "4")], usize::MAX).1, whole[4..]);

    for (target, headers) in [
        (events.clone(), vec![("last-event-id", "x")]),
        (events.clone(), vec![("last-event-id", "-1")]),
        (events.clone(), vec![("last-event-id", "99999999999999999999")]),
        (format!("{events}?after=x"), vec![]),
        (format!("{events}?afetr=1"), vec![]),
    ] {
        assert_problem(&daemon.call("GET", &target, &headers, ""), 400, &events);
    }
    let frames = daemon.get(&format!("{location}/frames")).json();
    let shot: Vec<_> = frames["frames"].as_array().unwrap().iter().map(|f| (&f["station"], &f["exposure"])).collect();
    assert_eq!(json!(shot), json!([[0, 0], [0, 1], [0, 2], [1, 0], [1, 1], [1, 2]]), "{frames}");

    let planned = daemon.get(&format!("{location}/plan")).json();
    assert_eq!(planned, daemon.call("POST", "/v1/sessions?dry_run=true", &[JSON], SMALL).json());
    for frame in frames["frames"].as_array().unwrap() {
        let mut answer = Vec::new();
        let path = format!("{location}/frames/{}", frame["file"].as_str().unwrap());
        daemon.open(&path, &[]).read_to_end(&mut answer).unwrap();
        let body = answer.windows(4).position(|four| four == b"\r\n\r\n").unwrap() + 4;
        assert!(String::from_utf8_lossy(&answer[..body]).to_lowercase().contains("content-type: image/jpeg"));
        assert_eq!(frame["blake3"], blake3::hash(&answer[body..]).to_hex().as_str(), "{path}");
    }
    assert_problem(
        &daemon.get(&format!("{location}/frames/009-00.jpg")),
        404,
        &format!("{location}/frames/009-00.jpg"),
    );
}

#[test]
fn an_open_stream_does_not_keep_the_daemon_from_ending() {
    let mut daemon = Daemon::start();
    let started = daemon.call("POST", "/v1/sessions", &[JSON], "{}");
    let location = started.header("location").unwrap().to_owned();
    let mut stream = daemon.open(&format!("{location}/events"), &[]);
    stream.read_exact(&mut [0; 20]).unwrap();
    assert!(daemon.terminate().success());
    let mut rest = Vec::new();
    stream.read_to_end(&mut rest).unwrap();
    assert!(rest.ends_with(b"0\r\n\r\n"), "the stream ends in order: {}", String::from_utf8_lossy(&rest));
}

#[test]
fn the_list_is_paged() {
    let daemon = Daemon::start();
    let mut want = Vec::new();
    for _ in 0..3 {
        let started = daemon.call("POST", "/v1/sessions", &[JSON], SMALL);
        assert_eq!(started.status, 202, "{}", started.text);
        let location = started.header("location").unwrap().to_owned();
        daemon.call("POST", &format!("{location}/abort"), &[], "");
        daemon.wait_for_end(&location);
        want.insert(0, started.json()["id"].clone());
    }
    let first = daemon.get("/v1/sessions?max_page_size=2").json();
    let token = first["next_page_token"].as_str().unwrap();
    let second = daemon.get(&format!("/v1/sessions?max_page_size=2&page_token={token}")).json();
    assert!(second.get("next_page_token").is_none());
    let pages = [&first, &second].into_iter().flat_map(|page| page["sessions"].as_array().unwrap());
    assert_eq!(pages.map(|s| s["id"].clone()).collect::<Vec<_>>(), want);
}

#[test]
fn the_lamp_and_its_hours_are_told() {
    let daemon = Daemon::start();
    let lamp = || daemon.get("/v1/rig").json()["lamp"].clone();
    assert_eq!(lamp(), json!({"lit": false, "hours": 0.0, "rated_hours": null}));
    assert!(daemon.get("/metrics").text.contains("\nrigd_lamp_hours 0.0\n"));
    let running = || daemon.get("/v1/rig").json()["running"].clone();
    assert_eq!(running(), Value::Null);
    let started = daemon.call("POST", "/v1/sessions", &[JSON], SMALL);
    assert_eq!(started.status, 202);
    let wait = |lit: bool| {
        let end = std::time::Instant::now() + std::time::Duration::from_secs(60);
        while lamp()["lit"] != lit {
            assert!(std::time::Instant::now() < end, "waited in vain for lit = {lit}");
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
    };
    wait(true);
    assert_eq!(running(), started.json()["id"]);
    wait(false);
    let hours = lamp()["hours"].as_f64().unwrap();
    assert!(hours > 0.0);
    let metrics = daemon.get("/metrics").text;
    let told = metrics.lines().find_map(|line| line.strip_prefix("rigd_lamp_hours ")).unwrap();
    assert_eq!(told.parse(), Ok(hours));
    daemon.wait_for_end(started.header("location").unwrap());
    assert_eq!(running(), Value::Null);
}

/// The page comes from the daemon alone: its parts are served, and nothing in them names another machine.
#[test]
fn the_page_needs_no_other_machine() {
    let daemon = Daemon::start();
    for path in daemon::parts_of_the_page() {
        let kind = match path.rsplit_once('.') {
            Some((_, "js")) => "text/javascript",
            Some((_, "css")) => "text/css",
            Some((_, "svg")) => "image/svg+xml",
            Some((_, "glsl")) => "text/plain",
            _ => "text/html",
        };
        let answer = daemon.get(&path);
        assert_eq!(answer.status, 200, "{path}");
        assert!(answer.header("content-type").unwrap().starts_with(kind), "{path}");
        assert!(answer.header("content-security-policy").unwrap().contains("default-src 'self'"));
        let elsewhere = answer.text.replace("http://www.w3.org/2000/svg", "").contains("://");
        assert!(!elsewhere, "{path} names another machine");
    }
}

/// A request cut off or never finished gets no panic and takes no other client's answer.
#[test]
fn broken_connections_hurt_nobody_else() {
    let daemon = Daemon::start();
    for bytes in [
        &b"GET"[..],
        b"POST /v1/sessions HTTP/1.1\r\nhost: localhost\r\ncontent-length: 10\r\n\r\n{",
        b"\0\xff\r\n\r\n",
        b"\r\n",
    ] {
        let mut socket = daemon.connect();
        socket.write_all(bytes).unwrap();
        drop(socket);
        assert_eq!(daemon.get("/livez").status, 200);
    }
}
