//! A pbrt-v4 scene: every material a `mix` of diffuse and conductor, and all of them nested `mix`es with the amounts as textures.
//!
//! A mix takes one of two materials, so parts add up to 1 and no colour exceeds 1. The last of the chain is black: it takes what
//! the weights leave. Where the weights of a texel add up to more than 1, or albedos do, the whole material is darker by one factor
//! and the light of the scene brighter by it.

use super::ply::{V, ply};
use super::surface::{IRRADIANCE, PIXELS, TO_LIGHT};
use super::{Captured, Export, File, Format, Model, Words};
use crate::numerics::brdf::nearest::{Nearest, Other, fresnel, ggx_correlated, nearest};
use crate::numerics::brdf::{Lobe, Material};
use crate::numerics::geometry::Vec3;
use crate::numerics::render::tile::{Texels, Tile};
use nalgebra::Complex;
use std::f64::consts::FRAC_1_PI;

/// The format.
pub const FORMAT: Format = Format { name: "pbrt", about: "pbrt-v4 scene", make };

/// Reflectances at normal incidence that a conductor may have: nearly 1, so that it hardly grows towards grazing, or a dielectric's.
const REFLECTANCES: [f64; 2] = [0.9999, 0.04];
/// What is left of a texel counts as nothing below this.
const NOTHING: f64 = 1e-6;

/// A material as the scene says it, before the common factor: `diffuse / pi + amount x conductor`.
struct Said {
    nearest: Nearest,
    /// Reflectance of the conductor at normal incidence, per channel.
    reflectance: [f64; 3],
    /// Factor of the conductor.
    amount: f64,
}

/// Fresnel reflectance as pbrt makes it of a reflectance at normal incidence: index 1, absorption k.
fn reflected(cos: f64, reflectance: f64) -> f64 {
    let k = 2.0 * reflectance.sqrt() / (1.0 - reflectance).sqrt();
    fresnel(cos, Complex::new(1.0, k))
}

fn said(material: &Material, lobe: &dyn Lobe) -> Said {
    let tried = REFLECTANCES.map(|most| {
        let other: Box<Other> =
            Box::new(move |a, alpha| ggx_correlated(a, alpha) * reflected(a.cos_difference(), most) / most);
        let nearest = nearest(material, lobe, &*other);
        let brightest = nearest.specular.into_iter().fold(0.0, f64::max);
        let part = |s: f64| if brightest > 0.0 { most * s / brightest } else { 0.0 };
        Said { reflectance: nearest.specular.map(part), amount: brightest / most, nearest }
    });
    let [flat, growing] = tried;
    // A conductor of 4 % needs 25 times the amount: taken where there is room for it.
    let fits = growing.amount + brightest(growing.nearest.diffuse) <= 1.0;
    if fits && growing.nearest.error < flat.nearest.error { growing } else { flat }
}

fn brightest(colour: [f64; 3]) -> f64 {
    colour.into_iter().fold(0.0, f64::max)
}

/// The chain of mixes, as the files say it.
struct Chain {
    materials: Vec<Said>,
    /// Amount of each material in what those before it leave, by texel.
    amounts: Vec<Vec<f32>>,
    /// What amounts are to be multiplied by to be weights.
    sum: f64,
    /// How much darker the material is than measured, and the light brighter.
    darker: f64,
}

impl Chain {
    fn of(captured: &Captured) -> Self {
        let materials: Vec<Said> = captured.materials.iter().map(|material| said(material, captured.lobe)).collect();
        let texels = &captured.tile.texels().weights;
        let total = |texel: &[f32]| texel.iter().map(|weight| f64::from(*weight)).sum::<f64>();
        let sum = texels.iter().map(|texel| total(texel)).fold(1.0, f64::max);
        let amount = |m: usize, texel: &[f32]| {
            let left = 1.0 - total(&texel[..m]) / sum;
            if left > NOTHING { (f64::from(texel[m]) / sum / left).min(1.0) as f32 } else { 0.0 }
        };
        let amounts = (0..materials.len()).map(|m| texels.iter().map(|texel| amount(m, texel)).collect()).collect();
        let most =
            materials.iter().map(|said| sum * (brightest(said.nearest.diffuse) + said.amount)).fold(1.0, f64::max);
        Self { materials, amounts, sum, darker: most }
    }

    /// Factor of albedos in the scene.
    fn scale(&self) -> f64 {
        self.sum / self.darker
    }

    /// Part of the conductor in the mix of a material, and reflectance of its diffuse part.
    fn parts(&self, m: usize) -> (f64, [f64; 3]) {
        let said = &self.materials[m];
        let amount = (self.scale() * said.amount).clamp(0.0, 1.0);
        let left = (1.0 - amount).max(NOTHING);
        (amount, said.nearest.diffuse.map(|rho| (self.scale() * rho / left).min(1.0)))
    }

    /// The scene as pbrt evaluates it, in the mean over its choices, under a light as bright as the scene's.
    fn model(self, captured: &Captured) -> Box<Model> {
        let texel = |i: usize| std::array::from_fn(|m| self.amounts.get(m).map_or(0.0, |map| map[i]));
        let side = captured.side();
        let texels = Texels { size: (side, side), weights: (0..side * side).map(texel).collect() };
        let amounts = Tile::seamless(texels);
        Box::new(move |[u, v], angles| {
            let (mut sum, mut left) = ([0.0; 3], 1.0);
            let cos = angles.cos_difference();
            for (m, (said, amount)) in self.materials.iter().zip(amounts.at(u, v)).enumerate() {
                let (part, diffuse) = self.parts(m);
                let lobe = part * ggx_correlated(angles, said.nearest.alpha);
                for c in 0..3 {
                    let brdf = (1.0 - part) * diffuse[c] * FRAC_1_PI + lobe * reflected(cos, said.reflectance[c]);
                    sum[c] += left * amount * self.darker * brdf;
                }
                left *= 1.0 - amount;
            }
            sum
        })
    }

