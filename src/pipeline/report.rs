//! What a fit says of itself: `report.json` and `material.json`.

use crate::numerics::brdf;
use crate::numerics::fit::selection::Candidate;
use crate::numerics::fit::{MAX_MATERIALS, Mixture};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Seconds of wall time a stage took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Seconds {
    /// Reading the dataset; added by who read it.
    pub load: f64,
    /// Gathering samples.
    pub observe: f64,
    /// Choosing the number of materials and the start of the fit.
    pub initialise: f64,
    /// Solving, standard errors and judging.
    pub fit: f64,
    /// All of it.
    pub total: f64,
}

/// A combination of materials, model, lobe and light gains that was tried.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CandidateReport {
    /// Number of materials.
    pub materials: usize,
    /// BRDF model.
    pub model: String,
    /// Colour of the lobe: `none`, `achromatic`, `coloured`.
    pub lobe: String,
    /// True where a gain was fitted for each light.
    pub light_gains: bool,
    /// Mean relative error on left-out lights; none where no light can be left out.
    pub left_out_relative_error: Option<f64>,
    /// The same on their highlights.
    pub left_out_highlight_relative_error: Option<f64>,
    /// Bayes' information criterion over the weights in use; the smaller the better.
    pub bic: f64,
    /// True for the one taken.
    pub taken: bool,
    /// Why it was taken or refused.
    pub reason: String,
}

impl From<&Candidate> for CandidateReport {
    fn from(candidate: &Candidate) -> Self {
        Self {
            materials: candidate.materials,
            model: candidate.lobe.name().to_owned(),
            lobe: candidate.colour.name().to_owned(),
            light_gains: candidate.gains.is_some(),
            left_out_relative_error: candidate.left_out.map(|errors| errors.overall),
            left_out_highlight_relative_error: candidate.left_out.and_then(|errors| errors.highlight),
            bic: candidate.bic,
            taken: candidate.taken,
            reason: candidate.reason.clone(),
        }
    }
}

/// What an adaptive session did not shoot, and what that cost.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Saved {
    /// Exposures of the plan that were left out.
    pub exposures: usize,
    /// Light stations of the plan that were left out; their exposures are counted above.
    pub stations: usize,
    /// Shutter time of all these exposures, seconds.
    pub shutter_s: f64,
    /// Relative standard error of a sample that the noise model predicts with the exposures shot, mean over samples and metered stations;
    /// null where none was metered.
    pub sigma: Option<f64>,
    /// The same with all exposures of the plan.
    pub sigma_whole: Option<f64>,
    /// What the last fit said of the lights shot so far; null where no fit was asked.
    pub lights: Option<LightsReached>,
}

impl std::fmt::Display for Saved {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { exposures, stations, shutter_s, .. } = self;
        write!(f, "{exposures} exposures ({stations} whole stations), {shutter_s:.1} s of shutter time")?;
        if let (Some(sigma), Some(whole)) = (self.sigma, self.sigma_whole) {
            let (sigma, whole) = (100.0 * sigma, 100.0 * whole);
            write!(f, "; predicted standard error of a sample {sigma:.2} % instead of {whole:.2} %")?;
        }
        if let Some(LightsReached { stations, left_out_error: Some(error), .. }) = &self.lights {
            write!(f, "; left-out lights of {stations} stations predicted within {:.2} %", 100.0 * error)?;
        }
        Ok(())
    }
}

/// What a fit said of the light stations shot so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LightsReached {
    /// How many they were.
    pub stations: usize,
    /// Mean relative error on lights that it left out.
    pub left_out_error: Option<f64>,
    /// Largest relative standard error of a parameter; null where the data do not determine one.
    pub parameter_error: Option<f64>,
    /// True when both met their targets, and no more stations were shot.
    pub enough: bool,
}

/// One light of the dataset, as the fit explains it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightReport {
    /// Its image.
    pub image: String,
    /// True when the fit did not see it: its error is then one of prediction.
    pub left_out: bool,
    /// Samples used, or predicted.
    pub samples: usize,
    /// Mean of |I - model| / I over them and the channels; null where there is no sample.
    pub mean_relative_error: Option<f64>,
}

