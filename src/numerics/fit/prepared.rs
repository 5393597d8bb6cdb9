//! Observations made ready for the inner loops under one model and one objective: what does not change while BRDF
//! parameters and weights do is computed once.

use super::objective::{MODEL_FLOOR, Measure, Objective};
use super::observations::{Observations, Row};
use super::{CHUNK, MAX_MATERIALS};
use crate::numerics::brdf::{Family, Lobe};
use crate::numerics::simd::{LANES, Lane, Level, Vector, Work};
use rayon::prelude::*;
use std::ops::Range;

/// Rows that one task makes ready.
const TASK: usize = 128;

/// Blocks of points in a chunk.
pub(super) const BLOCKS: usize = CHUNK / LANES;

/// Standard deviations of a weight that is zero below which noise hardly ever puts it.
///
/// Less clips noise and biases the BRDF parameters; more lets them wander where only the sign of the weights holds them. On
/// marble and wood at 2 % noise their intervals hold from 2.6 to 3 (docs/study.md, Weights below zero).
const SLACK: f64 = 2.75;

/// A [`Row`] made ready.
#[derive(Clone)]
#[repr(align(64))]
pub struct ReadyRow {
    /// What the roughness is compared with (`brdf::Fixed`).
    pub exponent: Lane,
    /// Factor of the lobe (`brdf::Fixed`).
    pub scale: Lane,
    /// tan^2 of the angles of incidence and reflection.
    pub tan2: [Lane; 2],
    /// Irradiance over the standard deviation the objective gives the sample; 0 where there is none.
    pub irradiance: [Lane; 3],
    /// Radiance over the same.
    pub radiance: [Lane; 3],
}

/// Ready rows of all points, or of a chunk of them.
#[derive(Clone)]
pub struct Prepared {
    /// How the lobe depends on its roughness.
    pub family: Family,
    /// Cauchy's scale in units of the residuals; none for plain squares.
    pub cauchy: Option<f32>,
    /// [`Objective::proportional`], if deviations follow the model.
    pub(super) proportional: Option<f32>,
    /// What a cost has to be multiplied by: absolute radiances are brought near 1 first.
    pub unit2: f64,
    /// Points.
    pub points: usize,
    first: Vec<usize>,
    rows: Vec<ReadyRow>,
    /// Least weights a block; empty where none were set.
    floors: Vec<[Lane; MAX_MATERIALS]>,
}

/// What samples are made ready with.
#[derive(Clone, Copy)]
pub struct Recipe<'a> {
    /// Reflection model.
    pub lobe: &'a dyn Lobe,
    /// Objective.
    pub objective: Objective,
    /// Root mean square radiance ([`brightness`]), which absolute residuals are measured by.
    pub brightness: f64,
}

/// Root mean square radiance of all samples.
pub fn brightness(observations: &Observations) -> f64 {
    let mut sum = 0.0;
    for row in observations.rows() {
        let square: f32 = row.radiance.iter().flatten().map(|i| i * i).sum();
        sum += f64::from(square);
    }
    let mean = sum / (3 * observations.samples()).max(1) as f64;
    if mean > 0.0 { mean.sqrt() } else { 1.0 }
}

impl Prepared {
    /// All points of `observations`.
    pub fn new(observations: &Observations, recipe: &Recipe<'_>) -> Self {
        let mut prepared = Self::empty(recipe);
        prepared.refill(observations, recipe, 0..observations.blocks());
        prepared
    }

    /// No points yet.
    pub fn empty(recipe: &Recipe<'_>) -> Self {
        let unit = if recipe.objective.measure == Measure::Absolute { recipe.brightness } else { 1.0 };
        Self {
            family: recipe.lobe.family(),
            cauchy: recipe.objective.cauchy_scale(1.0).map(|scale| scale as f32),
            proportional: None,
            unit2: unit * unit,
            points: 0,
            first: vec![0],
            rows: Vec::new(),
            floors: Vec::new(),
        }
    }

    /// The same with deviations in proportion to the modelled radiance where [`Objective::proportional`] says so.
    ///
    /// Deviations in proportion to measured radiances favour samples that noise made dark: weights come out low by twice
    /// the relative variance of a residual. This takes effect with Cauchy's reweighting.
    pub fn following_the_model(self, objective: Objective) -> Self {
        Self { proportional: objective.proportional(), ..self }
    }

