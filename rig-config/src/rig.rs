//! The validated description of a rig. Only [`crate::Rig`] values that passed every check exist outside this crate's reader.

use crate::Shutter;
use std::path::PathBuf;

/// A whole rig.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// Name for people and manifests.
    pub name: String,
    /// Who moves the light.
    pub arm: Arm,
    /// The lamp and where its arm carries it.
    pub lamp: Lamp,
    /// Who takes the pictures.
    pub camera: Camera,
    /// The sampled object.
    pub object: Sphere,
    /// What an acquisition does when the request says nothing else.
    pub plan: Plan,
    /// How the material is fitted.
    pub fit: Fit,
    /// What tells how bright the lamp is at every station; none: nothing does.
    pub reference_patch: Option<ReferencePatch>,
    /// What a calibration run uses; none: there are no calibration runs.
    pub calibration: Option<Calibration>,
    /// Where sessions are kept.
    pub storage: Storage,
    /// Where the daemon listens.
    pub server: Server,
    /// Whom the daemon tells; none: nobody.
    pub notify: Option<Notify>,
    /// The simulated world; present exactly when a driver is `simulated`.
    pub simulation: Option<Simulation>,
}

/// How the arm is reached.
#[derive(Clone, Debug, PartialEq)]
pub enum ArmDriver {
    /// Our own firmware (firmware-protocol) on a serial port.
    Rigproto {
        /// Device path, best under /dev/serial/by-id.
        port: PathBuf,
    },
    /// GRBL on a serial port.
    Grbl {
        /// Device path.
        port: PathBuf,
        /// The output the lamp hangs on.
        lamp: GrblLamp,
        /// The arm's angle at machine position 0, degrees.
        zero_deg: f64,
    },
    /// The simulated arm: the firmware's own handler behind a PTY.
    Simulated,
}

/// The output of a GRBL controller that feeds the lamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GrblLamp {
    /// Spindle: any level.
    Spindle,
    /// Flood coolant: on or off.
    Coolant,
}

/// The motorised arm.
#[derive(Clone, Debug, PartialEq)]
pub struct Arm {
    /// How it is reached.
    pub driver: ArmDriver,
    /// Line speed, baud.
    pub baud: u32,
    /// Greatest speed, degrees per second.
    pub speed_deg_s: f64,
    /// Acceleration, degrees per second squared.
    pub acceleration_deg_s2: f64,
    /// Permitted angles, degrees, lower and upper.
    pub travel_deg: [f64; 2],
    /// A station is reached when the status is this close, degrees.
    pub tolerance_deg: f64,
    /// Wait after every move before the first exposure, seconds.
    pub settle_s: f64,
    /// Where the arm rests after a session, degrees.
    pub park_deg: f64,
    /// Longest time homing may take, seconds.
    pub home_timeout_s: f64,
}

/// The lamp: level, warm-up, and geometry of its circle.
#[derive(Clone, Debug, PartialEq)]
pub struct Lamp {
    /// Level during a session, permille of full.
    pub level_permille: u16,
    /// Warm-up before the first exposure, seconds.
    pub soak_s: f64,
    /// The lamp must change by less than 0.3 % in this time before a session's first bracket, seconds; 0: nobody looks.
    pub steady_s: f64,
    /// Rated life, hours, if stated.
    pub rated_hours: Option<f64>,
    /// Centre of the circle the lamp travels on, camera frame, mm.
    pub circle_center_mm: [f64; 3],
    /// Radius of that circle, mm.
    pub circle_radius_mm: f64,
    /// Radiant intensity per channel, radiance units x mm^2: irradiance at distance d (mm) is intensity / d^2.
    pub intensity: [f64; 3],
}