/// `report.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Object points used.
    pub pixels: usize,
    /// Samples used: point under light, all three channels.
    pub samples: usize,
    /// Number of materials.
    pub materials: usize,
    /// BRDF model.
    pub model: String,
    /// Colour of the lobe: `none`, `achromatic`, `coloured`.
    pub lobe: String,
    /// Factor of each light's irradiance, where left-out lights asked for gains; their geometric mean is 1.
    pub light_gains: Option<Vec<f64>>,
    /// Solver.
    pub solver: String,
    /// Rule of the weights.
    pub weights: String,
    /// Objective.
    pub objective: String,
    /// Mean of |I - model| / I over used samples and channels.
    pub mean_relative_error: f64,
    /// The same on samples with a half angle below 6 degrees.
    pub highlight_relative_error: Option<f64>,
    /// The same on the lights left out.
    pub left_out_relative_error: Option<f64>,
    /// The same on the highlight samples of the lights left out.
    pub left_out_highlight_relative_error: Option<f64>,
    /// Indices of the lights left out.
    pub left_out: Vec<usize>,
    /// Every light, in the order of the dataset; empty in reports of earlier versions.
    #[serde(default)]
    pub lights: Vec<LightReport>,
    /// Weighted squared residuals, summed.
    pub cost: f64,
    /// Chi^2 (noise and model floor) over degrees of freedom.
    pub reduced_chi2: f64,
    /// Outer iterations of the solver.
    pub iterations: usize,
    /// Why the solver ended: `converged` or `iteration limit`.
    pub termination: String,
    /// Wall time.
    pub seconds: Seconds,
    /// Processor time of the whole process while loading and fitting, seconds.
    pub cpu_seconds: f64,
    /// Least cosine of incidence and of reflection of a used sample.
    pub cosine_cutoff: f64,
    /// Lit, visible samples without a usable value: clipped, too dark, or masked.
    pub unusable_samples: usize,
    /// What was tried, and what left-out lights said of it.
    pub candidates: Vec<CandidateReport>,
    /// What a reader must know before trusting the figures.
    pub warnings: Vec<String>,
    /// How the solver went about it, where that is worth knowing.
    pub notes: Vec<String>,
    /// What the session left out of its plan; null of one that shot all of it, and of a dataset that is no session's.
    #[serde(default)]
    pub adaptive: Option<Saved>,
}

impl Report {
    /// Adds the time that reading the dataset took: wall time and processor time, seconds.
    pub fn add_load(&mut self, wall_s: f64, cpu_s: f64) {
        self.seconds.load += wall_s;
        self.seconds.total += wall_s;
        self.cpu_seconds += cpu_s;
    }
}

/// How well the data determine a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Identified {
    /// Measured.
    Identified,
    /// Measured poorly; see the reason.
    Weak,
    /// Not determined by the data; the value only completes the model.
    Unidentified,
}

/// A fitted parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// Its value.
    pub value: f64,
    /// Its standard error; none when it did not move with the data.
    pub standard_error: Option<f64>,
    /// How well the data determine it.
    pub identified: Identified,
    /// Why it is weak or unidentified.
    pub reason: Option<String>,
}

/// One material of `material.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MaterialReport {
    /// Part of the object's weighted diffuse albedo, 0 to 1.
    pub share: f64,
    /// Diffuse albedo per channel.
    pub rho_d: Vec<Parameter>,
    /// Specular albedo per channel; empty for a model without a lobe.
    pub rho_s: Vec<Parameter>,
    /// Roughness; none for a model without a lobe.
    pub beta: Option<Parameter>,
}

impl MaterialReport {
    fn check(&self, has_lobe: bool) -> Result<(), String> {
        check_albedo("rho_d", &self.rho_d)?;
        match (&self.beta, has_lobe) {
            (Some(beta), true) if beta.value.is_finite() && beta.value > 0.0 => check_albedo("rho_s", &self.rho_s),
            (Some(beta), true) => Err(format!("beta is {}: it must be finite and positive", beta.value)),
            (None, true) => Err("beta is missing: a model with a lobe needs it".to_owned()),
            (None, false) if self.rho_s.is_empty() => Ok(()),
            (_, false) => Err("rho_s must be empty and beta null: this model has no lobe".to_owned()),
        }
    }
}

