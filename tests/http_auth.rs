//! Who may ask what: every operation of the OpenAPI document with every kind of token, and tokens that are seen nowhere else.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod daemon;

use daemon::{Answer, Daemon, serve, shipped};
use serde_json::{Value, json};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const READ: &str = "read-0123456789abcdef0123456789abcdef";
const CONTROL: &str = "ctrl-0123456789abcdef0123456789abcdef";
const WRONG: &str = "none-0123456789abcdef0123456789abcdef";
const NOBODY: &str = "01a208e9-cbda-76fb-b465-63318274b666";

/// A file of both tokens that only its owner may read.
fn tokens_in(folder: &Path) -> PathBuf {
    write_private(&folder.join("tokens"), &format!("# of this test\nread {READ}\ncontrol {CONTROL}\n"))
}

fn write_private(path: &Path, text: &str) -> PathBuf {
    std::fs::write(path, text).unwrap();
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600)).unwrap();
    path.to_owned()
}

/// The shipped rig with a file of tokens.
fn config(tokens: &Path) -> String {
    let text = shipped().replace("# tokens = \"/etc/rigd/tokens\"", &format!("tokens = {tokens:?}"));
    assert_ne!(text, shipped());
    text
}

fn start(set: impl FnOnce(&mut Command) -> &mut Command) -> Daemon {
    let folder = tempfile::tempdir().unwrap();
    let (text, data) = (config(&tokens_in(folder.path())), folder.path().join("data"));
    Daemon::start_as(folder, &text, &data, set)
}

fn start_on_loopback() -> Daemon {
    start(|command| command.args(["--listen", "127.0.0.1:0"]))
}

fn call(daemon: &Daemon, method: &str, target: &str, token: Option<&str>) -> Answer {
    let value = token.map(|token| format!("Bearer {token}"));
    let headers: Vec<_> = value.iter().map(|value| ("authorization", value.as_str())).collect();
    daemon.call(method, target, &headers, "")
}

/// 401 or 403, as RFC 6750 and RFC 9457 want it.
fn assert_refused(answer: &Answer, status: u16, error: Option<&str>, what: &str) {
    assert_eq!(answer.status, status, "{what}: {}", answer.text);
    let challenge = answer.header("www-authenticate").unwrap_or_else(|| panic!("{what}: no challenge"));
    assert!(challenge.starts_with("Bearer realm="), "{what}: {challenge}");
    let told = challenge.split("error=\"").nth(1).and_then(|rest| rest.split('"').next());
    assert_eq!(told, error, "{what}: {challenge}");
    if !what.starts_with("HEAD") {
        assert_eq!(answer.json()["status"], status, "{what}");
    }
}

#[test]
fn every_operation_asks_for_its_scope() {
    let daemon = start_on_loopback();
    let spec = call(&daemon, "GET", "/openapi.json", Some(READ)).json();
    let scheme = &spec["components"]["securitySchemes"]["token"];
    assert_eq!((&scheme["type"], &scheme["scheme"]), (&json!("http"), &json!("bearer")));
    let mut operations = 0;
    for (path, item) in spec["paths"].as_object().unwrap() {
        let target = path.split('/').map(|part| if part.starts_with('{') { NOBODY } else { part }).collect::<Vec<_>>();
        let target = target.join("/");
        for method in ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "BREW"] {
            let operation = &item[method.to_lowercase().as_str()];
            operations += usize::from(operation.is_object());
            check(&daemon, path, &target, method, operation);
        }
    }
    assert!(operations > 20, "only {operations} operations in the document");
    assert_eq!(call(&daemon, "GET", "/v1/sessions", Some(READ)).json()["sessions"], json!([]), "something was started");
}

/// One method of one path with every kind of token.
fn check(daemon: &Daemon, path: &str, target: &str, method: &str, operation: &Value) {
    let looking = ["GET", "HEAD"].contains(&method);
    let open = looking && path == "/livez";
    if operation.is_object() {
        let declared = if open { Value::Null } else { json!([{"token": [if looking { "read" } else { "control" }]}]) };
        assert_eq!(operation["security"], declared, "{method} {path}");
    }
    for (token, reads, controls) in
        [(None, false, false), (Some(WRONG), false, false), (Some(READ), true, false), (Some(CONTROL), true, true)]
    {
        let what = format!("{method} {target} with {token:?}");
        let answer = call(daemon, method, target, token);
        if open || controls || looking && reads {
            assert!(![401, 403].contains(&answer.status), "{what}: {}", answer.text);
            if operation.is_object() {
                let known = operation["responses"].as_object().unwrap();
                assert!(known.contains_key(&answer.status.to_string()), "{what}: {}", answer.status);
            }
        } else if reads {
            assert_refused(&answer, 403, Some("insufficient_scope"), &what);
        } else {
            assert_refused(&answer, 401, token.map(|_| "invalid_token"), &what);
        }
    }
}

