//! No more than the scene needs: number of materials, reflection model, colour of the lobe and light gains, each judged by
//! left-out lights. A further freedom is taken only if it lowers the error on lights the fit never saw.

mod scene;

use super::MAX_MATERIALS;
use super::folds::LeftOut;
use super::objective::Objective;
use super::observations::Observations;
use super::unknowns::Colour;
use crate::numerics::brdf::{self, Lobe};
use scene::Scene;
use std::ops::ControlFlow;

/// One more material must lower the left-out error by this much, relative, to be worth having; another model, or a gain for
/// each light, by that much.
const MATERIAL_GAIN: f64 = 0.02;
const GAIN: f64 = 0.01;

/// A simpler lobe may raise it by this much.
const LOSS: f64 = 0.003;

/// What is taken may not raise the error on left-out highlights by more than this, relative.
const HIGHLIGHT_LOSS: f64 = 0.1;

/// No freedom is worth having below this error: what is left is rounding, not the scene.
const NEGLIGIBLE: f64 = 1e-3;

/// Bayes' criterion overrules left-out lights where one more material lowers it by more than this a residual, and their error
/// rises by less than `BEARABLE`, relative. Materials of one hue are told apart by their highlights only: the light left out is
/// then the one that tells, and its error is no judge. Never the other way round: the criterion charges a weight a point, and
/// where noise is not known it refuses materials that left-out lights need.
const BIC_TAKES: f64 = 0.75;
const BEARABLE: f64 = 0.75;

/// What is to be chosen: none where the caller leaves it to the data.
#[derive(Clone, Copy)]
pub struct Wishes {
    /// Number of materials.
    pub materials: Option<usize>,
    /// Reflection model.
    pub lobe: Option<&'static dyn Lobe>,
    /// Colour of the lobe.
    pub colour: Option<Colour>,
    /// True fits light gains, false does not.
    pub gains: Option<bool>,
}

/// A combination that was tried.
#[derive(Clone)]
pub struct Candidate {
    /// Number of materials.
    pub materials: usize,
    /// Reflection model.
    pub lobe: &'static dyn Lobe,
    /// Colour of the lobe.
    pub colour: Colour,
    /// Factor of each light's irradiance, where gains were fitted.
    pub gains: Option<Vec<f64>>,
    /// Errors on left-out lights; none where no light can be left out.
    pub left_out: Option<LeftOut>,
    /// Bayes' information criterion over the weights in use; the smaller the better.
    pub bic: f64,
    /// True for the one taken.
    pub taken: bool,
    /// Why it was taken or refused.
    pub reason: String,
}

impl Candidate {
    /// Error on left-out lights, at least [`NEGLIGIBLE`].
    fn error(&self) -> f64 {
        self.left_out.map_or(f64::INFINITY, |errors| errors.overall.max(NEGLIGIBLE))
    }

    /// True when this one predicts left-out lights better than `other` by the part `gain` of its error.
    fn beats(&self, other: &Self, gain: f64) -> bool {
        self.error() < other.error() * (1.0 - gain)
    }

    /// By how much it raises the error on left-out highlights, relative, where that is too much.
    fn loses_highlights(&self, other: &Self) -> Option<f64> {
        let highlight = |candidate: &Self| candidate.left_out.and_then(|errors| errors.highlight);
        let change = highlight(self)? / highlight(other)? - 1.0;
        (change > HIGHLIGHT_LOSS).then_some(change)
    }
}

/// True when the samples are at least as many as the unknowns, and the points as the materials: of more, every mixture
/// explains the points.
pub fn carried(observations: &Observations, materials: usize, colour: Colour, gains: bool) -> bool {
    let gains = if gains { observations.lights.saturating_sub(1) } else { 0 };
    let of_material = observations.points() + colour.unknowns(observations.channels()) - 1;
    materials <= observations.points() && materials * of_material + gains <= observations.residuals()
}

/// Callback of the choice: what was judged, and whether it is the best so far; it can break off.
pub type OnCandidate<'a> = &'a mut dyn FnMut(&Candidate, bool) -> ControlFlow<()>;

