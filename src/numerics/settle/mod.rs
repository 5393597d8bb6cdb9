//! When successive frames stop changing after a move: frames in cells of many pixels, the picture's change per degree of the arm, the
//! noise of the last frames, and the first time from which nothing is above it.
//!
//! A frame less the mean of the last ones of its burst is explained by two patterns, weighted by the noise of every cell: the arm
//! turned (the pattern of a burst shot a little beside the target) and the lamp brighter or darker (the picture itself). What neither
//! explains is the rest: something else in the picture moved.

mod fit;

use fit::{Change, Patterns};

/// Frames at the end of each burst that are taken for the arm at rest.
pub const LATE: usize = 3;
/// Cells darker than this tell nothing, levels.
const LEAST_LEVEL: f64 = 12.0;
/// Cells brighter than this are clipped in part, levels.
const MOST_LEVEL: f64 = 235.0;
/// Fewer usable cells than this are no picture of an object.
const LEAST_CELLS: usize = 12;
/// A difference above this many times the noise floor is no noise: one in 16 000 if it were.
pub const ABOVE_NOISE: f64 = 4.0;
/// Least noise of a cell's mean, levels: a JPEG's rounding.
const LEAST_SIGMA: f64 = 0.02;
/// A brighter lamp's picture is the picture itself but for the camera's curve, which may bend this part of the change into the other
/// pattern.
const LEAK: f64 = 0.2;
/// Late frames scatter by more than this many times what their pixels' noise explains: something moves.
const UNEASY: f64 = 2.0;

/// A patch of the picture, of two interleaved halves that share no block of a JPEG file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Mean level.
    pub level: f64,
    /// Half the difference of the halves: its noise is the mean's, and no change of the scene shows in it.
    pub half_difference: f64,
}

/// A frame in cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// When it was asked for, seconds after the arm reported rest.
    pub since_rest_s: f64,
    /// Its cells, as many and in the same order in every frame.
    pub cells: Vec<Cell>,
}

/// The frames shot after one move, in order; more than [`LATE`].
pub type Burst = Vec<Frame>;

/// One frame's difference from its burst's last ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Index of the burst.
    pub burst: usize,
    /// When it was asked for, seconds after the arm reported rest.
    pub since_rest_s: f64,
    /// By how much the arm seems to stand elsewhere, degrees.
    pub displacement_deg: f64,
    /// The greater of displacement and rest, each over its noise floor.
    pub over_noise: f64,
    /// Relative change of the lamp.
    pub lamp: f64,
    /// One of the last frames.
    pub late: bool,
}

impl Difference {
    /// True if it is no noise.
    pub fn differs(&self) -> bool {
        !self.late && self.over_noise > ABOVE_NOISE
    }
}

/// What the bursts show.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// Every frame of every burst, by time.
    pub differences: Vec<Difference>,
    /// Cells that were usable.
    pub cells: usize,
    /// Scatter of the last frames, degrees.
    pub noise_deg: f64,
    /// The same as their pixels' noise alone explains it.
    pub pixel_noise_deg: f64,
    /// The smallest displacement that would have been seen, degrees.
    pub smallest_deg: f64,
    /// The last frames scatter by much more than their pixels' noise, so something still moves.
    pub uneasy: bool,
    /// Greatest relative change of the lamp within a burst.
    pub lamp_change: f64,
    /// What the camera's curve may make of that change is above noise, and it shows more in the picture than the greatest displacement.
    pub lamp_hides: bool,
}

/// Why nothing can be said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blind {
    /// Too few cells are lit.
    Dark,
    /// Too few cells are lit and not clipped, and those that are clipped are many.
    Bright,
    /// Turning the arm does not change the picture, or only as a brighter lamp would.
    NoPattern,
}

