//! Materials out of a bank of measured ones (after Matusik, Pfister, Brand, McMillan, "A data-driven reflectance model",
//! SIGGRAPH 2003): nothing of the lobe is fitted, only which measured materials mix, and how much of each.
//!
//! Kept: any material is a non-negative combination of measured ones. Changed: the bank holds Ward parameters instead of
//! tabulated BRDFs (the rig's few samples a point could not tell more), and the object as a whole uses few of its
//! materials, as a texture needs, where the paper spans a space by all of them.

use super::kernel::{self, Sign};
use super::observations::Observations;
use super::prepared::Prepared;
use super::sampling::stratified;
use super::solver::{Iterate, OnIteration, Refusal, Solution, Solver, Task};
use super::varpro::{AlphaFit, Found, finish, recipe};
use crate::numerics::brdf::{Lobe, Material, ward::Ward};
use rayon::prelude::*;
use table::BANK;

pub mod table;

/// Points that decide which materials are taken.
const POINTS: usize = 400;

/// Sets of materials kept at every step.
const KEPT: usize = 8;

/// Most rounds of swaps; each tries every material of the bank in every place of every set kept.
const ROUNDS: usize = 10;

/// Non-negative combinations of measured materials.
pub struct Bank;

impl Solver for Bank {
    fn name(&self) -> &'static str {
        "bank"
    }

    fn coloured_only(&self) -> bool {
        true
    }

    fn only_model(&self) -> Option<&'static dyn Lobe> {
        Some(&Ward)
    }

    fn solve(&self, observations: &Observations, task: &Task, progress: OnIteration<'_>) -> Result<Solution, Refusal> {
        if task.lobe.name() != Ward.name() {
            return Err(Refusal::OtherModel { solver: self.name(), needs: Ward.name(), model: task.lobe.name() });
        }
        let recipe = recipe(task, observations);
        let some = observations.select(&stratified(observations, task.materials, POINTS));
        let Choice { set, rounds, converged, cancelled } =
            choose(&some, &Prepared::new(&some, &recipe), task.materials, progress);
        let names: Vec<&str> = set.indices.iter().map(|&index| BANK[index].0).collect();
        let found = Found { materials: set.materials(), cost: set.cost, iterations: rounds, converged };
        let notes = vec![format!("measured materials taken from the bank: {}", names.join(", "))];
        let alpha = AlphaFit { found, sign: Sign::NonNegative, cancelled, notes };
        Ok(finish(observations, &recipe, alpha))
    }
}

/// Some materials of the bank, ascending, and what they cost.
#[derive(Clone, PartialEq)]
struct Set {
    indices: Vec<usize>,
    cost: f64,
}

impl Set {
    fn materials(&self) -> Vec<Material> {
        self.indices.iter().map(|&index| BANK[index].1).collect()
    }
}

/// The set taken, and how the search for it went.
struct Choice {
    set: Set,
    rounds: usize,
    converged: bool,
    cancelled: bool,
}

/// Forward selection, then swaps until none lowers the cost. One set after another gets stuck where two materials stand in
/// for a third: several are kept at every step.
fn choose(some: &Observations, prepared: &Prepared, materials: usize, progress: OnIteration<'_>) -> Choice {
    let mut kept = vec![Set { indices: Vec::new(), cost: f64::INFINITY }];
    let (mut converged, mut cancelled, mut rounds) = (false, false, 0);
    while rounds < materials + ROUNDS && !converged && !cancelled {
        let before = kept[0].cost;
        let trials = if rounds < materials { extended(&kept) } else { swapped(&kept) };
        kept = best(prepared, trials);
        converged = materials == 1 || rounds >= materials && kept[0].cost >= before;
        rounds += 1;
        let (cost, taken) = (kept[0].cost * prepared.unit2, kept[0].materials());
        cancelled = progress(Iterate::new(rounds, cost, some, &taken)).is_break();
    }
    Choice { set: kept.swap_remove(0), rounds, converged, cancelled }
}