/// Tries what `wishes` leaves open and returns every candidate, one of them taken. Empty when the caller broke off.
pub fn select(
    observations: &Observations,
    objective: Objective,
    wishes: Wishes,
    on_candidate: OnCandidate<'_>,
) -> Vec<Candidate> {
    let scene = Scene::new(observations, objective);
    let mut choice = Choice { scene: &scene, tried: Vec::new(), best: 0, on_candidate };
    match choose(&mut choice, wishes) {
        ControlFlow::Continue(()) => choice.finish(),
        ControlFlow::Break(()) => Vec::new(),
    }
}

fn choose(choice: &mut Choice<'_>, wishes: Wishes) -> ControlFlow<()> {
    let lobe = wishes.lobe.unwrap_or(&brdf::ward::Ward);
    let colour = wishes.colour.unwrap_or(Colour::Coloured);
    choice.first(wishes.materials.unwrap_or(1), lobe, colour)?;
    if wishes.materials.is_none() {
        choice.more_materials()?;
    }
    if wishes.lobe.is_none() {
        choice.other_models(wishes.materials.is_none())?;
    }
    if wishes.colour.is_none() {
        choice.simpler_lobes()?;
    }
    if wishes.materials.is_some_and(|materials| materials > 1) {
        choice.one_fewer()?;
    }
    match wishes.gains {
        Some(false) => ControlFlow::Continue(()),
        wish => choice.light_gains(wish == Some(true)),
    }
}

struct Choice<'a> {
    scene: &'a Scene,
    tried: Vec<Candidate>,
    best: usize,
    on_candidate: OnCandidate<'a>,
}

impl Choice<'_> {
    fn best(&self) -> Candidate {
        self.tried[self.best].clone()
    }

    /// Residuals that candidates are judged by.
    fn residuals(&self) -> f64 {
        self.scene.points.residuals() as f64
    }

    fn first(&mut self, materials: usize, lobe: &'static dyn Lobe, colour: Colour) -> ControlFlow<()> {
        let candidate = self.scene.evaluate(materials, lobe, colour);
        self.tried.push(candidate);
        (self.on_candidate)(&self.tried[0], true)
    }

    /// Tries a candidate; takes it if `accept(candidate, best)`.
    fn attempt(
        &mut self,
        candidate: Candidate,
        accept: impl FnOnce(&Candidate, &Candidate) -> Result<String, String>,
    ) -> ControlFlow<(), bool> {
        let mut candidate = candidate;
        let verdict = accept(&candidate, &self.tried[self.best]);
        let accepted = verdict.is_ok();
        candidate.reason = verdict.unwrap_or_else(|reason| reason);
        self.tried.push(candidate);
        if accepted {
            self.tried[self.best].reason = "a later one was taken".to_owned();
            self.best = self.tried.len() - 1;
        }
        match (self.on_candidate)(&self.tried[self.tried.len() - 1], accepted) {
            ControlFlow::Continue(()) => ControlFlow::Continue(accepted),
            ControlFlow::Break(()) => ControlFlow::Break(()),
        }
    }

    /// One material more at a time; where that does not pay, two more may: between one and three, two explain little.
    fn more_materials(&mut self) -> ControlFlow<()> {
        let mut materials = self.best().materials + 1;
        while materials <= (self.best().materials + 2).min(MAX_MATERIALS) {
            let best = self.best();
            if !carried(&self.scene.points, materials, best.colour, false) {
                break;
            }
            let next = self.scene.evaluate(materials, best.lobe, best.colour);
            let judge =
                unless_overruled(self.residuals(), worth(MATERIAL_GAIN, "more materials", Highlights::KeptOrBic));
            self.attempt(next, judge)?;
            materials += 1;
        }
        ControlFlow::Continue(())
    }

    /// Shows what one material fewer would do, without taking it: the number was asked for.
    fn one_fewer(&mut self) -> ControlFlow<()> {
        let best = self.best();
        let fewer = self.scene.evaluate(best.materials - 1, best.lobe, best.colour);
        let asked = format!("{} materials were asked for", best.materials);
        self.attempt(fewer, |_, _| Err(asked))?;
        ControlFlow::Continue(())
    }

    fn other_models(&mut self, fewer: bool) -> ControlFlow<()> {
        let start = self.best();
        for &lobe in brdf::MODELS.iter().filter(|lobe| lobe.has_lobe() && lobe.name() != start.lobe.name()) {
            let next = self.scene.evaluate(start.materials, lobe, start.colour);
            self.attempt(next, worth(GAIN, "this model", Highlights::Kept))?;
        }
        let best = self.best();
        if fewer && best.lobe.name() != start.lobe.name() && best.materials > 1 {
            let next = self.scene.evaluate(best.materials - 1, best.lobe, best.colour);
            let judge = unless_overruled(self.residuals(), worth(-LOSS, "one material fewer", Highlights::Kept));
            self.attempt(next, judge)?;
        }
        ControlFlow::Continue(())
    }

    fn simpler_lobes(&mut self) -> ControlFlow<()> {
        for colour in [Colour::Achromatic, Colour::None] {
            let best = self.best();
            let lobe: &'static dyn Lobe = if colour == Colour::None { &brdf::lambert::Lambert } else { best.lobe };
            let next = self.scene.evaluate(best.materials, lobe, colour);
            if !self.attempt(next, worth(-LOSS, "a simpler lobe", Highlights::Kept))? {
                break;
            }
        }
        ControlFlow::Continue(())
    }

    fn light_gains(&mut self, wished: bool) -> ControlFlow<()> {
        let best = self.best();
        let next = self.scene.evaluate_with_gains(&best);
        let accept = worth(GAIN, "light gains", Highlights::Kept);
        self.attempt(next, |new, old| if wished { Ok("asked for".to_owned()) } else { accept(new, old) })?;
        ControlFlow::Continue(())
    }

    fn finish(mut self) -> Vec<Candidate> {
        let best = &mut self.tried[self.best];
        best.taken = true;
        if best.reason.is_empty() {
            best.reason = "nothing else that may be taken was better".to_owned();
        }
        self.tried
    }
}

