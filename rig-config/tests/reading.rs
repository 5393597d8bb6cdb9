//! Rig files as people write them: the shipped ones are accepted, and every mistake of a bad one is named at once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use rig_config::{ArmDriver, CameraDriver, ReadError, Rig, SHIPPED, json_schema};

fn simulated() -> &'static str {
    SHIPPED.iter().find(|(name, _)| *name == "simulated").unwrap().1
}

/// The shipped simulated rig with `from` replaced by `to`, and the reasons for refusing it.
fn refused(edits: &[(&str, &str)]) -> ReadError {
    let mut text = simulated().to_owned();
    for (from, to) in edits {
        assert!(text.contains(from), "the shipped file has no `{from}`");
        text = text.replacen(from, to, 1);
    }
    Rig::from_toml(&text, "rig.toml").expect_err("the file should be refused")
}

fn keys(error: &ReadError) -> Vec<&str> {
    error.reasons.iter().map(|r| r.key.as_str()).collect()
}

#[test]
fn shipped_rigs_are_accepted() {
    for (name, text) in SHIPPED {
        let rig = Rig::from_toml(text, name).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(rig.plan.stations_deg, [-55.0, -20.0, 15.0, 50.0, 85.0, 115.0, 140.0]);
        assert_eq!(rig.plan.exposures.len(), 10);
        assert_eq!(rig.plan.exposures[9].true_s, 16.0);
        assert_eq!(rig.object.radius_mm, 30.0);
    }
    let paper = Rig::from_toml(SHIPPED[0].1, "").unwrap();
    assert!(matches!(paper.arm.driver, ArmDriver::Rigproto { .. }));
    let body = CameraDriver::Gphoto2 { model: Some("Canon EOS 5D".into()), port: None, power_hook: None };
    assert_eq!((paper.camera.driver, paper.camera.width, paper.camera.height), (body, 4368, 2912));
    assert!(paper.simulation.is_none());
}

#[test]
fn twenty_mistakes_are_all_listed() {
    let error = refused(&[
        ("name = \"simulated rig\"", "name = \"\""),
        ("speed_deg_s = 30.0", "speed_deg_s = -30.0"),
        ("acceleration_deg_s2", "aceleration_deg_s2"),
        ("tolerance_deg = 0.05", "tolerance_deg = nan"),
        ("settle_s = 0.5", "settle_s = \"half a second\""),
        ("park_deg = 0.0", "park_deg = 200.0"),
        ("level_permille = 800", "level_permille = 1001"),
        ("circle_radius_mm = 600.0", "circle_radius_mm = 20.0"),
        ("intensity = [9.0e6, 8.0e6, 7.0e6]", "intensity = [4.0e5, 0.0]"),
        ("width = 288", "width = 0"),
        ("focal_px = [3300.0, 3300.0]", "focal_px = [3300.0, inf]"),
        ("iso = 100", "iso = 100.5"),
        ("stations_deg = [-55.0, -20.0", "stations_deg = [-155.0, 15.0"),
        ("\"1/100\", \"1/40\"", "\"1/90\", 7"),
        ("model = \"ward\"", "model = 5"),
        ("cosine_cutoff = 0.15", "colour = true"),
        ("reserve_bytes = 67108864", "reserve_bytes = -1"),
        ("127.0.0.1:7040\"", "0.0.0.0:7040\""),
        ("scene = \"marble\"", "scene = \"granite\""),
        ("speed = 40.0", ""),
    ]);
    let mut got = keys(&error);
    got.sort_unstable();
    let mut want = vec![
        "name",
        "arm.speed_deg_s",
        "arm.aceleration_deg_s2",
        "arm.acceleration_deg_s2",
        "arm.tolerance_deg",
        "arm.settle_s",
        "arm.park_deg",
        "lamp.level_permille",
        "lamp.circle_radius_mm",
        "lamp.intensity",
        "lamp.intensity[1]",
        "camera.width",
        "camera.focal_px[1]",
        "camera.iso",
        "plan.stations_deg[0]",
        "plan.stations_deg[2]",
        "plan.exposures[0]",
        "plan.exposures[1]",
        "fit.model",
        "fit.colour",
        "fit.cosine_cutoff",
        "storage.reserve_bytes",
        "server.listen",
        "simulation.scene",
        "simulation.speed",
    ];
    want.sort_unstable();
    assert_eq!(got, want, "{error}");
    let text = error.to_string();
    assert!(text.starts_with("rig.toml: 25 mistakes\n"), "{text}");
    assert!(text.contains("did you mean `acceleration_deg_s2`?"), "{text}");
    assert!(text.contains("is -30: must be at least 0.001"), "{text}");
}

