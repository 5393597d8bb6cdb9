//! A Mitsuba 3 scene: every material a BSDF of its own, mixed by its weight map.
//!
//! `blendbsdf` mixes two BSDFs so that the parts add up to 1; ours adds materials up, each by its weight. So each material is blended
//! with black by its map, and the mean of all M blends is taken by nested blends of fixed weight, with colours M times as bright.
//! Mixing is then exact, between texels as well. Diffuse part and lobe of a material are added up in the same way. Colours may
//! exceed 1 thereby, which the plugin `srgb` allows if it is told to.

use super::ply::{V, ply};
use super::surface::{IRRADIANCE, PIXELS, TO_LIGHT};
use super::{Captured, Export, File, Format, Model, Words};
use crate::numerics::brdf::nearest::{Nearest, Other, beckmann_smith, fresnel, ggx_smith, nearest};
use crate::numerics::brdf::{Lobe, Material};
use crate::numerics::geometry::{Angles, Vec3};
use nalgebra::Complex;
use std::f64::consts::FRAC_1_PI;

/// The format.
pub const FORMAT: Format = Format { name: "mitsuba", about: "Mitsuba 3 scene", make };

/// Index of the dielectric whose reflectance our Fresnel models have at normal incidence.
const INDEX: f64 = 1.5;

/// How the lobe of a material is said.
struct Plugin {
    /// Name of the distribution, as the plugin knows it.
    distribution: &'static str,
    /// With the Fresnel reflectance of a dielectric, over its value at normal incidence.
    dielectric: bool,
    value: fn() -> Box<Other>,
}

fn dielectric_gain(cos: f64) -> f64 {
    let index = Complex::new(INDEX, 0.0);
    fresnel(cos, index) / fresnel(1.0, index)
}

/// Lobes of `roughconductor` that are tried.
const PLUGINS: [Plugin; 4] = [
    Plugin { distribution: "beckmann", dielectric: false, value: || Box::new(beckmann_smith) },
    Plugin {
        distribution: "beckmann",
        dielectric: true,
        value: || Box::new(|a, alpha| beckmann_smith(a, alpha) * dielectric_gain(a.cos_difference())),
    },
    Plugin { distribution: "ggx", dielectric: false, value: || Box::new(ggx_smith) },
    Plugin {
        distribution: "ggx",
        dielectric: true,
        value: || Box::new(|a, alpha| ggx_smith(a, alpha) * dielectric_gain(a.cos_difference())),
    },
];