/// What left-out highlights have to say.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Highlights {
    /// What is taken may not lose them.
    Kept,
    /// It may where BIC wants it: too few materials have the highlights of none.
    KeptOrBic,
}

/// Judges one material more or fewer: as `predicts` says, unless Bayes' criterion is decisive for the larger number.
fn unless_overruled(
    residuals: f64,
    predicts: impl Fn(&Candidate, &Candidate) -> Result<String, String>,
) -> impl Fn(&Candidate, &Candidate) -> Result<String, String> {
    move |new, old| {
        let adds = new.materials > old.materials;
        let (more, fewer) = if adds { (new, old) } else { (old, new) };
        let needed = fewer.error() > NEGLIGIBLE && more.error() < fewer.error() * (1.0 + BEARABLE);
        let decisive = needed && more.bic - fewer.bic < -BIC_TAKES * residuals;
        match predicts(new, old) {
            Err(refused) if decisive && adds => {
                Ok(format!("{refused}, but taken: BIC is decisive ({:+.0})", new.bic - old.bic))
            }
            Ok(taken) if decisive && !adds => {
                Err(format!("{taken}, but refused: BIC is decisive ({:+.0})", new.bic - old.bic))
            }
            verdict => verdict,
        }
    }
}

/// Accepts what lowers the left-out error by the part `gain`, or raises it by less than `-gain`.
fn worth(
    gain: f64,
    what: &'static str,
    highlights: Highlights,
) -> impl Fn(&Candidate, &Candidate) -> Result<String, String> {
    move |new, old| {
        let change = new.bic - old.bic;
        if !new.error().is_finite() || !old.error().is_finite() {
            let judged = format!("{what}: too few lights to leave one out; BIC {change:+.0}");
            return if change < 0.0 { Ok(judged + ", taken") } else { Err(judged + ", refused") };
        }
        let better = new.beats(old, gain);
        let bic = if (change < 0.0) == better { "BIC agrees" } else { "BIC disagrees" };
        let error = format!("{what}: {} % left-out error", signed(new.error() / old.error() - 1.0));
        let asked = if gain < 0.0 { "may rise by" } else { "must fall by" };
        let asked = format!("{asked} {:.1} %", 100.0 * gain.abs());
        let loss = new.loses_highlights(old).filter(|_| highlights == Highlights::Kept || change >= 0.0);
        match (better, loss) {
            (true, None) => Ok(format!("{error}, taken ({asked}); {bic}")),
            (true, Some(loss)) => {
                Err(format!("{error}, but {:+.0} % on left-out highlights, refused; {bic}", 100.0 * loss))
            }
            (false, _) => Err(format!("{error}, refused ({asked}); {bic}")),
        }
    }
}

