//! The rig file as it is written. These types are the one owner of key names, types, bounds and defaults: the reader checks
//! against the schema derived from them, and `rigd config schema` prints it.

mod daemon;

pub(crate) use daemon::{RawNotify, RawServer, RawStorage};

use crate::patch::RawReferencePatch;
use schemars::JsonSchema;
use serde::Deserialize;
use std::path::PathBuf;
use std::sync::LazyLock;

/// JSON Schema (draft 2020-12) of the rig file.
pub fn json_schema() -> serde_json::Value {
    SCHEMA.clone()
}

/// The schema, made once; no `$ref`, so that it can be walked beside the file.
pub(crate) static SCHEMA: LazyLock<serde_json::Value> = LazyLock::new(|| {
    let mut settings = schemars::generate::SchemaSettings::draft2020_12();
    settings.inline_subschemas = true;
    settings.into_generator().into_root_schema_for::<RawRig>().to_value()
});

/// A capture rig: the arm that carries the lamp, the camera, the object, and what an acquisition does.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "rigd rig file")]
pub(crate) struct RawRig {
    /// Name for people and manifests.
    #[schemars(length(min = 1, max = 100))]
    pub name: String,
    pub arm: RawArm,
    pub lamp: RawLamp,
    pub camera: RawCamera,
    pub object: RawObject,
    pub plan: RawPlan,
    pub fit: RawFit,
    pub reference_patch: Option<RawReferencePatch>,
    pub calibration: Option<RawCalibration>,
    pub storage: RawStorage,
    #[serde(default)]
    pub server: RawServer,
    pub notify: Option<RawNotify>,
    pub simulation: Option<RawSimulation>,
}

#[derive(Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RawArmDriver {
    Rigproto,
    Grbl,
    Simulated,
}

#[derive(Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RawGrblLamp {
    Spindle,
    Coolant,
}

/// The motorised arm that carries the lamp.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawArm {
    /// How the arm is reached.
    pub driver: RawArmDriver,
    /// Serial device, best under /dev/serial/by-id; for rigproto and grbl.
    #[schemars(length(min = 1, max = 4096))]
    pub port: Option<String>,
    /// Line speed, baud.
    #[serde(default = "default_baud")]
    #[schemars(range(min = 1200, max = 4_000_000))]
    pub baud: u32,
    /// The output of a GRBL controller that feeds the lamp: spindle (any level) or coolant (on or off); for grbl.
    pub grbl_lamp: Option<RawGrblLamp>,
    /// The arm's angle at GRBL's machine position 0, the upper end of its travel, degrees; for grbl.
    #[schemars(range(min = -720, max = 720))]
    pub grbl_zero_deg: Option<f64>,
    /// Greatest speed, degrees per second.
    #[schemars(range(min = 0.001, max = 1000))]
    pub speed_deg_s: f64,
    /// Acceleration, degrees per second squared.
    #[schemars(range(min = 0.001, max = 10000))]
    pub acceleration_deg_s2: f64,
    /// Permitted angles, degrees: lower, upper.
    #[schemars(inner(range(min = -360, max = 360)))]
    pub travel_deg: [f64; 2],
    /// A station is reached when the arm's status is this close, degrees.
    #[schemars(range(max = 10), extend("exclusiveMinimum" = 0))]
    pub tolerance_deg: f64,
    /// Wait after every move before the first exposure, seconds.
    #[schemars(range(min = 0, max = 600))]
    pub settle_s: f64,
    /// Where the arm rests after a session, degrees.
    #[schemars(range(min = -360, max = 360))]
    pub park_deg: f64,
    /// Longest time homing may take, seconds.
    #[schemars(range(max = 3600), extend("exclusiveMinimum" = 0))]
    pub home_timeout_s: f64,
}

fn default_baud() -> u32 {
    115_200
}

