//! What a fit can be asked, by name.

use super::fit::FitError;
use crate::numerics::brdf::{self, Lobe};
use crate::numerics::fit::MAX_MATERIALS;
use crate::numerics::fit::objective::Objective;
use crate::numerics::fit::selection::Wishes;
use crate::numerics::fit::solver::{self, Solver};
use crate::numerics::fit::unknowns::Colour;
use crate::numerics::fit::weights::WeightRule;

/// Most worker threads that can be asked for.
const MAX_THREADS: usize = 256;

/// The name that leaves a choice to left-out lights.
pub const AUTO: &str = "auto";

/// What to fit and how.
#[derive(Clone, Debug, PartialEq)]
pub struct FitOptions {
    /// Number of materials; none lets left-out lights decide.
    pub materials: Option<usize>,
    /// BRDF model name, or `auto`.
    pub model: String,
    /// Colour of the lobe: `none`, `achromatic`, `coloured` or `auto`.
    pub lobe: String,
    /// Light gains: `on`, `off` or `auto`.
    pub gains: String,
    /// Solver name.
    pub solver: String,
    /// Rule of the weights: `exact` or `paper`.
    pub weights: String,
    /// Objective name.
    pub objective: String,
    /// Indices of lights kept out of the fit and used to judge it.
    pub leave_out: Vec<usize>,
    /// Cosine cut-off; none takes the dataset's.
    pub cosine_cutoff: Option<f64>,
    /// Worker threads; none takes all cores. The result does not depend on it.
    pub threads: Option<usize>,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            materials: None,
            model: AUTO.to_owned(),
            lobe: AUTO.to_owned(),
            gains: AUTO.to_owned(),
            solver: "varpro".to_owned(),
            weights: "exact".to_owned(),
            objective: Objective::NOISE_CAUCHY.name().to_owned(),
            leave_out: Vec::new(),
            cosine_cutoff: None,
            threads: None,
        }
    }
}

/// Names a model can be asked by.
pub fn models() -> Vec<&'static str> {
    std::iter::once(AUTO).chain(brdf::names()).collect()
}

/// Names a colour of the lobe can be asked by.
pub fn lobes() -> Vec<&'static str> {
    std::iter::once(AUTO).chain(Colour::ALL.map(|(name, _)| name)).collect()
}

/// Names light gains can be asked by.
pub const GAINS: [&str; 3] = [AUTO, "on", "off"];

/// Names of the solvers.
pub fn solvers() -> Vec<&'static str> {
    solver::names()
}

/// Names of the objectives.
pub fn objectives() -> Vec<&'static str> {
    Objective::ALL.iter().map(|(name, _)| *name).collect()
}

/// Names of the weight rules.
pub const WEIGHT_RULES: [&str; 2] = ["exact", "paper"];

/// The names in [`FitOptions`], resolved.
pub(super) struct Chosen {
    pub wishes: Wishes,
    pub objective: Objective,
    pub rule: WeightRule,
    pub solver: &'static dyn Solver,
    pub cutoff: f64,
}

