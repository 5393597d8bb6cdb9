//! The command line as people and shells meet it: help, manual, completions, colours, progress, hints.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod daemon;

use daemon::{Daemon, shipped};
use nix::fcntl::{FcntlArg, OFlag, fcntl};
use nix::pty::{Winsize, openpty};
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

fn rigd(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
    command.args(args).env_remove("NO_COLOR").env_remove("CLICOLOR_FORCE").env("TERM", "xterm-256color");
    // Build servers set it, and some libraries take it for a wish.
    command.env("CI", "true");
    command
}

fn piped(args: &[&str]) -> Output {
    rigd(args).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// All that a command writes when stdout and stderr are one terminal.
fn on_terminal(args: &[&str], set: &[(&str, &str)]) -> String {
    let size = Winsize { ws_row: 24, ws_col: 100, ws_xpixel: 0, ws_ypixel: 0 };
    let pty = openpty(Some(&size), None).unwrap();
    let mut child = {
        let [out, err] = [(); 2].map(|()| Stdio::from(pty.slave.try_clone().unwrap()));
        rigd(args).envs(set.iter().copied()).stdin(Stdio::null()).stdout(out).stderr(err).spawn().unwrap()
    };
    drop(pty.slave);
    // A child of another test may have inherited the other end, so that its closing is nothing to wait for.
    fcntl(&pty.master, FcntlArg::F_SETFL(OFlag::O_NONBLOCK)).unwrap();
    let (mut master, mut written, mut buffer) = (File::from(pty.master), Vec::new(), [0; 4096]);
    loop {
        let ended = child.try_wait().unwrap().is_some();
        match master.read(&mut buffer) {
            Ok(0) => break,
            Ok(count) => written.extend(&buffer[..count]),
            Err(e) if e.kind() == ErrorKind::WouldBlock && !ended => std::thread::sleep(Duration::from_millis(2)),
            // Nothing more, or the other end is closed (EIO).
            Err(_) => break,
        }
    }
    child.wait().unwrap();
    text(&written)
}

/// Every command as its help lists it, deepest last, `rigd` itself first.
fn commands() -> Vec<Vec<String>> {
    let mut all = vec![Vec::new()];
    let mut at = 0;
    while at < all.len() {
        let command: Vec<String> = all[at].clone();
        let words: Vec<&str> = command.iter().map(String::as_str).chain(["--help"]).collect();
        let help = text(&piped(&words).stdout);
        let listed = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
        let names = listed.filter(|line| line.starts_with("  ") && !line.starts_with("   "));
        for name in names.filter_map(|line| line.split_whitespace().next()).filter(|name| *name != "help") {
            all.push([command.clone(), vec![name.to_owned()]].concat());
        }
        at += 1;
    }
    all
}

#[test]
fn every_command_says_what_it_is_and_has_a_manual_page() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    assert!(piped(&["man", "--out", out]).status.success());
    let commands = commands();
    assert!(commands.len() > 45, "only {} commands found: {commands:?}", commands.len());
    let mut pages = Vec::new();
    for command in &commands {
        let words: Vec<&str> = command.iter().map(String::as_str).chain(["--help"]).collect();
        let help = piped(&words);
        let first = text(&help.stdout).lines().next().unwrap_or_default().to_owned();
        let told = help.status.success() && !first.starts_with("Usage") && first.trim().len() > 10;
        assert!(told, "rigd {}: {first:?}", command.join(" "));
        let name = ["rigd"].into_iter().chain(command.iter().map(String::as_str)).collect::<Vec<_>>().join("-");
        pages.push(folder.path().join(format!("{name}.1")));
        let page = std::fs::read_to_string(pages.last().unwrap()).unwrap();
        assert!(page.contains(".SH NAME") && page.contains(".SH SYNOPSIS"), "{name}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), pages.len(), "pages of no command");
    // What `man --warnings` calls a page, all of them at once.
    let mut lint = Command::new("groff");
    let Ok(read) = lint.args(["-man", "-K", "utf8", "-ww", "-Tutf8"]).args(&pages).output() else {
        println!("SKIPPED: there is no groff here to read the pages with");
        return;
    };
    assert!(read.status.success() && read.stderr.is_empty(), "{}", text(&read.stderr));
    assert!(String::from_utf8_lossy(&read.stdout).contains("follow and steer acquisitions"));
}

#[test]
fn bash_completes_commands_and_options() {
    let folder = tempfile::tempdir().unwrap();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = piped(&["completions", shell]);
        assert!(script.status.success() && script.stdout.len() > 1000, "{shell}");
        std::fs::write(folder.path().join(shell), script.stdout).unwrap();
    }
    for shell in ["bash", "zsh", "fish"] {
        let Ok(checked) = Command::new(shell).arg("-n").arg(folder.path().join(shell)).output() else {
            println!("SKIPPED: {shell} is not here to read its completions");
            continue;
        };
        assert!(checked.status.success(), "{shell}: {}", text(&checked.stderr));
    }
    let complete = |words: &[&str]| {
        let ask = r#"source "$1"; shift
            function=$(complete -p rigd | sed 's/.*-F \([^ ]*\).*/\1/')
            COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
            "$function" rigd "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
            printf '%s\n' "${COMPREPLY[@]}""#;
        let mut bash = Command::new("bash");
        let said = bash.args(["-c", ask, "bash"]).arg(folder.path().join("bash")).args(words).output().unwrap();
        assert!(said.status.success(), "{words:?}: {}", text(&said.stderr));
        text(&said.stdout).lines().map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(complete(&["rigd", "ses"]), ["session"]);
    let verbs = complete(&["rigd", "session", ""]);
    assert!(["start", "list", "watch", "abort"].iter().all(|verb| verbs.contains(&(*verb).to_owned())), "{verbs:?}");
    assert_eq!(complete(&["rigd", "session", "start", "--dry"]), ["--dry-run"]);
    assert_eq!(complete(&["rigd", "completions", "z"]), ["zsh"]);
}

/// A rig file, and a data directory that is not there.
fn rig(folder: &Path) -> (String, String) {
    let file = folder.join("rig.toml");
    std::fs::write(&file, shipped()).unwrap();
    (file.to_str().unwrap().to_owned(), folder.join("data").to_str().unwrap().to_owned())
}

#[test]
fn colours_are_on_terminals_alone_and_only_where_they_are_wanted() {
    let folder = tempfile::tempdir().unwrap();
    let (config, data) = rig(folder.path());
    let doctor = ["doctor", "--config", &config, "--data", &data];
    let coloured = on_terminal(&doctor, &[]);
    assert!(coloured.contains("\u{1b}[32mok") && coloured.contains("simulated camera"), "{coloured:?}");
    let broken = ["fit", "/nonexistent"];
    assert!(on_terminal(&broken, &[]).contains("\u{1b}["));
    for command in [&doctor[..], &broken, &["--help"], &["session", "fly"]] {
        for set in [("NO_COLOR", "1"), ("TERM", "dumb")] {
            let plain = on_terminal(command, &[set]);
            assert!(!plain.contains('\u{1b}') && plain.len() > 20, "{command:?} {set:?}: {plain:?}");
        }
        let said = piped(command);
        let all = [said.stdout, said.stderr].concat();
        assert!(!all.contains(&0x1b) && all.len() > 20, "{command:?}: {}", text(&all));
    }
}

#[test]
fn long_work_has_a_bar_on_a_terminal_and_lines_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    let (config, _) = rig(folder.path());
    let mut shot = 0;
    let mut shoot = |set: &[(&str, &str)], terminal: bool, more: &[&str]| {
        shot += 1;
        let out = folder.path().join(format!("frames-{shot}"));
        let args = ["simulate", "camera", "--config", &config, "--station", "1", "--out", out.to_str().unwrap()];
        let args = [&args, more].concat();
        if terminal {
            return (on_terminal(&args, set), String::new());
        }
        let said = piped(&args);
        (text(&said.stderr), text(&said.stdout))
    };
    let (bar, _) = shoot(&[], true, &[]);
    assert!(bar.contains('[') && bar.contains("/10 frames") && bar.contains('\r'), "{bar:?}");
    let (colourless, _) = shoot(&[("NO_COLOR", "1")], true, &[]);
    assert!(
        !colourless.split('\u{1b}').skip(1).any(|code| code.trim_start_matches(['[', ';', '0', '3']).starts_with('m'))
    );
    let lines: String = (1..=10).map(|n| format!("{n}/10 frames\n")).collect();
    let (dumb, _) = shoot(&[("TERM", "dumb")], true, &[]);
    assert!(dumb.replace('\r', "").starts_with(&lines) && !dumb.contains('\u{1b}'), "{dumb:?}");
    assert_eq!(shoot(&[], false, &[]).0, lines);
    let (quiet, json) = shoot(&[], false, &["--json"]);
    assert_eq!(
        (quiet.as_str(), serde_json::from_str::<serde_json::Value>(&json).unwrap()["frames"].as_u64()),
        ("", Some(10))
    );
}

#[test]
fn errors_say_what_to_do_next() {
    let folder = tempfile::tempdir().unwrap();
    let (config, _) = rig(folder.path());
    // A port that was free a moment ago and that nobody listens on.
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let nobody = format!("http://127.0.0.1:{port}");
    let data = folder.path().join("locked");
    let tokens = folder.path().join("tokens");
    let token = |c: char| c.to_string().repeat(32);
    std::fs::write(&tokens, format!("read {}\n", token('r'))).unwrap();
    std::fs::set_permissions(&tokens, std::os::unix::fs::PermissionsExt::from_mode(0o600)).unwrap();
    let locked = shipped().replacen("[server]", &format!("[server]\ntokens = {tokens:?}"), 1);
    let daemon = Daemon::start_with(tempfile::tempdir().unwrap(), &locked, &data);
    let url = daemon.url();
    let missing = folder.path().join("none");
    let missing = missing.to_str().unwrap();
    for (args, token, status, hint) in [
        (&["sesion", "list"][..], None, 2, "tip: a similar subcommand exists: 'session'"),
        (&["session", "wach"], None, 2, "'watch'"),
        (&["fit", missing], None, 2, "none"),
        (&["serve", "--config", missing], None, 2, "`rigd config show simulated > rig.toml`"),
        (&["config", "show", "mine"], None, 2, "choose one of zheng-2008"),
        (&["session", "--url", &nobody, "list"], None, 1, "hint: `rigd serve --config rig.toml` starts a daemon"),
        (&["queue", "--url", &url, "list"], None, 2, "hint: give one of this daemon's tokens, with --token-file"),
        (&["session", "--url", &url, "list"], Some(token('x')), 2, "RIGD_TOKEN"),
        (&["session", "--url", &url, "start"], Some(token('r')), 2, "one with the scope control"),
        (&["history", &config], None, 2, "index"),
    ] {
        let mut command = rigd(args);
        command.env_remove("RIGD_TOKEN");
        token.map(|token| command.env("RIGD_TOKEN", token));
        let said = command.output().unwrap();
        let errors = text(&said.stderr);
        assert_eq!(said.status.code(), Some(status), "{args:?}: {errors}");
        assert!(errors.starts_with("error: ") && errors.contains(hint), "{args:?}: {errors}");
        assert!(said.stdout.is_empty(), "{args:?}");
    }
}
