//! Start of the fit (paper 3.4-3.5): diffuse albedo without the highlights, classes by hue, closed-form weights and
//! diffuse albedos per class (Eq. 5-8), Levenberg-Marquardt for the specular lobe per class (Eq. 9).

use super::kmeans::{self, Feature};
use super::levmar::Stop;
use super::objective::Objective;
use super::observations::{Observations, Sample};
use super::{Mixture, alpha};
use crate::numerics::brdf::{Lobe, Material};
use std::f64::consts::PI;

/// Where Eq. 9 starts; the paper does not say.
const SPECULAR_START: (f64, f64) = (0.1, 0.2);

/// Below this median saturation hue is noise: cluster by log-chromaticity and luminance instead.
const GREY_SATURATION: f64 = 0.08;

/// Stop rule of Eq. 9.
const EQ9_STOP: Stop = Stop { relative_decrease: 1e-13, iterations: 200 };

/// The samples of a point without its two brightest (paper 3.4); always at least one.
pub fn without_highlights(mut samples: Vec<Sample>) -> Vec<Sample> {
    let brightness = |s: &Sample| s.radiance.iter().sum::<f64>();
    samples.sort_by(|a, b| brightness(a).total_cmp(&brightness(b)).then(a.light.cmp(&b.light)));
    samples.truncate(samples.len().saturating_sub(2).max(1));
    samples
}

/// Mean Lambert albedo of some samples of a point: mean of I / R with R = l_c cos(theta_i) / pi (paper Eq. 5-6).
pub fn mean_albedo(samples: &[Sample]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for sample in samples {
        let ratio = ratio(sample);
        for c in 0..3 {
            sum[c] += ratio[c];
        }
    }
    sum.map(|s| s / samples.len() as f64)
}

/// I / R with R = l_c cos(theta_i) / pi per channel (paper Eq. 5-6).
fn ratio(sample: &Sample) -> [f64; 3] {
    std::array::from_fn(|c| sample.radiance[c] / (sample.irradiance[c] / PI))
}

/// Hue (turns) and saturation of an albedo.
fn hue_saturation(rgb: [f64; 3]) -> (f64, f64) {
    let max = rgb.iter().copied().fold(f64::MIN, f64::max);
    let min = rgb.iter().copied().fold(f64::MAX, f64::min);
    let chroma = max - min;
    if max <= 0.0 || chroma <= 0.0 {
        return (0.0, 0.0);
    }
    let [r, g, b] = rgb;
    let sector = if max == r {
        ((g - b) / chroma).rem_euclid(6.0)
    } else if max == g {
        (b - r) / chroma + 2.0
    } else {
        (r - g) / chroma + 4.0
    };
    (sector / 6.0, chroma / max)
}

/// Features the classes are made by: (cos 2 pi H, sin 2 pi H, S) of the albedo (paper 3.4); for grey objects, where hue
/// means nothing, (ln r/g, ln b/g, ln luminance), each scaled to unit deviation.
pub fn features(albedos: &[[f64; 3]]) -> Vec<Feature> {
    let mut saturations: Vec<f64> = albedos.iter().map(|&a| hue_saturation(a).1).collect();
    let middle = saturations.len() / 2;
    let grey =
        !saturations.is_empty() && *saturations.select_nth_unstable_by(middle, f64::total_cmp).1 < GREY_SATURATION;
    if grey { standardised(albedos.iter().map(log_chromaticity).collect()) } else { hue_features(albedos) }
}

fn hue_features(albedos: &[[f64; 3]]) -> Vec<Feature> {
    let feature = |&albedo: &[f64; 3]| {
        let (hue, saturation) = hue_saturation(albedo);
        let (sin, cos) = (2.0 * PI * hue).sin_cos();
        [cos, sin, saturation]
    };
    albedos.iter().map(feature).collect()
}

fn log_chromaticity([r, g, b]: &[f64; 3]) -> Feature {
    [(r / g).ln(), (b / g).ln(), ((r + g + b) / 3.0).ln()]
}

fn standardised(mut features: Vec<Feature>) -> Vec<Feature> {
    for i in 0..3 {
        let n = features.len() as f64;
        let mean = features.iter().map(|f| f[i]).sum::<f64>() / n;
        let deviation = (features.iter().map(|f| (f[i] - mean).powi(2)).sum::<f64>() / n).sqrt();
        for feature in &mut features {
            feature[i] = if deviation > 0.0 { (feature[i] - mean) / deviation } else { 0.0 };
        }
    }
    features
}

/// Weights and diffuse albedo of one class.
#[derive(Clone, Debug, PartialEq)]
pub struct Diffuse {
    /// Weight per point of the class, 1 for the brightest.
    pub gamma: Vec<f64>,
    /// Diffuse albedo.
    pub rho_d: [f64; 3],
}

/// The minimiser of paper Eq. 8 in the gauge gamma(p_max) = 1. With y = ln(I / R), every sample having its three channels,
/// the normal equations split: ln gamma_p = mean_p(y) - mean(ln rho), ln rho_c - mean(ln rho) = mean(y_c - row mean of y).
pub fn log_linear(points: &[Vec<Sample>]) -> Diffuse {
    let mut channel = [0.0; 3];
    let mut rows = 0.0;
    let mut log_gamma = Vec::with_capacity(points.len());
    for samples in points {
        let mut point_sum = 0.0;
        for sample in samples {
            let y: [f64; 3] = std::array::from_fn(|c| (sample.radiance[c] / (sample.irradiance[c] / PI)).ln());
            let row_mean = y.iter().sum::<f64>() / 3.0;
            for c in 0..3 {
                channel[c] += y[c] - row_mean;
            }
            point_sum += row_mean;
            rows += 1.0;
        }
        log_gamma.push(point_sum / samples.len() as f64);
    }
    let top = log_gamma.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let top = if top.is_finite() { top } else { 0.0 };
    Diffuse {
        gamma: log_gamma.iter().map(|g| (g - top).exp()).collect(),
        rho_d: channel.map(|sum| (sum / f64::max(rows, 1.0) + top).exp()),
    }
}

