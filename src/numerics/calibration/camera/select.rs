//! Which freedoms of the interior the views ask for and determine. A free parameter that the views do not determine raises the
//! others' errors while the reprojection error stays the same, so the error alone cannot choose.

use super::adjust::{Adjusted, Free, adjust, free};
use super::interior::{Freedom, Interior, UNKNOWNS};
use super::pose::Pose;
use super::{Size, View};
use nalgebra::{Matrix6, SMatrix};

/// A freedom must lower chi^2, in units of the noise left, by this much per unknown: chance alone does so once in 2000 times.
const GAIN: f64 = 12.0;
/// Greatest standard deviation of the principal point in a model taken, parts of the image's diagonal: 5 px of 5250.
const PRINCIPAL_SIGMA: f64 = 1e-3;
/// Greatest relative standard deviation of the focal length in a model taken.
const FOCAL_SIGMA: f64 = 5e-3;

/// Why a freedom is free or held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// Free: the model is worse without it.
    Needed {
        /// What chi^2 would rise by if it were held.
        gain: f64,
    },
    /// Free: no camera has it exactly where it would be held, and the views determine it.
    Determined {
        /// Standard deviations, px.
        sigma_px: [f64; 2],
    },
    /// Held: freeing it explains nothing more.
    NoGain {
        /// What chi^2 would fall by.
        gain: f64,
        /// What it would have to fall by.
        needed: f64,
    },
    /// Held: with it free the principal point is uncertain.
    PrincipalUncertain {
        /// Standard deviation, px.
        sigma_px: f64,
        /// Most accepted, px.
        limit_px: f64,
    },
    /// Held: with it free the focal length is uncertain.
    FocalUncertain {
        /// Relative standard deviation.
        sigma: f64,
    },
    /// Held: it means nothing while another is held.
    Lacks(Freedom),
    /// Held: the views leave it quite open.
    Open,
}

impl Verdict {
    /// True for a freedom that is free.
    pub fn is_free(self) -> bool {
        matches!(self, Self::Needed { .. } | Self::Determined { .. })
    }
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Needed { gain } => write!(f, "free: chi^2 would be {gain:.0} higher without it"),
            Self::Determined { sigma_px: [x, y] } => {
                write!(
                    f,
                    "free: the views determine it to {x:.2}, {y:.2} px, and no camera has it exactly at the centre"
                )
            }
            Self::NoGain { gain, needed } => {
                write!(f, "held: it would lower chi^2 by only {:.1}, {needed:.0} is needed", gain.max(0.0))
            }
            Self::PrincipalUncertain { sigma_px, limit_px } => write!(
                f,
                "held: the views do not determine it; with it free the principal point is uncertain by {sigma_px:.1} px, \
                 more than {limit_px:.1} px"
            ),
            Self::FocalUncertain { sigma } => write!(
                f,
                "held: the views do not determine it; with it free the focal length is uncertain by {:.2} %",
                100.0 * sigma
            ),
            Self::Lacks(other) => write!(f, "held: it means nothing while {} is held", other.name()),
            Self::Open => write!(f, "held: the views do not determine it"),
        }
    }
}

/// A model and its fit.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    pub adjusted: Adjusted,
    pub freedoms: Vec<Freedom>,
    /// Squared residual over sigma per degree of freedom.
    pub variance: f64,
    /// Of [`Interior::values`], with the variance of the residuals; None if the views leave an unknown open.
    pub covariance: Option<(SMatrix<f64, UNKNOWNS, UNKNOWNS>, Vec<Matrix6<f64>>)>,
}

impl Fit {
    fn new(views: &[&View], freedoms: Vec<Freedom>, interior: Interior, poses: Vec<Pose>) -> Option<Self> {
        let unknowns: Free = free(&freedoms);
        let adjusted = adjust(views, &unknowns, interior, poses)?;
        let residuals = 2 * views.iter().map(|v| v.corners.len()).sum::<usize>();
        let spent = 6 * views.len() + unknowns.iter().filter(|f| **f).count();
        let left = residuals.checked_sub(spent).filter(|left| *left > 0)?;
        let variance = adjusted.cost / left as f64;
        let jacobian = adjusted.interior.values_by_unknowns();
        let covariance = adjusted.covariance(&unknowns).map(|(interior, poses)| {
            let poses = poses.iter().map(|pose| pose * variance).collect();
            (jacobian * interior * jacobian.transpose() * variance, poses)
        });
        Some(Self { adjusted, freedoms, variance, covariance })
    }

    fn refit(&self, views: &[&View], freedoms: Vec<Freedom>, size: Size) -> Option<Self> {
        let mut interior = self.adjusted.interior;
        let held = Interior::simple(1.0, size.center());
        let unknowns = free(&freedoms);
        (0..UNKNOWNS).filter(|&i| i > 0 && !unknowns[i]).for_each(|i| interior.0[i] = held.0[i]);
        Self::new(views, freedoms, interior, self.adjusted.poses.clone())
    }