impl Lamp {
    /// Position of the lamp, camera frame (x right, y down, z away), mm, with the arm at `angle_deg`:
    /// angle 0 lies between object and camera, positive angles turn towards +x, about the vertical axis.
    pub fn position_mm(&self, angle_deg: f64) -> [f64; 3] {
        let (sin, cos) = angle_deg.to_radians().sin_cos();
        let [x, y, z] = self.circle_center_mm;
        [x + self.circle_radius_mm * sin, y, z - self.circle_radius_mm * cos]
    }

    /// The lamp with the waits and the rated life of another: frames do not depend on them.
    #[must_use]
    pub fn waiting_like(&self, other: &Self) -> Self {
        let Self { soak_s, steady_s, rated_hours, .. } = *other;
        Self { soak_s, steady_s, rated_hours, ..self.clone() }
    }
}

/// A matt, evenly grey, flat piece fixed beside the object, camera frame, mm.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferencePatch {
    /// Middle of the circle on it that is looked at.
    pub center_mm: [f64; 3],
    /// Out of its lit side; any length.
    pub normal: [f64; 3],
    /// Diameter of that circle.
    pub diameter_mm: f64,
}

impl Rig {
    /// True when arm or camera is simulated: nothing it yields counts as measured.
    pub fn is_simulated(&self) -> bool {
        self.arm.driver == ArmDriver::Simulated || self.camera.driver == CameraDriver::Simulated
    }

    /// True when frames of both rigs belong together: one kind of arm, one lamp, one camera, one object and patch. Ports, speeds, waits, plans and
    /// the like may differ.
    pub fn sees_like(&self, other: &Self) -> bool {
        let angle = |rig: &Self| match &rig.arm.driver {
            ArmDriver::Rigproto { .. } => (1, 0.0),
            ArmDriver::Grbl { zero_deg, .. } => (2, *zero_deg),
            ArmDriver::Simulated => (3, 0.0),
        };
        let camera = |rig: &Self| Camera { driver: CameraDriver::Simulated, ..rig.camera.clone() };
        let world = |rig: &Self| rig.simulation.clone().map(|world| Simulation { speed: 1.0, ..world });
        angle(self) == angle(other)
            && self.lamp == other.lamp.waiting_like(&self.lamp)
            && camera(self) == camera(other)
            && self.object == other.object
            && self.reference_patch == other.reference_patch
            && world(self) == world(other)
    }
}

/// How the camera is reached.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraDriver {
    /// libgphoto2 through the camera worker process.
    Gphoto2 {
        /// Model as libgphoto2 spells it.
        model: Option<String>,
        /// Port as libgphoto2 spells it.
        port: Option<String>,
        /// Program and arguments that switch the camera's power off and on; none where nothing can.
        power_hook: Option<Vec<String>>,
    },
    /// Plays a folder of frames.
    Replay {
        /// The folder.
        directory: PathBuf,
    },
    /// The simulated camera.
    Simulated,
}

/// The camera: driver, optics (pinhole, camera frame), sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// How it is reached.
    pub driver: CameraDriver,
    /// Frame width, pixels.
    pub width: usize,
    /// Frame height, pixels.
    pub height: usize,
    /// Focal length, pixels, x and y.
    pub focal_px: [f64; 2],
    /// Principal point, pixels.
    pub principal_px: [f64; 2],
    /// Distortion k1 k2 p1 p2 k3 (Brown).
    pub distortion: [f64; 5],
    /// Aperture used throughout, f-number.
    pub f_number: f64,
    /// ISO speed used throughout.
    pub iso: u32,
    /// Charge at saturation, electrons.
    pub full_well_e: f64,
    /// Read noise, electrons rms.
    pub read_noise_e: f64,
}

/// The sampled sphere, camera frame, mm.
#[derive(Clone, Debug, PartialEq)]
pub struct Sphere {
    /// Centre.
    pub center_mm: [f64; 3],
    /// Radius.
    pub radius_mm: f64,
}

/// The rig's own acquisition plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Light stations: arm angles, degrees, in shooting order; with a reference patch a session may shoot them in another.
    pub stations_deg: Vec<f64>,
    /// The bracket, in shooting order.
    pub exposures: Vec<Shutter>,
}