    /// Some blocks of `observations` instead of what was there, in the same memory.
    pub fn refill(&mut self, observations: &Observations, recipe: &Recipe<'_>, blocks: Range<usize>) {
        self.points = observations.points().min(blocks.end * LANES) - blocks.start * LANES;
        let begin = observations.rows_of(0..blocks.start).end;
        self.first.clear();
        self.first.extend((blocks.start..=blocks.end).map(|block| observations.rows_of(block..block).start - begin));
        let source = &observations.rows()[observations.rows_of(blocks)];
        self.rows.resize(source.len(), EMPTY);
        self.rows.par_chunks_mut(TASK).zip(source.par_chunks(TASK)).for_each(|(ready, source)| {
            Level::best().run(Prepare { recipe, source, ready });
        });
        self.floors.clear();
    }

    /// Lets weights fall to `SLACK` of their standard deviations below zero under `Sign::Slack`: `deviations` are those
    /// for residuals of unit variance, `materials` a point.
    pub fn loosen(&mut self, deviations: &[f64], materials: usize, residual_variance: f64) {
        let slack = SLACK * residual_variance.sqrt();
        let least = |block: usize, m: usize, lane: usize| {
            let point = block * LANES + lane;
            let known = m < materials && point < self.points;
            if known { (-slack * deviations[point * materials + m]) as f32 } else { 0.0 }
        };
        let floor = |block| std::array::from_fn(|m| std::array::from_fn(|lane| least(block, m, lane)));
        self.floors = (0..self.blocks()).map(floor).collect();
    }

    /// Least weights of a block.
    pub(super) fn floor(&self, block: usize) -> Option<&[Lane; MAX_MATERIALS]> {
        self.floors.get(block)
    }

    /// Residuals there is room for.
    pub fn residuals(&self) -> usize {
        3 * LANES * self.rows.len()
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.first.len() - 1
    }

    /// Rows of a block.
    pub fn block(&self, block: usize) -> &[ReadyRow] {
        &self.rows[self.rows_of(block)]
    }

    /// Where the rows of a block stand among all.
    pub fn rows_of(&self, block: usize) -> Range<usize> {
        self.first[block]..self.first[block + 1]
    }
}

/// Makes rows ready.
struct Prepare<'a> {
    recipe: &'a Recipe<'a>,
    source: &'a [Row],
    ready: &'a mut [ReadyRow],
}

impl Work for Prepare<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Recipe { lobe, objective, brightness } = *self.recipe;
        for (ready, row) in self.ready.iter_mut().zip(self.source) {
            lobe.fixed_lanes(row, &mut ready.exponent, &mut ready.scale);
            if lobe.family() == Family::Ggx {
                let tan2 = |cos: f32| (1.0 - cos * cos).max(0.0) / (cos * cos);
                ready.tan2 = [row.cos_i.map(tan2), row.cos_r.map(tan2)];
            }
            for part in 0..LANES / V::WIDTH {
                scaled::<V>(objective.measure, (1.0 / brightness) as f32, row, part, ready);
            }
        }
    }
}

const EMPTY: ReadyRow = ReadyRow {
    exponent: [0.0; LANES],
    scale: [0.0; LANES],
    tan2: [[0.0; LANES]; 2],
    irradiance: [[0.0; LANES]; 3],
    radiance: [[0.0; LANES]; 3],
};

/// Irradiance and radiance over the standard deviation of the sample; zero where there is none.
#[inline(always)]
fn scaled<V: Vector>(measure: Measure, over_brightness: f32, row: &Row, part: usize, ready: &mut ReadyRow) {
    let (zero, one) = (V::splat(0.0), V::splat(1.0));
    for c in 0..3 {
        let radiance = V::load(&row.radiance[c], part);
        let weight = match measure {
            Measure::Absolute => V::splat(over_brightness),
            Measure::Relative => one / radiance,
            Measure::Noise => {
                let floor = V::splat(MODEL_FLOOR as f32) * radiance;
                one / floor.mul_add(floor, V::load(&row.variance[c], part)).sqrt()
            }
        };
        let weight = radiance.if_greater(zero, weight, zero);
        (V::load(&row.irradiance[c], part) * weight).store(&mut ready.irradiance[c], part);
        (radiance * weight).store(&mut ready.radiance[c], part);
    }
}