#[test]
fn what_the_document_does_not_name_is_closed_but_the_page() {
    let daemon = start_on_loopback();
    for path in daemon::parts_of_the_page() {
        assert_eq!(call(&daemon, "GET", &path, None).status, 200, "{path}");
        assert_refused(&call(&daemon, "POST", &path, None), 401, None, &path);
    }
    for path in ["/openapi.json", "/nowhere", "/livez/", "//livez", "/%6civez", "/v1/../livez"] {
        assert_refused(&call(&daemon, "GET", path, None), 401, None, path);
    }
    assert_eq!(call(&daemon, "GET", "/nowhere", Some(READ)).status, 404);
    let bearer = format!("Bearer {READ}");
    for (headers, status) in [
        (vec![("authorization", format!("bearer {READ}"))], 200),
        (vec![("authorization", READ.to_owned())], 401),
        (vec![("authorization", format!("Basic {READ}"))], 401),
        (vec![("authorization", format!("Bearer {}", &READ[..36]))], 401),
        (vec![("authorization", bearer.clone()), ("authorization", bearer.clone())], 401),
        (vec![("authorization", "Bearer \u{e9}".to_owned())], 401),
        (vec![("cookie", format!("token={READ}"))], 401),
    ] {
        let headers: Vec<_> = headers.iter().map(|(name, value)| (*name, value.as_str())).collect();
        assert_eq!(daemon.call("GET", "/v1/rig", &headers, "").status, status, "{headers:?}");
    }
    assert_eq!(call(&daemon, "GET", &format!("/v1/rig?access_token={READ}"), None).status, 401);
}

#[test]
fn beyond_loopback_only_with_tokens() {
    let folder = tempfile::tempdir().unwrap();
    let mut bare = serve(folder.path(), shipped(), &folder.path().join("data"));
    let out = bare.args(["--listen", "0.0.0.0:0"]).output().unwrap();
    let says = String::from_utf8(out.stderr).unwrap();
    assert_eq!((out.status.code(), says.contains("no tokens")), (Some(2), true), "{says}");

    let daemon = start(|command| command.args(["--listen", "0.0.0.0:0"]));
    assert!(daemon.url().starts_with("http://0.0.0.0:"));
    // The name this machine has in its network is its owner's affair; a token is needed under any.
    let host = ("host", "rig.example:7040");
    let bearer = format!("Bearer {READ}");
    assert_eq!(daemon.call("GET", "/v1/rig", &[host], "").status, 401);
    assert_eq!(daemon.call("GET", "/v1/rig", &[host, ("authorization", &bearer)], "").status, 200);
}

#[test]
fn files_of_tokens_are_private_and_whole() {
    let folder = tempfile::tempdir().unwrap();
    let tokens = tokens_in(folder.path());
    let refusal = |says: &str| {
        let mut command = serve(folder.path(), &config(&tokens), &folder.path().join("data"));
        let out = command.args(["--listen", "127.0.0.1:0"]).output().unwrap();
        let errors = String::from_utf8(out.stderr).unwrap();
        assert_eq!((out.status.code(), errors.contains(says)), (Some(2), true), "{says}: {errors}");
        assert!(!errors.contains(READ) && !errors.contains(CONTROL), "{errors}");
    };
    std::fs::set_permissions(&tokens, std::fs::Permissions::from_mode(0o644)).unwrap();
    refusal("everyone on this machine");
    write_private(&tokens, "# none\n");
    refusal("no token in it");
    write_private(&tokens, &format!("read {READ}\n{CONTROL}\n"));
    refusal("line 2: write `read TOKEN`");
    std::fs::remove_file(&tokens).unwrap();
    refusal("there is no such file of secrets");
    nix::unistd::mkfifo(&tokens, nix::sys::stat::Mode::S_IRWXU).unwrap();
    refusal("this is a pipe (FIFO)");
}

