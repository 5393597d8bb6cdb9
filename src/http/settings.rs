//! What the daemon was started with, without anything that is secret.

use super::HttpState;
use axum::extract::State;
use rig_config::{ArmDriver, CameraDriver, Rig};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use utoipa::ToSchema;

/// A token of the daemon's; the token itself is known to nobody here.
#[derive(Serialize, Deserialize, ToSchema)]
pub(super) struct TokenEntry {
    /// Its line in the file of tokens, from 1: tokens have no other name.
    line: usize,
    /// `read` or `control`.
    scope: String,
}

/// Somebody who is told; where is a secret.
#[derive(Serialize, Deserialize, ToSchema)]
pub(super) struct NotifyEntry {
    /// `webhook`, `ntfy` or `mail`.
    target: String,
    /// Messages that it took.
    sent: u64,
    /// Messages that were given up.
    failed: u64,
}

/// A key of the rig file and its value in effect.
#[derive(Serialize, Deserialize, ToSchema)]
pub(super) struct Setting {
    /// As in the rig file.
    key: String,
    /// What holds: from the rig file, its default, or the command line.
    #[schema(value_type = Value)]
    value: Value,
}

/// The settings in effect.
#[derive(Serialize, Deserialize, ToSchema)]
pub(super) struct Settings {
    /// Version of the daemon.
    version: String,
    /// What this build has beyond the usual: `raw`, `libjpeg-turbo`, `tls`.
    features: Vec<String>,
    /// The rig file; null where the program brought it along.
    file: Option<String>,
    /// Tokens, in the order of their file; empty: none is needed.
    tokens: Vec<TokenEntry>,
    /// Who is told.
    notifications: Vec<NotifyEntry>,
    /// Keys and values.
    settings: Vec<Setting>,
    /// How each kind of setting is changed, in words: none of them while the daemon runs.
    changes: Vec<String>,
}

/// Settings
///
/// The configuration in effect. Tokens, addresses of notifications, mail addresses, commands and keys are left out.
#[utoipa::path(get, path = "/v1/settings", tag = "rig", responses((status = 200, body = Settings, description = "The settings.")))]
pub(super) async fn settings(State(state): State<HttpState>) -> axum::Json<Settings> {
    let features = [
        ("raw", cfg!(feature = "raw")),
        ("libjpeg-turbo", cfg!(feature = "libjpeg-turbo")),
        ("tls", cfg!(feature = "tls")),
    ];
    let tokens = state.tokens.entries().map(|(line, scope)| TokenEntry { line, scope: scope.name().into() });
    let told = state.notifications.iter();
    axum::Json(Settings {
        version: env!("CARGO_PKG_VERSION").into(),
        features: features.iter().filter(|(_, there)| *there).map(|(name, _)| (*name).into()).collect(),
        file: state.rig_file.as_ref().map(|path| path.display().to_string()),
        tokens: tokens.collect(),
        notifications: told
            .map(|count| NotifyEntry { target: count.target.into(), sent: count.sent(), failed: count.failed() })
            .collect(),
        settings: values(&state.rig).into_iter().map(|(key, value)| Setting { key: key.into(), value }).collect(),
        changes: changes(&state),
    })
}

fn changes(state: &HttpState) -> Vec<String> {
    let file = state.rig_file.as_ref().map_or("the rig file".to_owned(), |path| path.display().to_string());
    vec![
        format!(
            "settings: edit {file}, check it with `rigd config check {file}`, then restart the daemon (`systemctl restart rigd`): a session that runs goes on if the rig file still describes its rig"
        ),
        "tokens: edit the file that server.tokens or the unit's LoadCredential= names, then restart the daemon".to_owned(),
        "notifications: [notify] names files of addresses; `rigd notify` sends a test message".to_owned(),
        "one session alone: stations, exposures, calibration and adaptive capture can be given when it is started or queued; how it is fitted, with POST .../fit".to_owned(),
    ]
}

fn values(rig: &Rig) -> Vec<(&'static str, Value)> {
    let (arm, lamp, camera, plan, fit) = (&rig.arm, &rig.lamp, &rig.camera, &rig.plan, &rig.fit);
    let mut all = vec![("name", json!(rig.name))];
    match &arm.driver {
        ArmDriver::Rigproto { port } => all.extend([("arm.driver", json!("rigproto")), ("arm.port", json!(port))]),
        ArmDriver::Grbl { port, .. } => all.extend([("arm.driver", json!("grbl")), ("arm.port", json!(port))]),
        ArmDriver::Simulated => all.push(("arm.driver", json!("simulated"))),
    }
    all.extend([
        ("arm.speed_deg_s", json!(arm.speed_deg_s)),
        ("arm.travel_deg", json!(arm.travel_deg)),
        ("arm.tolerance_deg", json!(arm.tolerance_deg)),
        ("arm.settle_s", json!(arm.settle_s)),
        ("arm.park_deg", json!(arm.park_deg)),
        ("lamp.level_permille", json!(lamp.level_permille)),
        ("lamp.soak_s", json!(lamp.soak_s)),
        ("lamp.steady_s", json!(lamp.steady_s)),
        ("lamp.rated_hours", json!(lamp.rated_hours)),
    ]);
    match &camera.driver {
        CameraDriver::Gphoto2 { model, port, power_hook } => all.extend([
            ("camera.driver", json!("gphoto2")),
            ("camera.model", json!(model)),
            ("camera.port", json!(port)),
            ("camera.power_hook", json!(power_hook.as_ref().map(|_| "set"))),
        ]),
        CameraDriver::Replay { directory } => {
            all.extend([("camera.driver", json!("replay")), ("camera.directory", json!(directory))]);
        }
        CameraDriver::Simulated => all.push(("camera.driver", json!("simulated"))),
    }
    all.extend([
        ("camera.width", json!(camera.width)),
        ("camera.height", json!(camera.height)),
        ("camera.f_number", json!(camera.f_number)),
        ("camera.iso", json!(camera.iso)),
        ("plan.stations_deg", json!(plan.stations_deg)),
        ("plan.exposures", json!(plan.exposures.iter().map(|e| e.label.as_str()).collect::<Vec<_>>())),
        ("fit.materials", json!(fit.materials)),
        ("fit.model", json!(fit.model)),
        ("fit.lobe", json!(fit.lobe)),
        ("fit.gains", json!(fit.gains)),
        ("fit.solver", json!(fit.solver)),
        ("fit.objective", json!(fit.objective)),
        ("fit.cosine_cutoff", json!(fit.cosine_cutoff)),
        ("storage.data", json!(rig.storage.data)),
        ("storage.reserve_bytes", json!(rig.storage.reserve_bytes)),
        ("storage.resume_at_start", json!(rig.storage.resume_at_start)),
        ("storage.keep_days", json!(rig.storage.keep_days)),
        ("server.listen", json!(rig.server.listen)),
        ("server.tokens", json!(rig.server.tokens)),
        ("server.certificate", json!(rig.server.tls.as_ref().map(|tls| &tls.certificate))),
    ]);
    if let Some(calibration) = &rig.calibration {
        all.push(("calibration.max_age_days", json!(calibration.max_age_days)));
    }
    if let Some(simulation) = &rig.simulation {
        all.extend([("simulation.seed", json!(simulation.seed)), ("simulation.speed", json!(simulation.speed))]);
    }
    all
}
