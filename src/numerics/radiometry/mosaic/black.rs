//! Black level and read noise of one frame, from the photosites that no light reaches.

use super::PLACES;

/// What masked photosites say of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Black {
    /// Mean count without light, by place of the pattern.
    pub level: [f64; PLACES],
    /// Standard deviation of a count without light, rounding included.
    pub noise: f64,
}

/// Photosites a place needs: the mean of so many is known to a thirtieth of the read noise.
const MIN_SITES: usize = 1000;
/// Standard deviations from the median beyond which a photosite is hot or dead and does not count.
const OUTLIER: f64 = 6.0;
/// Variance of rounding to a whole count: no converter is quieter.
const ROUNDING: f64 = 1.0 / 12.0;
/// Standard deviations in a median absolute deviation of a normal distribution.
const SIGMAS_PER_DEVIATION: f64 = 1.4826;

/// Counts of masked photosites by place, in the order they are met.
#[derive(Clone, Debug)]
pub struct Masked {
    histograms: [Vec<usize>; PLACES],
}

impl Masked {
    /// No photosites yet, of a converter with counts up to `highest`.
    pub fn none(highest: u16) -> Self {
        Self { histograms: std::array::from_fn(|_| vec![0; usize::from(highest) + 1]) }
    }

    /// Adds a photosite; `x`, `y` from a corner with red at the top left. Counts beyond the highest are left out.
    pub fn add(&mut self, x: usize, y: usize, count: u16) {
        if let Some(bin) = self.histograms[2 * (y % 2) + x % 2].get_mut(usize::from(count)) {
            *bin += 1;
        }
    }

    /// Mean and scatter by place, hot photosites left out; none of fewer photosites than tell.
    pub fn black(&self) -> Option<Black> {
        let mut level = [0.0; PLACES];
        let mut variance = 0.0;
        for (place, histogram) in self.histograms.iter().enumerate() {
            let (mean, own) = trimmed(histogram)?;
            level[place] = mean;
            variance += own / PLACES as f64;
        }
        Some(Black { level, noise: variance.max(ROUNDING).sqrt() })
    }
}

/// Mean and variance of the counts near the median.
fn trimmed(histogram: &[usize]) -> Option<(f64, f64)> {
    let sites: usize = histogram.iter().sum();
    if sites < MIN_SITES {
        return None;
    }
    let median = middle(histogram.iter().copied(), sites);
    let mut deviations = vec![0; histogram.len()];
    histogram.iter().enumerate().for_each(|(count, &sites)| deviations[count.abs_diff(median)] += sites);
    let deviation = middle(deviations.iter().copied(), sites) as f64;
    // One count more, for a scatter of less than a count has a median deviation of none.
    let reach = OUTLIER * SIGMAS_PER_DEVIATION * deviation + 1.0;
    let near = || histogram.iter().enumerate().filter(|(count, _)| count.abs_diff(median) as f64 <= reach);
    let over = |value: &dyn Fn(f64) -> f64| near().map(|(count, &n)| n as f64 * value(count as f64)).sum::<f64>();
    let total = over(&|_| 1.0);
    let mean = over(&|count| count) / total;
    Some((mean, over(&|count| (count - mean).powi(2)) / total))
}

/// The bin that the middle one of `sites` falls into.
fn middle(histogram: impl Iterator<Item = usize>, sites: usize) -> usize {
    let mut below = 0;
    histogram
        .take_while(|&bin| {
            below += bin;
            below <= sites / 2
        })
        .count()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn places_are_told_apart_and_hot_photosites_do_not_count() {
        let mut masked = Masked::none(4095);
        for i in 0..40_000_usize {
            let (x, y) = (i % 200, i / 200);
            let place = 2 * (y % 2) + x % 2;
            // Counts of 1 below, at, and 1 above the place's own level; variance 2/3.
            masked.add(x, y, (120 + 3 * place + (i / 4) % 3 - 1) as u16);
        }
        (0..40).for_each(|i| masked.add(i, i, 3000));
        let black = masked.black().unwrap();
        for (place, level) in black.level.into_iter().enumerate() {
            assert!((level - (120 + 3 * place) as f64).abs() < 0.02, "{level} at place {place}");
        }
        assert!((black.noise - (2.0_f64 / 3.0).sqrt()).abs() < 0.01, "{}", black.noise);
    }

    #[test]
    fn a_handful_of_photosites_says_nothing() {
        let mut masked = Masked::none(4095);
        (0..100).for_each(|i| masked.add(i, i / 10, 128));
        assert_eq!(masked.black(), None);
    }
}