/// The lamp: level, warm-up, and geometry of its circle.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawLamp {
    /// Level during a session, permille of full.
    #[schemars(range(min = 1, max = 1000))]
    pub level_permille: u16,
    /// Warm-up before the first exposure, seconds.
    #[schemars(range(min = 0, max = 86400))]
    pub soak_s: f64,
    /// After the warm-up a session's first bracket waits until the lamp changes by less than 0.3 % in this time, seconds; 0: it does not.
    #[serde(default = "default_steady")]
    #[schemars(range(min = 0, max = 3600))]
    pub steady_s: f64,
    /// The lamp's rated life, hours: from 70 % of it on, sessions warn.
    #[schemars(range(max = 1.0e6), extend("exclusiveMinimum" = 0))]
    pub rated_hours: Option<f64>,
    /// Centre of the circle the lamp travels on, camera frame (x right, y down, z away), mm.
    #[schemars(inner(range(min = -1.0e5, max = 1.0e5)))]
    pub circle_center_mm: [f64; 3],
    /// Radius of that circle, mm.
    #[schemars(range(max = 1.0e5), extend("exclusiveMinimum" = 0))]
    pub circle_radius_mm: f64,
    /// Radiant intensity (red, green, blue), radiance units x mm^2: irradiance at distance d (mm) is intensity / d^2.
    #[schemars(inner(range(min = 1.0e-12, max = 1.0e12)))]
    pub intensity: [f64; 3],
}

/// Two minutes: three readings a minute apart.
fn default_steady() -> f64 {
    120.0
}

#[derive(Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RawCameraDriver {
    Gphoto2,
    Replay,
    Simulated,
}

/// The camera: driver, optics (pinhole, camera frame), sensor.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawCamera {
    /// How the camera is reached.
    pub driver: RawCameraDriver,
    /// Model as libgphoto2 spells it; for gphoto2, any body if left out.
    #[schemars(length(min = 1, max = 200))]
    pub model: Option<String>,
    /// Port as libgphoto2 spells it (`usb:001,005`, `ptpip:127.0.0.1:15740`); for gphoto2, any port if left out.
    #[schemars(length(min = 1, max = 200))]
    pub port: Option<String>,
    /// Program and arguments that switch the camera's power off and on (a relay on its AC adapter), run when nothing else brings it back;
    /// for gphoto2.
    #[schemars(length(min = 1, max = 32))]
    pub power_hook: Option<Vec<String>>,
    /// Folder of frames to play; for replay.
    #[schemars(length(min = 1, max = 4096))]
    pub directory: Option<PathBuf>,
    /// Frame width, pixels.
    #[schemars(range(min = 16, max = 20000))]
    pub width: usize,
    /// Frame height, pixels.
    #[schemars(range(min = 16, max = 20000))]
    pub height: usize,
    /// Focal length, pixels: x, y.
    #[schemars(inner(range(min = 1, max = 1.0e7)))]
    pub focal_px: [f64; 2],
    /// Principal point, pixels: x, y.
    #[schemars(inner(range(min = -1.0e5, max = 1.0e5)))]
    pub principal_px: [f64; 2],
    /// Distortion k1 k2 p1 p2 k3 (Brown); none if left out.
    #[serde(default)]
    #[schemars(inner(range(min = -1.0e4, max = 1.0e4)))]
    pub distortion: [f64; 5],
    /// Aperture used throughout, f-number.
    #[schemars(range(min = 0.5, max = 128))]
    pub f_number: f64,
    /// ISO speed used throughout.
    #[schemars(range(min = 1, max = 1_000_000))]
    pub iso: u32,
    /// Charge at saturation, electrons.
    #[schemars(range(min = 100, max = 1.0e7))]
    pub full_well_e: f64,
    /// Read noise, electrons rms.
    #[schemars(range(min = 0, max = 1.0e4))]
    pub read_noise_e: f64,
}

/// The sampled sphere, camera frame.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawObject {
    /// Centre, mm.
    #[schemars(inner(range(min = -1.0e5, max = 1.0e5)))]
    pub center_mm: [f64; 3],
    /// Radius, mm.
    #[schemars(range(max = 1.0e4), extend("exclusiveMinimum" = 0))]
    pub radius_mm: f64,
}

/// What an acquisition does when the request says nothing else.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawPlan {
    /// Light stations: arm angles, degrees, in shooting order; with a `reference_patch` those that go one way are shot out, back and out
    /// again.
    #[schemars(length(min = 1, max = 1000), inner(range(min = -360, max = 360)))]
    pub stations_deg: Vec<f64>,
    /// The bracket: shutter labels as the body writes them (1/100, 0.6, 15), in shooting order.
    #[schemars(length(min = 1, max = 55))]
    pub exposures: Vec<String>,
}