/// How the material is fitted; names are those of `rigd fit --help`, checked by the composition root.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// Number of materials; none lets left-out lights decide.
    pub materials: Option<usize>,
    /// BRDF model name.
    pub model: String,
    /// Colour of the lobe, by name.
    pub lobe: String,
    /// Whether light gains are fitted, by name.
    pub gains: String,
    /// Solver name.
    pub solver: String,
    /// Objective name.
    pub objective: String,
    /// Samples with cos theta_i or cos theta_r at or below this are not used.
    pub cosine_cutoff: f64,
}

/// What a calibration run puts on the stage, and what it shoots.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// Inner corners of the chessboard along its one side.
    pub board_columns: usize,
    /// Inner corners along the other.
    pub board_rows: usize,
    /// Side of a square, mm.
    pub square_mm: f64,
    /// Views of the board; the card comes to lie on the board of the last one.
    pub board_views: usize,
    /// Exposure of the board.
    pub board_exposure: Shutter,
    /// Arm angle that lights the board, degrees.
    pub board_station_deg: f64,
    /// Diffuse reflectance of the grey card.
    pub card_reflectance: f64,
    /// Its relative standard deviation.
    pub card_reflectance_sigma: f64,
    /// Shorter side of the card, mm.
    pub card_side_mm: f64,
    /// How many balls stand on the stage.
    pub balls: usize,
    /// Radius of every ball, mm.
    pub ball_radius_mm: f64,
    /// Arm angles at which balls and card are shot, degrees.
    pub stations_deg: Vec<f64>,
    /// The bracket of balls and card, in shooting order.
    pub exposures: Vec<Shutter>,
    /// A calibration older than this is stale, days.
    pub max_age_days: f64,
}

/// Where sessions are kept.
#[derive(Clone, Debug, PartialEq)]
pub struct Storage {
    /// Directory of all sessions.
    pub data: PathBuf,
    /// Bytes kept free for journal and shutdown.
    pub reserve_bytes: u64,
    /// A session that the daemon's end interrupted goes on at its next start.
    pub resume_at_start: bool,
    /// Days after which a completed and verified session is removed; none: never.
    pub keep_days: Option<f64>,
}

/// Where the daemon listens.
#[derive(Clone, Debug, PartialEq)]
pub struct Server {
    /// Address and port; loopback only, unless there are tokens.
    pub listen: std::net::SocketAddr,
    /// File of the tokens that clients need; none: no token is needed.
    pub tokens: Option<PathBuf>,
    /// What TLS is spoken with; none: plain HTTP.
    pub tls: Option<TlsFiles>,
}

/// PEM files of the server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TlsFiles {
    /// The certificate, those that vouch for it after it.
    pub certificate: PathBuf,
    /// Its private key.
    pub key: PathBuf,
}

/// Whom the daemon tells that a session has ended or cannot go on: at least one of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Notify {
    /// File of the address that takes JSON.
    pub webhook_file: Option<PathBuf>,
    /// File of the address of an ntfy topic.
    pub ntfy_file: Option<PathBuf>,
    /// E-mail address.
    pub mail_to: Option<String>,
    /// The program that takes e-mail.
    pub sendmail: PathBuf,
}

/// Which simulated object stands in the rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scene {
    /// Marble ball: veins of a second material, sharp lobes.
    Marble,
    /// Striped wooden ball: soft lobes.
    Wood,
}

/// The simulated world.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulation {
    /// The object.
    pub scene: Scene,
    /// Seed of the scene's texture and of all noise.
    pub seed: u64,
    /// How many times faster than real motion, exposure and waiting pass.
    pub speed: f64,
    /// True if the rig file states camera, lamp and object only roughly: the truth is drawn from the seed about it.
    pub hidden: bool,
    /// True if the arm swings after a move; how is drawn from the seed.
    pub ringing: bool,
}
