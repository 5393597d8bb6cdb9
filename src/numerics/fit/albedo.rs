//! What the choice of points looks at: the diffuse albedo of a point, and how near it is to a highlight. Sixteen points at a
//! time, in f32.

use super::observations::{Observations, Row};
use crate::numerics::simd::{LANES, Lane, Level, Vector, Work};

/// A glance at a point.
#[derive(Clone, Copy, Debug)]
pub struct Glance {
    /// Mean of I / R with R = l_c cos(theta_i) / pi over the samples without the two brightest (paper 3.4), of at least one.
    pub albedo: [f64; 3],
    /// Least tan^2 of its half angles.
    pub least_tan2: f32,
}

/// A glance at every one of `points`, ascending.
pub fn glances(observations: &Observations, points: &[usize]) -> Vec<Glance> {
    let mut seen = Lanes { albedo: [[0.0; LANES]; 3], least_tan2: [0.0; LANES] };
    let mut block = None;
    let glance = |&point: &usize| {
        if block.replace(point / LANES) != Some(point / LANES) {
            let rows = &observations.rows()[observations.rows_of(point / LANES..point / LANES + 1)];
            Level::best().run(Block { rows, seen: &mut seen });
        }
        let lane = point % LANES;
        let albedo = std::array::from_fn(|c| f64::from(seen.albedo[c][lane]));
        Glance { albedo, least_tan2: seen.least_tan2[lane] }
    };
    points.iter().map(glance).collect()
}

/// Glances at the points of a block.
struct Lanes {
    albedo: [Lane; 3],
    least_tan2: Lane,
}

struct Block<'a> {
    rows: &'a [Row],
    seen: &'a mut Lanes,
}

impl Work for Block<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        for part in 0..LANES / V::WIDTH {
            glance::<V>(self.rows, part, self.seen);
        }
    }
}

/// A sample's brightness and I / R; zeros where there is none.
#[derive(Clone, Copy)]
struct Bright<V> {
    brightness: V,
    ratio: [V; 3],
}

#[inline(always)]
fn glance<V: Vector>(rows: &[Row], part: usize, seen: &mut Lanes) {
    let (zero, one) = (V::splat(0.0), V::splat(1.0));
    let mut count = zero;
    let mut least_tan2 = V::splat(f32::MAX);
    let mut sum = [zero; 3];
    let mut brightest = [Bright { brightness: zero, ratio: [zero; 3] }; 2];
    for row in rows {
        let present = V::load(&row.radiance[0], part).if_greater(zero, one, zero);
        let mut next = Bright { brightness: zero, ratio: [zero; 3] };
        for c in 0..3 {
            let radiance = V::load(&row.radiance[c], part);
            let ratio = radiance / (V::load(&row.irradiance[c], part) * V::splat(std::f32::consts::FRAC_1_PI));
            next.brightness = next.brightness + radiance;
            next.ratio[c] = present.if_greater(zero, ratio, zero);
        }
        for place in &mut brightest {
            exchange(place, &mut next);
        }
        // What is left over is not among the two brightest.
        for c in 0..3 {
            sum[c] = sum[c] + next.ratio[c];
        }
        count = count + present;
        let tan2 = V::load(&row.tan2_half, part);
        least_tan2 = present.if_greater(zero, least_tan2.if_greater(tan2, tan2, least_tan2), least_tan2);
    }
    let inverse = one / (count - V::splat(2.0)).max(one);
    let (several, many) = (V::splat(1.5), V::splat(2.5));
    for c in 0..3 {
        let few = count.if_greater(several, brightest[1].ratio[c], brightest[0].ratio[c]);
        count.if_greater(many, sum[c] * inverse, few).store(&mut seen.albedo[c], part);
    }
    least_tan2.store(&mut seen.least_tan2, part);
}

/// Leaves the brighter of the two in `place`.
#[inline(always)]
fn exchange<V: Vector>(place: &mut Bright<V>, next: &mut Bright<V>) {
    let (old, new) = (*place, *next);
    let (was, is) = (old.brightness, new.brightness);
    place.brightness = is.if_greater(was, is, was);
    next.brightness = is.if_greater(was, was, is);
    for c in 0..3 {
        place.ratio[c] = is.if_greater(was, new.ratio[c], old.ratio[c]);
        next.ratio[c] = is.if_greater(was, old.ratio[c], new.ratio[c]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::fit::initialise::{mean_albedo, without_highlights};
    use crate::numerics::fit::observations::tests::synthetic;

    #[test]
    fn gives_the_albedo_of_the_darker_samples_and_the_least_angle() {
        let (all, _) = synthetic(40, 2, 6);
        for lights in 1..=7 {
            let (observations, _) = all.filtered(1, |light| light < lights);
            let points: Vec<usize> = (0..observations.points()).collect();
            for (glance, &point) in glances(&observations, &points).iter().zip(&points) {
                let known = mean_albedo(&without_highlights(observations.of(point).collect()));
                for (found, known) in glance.albedo.iter().zip(known) {
                    assert!((found / known - 1.0).abs() < 1e-5, "{lights} lights");
                }
                let least = observations.of(point).map(|s| s.angles.tan2_half as f32).fold(f32::MAX, f32::min);
                assert_eq!(glance.least_tan2, least);
            }
        }
    }
}