#[test]
fn what_a_calibration_is_shot_with_is_checked_like_the_plan() {
    let text = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated-calibration").unwrap().1;
    let refused = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        Rig::from_toml(&text.replacen(from, to, 1), "edited").unwrap_err().to_string()
    };
    for (from, to, says) in [
        (
            "board_station_deg = 15.0",
            "board_station_deg = 175.0",
            "calibration.board_station_deg: 175 is outside arm.travel_deg",
        ),
        ("board_exposure = \"1/4\"", "board_exposure = \"1/7\"", "calibration.board_exposure: "),
        ("\"4\", \"8\"]", "\"4\", \"4\"]", "calibration.exposures[9]: `4` opens as long as calibration.exposures[8]"),
        ("board_columns = 9", "board_columns = 2", "calibration.board_columns: is 2: must be at least 3"),
        ("square_mm = 15.0", "square_mm = 0", "calibration.square_mm: is 0: must be above 0"),
    ] {
        let error = refused(from, to);
        assert!(error.contains(says), "{from}: {error}");
    }
    let twice = text.replacen(
        "stations_deg = [-55.0, -20.0, 15.0, 50.0, 85.0, 115.0, 140.0]\n# The bracket for",
        "stations_deg = [1, 1]\n# The bracket for",
        1,
    );
    assert_ne!(twice, text);
    let error = Rig::from_toml(&twice, "edited").unwrap_err().to_string();
    assert!(error.contains("calibration.stations_deg[1]: 1 is calibration.stations_deg[0] again"), "{error}");
    let rest = ["stations_deg", "exposures"].iter().fold(text.to_owned(), |text, key| {
        let (head, section) = text.split_once("[calibration]").unwrap();
        let kept: Vec<&str> = section.lines().filter(|line| !line.starts_with(&format!("{key} ="))).collect();
        format!("{head}[calibration]{}", kept.join("\n"))
    });
    let rig = Rig::from_toml(&rest, "edited").unwrap();
    let calibration = rig.calibration.unwrap();
    assert_eq!((calibration.stations_deg, calibration.exposures), (rig.plan.stations_deg, rig.plan.exposures));
}

#[test]
fn with_tokens_any_address_may_be_listened_on() {
    let text = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated").unwrap().1;
    let text =
        text.replacen("listen = \"127.0.0.1:7040\"", "listen = \"192.168.0.2:7040\"\ntokens = \"/run/tokens\"", 1);
    let server = Rig::from_toml(&text, "edited").unwrap().server;
    assert_eq!((server.listen.to_string().as_str(), server.tokens), ("192.168.0.2:7040", Some("/run/tokens".into())));
}

