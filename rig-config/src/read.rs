//! Reading a rig file: text -> table -> checked keys -> checked contradictions -> [`Rig`].

use crate::raw::{RawArmDriver, RawCalibration, RawCameraDriver, RawGrblLamp, RawRig, RawScene, SCHEMA};
use crate::rig::*;
use crate::{Shutter, check, contradictions};
use std::fmt;
use std::io::Read;
use std::path::Path;

/// Largest rig file read, bytes; the shipped ones have 4 000.
const LARGEST_FILE: u64 = 1 << 20;

/// One reason why a rig file is refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reason {
    /// Where: the key path (`plan.exposures[3]`), `line N` for text that is no TOML, empty for the file itself.
    pub key: String,
    /// What is wrong there and what to do.
    pub what: String,
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.key.is_empty() { f.write_str(&self.what) } else { write!(f, "{}: {}", self.key, self.what) }
    }
}

/// Why a rig file is refused: every reason at once.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub struct ReadError {
    /// The file, or what else the text came from.
    pub origin: String,
    /// At least one reason, in the order of the checks.
    pub reasons: Vec<Reason>,
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.reasons.as_slice() {
            [only] => write!(f, "{}: {only}", self.origin),
            reasons => {
                write!(f, "{}: {} mistakes", self.origin, reasons.len())?;
                reasons.iter().try_for_each(|reason| write!(f, "\n  {reason}"))
            }
        }
    }
}

impl Rig {
    /// Reads and checks a rig file.
    ///
    /// # Errors
    /// The file cannot be read, is no UTF-8 or TOML, or describes no possible rig; all reasons at once.
    pub fn read(path: &Path) -> Result<Self, ReadError> {
        Self::from_toml(&Self::read_text(path)?, &path.display().to_string())
    }

    /// The text of a rig file, not yet checked.
    ///
    /// # Errors
    /// The file cannot be read, is too large, or no UTF-8.
    pub fn read_text(path: &Path) -> Result<String, ReadError> {
        let origin = path.display().to_string();
        let refuse =
            |what: String| ReadError { origin: origin.clone(), reasons: vec![Reason { key: String::new(), what }] };
        let file = std::fs::File::open(path)
            .map_err(|e| refuse(format!("cannot be opened ({e}): give the path of a rig file; `rigd config show simulated > rig.toml` writes one to start from")))?;
        let mut bytes = Vec::new();
        file.take(LARGEST_FILE + 1)
            .read_to_end(&mut bytes)
            .map_err(|e| refuse(format!("cannot be read ({e}): give the path of a rig file")))?;
        if bytes.len() as u64 > LARGEST_FILE {
            return Err(refuse(format!("is larger than {LARGEST_FILE} bytes: this is no rig file")));
        }
        String::from_utf8(bytes)
            .map_err(|e| refuse(format!("is no UTF-8 text at byte {}: save it as UTF-8", e.utf8_error().valid_up_to())))
    }

    /// Checks the text of a rig file; `origin` names it in the error.
    ///
    /// # Errors
    /// The text is no TOML or describes no possible rig; all reasons at once.
    pub fn from_toml(text: &str, origin: &str) -> Result<Self, ReadError> {
        let refuse = |reasons| ReadError { origin: origin.to_owned(), reasons };
        let table: toml::Table = text.parse().map_err(|e| refuse(vec![syntax(text, &e)]))?;
        let value = toml::Value::Table(table);
        let mut reasons = Vec::new();
        check::check(&value, &SCHEMA, "", &mut reasons);
        contradictions::check(&value, &mut reasons);
        if !reasons.is_empty() {
            return Err(refuse(reasons));
        }
        // The checks above leave nothing for serde to refuse; if they ever do, it is still an answer and no panic.
        let left_over = |what: String| refuse(vec![Reason { key: String::new(), what }]);
        let raw: RawRig = value.try_into().map_err(|e: toml::de::Error| left_over(e.message().to_owned()))?;
        raw.into_rig().map_err(left_over)
    }
}

fn syntax(text: &str, error: &toml::de::Error) -> Reason {
    let at = error.span().map_or(0, |span| span.start);
    let line = 1 + text.bytes().take(at).filter(|b| *b == b'\n').count();
    Reason { key: format!("line {line}"), what: format!("is no TOML: {}", error.message()) }
}

