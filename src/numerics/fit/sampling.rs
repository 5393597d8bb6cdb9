//! Which points settle the BRDF parameters: few are enough, if rare materials and highlights are among them.

use super::albedo::glances;
use super::initialise::features;
use super::kmeans;
use super::observations::Observations;

/// Points looked at for each one taken.
const POOL: usize = 2;

/// tan^2 of the half angle below which a point counts as near a highlight (17 degrees).
const NEAR: f32 = 0.1;

/// Indices of at most `count` points, ascending: from points spread evenly over all, equal parts of every class of diffuse
/// colour and of points near a highlight and away from any. The choice looks at colours and angles, not at residuals, so it
/// does not bias a fit; it is the same every time.
pub fn stratified(observations: &Observations, classes: usize, count: usize) -> Vec<usize> {
    let total = observations.points();
    if count >= total {
        return (0..total).collect();
    }
    let pool_size = total.min(POOL * count);
    let pool: Vec<usize> = (0..pool_size).map(|i| i * total / pool_size).collect();
    let seen = glances(observations, &pool);
    let mut strata: Vec<Vec<usize>> = vec![Vec::new(); 2 * classes];
    let class = if classes > 1 {
        kmeans::cluster(&features(&seen.iter().map(|glance| glance.albedo).collect::<Vec<_>>()), classes)
    } else {
        vec![0; pool.len()]
    };
    for ((&point, glance), class) in pool.iter().zip(&seen).zip(class) {
        strata[2 * class + usize::from(glance.least_tan2 < NEAR)].push(point);
    }
    let mut taken = share(&strata, count);
    taken.sort_unstable();
    taken
}

/// Equal parts of every stratum; what a small one cannot give the larger ones do.
fn share(strata: &[Vec<usize>], count: usize) -> Vec<usize> {
    let mut order: Vec<&Vec<usize>> = strata.iter().collect();
    order.sort_by_key(|stratum| stratum.len());
    let mut taken = Vec::with_capacity(count);
    for (index, stratum) in order.iter().enumerate() {
        let quota = ((count - taken.len()) / (order.len() - index)).min(stratum.len());
        taken.extend((0..quota).map(|i| stratum[i * stratum.len() / quota]));
    }
    taken
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::fit::observations::tests::synthetic;

    #[test]
    fn small_strata_are_taken_whole_and_nothing_twice() {
        let strata = [vec![1, 2, 3], (10..110).collect(), Vec::new(), (200..260).collect()];
        let mut taken = share(&strata, 43);
        assert_eq!(taken.len(), 43);
        assert!([1, 2, 3].iter().all(|p| taken.contains(p)));
        taken.sort_unstable();
        taken.dedup();
        assert_eq!(taken.len(), 43);
    }

    #[test]
    fn takes_as_many_points_as_asked_or_all() {
        let (observations, _) = synthetic(300, 2, 5);
        let taken = stratified(&observations, 2, 100);
        assert_eq!(taken.len(), 100);
        assert!(taken.windows(2).all(|pair| pair[0] < pair[1]));
        assert_eq!(stratified(&observations, 2, 1000).len(), 300);
    }
}