/// Compares every frame with the last ones of its burst. `beside` was shot with the arm `beside_deg` degrees from where the others were.
///
/// # Errors
/// [`Blind`], when the picture cannot show a turn of the arm.
pub fn measure(beside: &Burst, beside_deg: f64, bursts: &[Burst]) -> Result<Measured, Blind> {
    let references: Vec<Vec<f64>> = bursts.iter().map(|burst| mean(late(burst))).collect();
    let picture = mean_of(&references);
    let displaced = mean(late(beside));
    let used = usable(&picture, &displaced)?;
    let sigma = noise(bursts, &used);
    let patterns = Patterns::new(
        used.iter().map(|&cell| (displaced[cell] - picture[cell]) / beside_deg).collect(),
        used.iter().map(|&cell| picture[cell]).collect(),
        sigma,
    )
    .ok_or(Blind::NoPattern)?;
    let mut changes = Vec::new();
    for (index, (burst, reference)) in bursts.iter().zip(&references).enumerate() {
        let first_late = burst.len().saturating_sub(LATE);
        for (i, frame) in burst.iter().enumerate() {
            let levels: Vec<f64> = used.iter().map(|&cell| frame.cells[cell].level - reference[cell]).collect();
            changes.push((index, frame.since_rest_s, i >= first_late, patterns.explain(&levels)));
        }
    }
    Ok(judge(&changes, &patterns))
}

/// Holds every change against the scatter of the late ones.
fn judge(changes: &[(usize, f64, bool, Change)], patterns: &Patterns) -> Measured {
    let of_late = |value: fn(&Change) -> f64| {
        let late: Vec<f64> = changes.iter().filter(|(_, _, late, _)| *late).map(|(_, _, _, c)| value(c)).collect();
        // The mean they are compared with holds them, which makes them smaller.
        let shrunk = 1.0 - 1.0 / LATE as f64;
        (late.iter().map(|v| v * v).sum::<f64>() / late.len().max(1) as f64 / shrunk).sqrt()
    };
    let pixel_noise_deg = patterns.sigma_deg();
    let noise_deg = of_late(|c| c.displacement_deg).max(pixel_noise_deg);
    let rest_noise = of_late(|c| c.rest).max(1.0);
    // An early frame is compared with a mean of [`LATE`] as noisy ones.
    let early = (1.0 + 1.0 / LATE as f64).sqrt();
    let rest_step = (0.5 / patterns.freedom()).sqrt();
    let mut differences: Vec<Difference> = changes
        .iter()
        .map(|&(burst, since_rest_s, late, change)| {
            let own = if late { (1.0 - 1.0 / LATE as f64).sqrt() } else { early };
            let turned = change.displacement_deg.abs() / (noise_deg * own);
            let rest = (change.rest / (rest_noise * own) - 1.0) / rest_step;
            let (displacement_deg, lamp) = (change.displacement_deg, change.lamp);
            Difference { burst, since_rest_s, displacement_deg, over_noise: turned.max(rest), lamp, late }
        })
        .collect();
    differences.sort_by(|a, b| a.since_rest_s.total_cmp(&b.since_rest_s));
    let greatest = |value: fn(&Difference) -> f64| differences.iter().map(value).fold(0.0, f64::max);
    let (lamp_change, turned) = (greatest(|d| d.lamp.abs()), greatest(|d| d.displacement_deg.abs()));
    let of_lamp = lamp_change / patterns.sigma_lamp();
    let lamp_hides = LEAK * of_lamp > ABOVE_NOISE * early && of_lamp > turned / pixel_noise_deg;
    Measured {
        cells: patterns.cells(),
        noise_deg,
        pixel_noise_deg,
        smallest_deg: ABOVE_NOISE * early * noise_deg,
        uneasy: noise_deg > UNEASY * pixel_noise_deg || rest_noise > UNEASY,
        lamp_change,
        lamp_hides,
        differences,
    }
}

fn late(burst: &Burst) -> &[Frame] {
    &burst[burst.len().saturating_sub(LATE)..]
}

fn mean(frames: &[Frame]) -> Vec<f64> {
    let levels: Vec<Vec<f64>> = frames.iter().map(|f| f.cells.iter().map(|c| c.level).collect()).collect();
    mean_of(&levels)
}

fn mean_of(all: &[Vec<f64>]) -> Vec<f64> {
    let cells = all.first().map_or(0, Vec::len);
    (0..cells).map(|cell| all.iter().map(|levels| levels[cell]).sum::<f64>() / all.len() as f64).collect()
}