impl FitOptions {
    /// Resolves the names for a dataset with this many lights and this cosine cut-off.
    pub(super) fn resolve(&self, lights: usize, cosine_cutoff: f64) -> Result<Chosen, FitError> {
        let solver = solver::by_name(&self.solver).ok_or_else(|| one_of("solver", &self.solver, &solvers()))?;
        let lobe = if self.model == AUTO { solver.only_model() } else { Some(self.lobe_named()?) };
        // The name is looked up whatever the model: a slip of the pen is one also where there is no lobe.
        let asked = self.colour_asked()?;
        let colour = if lobe.is_some_and(|lobe| !lobe.has_lobe()) { Some(Colour::None) } else { asked };
        if let (Some(lobe), Some(asked)) = (lobe.filter(|lobe| !lobe.has_lobe()), self.lobe_asked()) {
            return Err(FitError::Input(format!(
                "the model {} has no lobe to be {asked}: choose lobe none or auto",
                lobe.name()
            )));
        }
        let gains = match self.gains.as_str() {
            AUTO => None,
            "on" => Some(true),
            "off" => Some(false),
            other => return Err(one_of("choice of light gains", other, &GAINS)),
        };
        let objective =
            Objective::by_name(&self.objective).ok_or_else(|| one_of("objective", &self.objective, &objectives()))?;
        let rule =
            WeightRule::by_name(&self.weights).ok_or_else(|| one_of("weight rule", &self.weights, &WEIGHT_RULES))?;
        if rule == WeightRule::Paper && self.solver != "zheng2008" {
            return Err(FitError::Input(format!(
                "weights \"paper\" (sum of weights at most 1) is a rule of the solver zheng2008: choose it, or weights \"exact\" for {}",
                self.solver
            )));
        }
        let colour = self.colour_for(solver, colour)?;
        let cutoff = self.cosine_cutoff.unwrap_or(cosine_cutoff);
        self.check_numbers(lights, cutoff)?;
        Ok(Chosen {
            wishes: Wishes { materials: self.materials, lobe, colour, gains },
            objective,
            rule,
            solver,
            cutoff,
        })
    }

    /// The colour of the lobe that was asked for; none leaves it open.
    fn colour_asked(&self) -> Result<Option<Colour>, FitError> {
        if self.lobe == AUTO {
            return Ok(None);
        }
        let found = Colour::ALL.iter().find(|(known, _)| *known == self.lobe);
        found.map(|(_, colour)| Some(*colour)).ok_or_else(|| one_of("lobe", &self.lobe, &lobes()))
    }

    /// The colour of the lobe that was asked for, if it is one.
    fn lobe_asked(&self) -> Option<&str> {
        ["achromatic", "coloured"].into_iter().find(|name| *name == self.lobe)
    }

    /// The colour of the lobe as far as the solver leaves a choice.
    fn colour_for(&self, solver: &dyn Solver, colour: Option<Colour>) -> Result<Option<Colour>, FitError> {
        match colour {
            None if solver.coloured_only() => Ok(Some(Colour::Coloured)),
            Some(Colour::Achromatic) if solver.coloured_only() => Err(FitError::Input(format!(
                "the solver {} fits coloured lobes only: choose lobe coloured or auto, or another solver",
                self.solver
            ))),
            colour => Ok(colour),
        }
    }

    fn lobe_named(&self) -> Result<&'static dyn Lobe, FitError> {
        brdf::by_name(&self.model).ok_or_else(|| one_of("BRDF model", &self.model, &models()))
    }

    fn check_numbers(&self, lights: usize, cutoff: f64) -> Result<(), FitError> {
        let refuse = |reason: String| Err(FitError::Input(reason));
        if self.materials.is_some_and(|m| m == 0 || m > MAX_MATERIALS) {
            return refuse(format!("materials must be 1 to {MAX_MATERIALS}, or auto"));
        }
        if self.threads.is_some_and(|threads| !(1..=MAX_THREADS).contains(&threads)) {
            return refuse(format!("threads must be 1 to {MAX_THREADS}; left out, all cores work"));
        }
        if !(0.0..1.0).contains(&cutoff) {
            return refuse(format!("the cosine cut-off is {cutoff}: choose a value from 0 to below 1"));
        }
        if let Some(light) = self.leave_out.iter().find(|&&light| light >= lights) {
            return refuse(format!(
                "light {light} cannot be left out: the dataset has {lights} lights, numbered 0 to {}",
                lights.saturating_sub(1)
            ));
        }
        if let Some((i, light)) = self.leave_out.iter().enumerate().find(|(i, l)| self.leave_out[..*i].contains(l)) {
            return refuse(format!("light {light} is left out twice (entry {} of the list): remove one", i + 1));
        }
        if (0..lights).all(|light| self.leave_out.contains(&light)) {
            return refuse("every light is left out: keep at least one to fit".to_owned());
        }
        Ok(())
    }
}

fn one_of(what: &str, name: &str, known: &[&str]) -> FitError {
    FitError::Input(format!("unknown {what} \"{name}\": choose one of {}", known.join(", ")))
}
