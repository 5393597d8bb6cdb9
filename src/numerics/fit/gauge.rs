//! The gauge: gamma_m -> a gamma_m, rho_m -> rho_m / a leaves every radiance alone.

use super::Mixture;

/// Brings a mixture to its normal form: the largest gamma of each material is 1, and materials are ordered by their share
/// of the total weighted albedo, largest first. A material without any weight keeps its parameters and comes last.
pub fn normalise(mixture: &mut Mixture) {
    let count = mixture.materials.len();
    for m in 0..count {
        let largest = mixture.gamma.iter().skip(m).step_by(count).copied().fold(0.0, f64::max);
        if largest > 0.0 {
            scale(mixture, m, 1.0 / largest);
        }
    }
    let mut order: Vec<usize> = (0..count).collect();
    let share: Vec<f64> = (0..count).map(|m| share_of(mixture, m)).collect();
    order.sort_by(|&a, &b| share[b].total_cmp(&share[a]).then(a.cmp(&b)));
    mixture.materials = order.iter().map(|&m| mixture.materials[m]).collect();
    let old = mixture.gamma.clone();
    for point in 0..old.len() / count.max(1) {
        for (new, &m) in order.iter().enumerate() {
            mixture.gamma[point * count + new] = old[point * count + m];
        }
    }
}

/// Multiplies the weights of material `m` by `factor` and divides its albedos by it.
pub fn scale(mixture: &mut Mixture, m: usize, factor: f64) {
    let count = mixture.materials.len();
    for gamma in mixture.gamma.iter_mut().skip(m).step_by(count) {
        *gamma *= factor;
    }
    let material = &mut mixture.materials[m];
    for c in 0..3 {
        material.rho_d[c] /= factor;
        material.rho_s[c] /= factor;
    }
}

/// Sum over the points of gamma_m times the mean diffuse albedo: how much of the object material `m` makes up.
pub fn share_of(mixture: &Mixture, m: usize) -> f64 {
    let count = mixture.materials.len();
    let weight: f64 = mixture.gamma.iter().skip(m).step_by(count).sum();
    weight * mixture.materials[m].rho_d.iter().sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::brdf::ward::Ward;
    use crate::numerics::fit::observations::tests::synthetic;
    use crate::numerics::fit::predict;

    #[test]
    fn normal_form_keeps_every_radiance() {
        let (observations, mut mixture) = synthetic(50, 3, 9);
        scale(&mut mixture, 1, 7.0);
        let before = mixture.clone();
        normalise(&mut mixture);
        for m in 0..3 {
            let largest = mixture.gamma.iter().skip(m).step_by(3).copied().fold(0.0, f64::max);
            assert!((largest - 1.0).abs() < 1e-12);
        }
        for point in 0..observations.points() {
            for sample in observations.of(point) {
                let old = predict(&Ward, &before.materials, before.weights_of(point), &sample);
                let new = predict(&Ward, &mixture.materials, mixture.weights_of(point), &sample);
                for c in 0..3 {
                    assert!((old[c] / new[c] - 1.0).abs() < 1e-12);
                }
            }
        }
    }
}