/// A change in percent, with its sign unless it rounds to nothing.
fn signed(change: f64) -> String {
    let percent = format!("{:+.1}", 100.0 * change);
    if percent.ends_with("0.0") && percent.len() == 4 { "0.0".to_owned() } else { percent }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::brdf::ward::Ward;
    use crate::numerics::fit::observations::{Sample, tests::synthetic};
    use rand::{RngExt, SeedableRng, rngs::StdRng};

    const OPEN: Wishes = Wishes { materials: None, lobe: None, colour: None, gains: None };

    fn taken(observations: &Observations, wishes: Wishes) -> Candidate {
        let tried = select(observations, Objective::NOISE, wishes, &mut |_, _| ControlFlow::Continue(()));
        let taken: Vec<&Candidate> = tried.iter().filter(|c| c.taken).collect();
        assert_eq!(taken.len(), 1);
        assert!(tried.iter().all(|c| !c.reason.is_empty()));
        taken[0].clone()
    }

    fn noisy(clean: &Observations, seed: u64) -> Observations {
        let mut rng = StdRng::seed_from_u64(seed);
        let noise = |s: Sample, rng: &mut StdRng| Sample {
            radiance: s.radiance.map(|i| i * (1.0 + rng.random_range(-0.03..0.03))),
            ..s
        };
        clean.changed(1, |_, sample| Some(noise(sample, &mut rng))).0
    }

    #[test]
    fn takes_as_many_materials_as_made_the_data() {
        for truth in [1, 2, 3] {
            let (clean, _) = synthetic(900, truth, 30 + truth as u64);
            let found = taken(&noisy(&clean, 31), OPEN);
            assert_eq!(found.materials, truth, "{}", found.reason);
            assert_eq!(found.lobe.name(), "ward");
        }
    }

    /// Two materials of one hue differ by highlights only: left-out lights miss those, the fit does not.
    #[test]
    fn materials_of_one_hue_are_told_apart() {
        let (clean, mut truth) = synthetic(900, 2, 33);
        truth.materials[1].rho_d = truth.materials[0].rho_d.map(|albedo| 0.15 * albedo);
        truth.materials[1].beta = 0.06;
        let alike = |point: usize, s: Sample| Sample {
            radiance: super::super::predict(&Ward, &truth.materials, truth.weights_of(point), &s),
            ..s
        };
        let (observations, _) = clean.changed(1, |point, sample| Some(alike(point, sample)));
        let found = taken(&noisy(&observations, 34), Wishes { lobe: Some(&Ward), ..OPEN });
        assert_eq!(found.materials, 2, "{}", found.reason);
    }

    #[test]
    fn takes_no_lobe_where_there_is_none() {
        let (clean, mut truth) = synthetic(600, 1, 35);
        truth.materials[0].rho_s = [0.0; 3];
        let dull = |point: usize, s: Sample| Sample {
            radiance: super::super::predict(&Ward, &truth.materials, truth.weights_of(point), &s),
            ..s
        };
        let (observations, _) = clean.changed(1, |point, sample| Some(dull(point, sample)));
        assert_eq!(taken(&noisy(&observations, 36), OPEN).colour, Colour::None);
    }

    #[test]
    fn a_light_that_drifted_is_given_its_gain() {
        let (clean, _) = synthetic(600, 2, 37);
        let drifted = |s: Sample| {
            let factor = if s.light == 3 { 1.08 } else { 1.0 };
            Sample { radiance: s.radiance.map(|i| factor * i), ..s }
        };
        let (observations, _) = noisy(&clean, 38).changed(1, |_, sample| Some(drifted(sample)));
        let wishes = Wishes { materials: Some(2), lobe: Some(&Ward), colour: Some(Colour::Coloured), gains: None };
        let gains = taken(&observations, wishes).gains.unwrap_or_default();
        assert!(gains.len() == 7 && (gains[3] / gains[2] - 1.08).abs() < 0.01, "{gains:?}");
    }
}
