//! K-means with a deterministic start: far-apart seeds, then Lloyd's iteration.

/// A feature vector of a point.
pub type Feature = [f64; 3];

const ITERATIONS: usize = 100;

/// Class of every feature, `0..classes`. Seeds: the feature farthest from the mean, then always the one farthest from all
/// seeds so far, measured at the 99th percentile of distance so that a single outlier is no seed.
pub fn cluster(features: &[Feature], classes: usize) -> Vec<usize> {
    let mut centers = seeds(features, classes);
    let mut class = assign(features, &centers);
    for _ in 0..ITERATIONS {
        update(features, &class, &mut centers);
        let next = assign(features, &centers);
        if next == class {
            break;
        }
        class = next;
    }
    class
}

fn distance2(a: &Feature, b: &Feature) -> f64 {
    (0..3).map(|i| (a[i] - b[i]) * (a[i] - b[i])).sum()
}

fn mean<'a>(features: impl Iterator<Item = &'a Feature>) -> Option<Feature> {
    let mut sum = [0.0; 3];
    let mut count = 0.0;
    for feature in features {
        for i in 0..3 {
            sum[i] += feature[i];
        }
        count += 1.0;
    }
    (count > 0.0).then(|| sum.map(|s| s / count))
}

fn seeds(features: &[Feature], classes: usize) -> Vec<Feature> {
    let Some(center) = mean(features.iter()) else { return vec![[0.0; 3]; classes] };
    let mut chosen: Vec<Feature> = Vec::new();
    while chosen.len() < classes {
        let nearest = |f: &Feature| {
            chosen.iter().map(|s| distance2(f, s)).fold(None, |best: Option<f64>, d| Some(best.map_or(d, |b| b.min(d))))
        };
        let mut far: Vec<(f64, usize)> = features
            .iter()
            .enumerate()
            .map(|(i, f)| (nearest(f).unwrap_or_else(|| distance2(f, &center)), i))
            .collect();
        let rank = (far.len() - 1) * 99 / 100;
        let (_, (_, seed), _) = far.select_nth_unstable_by(rank, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        chosen.push(features[*seed]);
    }
    chosen
}

fn assign(features: &[Feature], centers: &[Feature]) -> Vec<usize> {
    let nearest = |feature: &Feature| {
        let mut best = (f64::INFINITY, 0);
        for (index, center) in centers.iter().enumerate() {
            let d = distance2(feature, center);
            if d < best.0 {
                best = (d, index);
            }
        }
        best.1
    };
    features.iter().map(nearest).collect()
}

fn update(features: &[Feature], class: &[usize], centers: &mut [Feature]) {
    for (index, center) in centers.iter_mut().enumerate() {
        let members = features.iter().zip(class).filter(|(_, c)| **c == index).map(|(f, _)| f);
        if let Some(moved) = mean(members) {
            *center = moved;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng, rngs::StdRng};

    #[test]
    fn separates_clouds_of_unequal_size() {
        let mut rng = StdRng::seed_from_u64(5);
        let homes = [[0.0, 0.0, 0.0], [3.0, 0.0, 1.0], [0.0, 4.0, -1.0]];
        let mut features = Vec::new();
        let mut truth = Vec::new();
        for (home, count) in [(0, 500), (1, 60), (2, 200)] {
            for _ in 0..count {
                features.push(std::array::from_fn(|i| homes[home][i] + rng.random_range(-0.8..0.8)));
                truth.push(home);
            }
        }
        let class = cluster(&features, 3);
        for i in 0..features.len() {
            for j in 0..features.len() {
                assert_eq!(truth[i] == truth[j], class[i] == class[j]);
            }
        }
    }

    #[test]
    fn survives_equal_features() {
        assert_eq!(cluster(&[[1.0; 3]; 10], 2).len(), 10);
    }
}