/// What systemd's LoadCredential hands over counts like a file of the rig file; an empty one is none.
#[test]
fn credentials_are_taken() {
    for (text, status) in [(format!("control {CONTROL}\n"), 401), (String::new(), 200)] {
        let folder = tempfile::tempdir().unwrap();
        write_private(&folder.path().join("tokens"), &text);
        let (data, credentials) = (folder.path().join("data"), folder.path().to_owned());
        let daemon = Daemon::start_as(folder, shipped(), &data, |command| {
            command.args(["--listen", "127.0.0.1:0"]).env("CREDENTIALS_DIRECTORY", credentials)
        });
        assert_eq!(daemon.get("/v1/rig").status, status, "{text:?}");
        assert_eq!(call(&daemon, "GET", "/v1/rig", Some(CONTROL)).status, 200);
    }
}

/// `rigd session` with a token of the environment or of a file: exit status and both outputs.
fn session(daemon: &Daemon, token: Option<&str>, args: &[&str]) -> (i32, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    command.args(["session", "--url", &daemon.url()]).args(args).env("RIGD_LOG", "trace").env_remove("RIGD_TOKEN");
    if let Some(token) = token {
        command.env("RIGD_TOKEN", token);
    }
    let out = command.output().unwrap();
    let all = [out.stdout, out.stderr].map(|bytes| String::from_utf8(bytes).unwrap()).concat();
    (out.status.code().unwrap(), all)
}

/// Everything is logged, everything is asked, right and wrong: no token comes out, and none lies on the disk.
#[test]
fn no_token_is_seen_in_logs_errors_or_files() {
    let logs = tempfile::tempdir().unwrap();
    let (log, file) = (logs.path().join("log"), logs.path().join("token"));
    let to = Stdio::from(std::fs::File::create(&log).unwrap());
    let data = logs.path().join("data");
    let secrets = tempfile::tempdir().unwrap();
    let text = config(&tokens_in(secrets.path()));
    let mut daemon = Daemon::start_as(tempfile::tempdir().unwrap(), &text, &data, |command| {
        command.args(["--listen", "127.0.0.1:0"]).env("RIGD_LOG", "trace").stderr(to)
    });
    let mut seen = String::new();
    let mut run = |token: Option<&str>, args: &[&str], status: i32| {
        let (ended, says) = session(&daemon, token, args);
        assert_eq!(ended, status, "{args:?}: {says}");
        seen += &says;
    };
    run(None, &["list"], 2);
    run(Some(WRONG), &["list"], 2);
    run(Some(&WRONG[..20]), &["list"], 2);
    run(Some(READ), &["start"], 2);
    run(Some(CONTROL), &["start", "--dry-run"], 0);
    for (text, status) in [(format!("{READ}\n"), 0), (format!("read {READ}\n"), 2)] {
        std::fs::write(&file, text).unwrap();
        run(None, &["list", "--token-file", file.to_str().unwrap()], status);
    }
    std::fs::remove_file(&file).unwrap();
    run(Some(CONTROL), &["start"], 0);
    for (method, path) in [
        ("GET", "/v1/rig"),
        ("GET", "/v1/settings"),
        ("GET", "/v1/log?lines=500"),
        ("POST", "/v1/sessions"),
        ("BREW", "/nowhere"),
    ] {
        for token in [READ, CONTROL, WRONG] {
            seen += &call(&daemon, method, path, Some(token)).text;
        }
    }
    assert!(daemon.terminate().success());
    let logged = std::fs::read_to_string(&log).unwrap();
    assert!(logged.contains("TRACE") || logged.contains("DEBUG") || logged.contains("INFO"), "nothing was logged");
    assert!(!logged.contains('\u{1b}'), "colours in a file");
    assert!(seen.contains("scope control"), "{seen}");
    for (what, text) in [("log", logged), ("answers", seen), ("files", all_text(&data))] {
        for secret in [READ, CONTROL, WRONG, &WRONG[..20]] {
            assert!(!text.contains(secret), "{secret} is in the {what}");
        }
    }
}

/// Every file below a directory.
fn all_text(directory: &Path) -> String {
    let entries = std::fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path());
    let texts = entries.map(|path| {
        if path.is_dir() {
            all_text(&path)
        } else {
            String::from_utf8_lossy(&std::fs::read(path).unwrap()).into_owned()
        }
    });
    texts.collect::<Vec<_>>().concat()
}
