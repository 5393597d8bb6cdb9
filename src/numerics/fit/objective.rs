//! Objectives: how much a residual of a sample counts.

use super::observations::Sample;

/// Standard deviation of what the model cannot say, relative to the radiance (METHOD 6: k).
pub const MODEL_FLOOR: f64 = 0.02;

/// What the fit minimises: the sum of weighted squared residuals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Objective {
    /// Absolute residuals (paper Eq. 2).
    Absolute,
    /// Residuals relative to the measured radiance (paper Eq. 11).
    Relative,
    /// Residuals over their standard deviation: variance of the sample plus (k I)^2.
    Noise,
}

impl Objective {
    /// Every objective with its name.
    pub const ALL: [(&'static str, Self); 3] =
        [("absolute", Self::Absolute), ("relative", Self::Relative), ("noise", Self::Noise)];

    /// The objective of this name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(known, _)| *known == name).map(|(_, objective)| *objective)
    }

    /// The objective's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Absolute => "absolute",
            Self::Relative => "relative",
            Self::Noise => "noise",
        }
    }

    /// Weight of the squared residual of each channel.
    pub fn weights(self, sample: &Sample) -> [f64; 3] {
        match self {
            Self::Absolute => [1.0; 3],
            Self::Relative => sample.radiance.map(|i| 1.0 / (i * i)),
            Self::Noise => noise_weights(sample),
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
