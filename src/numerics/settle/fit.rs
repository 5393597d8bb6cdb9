//! One frame's change as a sum of two patterns, by weighted least squares.

/// The two patterns, with the noise of every cell.
pub(super) struct Patterns {
    /// Change of level per degree, per cell.
    turn: Vec<f64>,
    /// Change of level per relative change of the lamp, but for the camera's curve.
    lamp: Vec<f64>,
    /// Precision of a cell.
    weights: Vec<f64>,
    /// Covariance of the two.
    covariance: [[f64; 2]; 2],
}

/// What a frame shows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Change {
    /// Turn of the arm, degrees.
    pub displacement_deg: f64,
    /// Relative change of the lamp.
    pub lamp: f64,
    /// Root mean square of what is left, over the cells' noise.
    pub rest: f64,
}

/// Patterns more alike than this cosine are not told apart.
const ALIKE: f64 = 0.9995;

impl Patterns {
    /// None when the patterns are the same, or one is nothing.
    pub fn new(turn: Vec<f64>, lamp: Vec<f64>, sigma: Vec<f64>) -> Option<Self> {
        let weights: Vec<f64> = sigma.iter().map(|s| 1.0 / (s * s)).collect();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).zip(&weights).map(|((a, b), w)| a * b * w).sum::<f64>();
        let (tt, tl, ll) = (dot(&turn, &turn), dot(&turn, &lamp), dot(&lamp, &lamp));
        let determinant = tt * ll - tl * tl;
        let sound = tt > 0.0 && ll > 0.0 && tl * tl < ALIKE * ALIKE * tt * ll;
        let covariance = [[ll / determinant, -tl / determinant], [-tl / determinant, tt / determinant]];
        sound.then_some(Self { turn, lamp, weights, covariance })
    }

    /// Standard deviation of a displacement by the cells' noise, degrees.
    pub fn sigma_deg(&self) -> f64 {
        self.covariance[0][0].sqrt()
    }

    /// Standard deviation of the lamp's relative change by the cells' noise.
    pub fn sigma_lamp(&self) -> f64 {
        self.covariance[1][1].sqrt()
    }

    /// Cells.
    pub fn cells(&self) -> usize {
        self.weights.len()
    }

    /// Degrees of freedom of the rest.
    pub fn freedom(&self) -> f64 {
        self.cells() as f64 - 2.0
    }

    /// What a difference of levels shows.
    pub fn explain(&self, levels: &[f64]) -> Change {
        let dot = |a: &[f64]| a.iter().zip(levels).zip(&self.weights).map(|((a, l), w)| a * l * w).sum::<f64>();
        let right = [dot(&self.turn), dot(&self.lamp)];
        let [turned, lamp] = self.covariance.map(|row| row[0] * right[0] + row[1] * right[1]);
        let patterns = self.turn.iter().zip(&self.lamp);
        let left = levels.iter().zip(patterns).map(|(level, (t, l))| level - turned * t - lamp * l);
        let squares: f64 = left.zip(&self.weights).map(|(left, w)| left * left * w).sum();
        Change { displacement_deg: turned, lamp, rest: (squares / self.freedom()).sqrt() }
    }
}
