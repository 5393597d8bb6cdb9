//! Lights that stand in one place: they say the same, and none of them is a test of a fit to another.

use super::observations::{Observations, Sample};

/// Points at which lights are compared.
const COMPARED: usize = 50;

/// Angles of two lights that agree to this cosine or squared tangent, at every point, are those of one place.
const SAME: f64 = 1e-6;

/// Pairs of lights with the same angles at all of some points that both light; of three in one place, each with the first.
pub fn twins(observations: &Observations) -> Vec<(usize, usize)> {
    let points: Vec<Vec<Sample>> = {
        let some = observations.subset(COMPARED);
        (0..some.points()).map(|point| some.of(point).collect()).collect()
    };
    let same = |a: usize, b: usize| {
        let mut shared = points.iter().filter_map(|samples| {
            let of = |light| samples.iter().find(|s: &&Sample| s.light == light);
            Some((of(a)?.angles, of(b)?.angles))
        });
        let close = |x: f64, y: f64| (x - y).abs() <= SAME * x.abs().max(1.0);
        let mut any = false;
        let all = shared.all(|(x, y)| {
            any = true;
            close(x.cos_i, y.cos_i) && close(x.tan2_half, y.tan2_half) && close(x.cos_iv, y.cos_iv)
        });
        any && all
    };
    let twin_of = |b: usize| (0..b).find(|&a| same(a, b)).map(|a| (a, b));
    (0..observations.lights).filter_map(twin_of).collect()
}

/// Places in which lights with samples stand.
pub fn places(observations: &Observations) -> usize {
    // Each light that repeats an earlier one stands once among the twins.
    observations.lights_in_use().len().saturating_sub(twins(observations).len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::fit::observations::tests::synthetic;

    #[test]
    fn a_light_that_repeats_another_is_found() {
        let (observations, _) = synthetic(200, 1, 31);
        assert_eq!(twins(&observations), []);
        let mut doubled = Observations::new(observations.lights + 1);
        for point in 0..observations.points() {
            let mut samples: Vec<Sample> = observations.of(point).collect();
            let again = samples.iter().find(|s| s.light == 2).map(|s| Sample { light: observations.lights, ..*s });
            samples.extend(again);
            doubled.push(point, &samples);
        }
        assert_eq!(twins(&doubled), [(2, observations.lights)]);
    }
}
