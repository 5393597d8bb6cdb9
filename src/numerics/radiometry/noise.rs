//! Sensor noise: photon and read noise in units of normalised exposure.

/// Noise of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorNoise {
    /// Charge at saturation, electrons.
    pub full_well_e: f64,
    /// Read noise, electrons rms.
    pub read_noise_e: f64,
}

impl SensorNoise {
    /// Variance of an exposure (unit squared) of which `saturation` (same unit) fills the well: photon plus read noise.
    pub fn exposure_variance(&self, exposure: f64, saturation: f64) -> f64 {
        let per_electron = saturation / self.full_well_e;
        exposure.max(0.0) * per_electron + (self.read_noise_e * per_electron).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variance_in_electrons_is_charge_plus_squared_read_noise() {
        let noise = SensorNoise { full_well_e: 80_000.0, read_noise_e: 30.0 };
        // One exposure unit is 20 000 e-: half a unit is 10 000 e- with a variance of 10 000 + 900 e-^2.
        let variance = noise.exposure_variance(0.5, 4.0);
        assert!((variance * 20_000.0_f64.powi(2) - 10_900.0).abs() < 1e-6);
    }
}
