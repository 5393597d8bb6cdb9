//! Messages to people: each once, to every target, whatever the targets do, and no session waits for one.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod receiver;
mod support;

use jiff::Timestamp;
use receiver::Receiver;
use rigd::devices::arm::ArmError;
use rigd::notify::{Notifier, Patience, Target};
use rigd::session::handle::{EngineHandle, QueueRequest};
use rigd::session::state::SessionState as S;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Duration;
use support::{Act, Fakes, begin, rig, until, wait_for};

/// Longer than any test, so that only what is asserted can end a wait.
const LONG: Duration = Duration::from_secs(600);

fn patience() -> Patience {
    Patience {
        answer: LONG,
        again: vec![Duration::from_millis(5); 2],
        queue: 16,
        look: Duration::from_millis(2),
        end: Duration::from_secs(20),
    }
}

fn webhook(receiver: &Receiver) -> Target {
    Target::Webhook(Target::address(&format!("{}/hook?key=s3cret", receiver.address)).unwrap())
}

fn tell(engine: &EngineHandle, targets: Vec<Target>, patience: Patience) -> Notifier {
    Notifier::start(engine.clone(), "fake rig", targets, Timestamp::now(), patience).unwrap()
}

fn counts(notifier: &Notifier) -> Vec<(&'static str, u64, u64)> {
    notifier.counts().iter().map(|count| (count.target, count.sent(), count.failed())).collect()
}

/// A program in place of sendmail: keeps its arguments and what it is told, then does as `then` says.
fn mail_program(folder: &Path, then: &str) -> PathBuf {
    let (program, kept) = (folder.join("sendmail"), folder.join("mail").display().to_string());
    std::fs::write(
        &program,
        format!("#!/bin/sh\n{{ echo \"$@\"; cat; }} > {kept}.part\nmv {kept}.part {kept}\n{then}\n"),
    )
    .unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    program
}

fn completed(engine: &EngineHandle) -> String {
    let id = begin(engine);
    wait_for(engine, &id, S::Completed);
    id
}

#[test]
fn a_completed_session_is_told_to_everyone_once() {
    let (fakes, folder) = (Fakes::default(), tempfile::tempdir().unwrap());
    let engine = fakes.engine(&folder.path().join("data"));
    let (hook, topic) = (Receiver::start(|_| Some(200)), Receiver::start(|_| Some(202)));
    let before = completed(&engine);
    let targets = vec![
        webhook(&hook),
        Target::Ntfy(Target::address(&topic.address).unwrap()),
        Target::Mail { to: "night@example.org".into(), sendmail: mail_program(folder.path(), "exit 0") },
    ];
    let notifier = tell(&engine, targets, patience());
    let id = completed(&engine);
    until("the messages", || counts(&notifier) == [("webhook", 1, 0), ("ntfy", 1, 0), ("mail", 1, 0)]);
    notifier.end();

    let told = hook.got();
    assert_eq!(told.len(), 1, "{told:?}");
    assert_eq!(told[0].line, "POST /hook?key=s3cret HTTP/1.1");
    assert_eq!(told[0].header("content-type"), Some("application/json"));
    let body = told[0].json();
    assert_eq!((&body["event"], &body["rig"]), (&"completed".into(), &"fake rig".into()));
    assert_eq!(body["session"]["id"], id.as_str());
    assert_ne!(id, before, "the session that had ended before is no news");
    assert_eq!(body["text"], "fake rig, 6 of 6 frames, mean relative error 4.00 %");

    let told = topic.got();
    assert_eq!((told.len(), told[0].body.as_str()), (1, body["text"].as_str().unwrap()));
    assert_eq!(told[0].header("title"), Some("rigd: session completed"));

    let mail = std::fs::read_to_string(folder.path().join("mail")).unwrap();
    let (arguments, mail) = mail.split_once('\n').unwrap();
    assert_eq!(arguments, "-i night@example.org");
    let (head, text) = mail.split_once("\n\n").unwrap();
    assert!(head.contains("To: night@example.org\n") && head.contains("Subject: rigd: session completed\n"), "{head}");
    assert!(text.contains("4.00 %") && text.contains(&id), "{text}");
}

#[test]
fn a_failure_a_lamp_that_stays_on_and_a_full_disk_are_told() {
    let (fakes, folder) = (Fakes::default(), tempfile::tempdir().unwrap());
    let engine = fakes.engine(folder.path());
    let hook = Receiver::start(|_| Some(200));
    let notifier = tell(&engine, vec![webhook(&hook)], patience());
    let events = || {
        let mut events: Vec<String> =
            hook.got().iter().map(|told| told.json()["event"].as_str().unwrap().to_owned()).collect();
        events.sort();
        events
    };

    let disk = fakes.disk.clone();
    fakes.on_shot(move |_, count, _| {
        if count == 2 {
            disk.free.store(1200, Ordering::SeqCst);
        }
        Act::Good
    });
    let id = begin(&engine);
    until("the message", || events() == ["no_room"]);
    assert!(hook.got()[0].json()["text"].as_str().unwrap().contains("1200 are free"), "{:?}", hook.got());
    fakes.disk.free.store(u64::MAX, Ordering::SeqCst);
    wait_for(&engine, &id, S::Completed);
    until("the messages", || events() == ["completed", "no_room"]);

    // An arm that is gone before it answered once, and stays away.
    fakes.on_arm(|call, _| (call == "open").then_some(ArmError::NoAnswer { what: "a handshake", waited_s: 1.0 }));
    let id = begin(&engine);
    wait_for(&engine, &id, S::Failed);
    until("the messages", || events() == ["completed", "failed", "lamp_fault", "no_room"]);
    let lamp = hook.got().into_iter().find(|told| told.json()["event"] == "lamp_fault").unwrap().json();
    assert!(lamp["text"].as_str().unwrap().contains("switch the lamp's supply off"), "{lamp}");
    fakes.on_arm(|_, _| None);
    until("the lamp", || engine.lamp_fault().is_none());

    fakes.disk.free.store(10, Ordering::SeqCst);
    engine.enqueue(&QueueRequest::default()).unwrap();
    until("the messages", || events() == ["completed", "failed", "lamp_fault", "no_room", "queue_stands"]);
    notifier.end();
}

