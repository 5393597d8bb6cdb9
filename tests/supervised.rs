//! The daemon under a service manager: what it tells it, and that the watchdog's pings end when a part of it hangs. Single threads are
//! frozen from outside, as a debugger does: the daemon has no switch for it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod daemon;

use daemon::{Daemon, shipped};
use nix::sys::ptrace;
use nix::sys::wait::{WaitPidFlag, waitpid};
use nix::unistd::Pid;
use std::net::TcpListener;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixDatagram;
use std::process::Stdio;
use std::time::Duration;

/// After this long without a ping systemd would end the daemon.
const WATCHDOG: Duration = Duration::from_secs(4);

/// A daemon, and the socket on which it talks to its manager.
struct Supervised {
    daemon: Daemon,
    manager: UnixDatagram,
}

impl Supervised {
    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (path, data) = (folder.path().join("notify"), folder.path().join("data"));
        let manager = UnixDatagram::bind(&path).unwrap();
        manager.set_read_timeout(Some(WATCHDOG)).unwrap();
        let daemon = Daemon::start_as(folder, shipped(), &data, |command| {
            command
                .args(["--listen", "127.0.0.1:0"])
                .env("NOTIFY_SOCKET", path)
                .env("WATCHDOG_USEC", WATCHDOG.as_micros().to_string())
        });
        Self { daemon, manager }
    }

    /// The next message; none when none comes before systemd's patience ends.
    fn next(&self) -> Option<String> {
        let mut bytes = [0; 4096];
        self.manager.recv(&mut bytes).ok().map(|length| String::from_utf8_lossy(&bytes[..length]).trim().to_owned())
    }

    fn assert_pings(&self, pings: usize, when: &str) {
        for _ in 0..pings {
            assert_eq!(self.next().as_deref(), Some("WATCHDOG=1"), "{when}");
        }
    }

    /// Threads of the daemon by this name.
    fn threads(&self, name: &str) -> Vec<Pid> {
        let tasks = std::fs::read_dir(format!("/proc/{}/task", self.daemon.pid())).unwrap();
        let tasks = tasks.map(|entry| entry.unwrap());
        let named = tasks.filter(|task| std::fs::read_to_string(task.path().join("comm")).unwrap().trim() == name);
        named.map(|task| Pid::from_raw(task.file_name().to_str().unwrap().parse().unwrap())).collect()
    }
}

#[test]
fn the_manager_is_told_of_begin_life_and_end() {
    let mut supervised = Supervised::start();
    let first = supervised.next().unwrap();
    assert!(first.starts_with("READY=1") && first.contains(&supervised.daemon.url()), "{first}");
    supervised.assert_pings(2, "idle");
    let started = supervised.daemon.call("POST", "/v1/sessions", &[("content-type", "application/json")], "{}");
    assert_eq!(started.status, 202, "{}", started.text);
    supervised.assert_pings(4, "in a session");
    assert!(supervised.daemon.terminate().success());
    let mut rest = Vec::new();
    while rest.last().is_none_or(|message| message != "STOPPING=1") {
        rest.push(supervised.next().expect("the end is not told"));
    }
    assert!(rest.iter().all(|message| ["WATCHDOG=1", "STOPPING=1"].contains(&message.as_str())), "{rest:?}");
}

#[test]
fn a_manager_that_does_not_read_holds_up_nothing() {
    let mut supervised = Supervised::start();
    // More than the kernel keeps for it, until it is full.
    let flood = UnixDatagram::unbound().unwrap();
    flood.set_nonblocking(true).unwrap();
    let path = supervised.manager.local_addr().unwrap().as_pathname().unwrap().to_owned();
    while flood.send_to(b"X=1", &path).is_ok() {}
    // Its next ping has no room; by the second one at the latest a thread that waits for it would serve nobody.
    std::thread::sleep(WATCHDOG / 2 + WATCHDOG / 4);
    for _ in 0..20 {
        assert_eq!(supervised.daemon.call("GET", "/livez", &[], "").status, 200);
    }
    assert!(supervised.daemon.terminate().success());
}

#[test]
fn pings_end_when_the_engine_or_http_hangs() {
    let supervised = Supervised::start();
    assert!(supervised.next().unwrap().starts_with("READY=1"));
    for name in ["engine", "tokio-rt-worker"] {
        supervised.assert_pings(2, name);
        let frozen = supervised.threads(name);
        assert!(!frozen.is_empty(), "there is no thread {name}");
        for thread in &frozen {
            ptrace::seize(*thread, ptrace::Options::empty()).unwrap();
            ptrace::interrupt(*thread).unwrap();
            waitpid(*thread, Some(WaitPidFlag::__WALL)).unwrap();
        }
        // What was said or done just before may still be pending.
        let pings = std::iter::from_fn(|| supervised.next()).take(3).count();
        assert!(pings < 3, "{name} is frozen, and the pings go on");
        for thread in frozen {
            ptrace::detach(thread, None).unwrap();
        }
    }
    supervised.assert_pings(2, "thawed");
}

/// A manager's socket is taken instead of an own one, and only a loopback one without tokens.
#[test]
fn a_socket_is_taken_over() {
    for (address, taken) in [("127.0.0.1:0", true), ("0.0.0.0:0", false)] {
        let listener = TcpListener::bind(address).unwrap();
        let port = listener.local_addr().unwrap().port();
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("data");
        let handed = [("LISTEN_FDS", "1"), ("LISTEN_FDS_FIRST_FD", "0")];
        if taken {
            let socket = Stdio::from(OwnedFd::from(listener));
            let daemon = Daemon::start_as(folder, shipped(), &data, |command| command.envs(handed).stdin(socket));
            assert_eq!(daemon.url(), format!("http://127.0.0.1:{port}"));
            assert_eq!(daemon.get("/livez").status, 200);
        } else {
            let mut command = daemon::serve(folder.path(), shipped(), &data);
            let out = command.envs(handed).stdin(Stdio::from(OwnedFd::from(listener))).output().unwrap();
            assert_eq!(out.status.code(), Some(2), "{}", String::from_utf8_lossy(&out.stderr));
        }
    }
}
