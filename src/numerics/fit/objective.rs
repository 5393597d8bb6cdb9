//! Objectives: how much a residual of a sample counts.

use super::observations::Sample;

/// Standard deviation of what the model cannot say, relative to the radiance.
pub const MODEL_FLOOR: f64 = 0.02;

/// Cauchy's scale in standard deviations (noise and model floor together). At 2.385 it is 95 % as efficient as least squares
/// where errors are normal (Rey 1983); at this scale relighting of sound scenes is as good as with least squares within
/// 0.2 %, and 5 % of outliers cost 5 % more than at 2.385.
pub const CAUCHY_SCALE: f64 = 3.5;

/// What a residual is measured by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measure {
    /// Absolute residuals (paper Eq. 2).
    Absolute,
    /// Residuals relative to the measured radiance (paper Eq. 11).
    Relative,
    /// Residuals over their standard deviation: variance of the sample plus (k I)^2, k = [`MODEL_FLOOR`].
    Noise,
}

/// What the fit minimises: the sum of the squared residuals r^2, or, with `cauchy`, of `s^2 ln(1 + r^2 / s^2)`, under which
/// an outlier pulls less the farther it lies. The scale s is [`CAUCHY_SCALE`] standard deviations: of the noise, or of 2 %
/// of the radiance, or, for absolute residuals, of 2 % of the root mean square radiance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Objective {
    /// What a residual is measured by.
    pub measure: Measure,
    /// True: Cauchy's function of it, not its square.
    pub cauchy: bool,
}

impl Objective {
    /// Eq. 2 of the paper.
    pub const ABSOLUTE: Self = Self { measure: Measure::Absolute, cauchy: false };
    /// Eq. 11 of the paper.
    pub const RELATIVE: Self = Self { measure: Measure::Relative, cauchy: false };
    /// Noise-weighted.
    pub const NOISE: Self = Self { measure: Measure::Noise, cauchy: false };
    /// Noise-weighted and robust: the default.
    pub const NOISE_CAUCHY: Self = Self { measure: Measure::Noise, cauchy: true };

    /// Every objective with its name.
    pub const ALL: [(&'static str, Self); 6] = [
        ("absolute", Self::ABSOLUTE),
        ("relative", Self::RELATIVE),
        ("noise", Self::NOISE),
        ("absolute-cauchy", Self { cauchy: true, ..Self::ABSOLUTE }),
        ("relative-cauchy", Self { cauchy: true, ..Self::RELATIVE }),
        ("noise-cauchy", Self::NOISE_CAUCHY),
    ];

    /// The objective of this name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(known, _)| *known == name).map(|(_, objective)| *objective)
    }

    /// The objective's name.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, known)| *known == self).map_or("", |(name, _)| name)
    }

    /// Cauchy's scale in units of the weighted residual; none for plain squares. `brightness` is the root mean square
    /// radiance.
    pub fn cauchy_scale(self, brightness: f64) -> Option<f64> {
        let deviation = match self.measure {
            Measure::Absolute => MODEL_FLOOR * brightness,
            Measure::Relative => MODEL_FLOOR,
            Measure::Noise => 1.0,
        };
        self.cauchy.then_some(CAUCHY_SCALE * deviation)
    }

    /// Square of the radiance, in deviations, from which on these are taken to be in proportion to the radiance; none where
    /// they never are. A bracket collects about the same number of photons at every radiance it reaches, so its relative
    /// noise is constant; where a sample's own variance exceeds that of the model floor, it is no longer taken for that.
    pub fn proportional(self) -> Option<f32> {
        match self.measure {
            Measure::Absolute => None,
            Measure::Relative => Some(0.5),
            Measure::Noise => Some((0.5 / (MODEL_FLOOR * MODEL_FLOOR)) as f32),
        }
    }

    /// Weight of the squared residual of each channel.
    pub fn weights(self, sample: &Sample) -> [f64; 3] {
        match self.measure {
            Measure::Absolute => [1.0; 3],
            Measure::Relative => sample.radiance.map(|i| 1.0 / (i * i)),
            Measure::Noise => noise_weights(sample),
        }
    }
}

/// 1 / (variance + (k I)^2) per channel.
pub fn noise_weights(sample: &Sample) -> [f64; 3] {
    std::array::from_fn(|c| {
        let floor = MODEL_FLOOR * sample.radiance[c];
        1.0 / (sample.variance[c] + floor * floor)
    })
}
