//! The simulated world before a simulated EOS 5D Mark II: what its sensor sees while its shutter is open.

use super::camera::SimulatedCamera;
use crate::devices::Cancel;
use crate::devices::camera::{Camera, Shot};
use rig_config::Shutter;
use simulated_eos::{ExposureSettings, Picture, PictureKind, Sensor};

/// Makes the body's JPEG files. It has no raw files to give.
pub struct EosSensor(SimulatedCamera);

impl EosSensor {
    /// A sensor that sees what `camera` sees.
    pub fn new(camera: SimulatedCamera) -> Self {
        Self(camera.calling_itself("Canon EOS 5D Mark II"))
    }
}

impl Sensor for EosSensor {
    fn expose(&mut self, settings: &ExposureSettings) -> Vec<Picture> {
        let Ok(shutter) = Shutter::from_label(settings.shutter.label) else { return Vec::new() };
        let shot =
            Shot { station: 0, exposure: 0, shutter, f_number: settings.aperture.f_number, iso: settings.iso.speed };
        let file = self.0.shoot(&shot, &Cancel::default());
        file.into_iter().map(|frame| Picture { bytes: frame.bytes, kind: PictureKind::Jpeg }).collect()
    }
}