/// How the material is fitted.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawFit {
    /// Number of materials; left-out lights decide if left out.
    #[schemars(range(min = 1, max = 16))]
    pub materials: Option<usize>,
    /// BRDF model, a name of `rigd fit --help`.
    #[schemars(length(min = 1, max = 64))]
    pub model: String,
    /// Colour of the lobe, a name of `rigd fit --help`.
    #[serde(default = "default_choice")]
    #[schemars(length(min = 1, max = 64))]
    pub lobe: String,
    /// Light gains, a name of `rigd fit --help`.
    #[serde(default = "default_choice")]
    #[schemars(length(min = 1, max = 64))]
    pub gains: String,
    /// Solver, a name of `rigd fit --help`.
    #[schemars(length(min = 1, max = 64))]
    pub solver: String,
    /// Objective, a name of `rigd fit --help`.
    #[schemars(length(min = 1, max = 64))]
    pub objective: String,
    /// Samples with cos theta_i or cos theta_r at or below this are not used.
    #[schemars(range(min = 0, max = 0.9))]
    pub cosine_cutoff: f64,
}

/// What a calibration run puts on the stage: board, card and balls. Without the section there are no calibration runs.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawCalibration {
    /// Inner corners of the chessboard along its one side, where four squares meet.
    #[schemars(range(min = 3, max = 60))]
    pub board_columns: usize,
    /// Inner corners along the other side.
    #[schemars(range(min = 3, max = 60))]
    pub board_rows: usize,
    /// Side of a square, mm.
    #[schemars(range(max = 1000), extend("exclusiveMinimum" = 0))]
    pub square_mm: f64,
    /// Views of the board; the card comes to lie on the board of the last one.
    #[serde(default = "default_views")]
    #[schemars(range(min = 3, max = 100))]
    pub board_views: usize,
    /// Shutter label at which the board's white is bright and not clipped.
    pub board_exposure: String,
    /// Arm angle that lights the board, degrees.
    #[schemars(range(min = -360, max = 360))]
    pub board_station_deg: f64,
    /// Diffuse reflectance of the grey card.
    #[serde(default = "default_grey")]
    #[schemars(range(max = 1), extend("exclusiveMinimum" = 0))]
    pub card_reflectance: f64,
    /// Its relative standard deviation.
    #[serde(default = "default_grey_sigma")]
    #[schemars(range(min = 0, max = 0.5))]
    pub card_reflectance_sigma: f64,
    /// Shorter side of the card, mm.
    #[schemars(range(max = 1000), extend("exclusiveMinimum" = 0))]
    pub card_side_mm: f64,
    /// How many balls stand on the stage.
    #[serde(default = "default_balls")]
    #[schemars(range(min = 2, max = 12))]
    pub balls: usize,
    /// Radius of every ball by caliper, mm.
    #[schemars(range(max = 1000), extend("exclusiveMinimum" = 0))]
    pub ball_radius_mm: f64,
    /// Arm angles at which balls and card are shot, degrees; those of the plan if left out.
    #[schemars(length(min = 1, max = 1000), inner(range(min = -360, max = 360)))]
    pub stations_deg: Option<Vec<f64>>,
    /// The bracket of balls and card, shutter labels in shooting order; that of the plan if left out.
    #[schemars(length(min = 3, max = 55))]
    pub exposures: Option<Vec<String>>,
    /// A calibration older than this is named in the warnings, days.
    #[serde(default = "default_age")]
    #[schemars(range(max = 100_000), extend("exclusiveMinimum" = 0))]
    pub max_age_days: f64,
}

fn default_views() -> usize {
    12
}

fn default_balls() -> usize {
    3
}

fn default_grey() -> f64 {
    0.18
}

/// An unmeasured card's grey is off by this much.
fn default_grey_sigma() -> f64 {
    0.05
}

fn default_age() -> f64 {
    30.0
}

/// Left-out lights choose.
fn default_choice() -> String {
    "auto".to_owned()
}

#[derive(Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RawScene {
    Marble,
    Wood,
}

/// The simulated world; only with a simulated driver.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawSimulation {
    /// Which object stands in the rig.
    pub scene: RawScene,
    /// Seed of the scene's texture and of all noise.
    #[schemars(range(min = 0, max = 9_007_199_254_740_991_i64))]
    pub seed: u64,
    /// How many times faster than real motion, exposure and waiting pass.
    #[schemars(range(min = 0.1, max = 10000))]
    pub speed: f64,
    /// Whether this file states camera, lamp and object only roughly: the truth is drawn from the seed about it, for calibrations
    /// to find. Left out: it states them exactly.
    #[serde(default)]
    pub hidden: bool,
    /// Whether the arm swings after a move, by amplitude, frequency and decay drawn from the seed, for `rigd calibrate settle` to find.
    /// Left out: it stands at once.
    #[serde(default)]
    pub ringing: bool,
}