    fn text(&self, captured: &Captured) -> String {
        let count = self.materials.len();
        let mut text = String::new();
        for m in 0..count {
            let (part, diffuse) = self.parts(m);
            let n = m + 1;
            text += &format!(
                "\nTexture \"amount_{n}\" \"float\" \"imagemap\" \"string filename\" \"amount_{n}.exr\" \"string wrap\" \"repeat\" \"string filter\" \"bilinear\"\nMakeNamedMaterial \"diffuse_{n}\" \"string type\" \"diffuse\" \"rgb reflectance\" [ {} ]\nMakeNamedMaterial \"lobe_{n}\" \"string type\" \"conductor\" \"rgb reflectance\" [ {} ] \"float roughness\" [ {} ] \"bool remaproughness\" false\nMakeNamedMaterial \"material_{n}\" \"string type\" \"mix\" \"string materials\" [ \"diffuse_{n}\" \"lobe_{n}\" ] \"float amount\" [ {} ]\n",
                three(diffuse),
                three(self.materials[m].reflectance),
                self.materials[m].nearest.alpha as f32,
                part as f32,
            );
        }
        text += "\nMakeNamedMaterial \"mixed_0\" \"string type\" \"diffuse\" \"rgb reflectance\" [ 0 0 0 ]\n";
        for (step, m) in (0..count).rev().enumerate() {
            text += &format!(
                "MakeNamedMaterial \"mixed_{}\" \"string type\" \"mix\" \"string materials\" [ \"mixed_{step}\" \"material_{}\" ] \"texture amount\" \"amount_{}\"\n",
                step + 1,
                m + 1,
                m + 1
            );
        }
        let view = captured.surface.view;
        let vector = |v: Vec3| three([v.x, v.y, v.z]);
        format!(
            "# {count} materials of the model {}, captured by {}\nScale -1 1 1\nLookAt {} {} 0 1 0\nCamera \"perspective\" \"float fov\" [ {} ]\nSampler \"zsobol\" \"integer pixelsamples\" [ 256 ]\nPixelFilter \"box\"\nIntegrator \"path\" \"integer maxdepth\" [ 1 ]\nFilm \"rgb\" \"integer xresolution\" [ {PIXELS} ] \"integer yresolution\" [ {PIXELS} ] \"string filename\" \"render.exr\"\n\nWorldBegin\nLightSource \"distant\" \"point3 from\" [ {} ] \"point3 to\" [ 0 0 0 ] \"rgb L\" [ {} ]\n{text}\nNamedMaterial \"mixed_{count}\"\nShape \"plymesh\" \"string filename\" \"shape.ply\"\n",
            captured.description.model,
            super::words::comment(&captured.description.provenance.software),
            vector(view.position),
            vector(view.look_at),
            view.field_deg,
            vector(Vec3::from(TO_LIGHT).normalize()),
            three([IRRADIANCE * self.darker; 3]),
        )
    }
}

fn three(values: [f64; 3]) -> String {
    values.map(|value| (value as f32).to_string()).join(" ")
}

fn make(captured: &Captured) -> Result<Export, String> {
    let chain = Chain::of(captured);
    let mut files: Vec<File> = chain
        .amounts
        .iter()
        .enumerate()
        .map(|(m, map)| File {
            name: format!("amount_{}.exr", m + 1),
            content: captured.tile_map(map.clone(), "amount of a material in what those before it leave"),
        })
        .collect();
    files.push(File::bytes("shape.ply", ply(&captured.surface, V::Up)));
    files.push(File::text("scene.pbrt", chain.text(captured)));
    let words = words(&chain, captured.lobe.has_lobe());
    Ok(Export { files, words, model: Some(chain.model(captured)) })
}

fn words(chain: &Chain, has_lobe: bool) -> Words {
    let mut loses = Vec::new();
    if has_lobe {
        loses.push("pbrt-v4 masks light and view correlated by height, and its Fresnel reflectance is a conductor's: no lobe of rigd's is exactly one of pbrt's. The nearest are, root mean square over all angles:".to_owned());
        loses.extend(chain.materials.iter().enumerate().map(|(m, said)| {
            format!("Material {}: alpha {:.4}, {:.1} % off.", m + 1, said.nearest.alpha, 100.0 * said.nearest.error)
        }));
    }
    loses.push(
        "Between texels the product of two amounts is not straight; the materials at the texels are right.".to_owned(),
    );
    loses.push("pbrt takes one of the mixed materials at random: noise that falls with the number of samples. It renders spectra: colours are exact for white light alone.".to_owned());
    if chain.darker > 1.0 {
        loses.push(format!(
            "Weights and albedos add up to more than 1, which pbrt cuts off: the material is {0:.4} times darker than measured, the light of the scene {0:.4} times brighter.",
            chain.darker
        ));
    }
    loses.push("Standard errors have no place in a scene; numbers are in single precision.".to_owned());
    Words {
        carries: vec![
            "scene.pbrt: camera, a distant light, and the material; amount_1.exr ...; shape.ply.".to_owned(),
            "Nested mix materials, any number: amount_1 is the part of material 1, amount_2 that of material 2 in what is left, and so on; the rest is black.".to_owned(),
        ],
        loses,
        open: vec![
            "pbrt scene.pbrt. The integrator follows light once, as rigd render does: raise maxdepth for all of it. Not with --gpu or --wavefront where these refuse textures of a mix.".to_owned(),
        ],
    }
}