#[test]
fn each_contradiction_is_named_alone() {
    type Case<'a> = (&'a [(&'a str, &'a str)], &'a str, &'a str);
    let cases: &[Case] = &[
        (&[("travel_deg = [-90.0, 170.0]", "travel_deg = [170.0, -90.0]")], "arm.travel_deg", "swap"),
        (&[("park_deg = 0.0", "park_deg = -90.5")], "arm.park_deg", "outside arm.travel_deg"),
        (&[("115.0, 140.0]", "115.0, 170.5]")], "plan.stations_deg[6]", "outside arm.travel_deg"),
        (&[("115.0, 140.0]", "115.0, 50]")], "plan.stations_deg[6]", "plan.stations_deg[3] again"),
        (&[("\"6\", \"15\"", "\"6\", \"6.3\"")], "plan.exposures[9]", "as long as plan.exposures[8]"),
        (&[("\"6\", \"15\"", "\"6\", \"bulb\"")], "plan.exposures[9]", "no third-stop"),
        (&[("\"1.3\"", "\"1.5\"")], "plan.exposures[6]", "half-stop"),
        // 29 mm off the plane of the circle, and the circle passes 3 mm from the centre's axis.
        (
            &[("[0.0, 0.0, 1500.0]\ncircle_radius_mm = 600.0", "[0.0, 29.0, 1500.0]\ncircle_radius_mm = 3.0")],
            "lamp.circle_radius_mm",
            "comes within 29.2 mm",
        ),
        (
            &[("center_mm = [0.0, 0.0, 1500.0]\nradius", "center_mm = [0.0, 0.0, -1500.0]\nradius")],
            "object.center_mm",
            "before",
        ),
        (
            &[("center_mm = [0.0, 0.0, 1500.0]\nradius", "center_mm = [40.0, 0.0, 1500.0]\nradius")],
            "object.center_mm",
            "x 166",
        ),
        (&[("height = 192", "height = 130")], "object.center_mm", "y 30 to 162 px"),
        (&[("listen = \"127.0.0.1:7040\"", "listen = \"localhost\"")], "server.listen", "ADDRESS:PORT"),
        (&[("listen = \"127.0.0.1:7040\"", "listen = \"192.168.0.2:80\"")], "server.listen", "loopback"),
        (&[("driver = \"simulated\"", "driver = \"simulated\"\nport = \"/dev/ttyUSB0\"")], "arm.port", "no meaning"),
        (&[("width = 288", "directory = \"frames\"\nwidth = 288")], "camera.directory", "replay"),
        (&[("[simulation]\n", "[camera.extra]\n")], "simulation", "missing"),
    ];
    for (edits, key, says) in cases {
        let error = refused(edits);
        let reason = error.reasons.iter().find(|r| r.key == *key).unwrap_or_else(|| panic!("{key}: {error}"));
        assert!(reason.what.contains(says), "{key}: {}", reason.what);
        let alone = error.reasons.len() == 1 || error.reasons.iter().all(|r| r.key == *key || r.key == "camera.extra");
        assert!(alone, "{error}");
    }
    for (line, key) in [
        ("port = \"/dev/ttyUSB0\"", "camera.port"),
        ("port = \"usb:1\"", "camera.port"),
        ("port = \"ptpip:10.0.0.1:80000\"", "camera.port"),
        ("port = \"ptpip::15740\"", "camera.port"),
        ("power_hook = [\" \", \"cycle\"]", "camera.power_hook[0]"),
    ] {
        let paper = SHIPPED[0].1.replacen("driver = \"gphoto2\"", &format!("driver = \"gphoto2\"\n{line}"), 1);
        assert_eq!(keys(&Rig::from_toml(&paper, "").unwrap_err()), [key], "{line}");
    }
    for port in ["usb:", "usb:001,005", "ptpip:127.0.0.1:15740:15740", "ptpip:camera.local"] {
        let line = format!("driver = \"gphoto2\"\nport = {port:?}");
        Rig::from_toml(&SHIPPED[0].1.replacen("driver = \"gphoto2\"", &line, 1), "").unwrap();
    }
    // A real arm lacks what its driver needs, and the simulated camera photographs the simulated arm only.
    let grbl = refused(&[("driver = \"simulated\"", "driver = \"grbl\"")]);
    assert_eq!(keys(&grbl), ["arm.port", "arm.grbl_lamp", "arm.grbl_zero_deg", "camera.driver"]);
    let low = "driver = \"grbl\"\nport = \"/dev/x\"\ngrbl_lamp = \"spindle\"\ngrbl_zero_deg = 0";
    assert_eq!(keys(&refused(&[("driver = \"simulated\"", low)])), ["camera.driver", "arm.grbl_zero_deg"]);
    let lamp = "driver = \"grbl\"\nport = \"/dev/x\"\ngrbl_lamp = \"coolant\"\ngrbl_zero_deg = 175";
    let coolant = refused(&[("driver = \"simulated\"", lamp)]);
    assert_eq!(keys(&coolant), ["lamp.level_permille", "camera.driver"]);
    let paper = SHIPPED[0].1.to_owned() + "\n[simulation]\nscene = \"wood\"\nseed = 1\nspeed = 1\n";
    assert_eq!(keys(&Rig::from_toml(&paper, "").unwrap_err()), ["simulation"]);
}