impl RawRig {
    fn into_rig(self) -> Result<Rig, String> {
        let Self { name, arm, lamp, camera, object, plan, fit, .. } = self;
        let Self { reference_patch, calibration, storage, server, notify, simulation, .. } = self;
        let port = || arm.port.clone().map(Into::into).ok_or("arm.port is missing");
        let arm_driver = match arm.driver {
            RawArmDriver::Rigproto => ArmDriver::Rigproto { port: port()? },
            RawArmDriver::Grbl => ArmDriver::Grbl {
                port: port()?,
                lamp: match arm.grbl_lamp.ok_or("arm.grbl_lamp is missing")? {
                    RawGrblLamp::Spindle => GrblLamp::Spindle,
                    RawGrblLamp::Coolant => GrblLamp::Coolant,
                },
                zero_deg: arm.grbl_zero_deg.ok_or("arm.grbl_zero_deg is missing")?,
            },
            RawArmDriver::Simulated => ArmDriver::Simulated,
        };
        let camera_driver = match camera.driver {
            RawCameraDriver::Gphoto2 => {
                CameraDriver::Gphoto2 { model: camera.model, port: camera.port, power_hook: camera.power_hook }
            }
            RawCameraDriver::Replay => {
                CameraDriver::Replay { directory: camera.directory.ok_or("camera.directory is missing")? }
            }
            RawCameraDriver::Simulated => CameraDriver::Simulated,
        };
        let plan = Plan { exposures: bracket(&plan.exposures)?, stations_deg: plan.stations_deg };
        let calibration = calibration.map(|calibration| calibration.with_plan(&plan)).transpose()?;
        Ok(Rig {
            name,
            arm: Arm {
                driver: arm_driver,
                baud: arm.baud,
                speed_deg_s: arm.speed_deg_s,
                acceleration_deg_s2: arm.acceleration_deg_s2,
                travel_deg: arm.travel_deg,
                tolerance_deg: arm.tolerance_deg,
                settle_s: arm.settle_s,
                park_deg: arm.park_deg,
                home_timeout_s: arm.home_timeout_s,
            },
            lamp: Lamp {
                level_permille: lamp.level_permille,
                soak_s: lamp.soak_s,
                steady_s: lamp.steady_s,
                rated_hours: lamp.rated_hours,
                circle_center_mm: lamp.circle_center_mm,
                circle_radius_mm: lamp.circle_radius_mm,
                intensity: lamp.intensity,
            },
            camera: Camera {
                driver: camera_driver,
                width: camera.width,
                height: camera.height,
                focal_px: camera.focal_px,
                principal_px: camera.principal_px,
                distortion: camera.distortion,
                f_number: camera.f_number,
                iso: camera.iso,
                full_well_e: camera.full_well_e,
                read_noise_e: camera.read_noise_e,
            },
            object: Sphere { center_mm: object.center_mm, radius_mm: object.radius_mm },
            plan,
            fit: Fit {
                materials: fit.materials,
                model: fit.model,
                lobe: fit.lobe,
                gains: fit.gains,
                solver: fit.solver,
                objective: fit.objective,
                cosine_cutoff: fit.cosine_cutoff,
            },
            reference_patch: reference_patch.map(ReferencePatch::from),
            calibration,
            storage: Storage {
                data: storage.data,
                reserve_bytes: storage.reserve_bytes,
                resume_at_start: storage.resume_at_start,
                keep_days: storage.keep_days,
            },
            server: Server {
                listen: server.listen.parse().map_err(|e| format!("server.listen: {e}"))?,
                tokens: server.tokens,
                tls: server.certificate.zip(server.key).map(|(certificate, key)| TlsFiles { certificate, key }),
            },
            notify: notify.map(|n| Notify {
                webhook_file: n.webhook_file,
                ntfy_file: n.ntfy_file,
                mail_to: n.mail_to,
                sendmail: n.sendmail,
            }),
            simulation: simulation.map(|s| Simulation {
                scene: match s.scene {
                    RawScene::Marble => Scene::Marble,
                    RawScene::Wood => Scene::Wood,
                },
                seed: s.seed,
                speed: s.speed,
                hidden: s.hidden,
                ringing: s.ringing,
            }),
        })
    }
}

fn bracket(labels: &[String]) -> Result<Vec<Shutter>, String> {
    labels.iter().map(|label| Shutter::from_label(label).map_err(|e| e.to_string())).collect()
}

impl RawCalibration {
    /// Stations and bracket that are left out are those of the plan.
    fn with_plan(self, plan: &Plan) -> Result<Calibration, String> {
        let exposures = match &self.exposures {
            Some(labels) => bracket(labels)?,
            None => plan.exposures.clone(),
        };
        Ok(Calibration {
            board_columns: self.board_columns,
            board_rows: self.board_rows,
            square_mm: self.square_mm,
            board_views: self.board_views,
            board_exposure: Shutter::from_label(&self.board_exposure).map_err(|e| e.to_string())?,
            board_station_deg: self.board_station_deg,
            card_reflectance: self.card_reflectance,
            card_reflectance_sigma: self.card_reflectance_sigma,
            card_side_mm: self.card_side_mm,
            balls: self.balls,
            ball_radius_mm: self.ball_radius_mm,
            stations_deg: self.stations_deg.unwrap_or_else(|| plan.stations_deg.clone()),
            exposures,
            max_age_days: self.max_age_days,
        })
    }
}