/// Every set with one more material.
fn extended(sets: &[Set]) -> Vec<Vec<usize>> {
    let with = |set: &Set, new: usize| set.indices.iter().copied().chain([new]).collect();
    sets.iter().flat_map(|set| (0..BANK.len()).map(move |new| with(set, new))).collect()
}

/// The sets themselves, and every one with one material replaced.
fn swapped(sets: &[Set]) -> Vec<Vec<usize>> {
    let mut trials: Vec<Vec<usize>> = sets.iter().map(|set| set.indices.clone()).collect();
    for set in sets {
        for place in 0..set.indices.len() {
            for new in 0..BANK.len() {
                let mut indices = set.indices.clone();
                indices[place] = new;
                trials.push(indices);
            }
        }
    }
    trials
}

/// The cheapest sets of different materials; at least one.
fn best(prepared: &Prepared, mut trials: Vec<Vec<usize>>) -> Vec<Set> {
    trials.iter_mut().for_each(|indices| indices.sort_unstable());
    trials.retain(|indices| indices.windows(2).all(|pair| pair[0] != pair[1]));
    trials.sort_unstable();
    trials.dedup();
    let price = |indices| {
        let mut set = Set { indices, cost: 0.0 };
        set.cost = kernel::weights(prepared, &set.materials(), Sign::NonNegative).1;
        set
    };
    let mut sets: Vec<Set> = trials.into_par_iter().map(price).collect();
    sets.sort_by(|a, b| a.cost.total_cmp(&b.cost).then_with(|| a.indices.cmp(&b.indices)));
    sets.truncate(KEPT);
    sets
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::numerics::fit::objective::Objective;
    use crate::numerics::fit::observations::Sample;
    use crate::numerics::fit::observations::tests::{noisy, synthetic};
    use crate::numerics::fit::predict;
    use crate::numerics::fit::solver::tests::{go_on, task};

    /// A scene mixed of materials of the bank gives these materials back, whether exact or with 2 % noise.
    #[test]
    fn takes_the_materials_a_scene_was_made_of() {
        for names in [vec!["delrin"], vec!["delrin", "cherry-235"], vec!["dark-red-paint", "blue-rubber", "delrin"]] {
            let known: Vec<Material> =
                names.iter().map(|name| BANK.iter().find(|(known, _)| known == name).unwrap().1).collect();
            let (shape, truth) = synthetic(1000, known.len(), 41);
            let paint = |point: usize, mut sample: Sample| {
                sample.radiance = predict(&Ward, &known, truth.weights_of(point), &sample);
                Some(sample)
            };
            let exact = shape.changed(1, paint).0;
            for observations in [exact.clone(), noisy(&exact, 0.02, 41)] {
                let solution = Bank.solve(&observations, &task(known.len(), Objective::NOISE), &mut go_on).unwrap();
                for name in &names {
                    assert!(solution.notes[0].contains(name), "{names:?}: {:?}", solution.notes);
                }
            }
        }
    }

    /// The restated table against entries of the published one: red as printed, green x 1.15, blue x 1.66.
    #[test]
    fn the_table_is_the_published_one_with_its_channel_scales() {
        let (_, delrin) = BANK.iter().find(|(name, _)| *name == "delrin").unwrap();
        let (printed_d, printed_s) = ([0.293, 0.244, 0.146], [0.0348, 0.0295, 0.0202]);
        for (c, scale) in [1.0, 1.15, 1.66].into_iter().enumerate() {
            assert!((delrin.rho_d[c] / (printed_d[c] * scale) - 1.0).abs() < 1e-3);
            assert!((delrin.rho_s[c] / (printed_s[c] * scale) - 1.0).abs() < 1e-3);
        }
        assert_eq!(delrin.beta, 0.162);
        let sound = |m: &Material| m.beta > 0.0 && m.rho_d.iter().chain(&m.rho_s).all(|v| (0.0..=1.0).contains(v));
        assert!(BANK.len() == 86 && BANK.iter().all(|(_, material)| sound(material)));
    }
}