#[test]
fn a_reference_patch_must_be_seen_beside_the_object() {
    let with = |center: &str, normal: &str, diameter: &str| {
        let patch = format!("[reference_patch]\ncenter_mm = {center}\nnormal = {normal}\ndiameter_mm = {diameter}\n\n");
        Rig::from_toml(&simulated().replacen("[plan]", &(patch + "[plan]"), 1), "edited")
    };
    let (center, normal) = ("[-47, 25, 1460]", "[0.342, 0, -0.94]");
    let patch = with(center, normal, "22").unwrap().reference_patch.unwrap();
    assert_eq!((patch.center_mm, patch.normal, patch.diameter_mm), ([-47.0, 25.0, 1460.0], [0.342, 0.0, -0.94], 22.0));
    for (center, normal, diameter, key, says) in [
        (center, "[0, 0, 0.0]", "22", "reference_patch.normal", "has no length"),
        ("[-47, 25, -1460]", normal, "22", "reference_patch.center_mm", "before the camera"),
        ("[0, 0, 0]", normal, "22", "reference_patch.center_mm", "before the camera"),
        (center, "[0.342, 0, 0.94]", "22", "reference_patch.normal", "a cosine of -0.9"),
        (center, "[0.9, 0, -0.2]", "22", "reference_patch.normal", "a cosine of 0.2"),
        // Its left end is 64.3 mm left at a depth of 1456.2 mm, its right one 43.7 mm at 1463.8 mm.
        ("[-54, 25, 1460]", normal, "22", "reference_patch.center_mm", "spans x -2 to 46 px"),
        ("[-41, 25, 1460]", normal, "22", "reference_patch.center_mm", "x 78 to 210, y 30 to 162 px"),
        ("[-47, 55, 1460]", normal, "22", "reference_patch.center_mm", "outside the camera's view of 0 to 192 px"),
        (center, normal, "9", "reference_patch.diameter_mm", "is 19 px large along x"),
        (center, normal, "0", "reference_patch.diameter_mm", "must be above 0"),
    ] {
        let error = with(center, normal, diameter).unwrap_err();
        let reason = error.reasons.iter().find(|r| r.key == key).unwrap_or_else(|| panic!("{key}: {error}"));
        assert!(reason.what.contains(says), "{says}: {error}");
    }
}

#[test]
fn a_lamp_waits_two_minutes_to_be_steady_unless_told_otherwise() {
    let rig = |text: &str| Rig::from_toml(text, "edited").unwrap();
    let left_out = rig(&simulated().replacen("steady_s = 0.0\n", "", 1));
    assert_eq!((left_out.lamp.steady_s, left_out.lamp.rated_hours), (120.0, None));
    // Waits and the rated life may change while a session rests; lamp and patch may not.
    let now = rig(&simulated().replacen("steady_s = 0.0\n", "steady_s = 9.0\nrated_hours = 50.0\n", 1));
    assert!(left_out.sees_like(&now) && now.sees_like(&left_out));
    let brighter = rig(&simulated().replacen("[9.0e6, 8.0e6", "[9.1e6, 8.0e6", 1));
    let patch = "[reference_patch]\ncenter_mm = [-47, 25, 1460]\nnormal = [0, 0, -1]\ndiameter_mm = 22\n\n[plan]";
    let patched = rig(&simulated().replacen("[plan]", patch, 1));
    assert!(!left_out.sees_like(&brighter) && !left_out.sees_like(&patched) && patched.sees_like(&patched));
}

