//! `rigd config check` says what `rigd serve` would: a file that passes is one that serves, or the difference is told.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::Path;
use std::process::Command;

fn shipped(name: &str) -> String {
    rig_config::SHIPPED.iter().find(|(shipped, _)| *shipped == name).unwrap().1.to_owned()
}

fn rigd(text: &str, args: &[&str]) -> (Option<i32>, String) {
    run(Path::new(env!("CARGO_BIN_EXE_rigd")), text, args)
}

fn run(program: &Path, text: &str, args: &[&str]) -> (Option<i32>, String) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("rig.toml");
    std::fs::write(&file, text).unwrap();
    let output = Command::new(program).args(args).arg(&file).current_dir(folder.path()).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout) + &text(&output.stderr))
}

#[test]
fn a_simulated_camera_before_a_real_arm_is_refused_by_both() {
    let text =
        shipped("simulated").replacen("driver = \"simulated\"", "driver = \"rigproto\"\nport = \"/dev/null\"", 1);
    let reason = "photographs the simulated arm: set arm.driver";
    for args in [&["config", "check"][..], &["serve", "--listen", "127.0.0.1:0", "--config"]] {
        let (status, said) = rigd(&text, args);
        assert!(
            status == Some(2) && said.contains("camera.driver") && said.contains(reason),
            "{args:?} {status:?}: {said}"
        );
    }
}

#[cfg(not(feature = "tls"))]
#[test]
fn a_certificate_is_refused_by_a_build_without_tls() {
    let folder = tempfile::tempdir().unwrap();
    let [certificate, key] = ["certificate.pem", "key.pem"].map(|name| folder.path().join(name));
    std::fs::write(&certificate, "").unwrap();
    std::fs::write(&key, "").unwrap();
    std::fs::set_permissions(&key, std::os::unix::fs::PermissionsExt::from_mode(0o600)).unwrap();
    let files = format!("[server]\ncertificate = {certificate:?}\nkey = {key:?}");
    let text = shipped("simulated").replace("[server]", &files);
    let (status, said) = rigd(&text, &["config", "check"]);
    assert!(
        status == Some(0) && said.contains("refuses it all the same: server.certificate: this rigd was built without"),
        "{said}"
    );
    let (status, said) = rigd(&text, &["serve", "--listen", "127.0.0.1:0", "--config"]);
    assert!(status == Some(2) && said.contains("built without `--features tls`"), "{status:?}: {said}");
    let (status, said) = rigd(&text.replace("key =", "# key ="), &["config", "check"]);
    assert!(
        status == Some(2) && said.contains("server.key: missing: server.certificate needs it"),
        "{status:?}: {said}"
    );
}

/// A program alone in its folder has no camera worker beside it.
#[test]
fn a_missing_camera_worker_is_told_by_both() {
    let alone = tempfile::tempdir().unwrap();
    let program = alone.path().join("rigd");
    std::fs::copy(env!("CARGO_BIN_EXE_rigd"), &program).unwrap();
    let text = shipped("zheng-2008");
    let reason = "camera.driver = \"gphoto2\" needs";
    let (status, said) = run(&program, &text, &["config", "check"]);
    assert_eq!(status, Some(0), "{said}");
    assert!(said.contains("sound") && said.contains("rigd serve refuses it") && said.contains(reason), "{said}");
    let (status, said) = run(&program, &text, &["serve", "--listen", "127.0.0.1:0", "--config"]);
    assert!(status == Some(2) && said.contains(reason) && said.contains("cargo build"), "{status:?}: {said}");
}