/// A material as the scene says it.
enum Said {
    /// The model is one of Mitsuba's.
    Same(Material),
    /// The nearest lobe there is.
    Near(Nearest, &'static Plugin),
}

fn said(material: &Material, lobe: &'static dyn Lobe) -> Said {
    if !lobe.has_lobe() || lobe.name() == "ggx" {
        return Said::Same(*material);
    }
    let tried = PLUGINS.iter().map(|plugin| (nearest(material, lobe, &*(plugin.value)()), plugin));
    match tried.min_by(|a, b| a.0.error.total_cmp(&b.0.error)) {
        Some((nearest, plugin)) => Said::Near(nearest, plugin),
        None => Said::Same(*material),
    }
}

fn make(captured: &Captured) -> Result<Export, String> {
    let materials: Vec<Said> = captured.materials.iter().map(|material| said(material, captured.lobe)).collect();
    let count = materials.len();
    let scales: Vec<f64> = (0..count).map(|m| brightest(captured, m)).collect();
    let mut files: Vec<File> = (0..count)
        .map(|m| {
            let pixels =
                captured.tile_weights(m).iter().map(|weight| (f64::from(*weight) / scales[m]) as f32).collect();
            File { name: texture(m), content: captured.tile_map(pixels, "material weight, part of its largest") }
        })
        .collect();
    files.push(File::bytes("shape.ply", ply(&captured.surface, V::Down)));
    files.push(File::text("scene.xml", scene(captured, &materials, &scales)));
    let words = words(&materials);
    Ok(Export { files, model: Some(model(captured, &materials, &scales)), words })
}

/// Weights above 1 would be cut off: what the map is divided by, at least 1.
fn brightest(captured: &Captured, m: usize) -> f64 {
    captured.tile_weights(m).into_iter().fold(1.0, |most, weight| f64::max(most, f64::from(weight)))
}

fn texture(m: usize) -> String {
    format!("weight_{}.exr", m + 1)
}

/// The scene as Mitsuba evaluates it.
fn model(captured: &Captured, materials: &[Said], scales: &[f64]) -> Box<Model> {
    let tile = captured.tile.clone();
    let count = materials.len() as f64;
    let evaluated: Vec<Box<Reflect>> =
        materials.iter().zip(scales).map(|(said, scale)| reflect(said, count * scale)).collect();
    Box::new(move |[u, v], angles| {
        let mut sum = [0.0; 3];
        for (brdf, weight) in evaluated.iter().zip(tile.at(u, v)) {
            let value = brdf(angles);
            (0..3).for_each(|c| sum[c] += weight * value[c]);
        }
        sum
    })
}

/// BRDF of a material, 1/sr per channel.
type Reflect = dyn Fn(&Angles) -> [f64; 3] + Send + Sync;

/// A material out of the numbers that [`body`] writes, in single precision.
fn reflect(said: &Said, scale: f64) -> Box<Reflect> {
    let single = |value: f64| f64::from(value as f32);
    match said {
        Said::Same(material) => {
            let (scale, alpha) = (3.0 * scale, single(material.beta.sqrt()).powi(2));
            let diffuse = material.rho_d.map(|rho| single(scale * rho) / scale);
            let metal = material.rho_s.map(|rho| single(metal(scale * rho)));
            let rest = material.rho_s.map(|rho| single(rest(scale * rho)));
            Box::new(move |angles| {
                let lobe = ggx_smith(angles, alpha) / scale;
                let grazing = (1.0 - angles.cos_difference()).powi(5);
                let fresnel = |c: usize| rest[c] + metal[c] + (1.0 - metal[c]) * grazing;
                std::array::from_fn(|c| diffuse[c] * FRAC_1_PI + lobe * fresnel(c))
            })
        }
        Said::Near(nearest, plugin) => {
            let (lobe, alpha, scale) = ((plugin.value)(), single(nearest.alpha), 2.0 * scale);
            let [diffuse, specular] =
                [nearest.diffuse, nearest.specular].map(|rgb| rgb.map(|v| single(scale * v) / scale));
            Box::new(move |angles| {
                let value = lobe(angles, alpha);
                std::array::from_fn(|c| diffuse[c] * FRAC_1_PI + specular[c] * value)
            })
        }
    }
}

fn words(materials: &[Said]) -> Words {
    let mut carries = vec![
        "scene.xml: camera, a distant light, and the material; weight_1.exr ... the tile's weights; shape.ply.".to_owned(),
        "Weights are mixed by blendbsdf exactly, any number of materials; colours are brighter than the albedos by the number of parts that are mixed, so that the mean is right.".to_owned(),
    ];
    let mut loses = Vec::new();
    for (m, said) in materials.iter().enumerate() {
        match said {
            Said::Same(_) => carries.push(format!("Material {}: the very model.", m + 1)),
            Said::Near(nearest, plugin) => loses.push(format!(
                "Material {}: Mitsuba has no such lobe; the nearest is {}{} with alpha {:.4}, {:.1} % off (root mean square over all angles, as the fit weighs them).",
                m + 1,
                plugin.distribution,
                if plugin.dielectric { " under a dielectric's Fresnel reflectance" } else { "" },
                nearest.alpha,
                100.0 * nearest.error
            )),
        }
    }
    loses.push("Standard errors have no place in a scene; numbers are in single precision.".to_owned());
    let open = vec![
        "mitsuba -m scalar_rgb scene.xml (pip install mitsuba; or llvm_ad_rgb). A variant that renders colours as RGB is needed: spectral ones have no colours beyond 1.".to_owned(),
        "The integrator follows light once, as rigd render does; put `path` for all of it. Take the bsdf with the id \"captured\" into a scene of your own.".to_owned(),
    ];
    Words { carries, loses, open }
}

fn scene(captured: &Captured, materials: &[Said], scales: &[f64]) -> String {
    let view = captured.surface.view;
    let count = materials.len();
    let leaf = |m: usize| {
        let weight = format!(
            "<texture name=\"weight\" type=\"bitmap\">\n<string name=\"filename\" value=\"{}\"/>\n<boolean name=\"raw\" value=\"true\"/>\n<string name=\"filter_type\" value=\"bilinear\"/>\n<string name=\"wrap_mode\" value=\"repeat\"/>\n</texture>",
            texture(m)
        );
        blend(&weight, &diffuse([0.0; 3]), &body(&materials[m], count as f64 * scales[m]))
    };
    let material = (1..count).fold(leaf(0), |before, m| blend(&fixed(m + 1), &before, &leaf(m)));
    let material = material.replacen("<bsdf ", "<bsdf id=\"captured\" ", 1);
    let numbers = |v: Vec3| format!("{}, {}, {}", v.x as f32, v.y as f32, v.z as f32);
    indented(&format!(
        "<scene version=\"3.0.0\">
<!-- {} materials of the model {}, captured by {} -->
<integrator type=\"direct\">
<integer name=\"emitter_samples\" value=\"1\"/>
<integer name=\"bsdf_samples\" value=\"0\"/>
</integrator>
<sensor type=\"perspective\">
<string name=\"fov_axis\" value=\"y\"/>
<float name=\"fov\" value=\"{}\"/>
<transform name=\"to_world\">
<lookat origin=\"{}\" target=\"{}\" up=\"0, 1, 0\"/>
</transform>
<sampler type=\"multijitter\">
<integer name=\"sample_count\" value=\"16\"/>
</sampler>
<film type=\"hdrfilm\">
<integer name=\"width\" value=\"{PIXELS}\"/>
<integer name=\"height\" value=\"{PIXELS}\"/>
<string name=\"pixel_format\" value=\"rgb\"/>
<rfilter type=\"box\"/>
</film>
</sensor>
<emitter type=\"directional\">
<vector name=\"direction\" value=\"{}\"/>
<rgb name=\"irradiance\" value=\"{IRRADIANCE}\"/>
</emitter>
{material}
<shape type=\"ply\">
<string name=\"filename\" value=\"shape.ply\"/>
<ref id=\"captured\"/>
</shape>
</scene>
",
        count,
        captured.description.model,
        super::words::comment(&captured.description.provenance.software),
        view.field_deg,
        numbers(view.position),
        numbers(view.look_at),
        numbers(-Vec3::from(TO_LIGHT).normalize()),
    ))
}

/// The mean of a mean of `parts - 1` and one more.
fn fixed(parts: usize) -> String {
    format!("<float name=\"weight\" value=\"{}\"/>", (1.0 / parts as f64) as f32)
}

/// Weight 0 is the first, 1 the second: they are ordered by their names.
fn blend(weight: &str, first: &str, second: &str) -> String {
    let named = |bsdf: &str, name: &str| bsdf.replacen("<bsdf ", &format!("<bsdf name=\"{name}\" "), 1);
    let (first, second) = (named(first, "bsdf_0"), named(second, "bsdf_1"));
    format!("<bsdf type=\"blendbsdf\">\n{weight}\n{first}\n{second}\n</bsdf>")
}

/// A material, `scale` times as bright as it is.
fn body(said: &Said, scale: f64) -> String {
    match said {
        Said::Same(material) if material.rho_s == [0.0; 3] => diffuse(material.rho_d.map(|rho| scale * rho)),
        Said::Same(material) => schlick(material, 3.0 * scale),
        Said::Near(nearest, plugin) => {
            let specular = nearest.specular.map(|s| 2.0 * scale * s);
            let diffuse = diffuse(nearest.diffuse.map(|rho| 2.0 * scale * rho));
            blend(&fixed(2), &diffuse, &conductor(plugin, specular, nearest.alpha))
        }
    }
}

/// GGX with Schlick's Fresnel reflectance, rho_s (1 + 24 s) with s = (1 - cos)^5, out of two: `roughconductor` has no Fresnel and any
/// colour, a metallic `principled` has c + (1 - c) s. Three parts with the diffuse one, each `scale` times as bright:
/// [`metal`] for c and [`rest`] for a make a + c + (1 - c) s what is wanted.
fn schlick(material: &Material, scale: f64) -> String {
    let rho_s = material.rho_s.map(|rho| scale * rho);
    let metal = format!(
        "<bsdf type=\"principled\">\n{}\n<float name=\"metallic\" value=\"1\"/>\n<float name=\"roughness\" value=\"{}\"/>\n</bsdf>",
        colour("base_color", rho_s.map(metal)),
        material.beta.sqrt() as f32
    );
    let rest = conductor(&PLUGINS[2], rho_s.map(rest), material.beta);
    let two = blend(&fixed(2), &diffuse(material.rho_d.map(|rho| scale * rho)), &metal);
    blend(&fixed(3), &two, &rest)
}

/// Reflectance at normal incidence of the metal.
fn metal(rho_s: f64) -> f64 {
    1.0 - 24.0 * rho_s
}

/// What the lobe without Fresnel adds to it.
fn rest(rho_s: f64) -> f64 {
    25.0 * rho_s - 1.0
}

fn diffuse(reflectance: [f64; 3]) -> String {
    format!("<bsdf type=\"diffuse\">\n{}\n</bsdf>", colour("reflectance", reflectance))
}

fn conductor(plugin: &Plugin, specular: [f64; 3], alpha: f64) -> String {
    let (material, gain) = match plugin.dielectric {
        false => ("<string name=\"material\" value=\"none\"/>".to_owned(), 1.0),
        true => (
            format!("<rgb name=\"eta\" value=\"{INDEX}\"/>\n<rgb name=\"k\" value=\"0\"/>"),
            1.0 / fresnel(1.0, Complex::new(INDEX, 0.0)),
        ),
    };
    format!(
        "<bsdf type=\"roughconductor\">\n<string name=\"distribution\" value=\"{}\"/>\n<float name=\"alpha\" value=\"{}\"/>\n{material}\n{}\n</bsdf>",
        plugin.distribution,
        alpha as f32,
        colour("specular_reflectance", specular.map(|s| gain * s))
    )
}

/// A colour that may exceed 1.
fn colour(name: &str, value: [f64; 3]) -> String {
    let [r, g, b] = value.map(|v| v as f32);
    format!(
        "<spectrum type=\"srgb\" name=\"{name}\">\n<rgb name=\"color\" value=\"{r}, {g}, {b}\"/>\n<boolean name=\"unbounded\" value=\"true\"/>\n</spectrum>"
    )
}

/// Lines indented by how many elements are open.
fn indented(text: &str) -> String {
    let (mut depth, mut out) = (0_usize, String::with_capacity(2 * text.len()));
    for line in text.lines() {
        if line.starts_with("</") {
            depth = depth.saturating_sub(1);
        }
        out += &format!("{}{line}\n", "  ".repeat(depth));
        let opens = line.starts_with('<') && !["</", "<!"].iter().any(|end| line.starts_with(end));
        if opens && !line.ends_with("/>") {
            depth += 1;
        }
    }
    out
}
