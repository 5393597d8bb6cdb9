//! TLS before the REST surface, with a certificate that openssl makes here: who gets in, and what a handshake may cost.
#![cfg(feature = "tls")]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod daemon;

use daemon::{serve, shipped};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use ureq::Agent;
use ureq::tls::{Certificate, RootCerts, TlsConfig};

const TOKEN: &str = "ctrl-0123456789abcdef0123456789abcdef";

/// A certificate for this machine's loopback, vouched for by itself, and its key.
fn certificate(folder: &Path, name: &str) -> [PathBuf; 2] {
    let files = [folder.join(format!("{name}.pem")), folder.join(format!("{name}.key"))];
    let config = folder.join(format!("{name}.cnf"));
    let text = "[req]\nprompt = no\ndistinguished_name = dn\nx509_extensions = ext\n[dn]\nCN = rig\n\
                [ext]\nbasicConstraints = critical, CA:FALSE\nsubjectAltName = IP:127.0.0.1, DNS:localhost\n";
    std::fs::write(&config, text).unwrap();
    let made = Command::new("openssl")
        .args([
            "req",
            "-x509",
            "-newkey",
            "ec",
            "-pkeyopt",
            "ec_paramgen_curve:P-256",
            "-nodes",
            "-days",
            "2",
            "-config",
        ])
        .arg(&config)
        .arg("-out")
        .arg(&files[0])
        .arg("-keyout")
        .arg(&files[1])
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    std::fs::set_permissions(&files[1], std::fs::Permissions::from_mode(0o600)).unwrap();
    files
}

fn config([certificate, key]: &[PathBuf; 2], tokens: &Path) -> String {
    std::fs::write(tokens, format!("control {TOKEN}\n")).unwrap();
    std::fs::set_permissions(tokens, std::fs::Permissions::from_mode(0o600)).unwrap();
    let lines = format!("[server]\ncertificate = {certificate:?}\nkey = {key:?}\ntokens = {tokens:?}");
    shipped().replace("[server]", &lines)
}

/// A daemon with TLS, ended when dropped.
struct Served {
    child: Child,
    url: String,
    files: [PathBuf; 2],
    folder: tempfile::TempDir,
}

impl Served {
    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let files = certificate(folder.path(), "rig");
        let text = config(&files, &folder.path().join("tokens"));
        let mut command = serve(folder.path(), &text, &folder.path().join("data"));
        let mut child = command.args(["--listen", "127.0.0.1:0"]).stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let url = line.trim().strip_prefix("listening on ").unwrap().to_owned();
        assert!(url.starts_with("https://127.0.0.1:"), "{url}");
        Self { child, url, files, folder }
    }

    fn connect(&self) -> TcpStream {
        TcpStream::connect(self.url.strip_prefix("https://").unwrap()).unwrap()
    }

    /// A client that trusts this certificate alone.
    fn client(&self, trusted: &Path) -> Agent {
        let root = Certificate::from_pem(&std::fs::read(trusted).unwrap()).unwrap();
        let tls = TlsConfig::builder().root_certs(RootCerts::new_with_certs(&[root])).build();
        let config = Agent::config_builder().tls_config(tls).http_status_as_error(false).proxy(None);
        config.timeout_global(Some(Duration::from_secs(60))).build().new_agent()
    }

    fn status(&self, path: &str, token: Option<&str>) -> u16 {
        let mut request = self.client(&self.files[0]).get(format!("{}{path}", self.url));
        if let Some(token) = token {
            request = request.header("Authorization", format!("Bearer {token}"));
        }
        request.call().unwrap().status().as_u16()
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn who_trusts_the_certificate_and_has_a_token_gets_in() {
    let served = Served::start();
    assert_eq!(served.status("/livez", None), 200);
    assert_eq!((served.status("/v1/rig", None), served.status("/v1/rig", Some(TOKEN))), (401, 200));
    // Another certificate of the same name vouches for nobody.
    let other = certificate(served.folder.path(), "other");
    assert!(served.client(&other[0]).get(format!("{}/livez", served.url)).call().is_err());

    let session = |trusted: Option<&Path>| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        command.args(["session", "list", "--url", &served.url]).env("RIGD_TOKEN", TOKEN).env_remove("SSL_CERT_FILE");
        trusted.map(|file| command.env("SSL_CERT_FILE", file));
        command.output().unwrap()
    };
    let trusting = session(Some(&served.files[0]));
    assert!(trusting.status.success(), "{}", String::from_utf8_lossy(&trusting.stderr));
    assert_eq!(session(None).status.code(), Some(1));
}

#[test]
fn plain_http_gets_no_answer_and_a_handshake_that_does_not_come_is_ended_while_others_are_served() {
    let served = Served::start();
    let mut plain = served.connect();
    plain.write_all(b"GET /livez HTTP/1.1\r\nhost: 127.0.0.1\r\n\r\n").unwrap();
    let mut said = Vec::new();
    // An alert of TLS, or nothing; the connection may also be reset.
    let _ = plain.read_to_end(&mut said);
    assert!(!said.starts_with(b"HTTP"), "{}", String::from_utf8_lossy(&said));

    // A hello that says how long it will be and then does not come, many times.
    let mut silent: Vec<TcpStream> = (0..50).map(|_| served.connect()).collect();
    for stream in &mut silent {
        stream.write_all(&[0x16, 0x03, 0x01, 0x01, 0x00, 0x01]).unwrap();
    }
    assert_eq!(served.status("/livez", None), 200);
    for mut stream in silent {
        stream.set_read_timeout(Some(Duration::from_secs(50))).unwrap();
        let mut rest = Vec::new();
        if let Err(error) = stream.read_to_end(&mut rest) {
            assert!(error.kind() == std::io::ErrorKind::ConnectionReset, "{error}: the connection is not ended");
        }
    }
    assert_eq!(served.status("/livez", None), 200);
}

#[test]
fn files_that_will_not_do_are_refused_and_nothing_of_a_key_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let (good, other) = (certificate(folder.path(), "good"), certificate(folder.path(), "other"));
    let [certificate, key] = &good;
    let swapped = folder.path().join("swapped.key");
    let lines: Vec<String> = std::fs::read_to_string(key).unwrap().lines().map(str::to_owned).collect();
    std::fs::write(&swapped, lines[1..].join("\n")).unwrap();
    std::fs::set_permissions(&swapped, std::fs::Permissions::from_mode(0o600)).unwrap();
    let open = folder.path().join("open.key");
    std::fs::copy(key, &open).unwrap();
    std::fs::set_permissions(&open, std::fs::Permissions::from_mode(0o644)).unwrap();
    for (files, words) in [
        ([certificate.clone(), other[1].clone()], "server.certificate and server.key"),
        ([key.clone(), key.clone()], "holds no certificate in PEM"),
        ([certificate.clone(), swapped], "holds no private key in PEM"),
        ([certificate.clone(), open], "everyone on this machine may use it"),
        ([folder.path().join("none"), key.clone()], "server.certificate"),
    ] {
        let text = config(&files, &folder.path().join("tokens"));
        let out = serve(folder.path(), &text, &folder.path().join("data")).output().unwrap();
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(out.status.code() == Some(2) && said.contains(words), "{words}: {said}");
        assert!(lines.iter().filter(|line| line.len() > 20).all(|line| !said.contains(line.as_str())), "{said}");
    }
}
