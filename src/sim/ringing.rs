//! How the simulated arm swings after a move: the truth of a measured settle time.

use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};

/// A damped oscillation about where the motor stands: amplitude x exp(-t / decay) x sin(2 pi frequency t), t from the motor's stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ringing {
    /// After a move at the arm's greatest speed, degrees; after a slower one proportionally less.
    pub amplitude_deg: f64,
    /// Oscillations a second.
    pub frequency_hz: f64,
    /// Time in which it falls to 1/e, seconds; infinite: it never ends.
    pub decay_s: f64,
}

/// Separates this draw from that of scene, noise and hidden truth, which use the same seed.
const STREAM: u64 = 0x7377_696e;

impl Ringing {
    /// An arm of about a metre, drawn from the seed: some tenths of a degree at a few hertz, gone within seconds.
    pub fn of_seed(seed: u64) -> Self {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed ^ STREAM);
        Self {
            amplitude_deg: random.random_range(0.5..1.0),
            frequency_hz: random.random_range(1.5..4.0),
            decay_s: random.random_range(0.3..0.9),
        }
    }

    /// The same with another amplitude.
    #[must_use]
    pub fn scaled(self, by: f64) -> Self {
        Self { amplitude_deg: by * self.amplitude_deg, ..self }
    }

    /// Angle off the motor's, degrees, `since_stop_s` after its stop.
    pub fn at(&self, since_stop_s: f64) -> f64 {
        let phase = std::f64::consts::TAU * self.frequency_hz * since_stop_s;
        self.amplitude_deg * (-since_stop_s / self.decay_s).exp() * phase.sin()
    }
}