#[test]
fn text_that_is_no_toml_names_the_line() {
    let error = Rig::from_toml("name = \"a\"\n[arm\n", "x").unwrap_err();
    assert_eq!(keys(&error), ["line 2"]);
    let error = Rig::from_toml("", "x").unwrap_err();
    assert!(keys(&error).contains(&"camera") && keys(&error).contains(&"name"), "{error}");
}

#[test]
fn files_that_cannot_be_read_are_refused_by_name() {
    let folder = std::env::temp_dir().join(format!("rig-config-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let cases: [(&str, Option<Vec<u8>>, &str); 4] = [
        ("missing.toml", None, "cannot be opened"),
        ("latin1.toml", Some(b"name = \"caf\xe9\"".to_vec()), "UTF-8"),
        ("huge.toml", Some(vec![b'#'; (1 << 20) + 1]), "larger than"),
        ("good.toml", Some(simulated().into()), ""),
    ];
    for (name, bytes, says) in cases {
        let path = folder.join(name);
        if let Some(bytes) = bytes {
            std::fs::write(&path, bytes).unwrap();
        }
        match Rig::read(&path) {
            Ok(_) => assert_eq!(name, "good.toml"),
            Err(e) => assert!(!says.is_empty() && e.to_string().contains(says) && e.to_string().contains(name), "{e}"),
        }
    }
    assert!(Rig::read(&folder).is_err(), "a directory is no rig file");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// The schema describes what the reader accepts: every key of the shipped files is in it, and it forbids all others.
#[test]
fn schema_covers_the_shipped_files() {
    let schema = json_schema();
    assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema");
    assert!(!schema.to_string().contains("$ref"));
    for (name, text) in SHIPPED {
        let file: toml::Table = text.parse().unwrap();
        for (section, value) in file.iter().filter_map(|(k, v)| Some((k, v.as_table()?))) {
            let mut described = &schema["properties"][section];
            if let Some(any) = described["anyOf"].as_array() {
                described = &any[0];
            }
            assert_eq!(described["additionalProperties"], false, "{section}");
            for key in value.keys() {
                assert!(
                    described["properties"][key]["description"].is_string(),
                    "{name}: {section}.{key} is not described"
                );
            }
        }
    }
}

#[test]
fn whom_to_tell_is_checked_and_an_address_in_the_file_is_not_repeated() {
    let notify = |section: &str| Rig::from_toml(&format!("{}\n[notify]\n{section}", simulated()), "rig.toml");
    for (section, key, says) in [
        ("", "notify", "names nobody"),
        ("sendmail = \"/usr/bin/msmtp\"", "notify", "names nobody"),
        ("webhook_file = \"https://example.org/s3cret\"", "notify.webhook_file", "is an address"),
        ("ntfy_file = \"ntfy://s3cret\"", "notify.ntfy_file", "is an address"),
        ("webhook = \"https://example.org/s3cret\"", "notify.webhook", "unknown key"),
        ("mail_to = \"-oQ/tmp@host\"", "notify.mail_to", "NAME@HOST"),
        ("mail_to = \"a@b, c@d\"", "notify.mail_to", "NAME@HOST"),
        ("mail_to = \"nobody\"", "notify.mail_to", "NAME@HOST"),
        ("mail_to = \"a@b\"\nsendmail = \"\"", "notify.sendmail", "is empty"),
    ] {
        let error = notify(section).unwrap_err();
        let found = error.reasons.iter().any(|reason| reason.key == key && reason.what.contains(says));
        assert!(found && !error.to_string().contains("s3cret"), "{section}: {error}");
    }
    let told = notify("mail_to = \"night@example.org\"").unwrap().notify.unwrap();
    assert_eq!(
        (told.mail_to.as_deref(), told.sendmail.to_str()),
        (Some("night@example.org"), Some("/usr/sbin/sendmail"))
    );
    assert!(Rig::from_toml(simulated(), "").unwrap().notify.is_none());
}
