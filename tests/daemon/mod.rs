//! A daemon under test: `rigd serve` with the simulated rig on a free port, and a plain HTTP client for it.
#![allow(dead_code, reason = "each test file uses its own part")]

use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, ExitStatus, Stdio};

/// A running daemon; ended and its data removed when dropped.
pub struct Daemon {
    child: Child,
    address: String,
    _stdout: BufReader<ChildStdout>,
    folder: tempfile::TempDir,
}

/// An answer read to its end.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    pub headers: Vec<(String, String)>,
    pub text: String,
}

impl Answer {
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }

    pub fn json(&self) -> Value {
        serde_json::from_str(&self.text).unwrap_or_else(|e| panic!("{e}: {}", self.text))
    }
}

impl Daemon {
    /// Starts `rigd serve` with the shipped simulated rig, its time sped up so that tests wait for little.
    pub fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let config = shipped().replace("speed = 40.0", "speed = 400.0");
        let data = folder.path().join("data");
        Self::start_with(folder, &config, &data)
    }

    /// Starts `rigd serve` with a rig file of this text, written to `folder`, on the sessions of `data`.
    pub fn start_with(folder: tempfile::TempDir, config: &str, data: &Path) -> Self {
        Self::start_as(folder, config, data, |command| command.args(["--listen", "127.0.0.1:0"]))
    }

    /// The same, with what `set` adds to the command.
    pub fn start_as(
        folder: tempfile::TempDir,
        config: &str,
        data: &Path,
        set: impl FnOnce(&mut Command) -> &mut Command,
    ) -> Self {
        let mut command = serve(folder.path(), config, data);
        let mut child = set(&mut command).stdout(Stdio::piped()).spawn().unwrap();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        stdout.read_line(&mut line).unwrap();
        let address =
            line.trim().strip_prefix("listening on http://").unwrap_or_else(|| panic!("said {line:?}")).to_owned();
        Self { child, address, _stdout: stdout, folder }
    }

    /// The directory of the session at `location`.
    pub fn directory(&self, location: &str) -> PathBuf {
        let id = location.strip_prefix("/v1/sessions/").unwrap();
        self.folder.path().join("data/sessions").join(id)
    }

    pub fn pid(&self) -> i32 {
        self.child.id().try_into().unwrap()
    }

    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    pub fn connect(&self) -> TcpStream {
        TcpStream::connect(&self.address).unwrap()
    }

    /// Sends a request with the given headers (Host unless given) and leaves the answer unread.
    fn send(&self, method: &str, target: &str, headers: &[(&str, &str)], body: &str) -> TcpStream {
        let mut socket = self.connect();
        let mut request = format!("{method} {target} HTTP/1.1\r\nconnection: close\r\n");
        if headers.iter().all(|(name, _)| *name != "host") {
            request += &format!("host: {}\r\n", self.address);
        }
        for (name, value) in headers {
            request += &format!("{name}: {value}\r\n");
        }
        request += &format!("content-length: {}\r\n\r\n{body}", body.len());
        socket.write_all(request.as_bytes()).unwrap();
        socket
    }

    pub fn call(&self, method: &str, target: &str, headers: &[(&str, &str)], body: &str) -> Answer {
        let mut reader = BufReader::new(self.send(method, target, headers, body));
        let (status, headers) = head(&mut reader);
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes).unwrap();
        Answer { status, headers, text: String::from_utf8_lossy(&bytes).into_owned() }
    }

    pub fn get(&self, target: &str) -> Answer {
        self.call("GET", target, &[], "")
    }

    /// An answer to GET whose body is not read yet, nor its head.
    pub fn open(&self, target: &str, headers: &[(&str, &str)]) -> TcpStream {
        self.send("GET", target, headers, "")
    }

    /// Status and event ids of a stream, until it ends or `most` were read.
    pub fn events(&self, target: &str, headers: &[(&str, &str)], most: usize) -> (u16, Vec<u64>) {
        let mut reader = BufReader::new(self.open(target, headers));
        let status = head(&mut reader).0;
        let lines = reader.lines().map_while(Result::ok);
        let ids = lines.filter_map(|line| line.strip_prefix("id:").map(|id| id.trim().parse().unwrap()));
        (status, ids.take(most).collect())
    }

    /// Waits for a session's end by reading its events to their end.
    pub fn wait_for_end(&self, location: &str) {
        self.events(&format!("{location}/events"), &[], usize::MAX);
    }

    /// Ends the daemon as a crash or the kernel does: at once.
    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Asks the daemon to end, as a service manager does, and waits for it.
    pub fn terminate(&mut self) -> ExitStatus {
        let pid = nix::unistd::Pid::from_raw(self.pid());
        nix::sys::signal::kill(pid, nix::sys::signal::Signal::SIGTERM).unwrap();
        self.child.wait().unwrap()
    }
}

/// `rigd serve` with a rig file of this text, written to `folder`, on the sessions of `data`.
pub fn serve(folder: &Path, config: &str, data: &Path) -> Command {
    let file = folder.join("rig.toml");
    std::fs::write(&file, config).unwrap();
    let mut command = Command::new(program());
    command.arg("serve").arg("--config").arg(&file).arg("--data").arg(data);
    command
}

/// The daemon's program; for the tests of another package the one that lies where theirs do.
pub fn program() -> PathBuf {
    let beside = || std::env::current_exe().unwrap().parent().unwrap().with_file_name("rigd");
    option_env!("CARGO_BIN_EXE_rigd").map_or_else(beside, PathBuf::from)
}

/// Paths of everything in web/: the page.
pub fn parts_of_the_page() -> Vec<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("web");
    let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let paths: Vec<_> = names.map(|name| if name == "index.html" { "/".into() } else { format!("/{name}") }).collect();
    assert!(paths.len() > 3 && paths.iter().any(|path| path == "/"), "{paths:?}");
    paths
}

/// Text of the shipped simulated rig.
pub fn shipped() -> &'static str {
    rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated").unwrap().1
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // Already ended where a test ended it.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn head(reader: &mut impl BufRead) -> (u16, Vec<(String, String)>) {
    let mut lines = Vec::new();
    loop {
        let mut line = String::new();
        reader.read_line(&mut line).unwrap();
        match line.trim_end() {
            "" => break,
            text => lines.push(text.to_owned()),
        }
    }
    let status = lines.first().and_then(|l| l.split(' ').nth(1)).and_then(|s| s.parse().ok()).expect("no status line");
    let headers =
        lines.iter().skip(1).filter_map(|l| l.split_once(": ")).map(|(k, v)| (k.to_lowercase(), v.to_owned()));
    (status, headers.collect())
}