#[test]
fn the_daemons_end_is_told_before_it_ends_and_not_again_by_the_next() {
    let (fakes, folder) = (Fakes::default(), tempfile::tempdir().unwrap());
    let hook = Receiver::start(|_| Some(200));
    let mut rig = rig();
    rig.storage.resume_at_start = false;
    let gate = fakes.gate_at(2);
    let engine = fakes.try_engine(folder.path(), rig.clone()).unwrap();
    let notifier = tell(&engine, vec![webhook(&hook)], patience());
    let id = begin(&engine);
    gate.reached();
    let ending = engine.clone();
    let end = std::thread::spawn(move || ending.shutdown());
    gate.open();
    end.join().unwrap().unwrap();
    notifier.end();
    let told = hook.got();
    assert_eq!(told.len(), 1, "{told:?}");
    assert_eq!(
        (&told[0].json()["event"], &told[0].json()["session"]["id"]),
        (&"interrupted".into(), &id.clone().into())
    );

    // The next daemon finds it as it was.
    fakes.on_shot(|_, _, _| Act::Good);
    let engine = fakes.try_engine(folder.path(), rig).unwrap();
    assert_eq!(engine.session(&id).unwrap().state, S::Interrupted);
    let notifier = tell(&engine, vec![webhook(&hook)], patience());
    completed(&engine);
    let told = hook.wait_for(2);
    notifier.end();
    assert_eq!((told.len(), &told[1].json()["event"]), (2, &"completed".into()));
}

#[test]
fn errors_are_tried_again_and_given_up_in_the_end() {
    let (fakes, folder) = (Fakes::default(), tempfile::tempdir().unwrap());
    let engine = fakes.engine(&folder.path().join("data"));
    let (late, never) =
        (Receiver::start(|number| Some(if number < 2 { 500 } else { 200 })), Receiver::start(|_| Some(500)));
    // Nothing listens on the port of `discard`.
    let nobody = Target::Ntfy(Target::address("http://127.0.0.1:9/topic").unwrap());
    let moved = Receiver::start(|_| Some(301));
    let refusing = Target::Mail { to: "a@b".into(), sendmail: mail_program(folder.path(), "exit 75") };
    let targets = vec![webhook(&late), webhook(&never), nobody, webhook(&moved), refusing];
    let notifier = tell(&engine, targets, patience());
    completed(&engine);
    let want = [("webhook", 1, 0), ("webhook", 0, 1), ("ntfy", 0, 1), ("webhook", 0, 1), ("mail", 0, 1)];
    until("the ends of all", || counts(&notifier) == want);
    notifier.end();
    assert_eq!((late.got().len(), never.got().len(), moved.got().len()), (3, 3, 3));
}

/// The first session's message hangs while two more sessions are shot to their ends.
#[test]
fn a_target_that_hangs_holds_up_neither_sessions_nor_other_targets() {
    let (fakes, folder) = (Fakes::default(), tempfile::tempdir().unwrap());
    let engine = fakes.engine(folder.path());
    let (hanging, well) = (Receiver::start(|_| None), Receiver::start(|_| Some(200)));
    let targets = vec![webhook(&hanging), webhook(&well)];
    let notifier = tell(&engine, targets, Patience { queue: 1, end: Duration::from_millis(50), ..patience() });
    completed(&engine);
    hanging.wait_for(1);
    for sessions in 2..=3 {
        completed(&engine);
        well.wait_for(sessions);
    }
    // The second waits behind the first, the third found the queue full.
    until("the third to be given up", || counts(&notifier) == [("webhook", 0, 1), ("webhook", 3, 0)]);
    assert_eq!(hanging.got().len(), 1);
    // The end of the daemon does not wait for it either.
    notifier.end();
}

#[test]
fn a_silent_target_and_a_program_that_does_not_end_meet_their_deadline() {
    let (fakes, folder) = (Fakes::default(), tempfile::tempdir().unwrap());
    let engine = fakes.engine(&folder.path().join("data"));
    let silent = Receiver::start(|_| None);
    let sleeping = Target::Mail { to: "a@b".into(), sendmail: mail_program(folder.path(), "exec sleep 600") };
    let patience = Patience { answer: Duration::from_millis(100), again: Vec::new(), ..patience() };
    let notifier = tell(&engine, vec![webhook(&silent), sleeping], patience);
    completed(&engine);
    until("both to be given up", || counts(&notifier) == [("webhook", 0, 1), ("mail", 0, 1)]);
    notifier.end();
}
