//! The gauge: gamma_m -> a gamma_m, rho_m -> rho_m / a leaves every radiance alone.

use super::{MAX_MATERIALS, Mixture};
use crate::numerics::brdf::Material;

/// Brings a mixture to its normal form: the largest gamma of each material is 1, and materials are ordered by their share
/// of the total weighted albedo, largest first. A material without any weight keeps its parameters and comes last.
pub fn normalise(mixture: &mut Mixture) {
    let count = mixture.materials.len();
    let mut largest = [0.0_f64; MAX_MATERIALS];
    for gamma in mixture.gamma.chunks_exact(count.max(1)) {
        for (most, &weight) in largest.iter_mut().zip(gamma) {
            *most = most.max(weight);
        }
    }
    let factor = largest.map(|most| if most > 0.0 { 1.0 / most } else { 1.0 });
    let share = shares(mixture);
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&a, &b| share[b].total_cmp(&share[a]).then(a.cmp(&b)));
    mixture.materials = order.iter().map(|&m| scaled(&mixture.materials[m], factor[m])).collect();
    // In place: the weights of millions of points are not copied for this.
    for gamma in mixture.gamma.chunks_exact_mut(count.max(1)) {
        let mut old = [0.0; MAX_MATERIALS];
        old[..count].copy_from_slice(gamma);
        for (weight, &m) in gamma.iter_mut().zip(&order) {
            *weight = old[m] * factor[m];
        }
    }
}

/// The material whose weights are multiplied by `factor`.
fn scaled(material: &Material, factor: f64) -> Material {
    let over = |albedo: [f64; 3]| albedo.map(|value| value / factor);
    Material { rho_d: over(material.rho_d), rho_s: over(material.rho_s), ..*material }
}

/// For every material, the sum over the points of gamma_m times its mean diffuse albedo: how much of the object it makes up,
/// whatever the gauge.
pub fn shares(mixture: &Mixture) -> Vec<f64> {
    let mut sum = [0.0; MAX_MATERIALS];
    for gamma in mixture.gamma.chunks_exact(mixture.materials.len().max(1)) {
        for (sum, &weight) in sum.iter_mut().zip(gamma) {
            *sum += weight;
        }
    }
    mixture.materials.iter().zip(sum).map(|(material, weight)| weight * material.rho_d.iter().sum::<f64>()).collect()
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
        mixture.materials[1] = scaled(&mixture.materials[1], 7.0);
        mixture.gamma.iter_mut().skip(1).step_by(3).for_each(|gamma| *gamma *= 7.0);
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
