//! Sensor noise: photon and read noise in units of normalised exposure.

/// Noise of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorNoise {
    /// Charge at saturation, electrons.
    pub full_well_e: f64,
    /// Read noise, electrons rms.
    pub read_noise_e: f64,
}