fn check_albedo(name: &str, channels: &[Parameter]) -> Result<(), String> {
    let values: Vec<f64> = channels.iter().map(|p| p.value).collect();
    if values.len() == 3 && values.iter().all(|v| v.is_finite() && *v >= 0.0) {
        return Ok(());
    }
    Err(format!("{name} is {values:?}: three finite values that are not negative are needed"))
}

/// Where a result comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Program and version.
    pub software: String,
    /// Images the material was fitted to.
    pub images: Vec<String>,
    /// True when the frames came from a simulated rig; null when the dataset does not say.
    pub simulated: Option<bool>,
    /// The calibration that lights and camera come from; null when the dataset does not say.
    #[serde(default)]
    pub calibration: Option<String>,
}

/// `material.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MaterialFile {
    /// Version of this file's shape.
    pub format: u32,
    /// BRDF model.
    pub model: String,
    /// What was pinned to make the parameters unique.
    pub gauge: String,
    /// Materials in the order of the channels of `weights.exr`.
    pub materials: Vec<MaterialReport>,
    /// Width and height of the weight map, pixels.
    pub size: [usize; 2],
    /// Where it comes from.
    pub provenance: Provenance,
}

/// The gauge every result is in.
pub const GAUGE: &str = "max gamma = 1 per material; materials ordered by share; standard errors are relative to the largest diffuse albedo";

impl MaterialFile {
    /// Refuses what does not say in full how the materials reflect: nothing missing is made up, nothing present passed over.
    ///
    /// # Errors
    /// What is wrong, and where in the file.
    pub fn check(&self) -> Result<(), String> {
        let Some(lobe) = brdf::by_name(&self.model).filter(|_| self.format == 1) else {
            return Err(format!(
                "format {} with model {:?} cannot be read by this version: format 1 with one of {}",
                self.format,
                self.model,
                brdf::names().join(", ")
            ));
        };
        if !(1..=MAX_MATERIALS).contains(&self.materials.len()) {
            return Err(format!("{} materials: 1 to {MAX_MATERIALS} are possible", self.materials.len()));
        }
        let mut materials = self.materials.iter().enumerate();
        materials.try_for_each(|(m, material)| {
            material.check(lobe.has_lobe()).map_err(|reason| format!("materials[{m}], model {}: {reason}", self.model))
        })
    }

    /// Largest standard error of a parameter, relative to its value; none where the data do not determine one of them.
    pub fn worst_parameter(&self) -> Option<f64> {
        let parameters = self.materials.iter().flat_map(|m| m.rho_d.iter().chain(&m.rho_s).chain(&m.beta));
        parameters.filter(|p| p.standard_error.is_some() || p.identified != Identified::Identified).try_fold(
            0.0,
            |worst, parameter| {
                let error = parameter.standard_error.filter(|_| parameter.identified != Identified::Unidentified)?;
                Some(f64::max(worst, error / parameter.value.abs()))
            },
        )
    }

    /// The BRDF parameters alone.
    pub fn materials(&self) -> Vec<crate::numerics::brdf::Material> {
        let triple = |list: &[Parameter]| std::array::from_fn(|c| list.get(c).map_or(0.0, |p| p.value));
        self.materials
            .iter()
            .map(|m| crate::numerics::brdf::Material {
                rho_d: triple(&m.rho_d),
                rho_s: triple(&m.rho_s),
                beta: m.beta.as_ref().map_or(1.0, |p| p.value),
            })
            .collect()
    }
}

/// Part of the object each material makes up.
pub(crate) fn shares(mixture: &Mixture) -> Vec<f64> {
    let share: Vec<f64> = crate::numerics::fit::gauge::shares(mixture);
    let total: f64 = share.iter().sum();
    share.iter().map(|s| if total > 0.0 { s / total } else { 0.0 }).collect()
}