/// A class of points: its members and what Eq. 8 says of them.
pub struct Class {
    /// Indices of its points.
    pub members: Vec<usize>,
    /// Weights of the members and diffuse albedo.
    pub diffuse: Diffuse,
}

/// Sorts the points into classes and solves Eq. 8 for each.
pub fn classes(observations: &Observations, materials: usize) -> Vec<Class> {
    let mut diffuse: Vec<Vec<Sample>> =
        (0..observations.points()).map(|p| without_highlights(observations.of(p).collect())).collect();
    let albedos: Vec<[f64; 3]> = diffuse.iter().map(|samples| mean_albedo(samples)).collect();
    let class = kmeans::cluster(&features(&albedos), materials);
    (0..materials)
        .map(|m| {
            let members: Vec<usize> = (0..observations.points()).filter(|&p| class[p] == m).collect();
            let samples: Vec<Vec<Sample>> = members.iter().map(|&p| std::mem::take(&mut diffuse[p])).collect();
            Class { members, diffuse: log_linear(&samples) }
        })
        .collect()
}

/// The initial mixture of `materials` classes: each point belongs wholly to its class.
pub fn initialise(lobe: &dyn Lobe, observations: &Observations, materials: usize) -> Mixture {
    let mut mixture = Mixture { materials: Vec::new(), gamma: vec![0.0; observations.points() * materials] };
    for (m, class) in classes(observations, materials).iter().enumerate() {
        for (&point, &gamma) in class.members.iter().zip(&class.diffuse.gamma) {
            mixture.gamma[point * materials + m] = gamma;
        }
        mixture.materials.push(specular(lobe, observations, &class.members, &class.diffuse));
    }
    mixture
}

/// Paper Eq. 9: rho_s and beta of one class by Levenberg-Marquardt, diffuse albedo and weights fixed, absolute residuals.
pub fn specular(lobe: &dyn Lobe, observations: &Observations, members: &[usize], diffuse: &Diffuse) -> Material {
    let start = Material { rho_d: diffuse.rho_d, rho_s: [SPECULAR_START.0; 3], beta: SPECULAR_START.1 };
    if !lobe.has_lobe() || members.is_empty() {
        return Material { rho_s: [0.0; 3], ..start };
    }
    let class = observations.select(members);
    alpha::solve_specular(lobe, start, &diffuse.gamma, Objective::ABSOLUTE, &class, EQ9_STOP)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::brdf::ward::Ward;
    use crate::numerics::fit::observations::tests::synthetic;

    #[test]
    fn hue_matches_known_colours() {
        for (rgb, hue, saturation) in [
            ([1.0, 0.0, 0.0], 0.0, 1.0),
            ([1.0, 1.0, 0.0], 1.0 / 6.0, 1.0),
            ([0.0, 0.5, 0.0], 1.0 / 3.0, 1.0),
            ([0.2, 0.2, 0.4], 2.0 / 3.0, 0.5),
        ] {
            let (h, s) = hue_saturation(rgb);
            assert!((h - hue).abs() < 1e-12 && (s - saturation).abs() < 1e-12, "{rgb:?} gave {h} {s}");
        }
    }

    /// A purely diffuse single material is recovered exactly by Eq. 8.
    #[test]
    fn log_linear_recovers_a_lambert_ball() {
        let (observations, truth) = synthetic(60, 1, 2);
        let rho = truth.materials[0].rho_d;
        let lambert = |point: usize, sample: Sample| {
            let radiance = std::array::from_fn(|c| truth.gamma[point] * rho[c] / PI * sample.irradiance[c]);
            Sample { radiance, ..sample }
        };
        let points: Vec<Vec<Sample>> = (0..observations.points())
            .map(|point| observations.of(point).map(|sample| lambert(point, sample)).collect())
            .collect();
        let found = log_linear(&points);
        let top = truth.gamma.iter().copied().fold(0.0, f64::max);
        for c in 0..3 {
            assert!((found.rho_d[c] - rho[c] * top).abs() < 1e-12);
        }
        for (g, t) in found.gamma.iter().zip(&truth.gamma) {
            assert!((g - t / top).abs() < 1e-12);
        }
    }

    /// With the true weights and diffuse albedo, Eq. 9 returns the true lobe.
    #[test]
    fn specular_start_recovers_a_known_lobe() {
        let (observations, truth) = synthetic(80, 1, 4);
        let members: Vec<usize> = (0..observations.points()).collect();
        let diffuse = Diffuse { gamma: truth.gamma.clone(), rho_d: truth.materials[0].rho_d };
        let found = specular(&Ward, &observations, &members, &diffuse);
        assert!((found.beta / truth.materials[0].beta - 1.0).abs() < 1e-6, "{found:?}");
        for c in 0..3 {
            assert!((found.rho_s[c] / truth.materials[0].rho_s[c] - 1.0).abs() < 1e-6);
        }
    }
}