    /// Relative standard deviation of the focal length.
    pub fn focal_sigma(&self) -> f64 {
        let [fx, ..] = self.adjusted.interior.values();
        self.sigma(0) / fx
    }

    /// Standard deviation of one of [`Interior::values`].
    pub fn sigma(&self, i: usize) -> f64 {
        self.covariance.as_ref().map_or(f64::INFINITY, |(c, _)| c[(i, i)].sqrt())
    }

    /// What the views leave too uncertain under this model.
    fn uncertain(&self, size: Size) -> Option<Verdict> {
        let limit_px = PRINCIPAL_SIGMA * size.diagonal();
        let sigma_px = self.sigma(2).max(self.sigma(3));
        if self.covariance.is_none() {
            return Some(Verdict::Open);
        }
        if sigma_px.is_nan() || sigma_px > limit_px {
            return Some(Verdict::PrincipalUncertain { sigma_px, limit_px });
        }
        let sigma = self.focal_sigma();
        (sigma.is_nan() || sigma > FOCAL_SIGMA).then_some(Verdict::FocalUncertain { sigma })
    }
}

/// The chosen model with the verdict on every freedom beyond the focal length.
pub(super) struct Choice {
    pub fit: Fit,
    pub verdicts: Vec<(Freedom, Verdict)>,
}

/// Adds freedoms to the focal length alone, the one that explains most first, as long as they pay and are determined.
/// None if not even the focal length can be adjusted.
pub(super) fn select(views: &[&View], size: Size, interior: Interior, poses: Vec<Pose>) -> Option<Choice> {
    let mut fit = Fit::new(views, vec![Freedom::Focal], interior, poses)?;
    let mut held;
    loop {
        let trials = trials(views, size, &fit);
        let best = trials.iter().filter(|t| t.verdict.is_free()).max_by(|a, b| a.gain.total_cmp(&b.gain));
        let Some(better) = best.and_then(|best| best.fit.clone()) else {
            held = trials.into_iter().map(|t| (t.freedom, t.verdict)).collect::<Vec<_>>();
            break;
        };
        fit = better;
    }
    let mut verdicts: Vec<_> = Vec::new();
    for freedom in Freedom::OPTIONAL {
        let verdict = match held.iter().position(|(f, _)| *f == freedom) {
            Some(at) => held.swap_remove(at).1,
            None => reason(views, size, &fit, freedom),
        };
        verdicts.push((freedom, verdict));
    }
    Some(Choice { fit, verdicts })
}

/// One freedom more.
struct Trial {
    freedom: Freedom,
    fit: Option<Fit>,
    /// Fall of chi^2 per unknown.
    gain: f64,
    verdict: Verdict,
}

fn trials(views: &[&View], size: Size, now: &Fit) -> Vec<Trial> {
    let held = Freedom::OPTIONAL.into_iter().filter(|freedom| !now.freedoms.contains(freedom));
    held.map(|freedom| {
        let lacking = freedom.needs().filter(|needed| !now.freedoms.contains(needed));
        if let Some(needed) = lacking {
            return Trial { freedom, fit: None, gain: 0.0, verdict: Verdict::Lacks(needed) };
        }
        let freedoms = now.freedoms.iter().copied().chain([freedom]).collect();
        let Some(fit) = now.refit(views, freedoms, size) else {
            return Trial { freedom, fit: None, gain: 0.0, verdict: Verdict::Open };
        };
        let gain = gain(now, &fit);
        let verdict = fit.uncertain(size).unwrap_or_else(|| judge(freedom, &fit, gain));
        Trial { freedom, gain: gain / freedom.unknowns().len() as f64, fit: Some(fit), verdict }
    })
    .collect()
}

/// By how much `richer` lowers chi^2, in units of the noise it leaves.
fn gain(poorer: &Fit, richer: &Fit) -> f64 {
    let gain = (poorer.adjusted.cost - richer.adjusted.cost) / richer.variance;
    if gain.is_nan() { 0.0 } else { gain }
}

/// The verdict on a freedom that the views determine.
fn judge(freedom: Freedom, fit: &Fit, gain: f64) -> Verdict {
    let needed = GAIN * freedom.unknowns().len() as f64;
    match freedom {
        Freedom::PrincipalPoint => Verdict::Determined { sigma_px: [fit.sigma(2), fit.sigma(3)] },
        _ if gain >= needed => Verdict::Needed { gain },
        _ => Verdict::NoGain { gain, needed },
    }
}

/// Why a freedom of the chosen model is free.
fn reason(views: &[&View], size: Size, fit: &Fit, freedom: Freedom) -> Verdict {
    if freedom == Freedom::PrincipalPoint {
        return judge(freedom, fit, 0.0);
    }
    let without = fit.freedoms.iter().copied().filter(|f| *f != freedom).collect();
    Verdict::Needed { gain: fit.refit(views, without, size).map_or(f64::INFINITY, |poorer| gain(&poorer, fit)) }
}
