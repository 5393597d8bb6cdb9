//! Pixels of about one radiance, averaged: what exposure ratios are measured on.
//!
//! The mean of a hundred pixels has hardly any noise left, so its logarithm is unbiased and a tone curve may be read at it.
//! Pixels are put together by what all frames say of them, never by the frame that is measured: noise does not choose.

/// One channel of the same points in every frame.
pub struct Channel<'a> {
    /// `signals[frame][point]`: level or linear sample, as stored.
    pub signals: &'a [Vec<f32>],
    /// Linear exposure of a signal, any unit, increasing.
    pub exposure: &'a (dyn Fn(f64) -> f64 + Sync),
    /// Signals outside it say little: too dark, or near clipping.
    pub trusted: (f64, f64),
    /// From this signal on a sample is clipped.
    pub clipped: f64,
    /// Trust in a point's sample in a frame (frame, point), 0 to 1, apart from its signal.
    pub trust: &'a (dyn Fn(usize, usize) -> f64 + Sync),
}

/// Points of about one radiance.
#[derive(Clone, Debug)]
pub struct Group {
    /// Number of points.
    pub points: usize,
    /// Mean signal and mean trust in every frame, none where the mean leaves the trusted range.
    pub means: Vec<Option<(f64, f64)>>,
}

/// Points in a group, at most: noise falls tenfold.
const POINTS: usize = 100;
/// Ratio of the radiances in a group, at most: over 5 % the bend of a tone curve moves a mean by less than 0.01 %.
const WIDTH: f64 = 1.05;

impl Channel<'_> {
    /// Groups of this channel's points, darkest first, with `times` (seconds, or any unit) as known so far.
    pub fn groups(&self, times: &[f64]) -> Vec<Group> {
        let points = self.signals.first().map_or(0, Vec::len);
        let mut order: Vec<(f64, usize)> =
            (0..points).filter_map(|point| Some((self.radiance(point, times)?, point))).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut groups = Vec::new();
        let mut rest = order.as_slice();
        while let Some((darkest, _)) = rest.first() {
            let near = rest.partition_point(|(radiance, _)| *radiance <= WIDTH * darkest);
            let (group, others) = rest.split_at(near.clamp(1, POINTS));
            groups.push(self.group(group));
            rest = others;
        }
        groups
    }

    /// Sum of exposures over sum of times (the Poisson estimate), up to the first clipped frame; none if no frame shows the point.
    fn radiance(&self, point: usize, times: &[f64]) -> Option<f64> {
        let (mut exposure, mut time, mut seen) = (0.0, 0.0, false);
        for (frame, &open) in self.signals.iter().zip(times) {
            let signal = f64::from(frame[point]);
            if signal >= self.clipped {
                break;
            }
            seen |= signal >= self.trusted.0;
            exposure += (self.exposure)(signal);
            time += open;
        }
        (seen && exposure > 0.0).then(|| exposure / time)
    }

    fn group(&self, group: &[(f64, usize)]) -> Group {
        let over = |value: &dyn Fn(usize) -> f64| {
            group.iter().map(|(_, point)| value(*point)).sum::<f64>() / group.len() as f64
        };
        let mean = |(frame, signals): (usize, &Vec<f32>)| {
            let mean = over(&|point| f64::from(signals[point]));
            let inside = mean >= self.trusted.0 && mean <= self.trusted.1;
            inside.then(|| (mean, over(&|point| (self.trust)(frame, point))))
        };
        Group { points: group.len(), means: self.signals.iter().enumerate().map(mean).collect() }
    }
}
