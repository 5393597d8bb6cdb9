//! The bracket of an adaptive session, exposure by exposure.

use super::{Next, OpenBracket, PipelineProcessing, read_frame};
use crate::numerics::geometry::{Light, Projection, Sphere};
use crate::numerics::radiometry::noise::SensorNoise;
use crate::pipeline::develop::BracketFrame;
use crate::pipeline::metering::{Advice, Lit, Metering};
use crate::session::calibration::file::CalibrationFile;
use crate::session::crop;
use crate::session::plan::LEAST_EXPOSURES;

/// Cosine of reflection above which samples are looked at while the sample is yet to be found: the rig file's outline may be off.
const INSIDE: f64 = 0.4;

impl PipelineProcessing {
    pub(super) fn next_exposure(&mut self, bracket: &OpenBracket) -> Result<Next, String> {
        let mut order: Vec<usize> = (0..bracket.exposures.len()).collect();
        order.sort_by(|&a, &b| bracket.exposures[a].true_s.total_cmp(&bracket.exposures[b].true_s));
        let (session, number) = (&bracket.session, bracket.number);
        let kept = self.open.take().filter(|open| (&open.0, open.1) == (session, number) && is_of(&open.2, bracket));
        let mut metering = match kept {
            Some((.., metering)) => metering,
            None => self.begin(bracket)?,
        };
        for frame in &bracket.frames[metering.seen().count()..] {
            let bytes = read_frame(&bracket.directory, frame)?;
            let frame = BracketFrame { name: &frame.file, bytes: &bytes, time_s: frame.true_s };
            metering.look(&frame).map_err(|e| e.to_string())?;
        }
        let advice = metering.advice(LEAST_EXPOSURES);
        self.open = Some((session.clone(), number, metering));
        match advice {
            Advice::Enough(worth) => Ok(Next::Enough(worth)),
            Advice::Shoot(at) => order.get(at).copied().map(Next::Shoot).ok_or_else(|| other_bracket(bracket)),
        }
    }

    /// Nothing is shot yet: where the sample is lit by what is known, and through which response it is seen.
    fn begin(&self, bracket: &OpenBracket) -> Result<Metering, String> {
        let known = self.known.as_ref().filter(|(session, _)| *session == bracket.session).map(|(_, known)| known);
        let known = known.ok_or("the response is not known: the first station is not developed")?;
        if known.expected_s.len() != bracket.exposures.len() {
            return Err(other_bracket(bracket));
        }
        let calibration = CalibrationFile::of_session(&bracket.directory)?;
        let rig = calibration.as_ref().map_or_else(|| self.rig.clone(), |calibration| calibration.applied(&self.rig));
        let crop = crop::of_session(&rig, calibration.is_some()).ok_or("the rig file does not show the sample")?;
        let (camera, cutoff) = (&rig.camera, rig.fit.cosine_cutoff);
        let lit = Lit {
            projection: &Projection::Pinhole {
                focal_px: camera.focal_px,
                principal_px: camera.principal_px,
                distortion: camera.distortion,
            },
            sphere: &Sphere { center: rig.object.center_mm.into(), radius: rig.object.radius_mm },
            light: &Light::Point { position: bracket.station.light_position_mm.into(), intensity: [1.0; 3] },
            crop,
            cos_i: cutoff,
            cos_r: if calibration.is_some() { cutoff.max(INSIDE) } else { cutoff },
        };
        let noise = SensorNoise { full_well_e: camera.full_well_e, read_noise_e: camera.read_noise_e };
        Ok(Metering::new(known, &noise, &lit))
    }
}

/// True when the frames that were looked at are the first of the bracket.
fn is_of(metering: &Metering, bracket: &OpenBracket) -> bool {
    let mut frames = bracket.frames.iter();
    metering.seen().all(|name| frames.next().is_some_and(|frame| frame.file == name))
}

fn other_bracket(bracket: &OpenBracket) -> String {
    format!("the first station was developed from other exposures than the {} of the plan", bracket.exposures.len())
}
