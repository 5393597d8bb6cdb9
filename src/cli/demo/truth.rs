//! A fitted material beside the one the simulated ball is made of.
//!
//! The gauge (gamma_m -> a gamma_m, rho_m -> rho_m / a) is removed first: each fitted material is scaled so that its weight
//! map fits the true one best.

use crate::numerics::brdf::Material;
use crate::numerics::geometry::Vec3;
use crate::pipeline::dataset::Geometry;
use crate::sim::world::World;
use crate::store::result::StoredMaterial;
use crate::study::relit::{UNSEEN_DEG, relit, true_geometry};
use anyhow::Context;
use rig_config::Rig;
use std::io::Write;

/// Every parameter must be this close to the truth for the material to count as recovered.
const PARAMETER_LIMIT: f64 = 0.25;

/// One line of the comparison.
struct Line {
    name: String,
    truth: f64,
    found: f64,
}

impl Line {
    fn error(&self) -> f64 {
        self.found / self.truth - 1.0
    }
}

/// The comparison.
pub struct Verdict {
    lines: Vec<Line>,
    mean_relative_error: f64,
    papers_error: f64,
    relight_error: f64,
    /// Relighting must be this good, mean relative error.
    relight_limit: f64,
    weight_error: f64,
}

impl Verdict {
    /// True when errors and every parameter are within their limits.
    pub fn recovered(&self) -> bool {
        self.mean_relative_error <= self.papers_error
            && self.relight_error <= self.relight_limit
            && self.lines.iter().all(|line| line.error().abs() <= PARAMETER_LIMIT)
    }

    /// Prints the comparison; what is out of its limit is marked with !.
    pub fn print(&self, out: &mut impl Write) -> std::io::Result<()> {
        let mark = |ok: bool| if ok { ' ' } else { '!' };
        writeln!(out, "  {:<24} {:>9} {:>9} {:>8}", "parameter", "truth", "found", "error")?;
        for line in &self.lines {
            let error = line.error();
            writeln!(
                out,
                "{} {:<24} {:>9.4} {:>9.4} {:>+7.1}%",
                mark(error.abs() <= PARAMETER_LIMIT),
                line.name,
                line.truth,
                line.found,
                100.0 * error
            )?;
        }
        writeln!(
            out,
            "  (found: albedos with the weights scaled to the true ones; page and report have them at a largest weight of 1)"
        )?;
        writeln!(out, "  weight maps: rms error {:.3}", self.weight_error)?;
        writeln!(
            out,
            "{} mean relative error {:.2} % (paper {:.2} %)",
            mark(self.mean_relative_error <= self.papers_error),
            100.0 * self.mean_relative_error,
            100.0 * self.papers_error
        )?;
        writeln!(
            out,
            "{} relighting under {} unseen lights: mean relative error {:.2} % (limit {} %)",
            mark(self.relight_error <= self.relight_limit),
            UNSEEN_DEG.len(),
            100.0 * self.relight_error,
            100.0 * self.relight_limit
        )
    }
}

/// Compares a fitted material with the ball of `rig`'s simulation.
pub fn compare(
    rig: &Rig,
    stored: &StoredMaterial,
    mean_relative_error: f64,
    (papers_error, relight_limit): (f64, f64),
) -> anyhow::Result<Verdict> {
    let simulation = rig.simulation.as_ref().context("the rig is not simulated")?;
    let world = World::new(rig, simulation);
    let geometry = true_geometry(rig, &world);
    let found = stored.material.materials();
    let (lines, weight_error) = match_materials(&world, stored, &geometry, &found)?;
    let relit = relit(rig, &world, stored).context("no fitted point is lit by an unseen light")?;
    let relight_error = relit.overall;
    Ok(Verdict { lines, mean_relative_error, papers_error, relight_error, relight_limit, weight_error })
}

/// Weights of one material over the fitted pixels, found and true.
fn weight_pairs(
    world: &World,
    stored: &StoredMaterial,
    geometry: &Geometry,
    found: usize,
    truth: usize,
) -> Vec<(f64, f64)> {
    let mut pairs = Vec::new();
    for y in 0..geometry.height {
        for x in 0..geometry.width {
            if stored.weights.iter().all(|map| *map.at(x, y) == 0.0) {
                continue;
            }
            let ray = geometry.projection.ray(x as f64 + 0.5, y as f64 + 0.5);
            if let Some(point) = geometry.object.at(x, y, &ray) {
                pairs.push((f64::from(*stored.weights[found].at(x, y)), world.scene().weights(&point.normal)[truth]));
            }
        }
    }
    pairs
}

/// Pairs found with true materials by hue, removes the gauge, and lists every parameter; and the rms error of the weights.
fn match_materials(
    world: &World,
    stored: &StoredMaterial,
    geometry: &Geometry,
    found: &[Material],
) -> anyhow::Result<(Vec<Line>, f64)> {
    let truth = world.scene().materials();
    anyhow::ensure!(found.len() == truth.len(), "{} materials were fitted, the ball has {}", found.len(), truth.len());
    let straight = hue_distance(&found[0], &truth[0]) + hue_distance(&found[1], &truth[1]);
    let crossed = hue_distance(&found[0], &truth[1]) + hue_distance(&found[1], &truth[0]);
    let mut lines = Vec::new();
    let (mut squares, mut count) = (0.0, 0.0);
    for (t, true_material) in truth.iter().enumerate() {
        let f = if straight <= crossed { t } else { 1 - t };
        let pairs = weight_pairs(world, stored, geometry, f, t);
        let product: f64 = pairs.iter().map(|(a, b)| a * b).sum();
        let square: f64 = pairs.iter().map(|(a, _)| a * a).sum();
        let gauge = product / square;
        squares += pairs.iter().map(|(a, b)| (gauge * a - b).powi(2)).sum::<f64>();
        count += pairs.len() as f64;
        lines.extend(parameter_lines(t, true_material, &found[f], gauge));
    }
    Ok((lines, (squares / f64::max(count, 1.0)).sqrt()))
}

fn hue_distance(a: &Material, b: &Material) -> f64 {
    let unit = |m: &Material| Vec3::from(m.rho_d).normalize();
    (unit(a) - unit(b)).norm()
}

fn parameter_lines(material: usize, truth: &Material, found: &Material, gauge: f64) -> Vec<Line> {
    let mut lines = Vec::new();
    let name = |what: &str| format!("material {} {what}", material + 1);
    for (c, channel) in ["red", "green", "blue"].iter().enumerate() {
        let found = found.rho_d[c] / gauge;
        lines.push(Line { name: name(&format!("rho_d {channel}")), truth: truth.rho_d[c], found });
    }
    for (c, channel) in ["red", "green", "blue"].iter().enumerate() {
        let found = found.rho_s[c] / gauge;
        lines.push(Line { name: name(&format!("rho_s {channel}")), truth: truth.rho_s[c], found });
    }
    lines.push(Line { name: name("beta"), truth: truth.beta, found: found.beta });
    lines
}
