//! The simulated camera's tone curves: what level a charge becomes.

/// Tone curve of a channel: power with a straight toe (as sRGB), then a contrast curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tone {
    /// Exponent: 2.2 is a usual monitor's.
    pub power: f64,
    /// Where the straight part ends; the curve's slope at black is finite.
    pub toe: f64,
    /// Depth of the contrast curve, 0 to 0.5.
    pub contrast: f64,
}

/// The curves of the rig whose file hides nothing.
pub const NOMINAL: [Tone; 3] = [
    Tone { power: 2.30, toe: 0.050, contrast: 0.16 },
    Tone { power: 2.20, toe: 0.055, contrast: 0.20 },
    Tone { power: 2.10, toe: 0.060, contrast: 0.12 },
];

impl Tone {
    /// Level (0 to 255) of a charge (0 to 1, 1 = full well); strictly increasing.
    pub fn level(&self, charge: f64) -> f64 {
        let (low, high) = (self.toe.powf(self.power), (1.0 + self.toe).powf(self.power));
        let v = (low + charge * (high - low)).powf(1.0 / self.power) - self.toe;
        255.0 * (v + self.contrast * v * (1.0 - v) * (2.0 * v - 1.0))
    }

    /// The charge of a level, by bisection.
    pub fn charge(&self, level: f64) -> f64 {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.level(middle) < level { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    /// Exposure of a level, 1 at level 128: what a measured response says.
    pub fn exposure(&self, level: usize) -> f64 {
        self.charge(level as f64) / self.charge(128.0)
    }

    /// The lowest level whose charge is ten times the noise of one sample (photons and read noise, electrons): below, one sample says
    /// little.
    pub fn lowest_used(&self, full_well_e: f64, read_noise_e: f64) -> usize {
        let clear = |level: &usize| {
            let electrons = self.charge(*level as f64) * full_well_e;
            electrons > 10.0 * (electrons + read_noise_e * read_noise_e).sqrt()
        };
        (1..128).find(clear).unwrap_or(128)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_rise_from_0_to_255_and_differ() {
        for curve in &NOMINAL {
            assert!(curve.level(0.0).abs() < 1e-9 && (curve.level(1.0) - 255.0).abs() < 1e-9);
            let levels: Vec<f64> = (0..=1000).map(|i| curve.level(f64::from(i) / 1000.0)).collect();
            assert!(levels.windows(2).all(|step| step[0] < step[1]));
        }
        assert!((NOMINAL[0].charge(60.0) / NOMINAL[2].charge(60.0) - 1.0).abs() > 0.02);
    }
}