/// Cells that are lit and not clipped in both pictures.
fn usable(picture: &[f64], displaced: &[f64]) -> Result<Vec<usize>, Blind> {
    let lit = |level: f64| (LEAST_LEVEL..=MOST_LEVEL).contains(&level);
    let used: Vec<usize> = (0..picture.len()).filter(|&cell| lit(picture[cell]) && lit(displaced[cell])).collect();
    if used.len() >= LEAST_CELLS {
        return Ok(used);
    }
    let clipped = picture.iter().filter(|level| **level > MOST_LEVEL).count();
    Err(if clipped > LEAST_CELLS { Blind::Bright } else { Blind::Dark })
}

/// Standard deviation of each used cell's mean level, from what tells its halves apart in the late frames.
fn noise(bursts: &[Burst], used: &[usize]) -> Vec<f64> {
    let freedom = (bursts.len() * (LATE - 1)) as f64;
    used.iter()
        .map(|&cell| {
            let of_burst = |burst: &Burst| {
                let halves: Vec<f64> = late(burst).iter().map(|frame| frame.cells[cell].half_difference).collect();
                let mean = halves.iter().sum::<f64>() / halves.len() as f64;
                halves.iter().map(|half| (half - mean).powi(2)).sum::<f64>()
            };
            (bursts.iter().map(of_burst).sum::<f64>() / freedom).sqrt().max(LEAST_SIGMA)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use rand::rngs::Xoshiro256PlusPlus;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    const CELLS: usize = 60;
    /// Noise of a cell's mean, levels.
    const SIGMA: f64 = 0.1;

    struct Scene(Xoshiro256PlusPlus);

    impl Scene {
        fn normal(&mut self) -> f64 {
            self.0.sample::<f64, _>(StandardNormal)
        }

        /// A picture under an arm `turned_deg` off, a lamp of relative strength `lamp`, and something that moves by `other`.
        fn frame(&mut self, since_rest_s: f64, turned_deg: f64, lamp: f64, other: f64) -> Frame {
            let cell = |cell: usize, a: f64, b: f64| {
                let x = cell as f64 / CELLS as f64;
                let (picture, turn) = (60.0 + 80.0 * (7.0 * x).sin().abs(), 2.0 * (x - 0.5));
                let strange = other * (40.0 * x).cos();
                Cell { level: lamp * picture + turned_deg * turn + strange + SIGMA * a, half_difference: SIGMA * b }
            };
            let noise: Vec<[f64; 2]> = (0..CELLS).map(|_| [self.normal(), self.normal()]).collect();
            let cells = noise.iter().enumerate().map(|(i, [a, b])| cell(i, *a, *b)).collect();
            Frame { since_rest_s, cells }
        }

        /// Bursts of eight frames, one a second, the first after 0, 1/8, 2/8 s ...
        fn bursts(&mut self, state: impl Fn(f64, usize) -> (f64, f64, f64)) -> Vec<Burst> {
            let mut burst = |index: usize| {
                let times = (0..8).map(|i| index as f64 / 8.0 + i as f64);
                times
                    .map(|t| state(t, index))
                    .enumerate()
                    .map(|(i, (turn, lamp, other))| self.frame(index as f64 / 8.0 + i as f64, turn, lamp, other))
                    .collect()
            };
            (0..8).map(&mut burst).collect()
        }
    }

    fn measured(seed: u64, state: impl Fn(f64, usize) -> (f64, f64, f64)) -> Measured {
        let mut scene = Scene(Xoshiro256PlusPlus::seed_from_u64(seed));
        let beside = (0..8).map(|i| scene.frame(f64::from(i), 2.0, 1.0, 0.0)).collect();
        let bursts = scene.bursts(state);
        measure(&beside, 2.0, &bursts).unwrap()
    }

    /// Scatter that least squares gives by hand: sigma over the root of the pattern's squares across the picture's direction.
    fn sigma_deg() -> f64 {
        let cell = |cell: usize| {
            let x = cell as f64 / CELLS as f64;
            (2.0 * (x - 0.5), 60.0 + 80.0 * (7.0 * x).sin().abs())
        };
        let sum = |value: fn((f64, f64)) -> f64| (0..CELLS).map(|i| value(cell(i))).sum::<f64>();
        let (tt, tl, ll) = (sum(|(t, _)| t * t), sum(|(t, l)| t * l), sum(|(_, l)| l * l));
        SIGMA / (tt - tl * tl / ll).sqrt()
    }

    #[test]
    fn a_still_picture_has_the_noise_of_its_cells_and_nothing_above_it() {
        for seed in 0..20 {
            let found = measured(seed, |_, _| (0.0, 1.0, 0.0));
            assert!(
                (found.pixel_noise_deg / sigma_deg() - 1.0).abs() < 0.15,
                "{}",
                found.pixel_noise_deg / sigma_deg()
            );
            assert!(!found.uneasy && !found.lamp_hides, "{seed}");
            assert!(found.differences.iter().all(|d| !d.differs()), "{seed}");
        }
    }

    #[test]
    fn a_displacement_above_the_stated_one_is_seen_and_one_of_half_of_it_is_not() {
        const SEEDS: u64 = 20;
        let (mut sizes, mut seen) = (0.0, [0.0; 2]);
        for seed in 0..SEEDS {
            let smallest = measured(seed, |_, _| (0.0, 1.0, 0.0)).smallest_deg;
            let of = |part: f64| {
                let found = measured(seed, move |t, _| (if t < 2.0 { part * smallest } else { 0.0 }, 1.0, 0.0));
                let early: Vec<_> = found.differences.into_iter().filter(|d| d.since_rest_s < 2.0).collect();
                let seen = early.iter().filter(|d| d.differs()).count() as f64 / early.len() as f64;
                let mean = early.iter().map(|d| d.displacement_deg).sum::<f64>() / early.len() as f64;
                (seen, mean / smallest / part)
            };
            let ((above, size), (below, _)) = (of(1.5), of(0.5));
            seen = [seen[0] + above / SEEDS as f64, seen[1] + below / SEEDS as f64];
            sizes += size / SEEDS as f64;
        }
        // Two standard deviations above and below the limit: 2.3 % of the frames lie on its other side, some more as the noise they are
        // held against is itself measured.
        assert!(seen[0] > 0.93 && seen[1] < 0.07, "{seen:?} of the frames are seen");
        // 16 frames against 8 means of three, each 1 in 6.9 sigma: 5 % a seed, 1 % of the mean of 20.
        assert!((sizes - 1.0).abs() < 0.04, "displacements come out {sizes} of their size");
    }

    #[test]
    fn a_lamp_that_changes_is_no_displacement() {
        let found = measured(1, |t, _| (0.0, 1.0 + 0.004 * t, 0.0));
        assert!(found.lamp_hides && (found.lamp_change - 0.026).abs() < 0.003, "{}", found.lamp_change);
        let turned = found.differences.iter().map(|d| d.displacement_deg.abs()).fold(0.0, f64::max);
        assert!(turned < 5.0 * sigma_deg(), "{turned}");
        // The same lamp under an arm that swings far more does not hide it.
        let found = measured(1, |t, _| (3.0 * (-t).exp(), 1.0 + 0.0004 * t, 0.0));
        assert!(!found.lamp_hides);
    }

    #[test]
    fn something_else_that_moves_differs_as_well() {
        let found = measured(2, |t, _| (0.0, 1.0, if t < 1.5 { 0.5 } else { 0.0 }));
        assert!(found.differences.iter().all(|d| d.late || d.differs() == (d.since_rest_s < 1.5)));
    }

    #[test]
    fn an_arm_that_never_rests_makes_the_last_frames_uneasy() {
        let found = measured(3, |t, _| (0.4 * (9.0 * t).sin(), 1.0, 0.0));
        assert!(found.uneasy && found.smallest_deg > 1.0, "{}", found.smallest_deg);
    }

    #[test]
    fn pictures_that_cannot_show_a_turn_are_told_apart() {
        let flat = |level: f64| -> Burst {
            let cells = vec![Cell { level, half_difference: 0.0 }; CELLS];
            (0..8).map(|i| Frame { since_rest_s: f64::from(i), cells: cells.clone() }).collect()
        };
        let of = |level: f64| measure(&flat(level), 2.0, &[flat(level), flat(level)]).unwrap_err();
        assert_eq!((of(3.0), of(250.0), of(100.0)), (Blind::Dark, Blind::Bright, Blind::NoPattern));
    }
}
