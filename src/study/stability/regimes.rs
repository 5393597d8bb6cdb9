//! The regimes: what goes wrong with a capture, and how much.

use super::POINTS;
use crate::study::forward::{Reflectance, TrueMaterial};
use crate::study::scene::{Clipping, LIGHT_AZIMUTHS_DEG, Scene};

/// One level of one regime.
#[derive(Clone, Debug)]
pub struct Row {
    /// What is wrong.
    pub regime: &'static str,
    /// How much.
    pub level: &'static str,
    /// The scene.
    pub scene: Scene,
    /// Number of materials to fit.
    pub materials: usize,
}

/// Every level of every regime; the short form takes the last, hardest level of each.
pub fn rows(long: bool) -> Vec<Row> {
    let mut table = Table { long, rows: Vec::new() };
    table.sweep("undisturbed wood", &[("", ())], |scene, ()| *scene = Scene { points: POINTS, ..Scene::wood() });
    table.sweep("undisturbed marble", &[("", ())], |_, ()| {});
    sensor(&mut table);
    rig(&mut table);
    materials(&mut table);
    table.sweep("all at once", &[("Ward", Reflectance::Ward), ("GGX, Fresnel", Reflectance::GgxFresnel)], ordinary);
    table.rows
}

/// Rows under construction.
struct Table {
    long: bool,
    rows: Vec<Row>,
}

impl Table {
    /// Adds one row a level: small marble, changed, fitted with as many materials as it has.
    fn sweep<T: Copy>(&mut self, regime: &'static str, levels: &[(&'static str, T)], change: impl Fn(&mut Scene, T)) {
        self.fitted(regime, levels, None, change);
    }

    /// The same with a number of materials to fit.
    fn fitted<T: Copy>(
        &mut self,
        regime: &'static str,
        levels: &[(&'static str, T)],
        materials: Option<usize>,
        change: impl Fn(&mut Scene, T),
    ) {
        let first = if self.long { 0 } else { levels.len() - 1 };
        for &(level, amount) in &levels[first..] {
            let mut scene = Scene { points: POINTS, ..Scene::marble() };
            change(&mut scene, amount);
            let materials = materials.unwrap_or(scene.materials.len());
            self.rows.push(Row { regime, level, scene, materials });
        }
    }
}

/// Noise, dark floor, clipping, outliers.
fn sensor(table: &mut Table) {
    table.sweep("noise", &[("1 %", 0.01), ("3 %", 0.03), ("5 %", 0.05)], |scene, noise| scene.noise = noise);
    let floors = [("2 % of median", 0.02), ("5 % of median", 0.05), ("10 % of median", 0.1)];
    table.sweep("dark floor, known", &floors, |scene, floor| scene.floor = floor);
    table.sweep("dark floor, unknown", &floors, |scene, floor| {
        scene.floor = floor;
        scene.variance_known = false;
    });
    let limits = [("4 x median", 4.0), ("2 x median", 2.0), ("1.5 x median", 1.5)];
    for (regime, kept) in [("clipped, kept", true), ("clipped, dropped", false)] {
        table.sweep(regime, &limits, |scene, at_medians| scene.clipping = Some(Clipping { at_medians, kept }));
    }
    table.sweep("outliers", &[("1 %", 0.01), ("5 %", 0.05)], |scene, share| scene.outliers = share);
}

/// Lights and geometry.
fn rig(table: &mut Table) {
    let lights: [(&str, &[f64]); 5] = [
        ("6", &LIGHT_AZIMUTHS_DEG[..6]),
        ("5", &LIGHT_AZIMUTHS_DEG[..5]),
        ("4", &[-55.0, -20.0, 50.0, 85.0]),
        ("3", &[-55.0, 15.0, 85.0]),
        ("2", &[-20.0, 50.0]),
    ];
    table.sweep("number of lights", &lights, |scene, lights| scene.azimuths_deg = lights.to_vec());
    let errors = [("1 mm", 1.0), ("2 mm", 2.0), ("5 mm", 5.0)];
    table.sweep("light position error", &errors, |scene, mm| scene.light_error_mm = mm);
    table.sweep("intensity drift", &[("1 %", 0.01), ("3 %", 0.03), ("5 %", 0.05)], |scene, drift| scene.drift = drift);
    table.sweep("distance term ignored", &[("", ())], |scene, ()| scene.distance_ignored = true);
    table.sweep("grazing samples", &[("cos > 0.01", 0.01)], |scene, cutoff| scene.cosine_cutoff = cutoff);
}

/// What the ball is made of.
fn materials(table: &mut Table) {
    table.sweep("grey", &[("", ())], |scene, ()| grey(scene));
    table.sweep("same hue", &[("", ())], |scene, ()| {
        scene.materials[1].rho_d = scene.materials[0].rho_d.map(|albedo| 0.15 * albedo);
    });
    table.sweep("same lobe", &[("beta 0.08", 0.08)], |scene, beta| {
        for material in &mut scene.materials {
            material.beta = beta;
        }
    });
    let roughness = [("0.30 / 0.40", [0.3, 0.4]), ("0.60 / 0.80", [0.6, 0.8])];
    table.sweep("broad lobe, beta", &roughness, set_beta);
    table.sweep("needle lobe, beta", &[("0.015 / 0.02", [0.015, 0.02])], set_beta);
    let laws = [("", Reflectance::Ggx), ("with Fresnel", Reflectance::GgxFresnel)];
    table.sweep("truth is GGX", &laws, |scene, law| scene.reflectance = law);
    for (level, fitted) in [("1", 1), ("2", 2)] {
        table.fitted("1 material, fitted with", &[(level, ())], Some(fitted), |scene, ()| scene.materials.truncate(1));
    }
    for (level, fitted) in [("2", 2), ("3", 3)] {
        table.fitted("3 materials, fitted with", &[(level, ())], Some(fitted), |scene, ()| {
            scene.materials.push(TrueMaterial { rho_d: [0.10, 0.22, 0.30], rho_s: [0.03, 0.04, 0.05], beta: 0.18 });
        });
    }
}

fn set_beta(scene: &mut Scene, beta: [f64; 2]) {
    for (material, beta) in scene.materials.iter_mut().zip(beta) {
        material.beta = beta;
    }
}

fn grey(scene: &mut Scene) {
    for material in &mut scene.materials {
        material.rho_d = [material.rho_d.iter().sum::<f64>() / 3.0; 3];
        material.rho_s = [material.rho_s.iter().sum::<f64>() / 3.0; 3];
    }
}

/// The imperfections of an ordinary rig together: enough to explain the fit error of Zheng 2008.
fn ordinary(scene: &mut Scene, law: Reflectance) {
    scene.reflectance = law;
    scene.distance_ignored = true;
    scene.light_error_mm = 2.0;
    scene.drift = 0.02;
    scene.outliers = 0.01;
    scene.floor = 0.02;
}
