//! MaterialX: a standard_surface a material, joined by `mix` with the weight maps as textures, so that the mixture stays one.

mod shading;

use super::ggx::{DIELECTRIC_F0, closest};
use super::texture::{Coding, Depth, Texture};
use super::{Captured, Export, File, Format, Words};
use shading::Layered;

/// The format.
pub const FORMAT: Format =
    Format { name: "materialx", about: "MaterialX, a standard_surface a material, mixed by the weights", make };

/// Index of refraction whose reflectance hardly changes with the angle: models without Fresnel's rise get it.
const FLAT_IOR: f64 = 1000.0;
/// Index of refraction of models with it: reflectance 0.04 at normal incidence.
const IOR: f64 = 1.5;

fn make(captured: &Captured) -> Result<Export, String> {
    let document = Document::of(captured);
    let mut files = vec![File::bytes("total.png", document.total.png()?)];
    for (k, share) in document.shares.iter().enumerate() {
        files.push(File::bytes(share_file(k + 1), share.png()?));
    }
    files.push(File::text("material.mtlx", document.xml()));
    Ok(Export { files, model: Some(Box::new(move |uv, angles| document.brdf(uv, angles))), words: words() })
}

fn words() -> Words {
    let lines = |all: &[&str]| all.iter().map(|&line| line.to_owned()).collect();
    Words {
        carries: lines(&[
            "material.mtlx: one standard_surface a material, joined by mix nodes; any number of materials.",
            "share_2.png ...: the part that material 2 has in materials 1 and 2, material 3 in 1 to 3, and so on; total.png: the sum of all weights over its largest value. 16 bits, linear.",
        ]),
        loses: lines(&[
            "The model: each lobe is GGX, the closest one to the material's own; MaterialX adds light that it lets bounce between facets.",
            "Models whose reflectance does not rise towards grazing light get specular_IOR 1000, with which standard_surface's hardly does; a reflectance above 1 is cut.",
        ]),
        open: lines(&[
            "MaterialXView --material material.mtlx, or any program that reads MaterialX 1.39 (Houdini, Maya, Arnold, RenderMan, USD through usdMtlx). Textures repeat over texture coordinates 0 to 1.",
        ]),
    }
}

fn share_file(material: usize) -> String {
    format!("share_{}.png", material + 1)
}

/// What the document says, and how it reflects.
struct Document {
    lobes: Vec<Layered>,
    /// Sum of the weights, in parts of the largest.
    total: Texture<1>,
    largest_total: f64,
    /// Of material 2 and each after it: its weight over the sum of those up to it.
    shares: Vec<Texture<1>>,
}

impl Document {
    fn of(captured: &Captured) -> Self {
        let count = captured.materials.len();
        let texels = &captured.tile.texels().weights;
        let sum = |weights: &[f32], up_to: usize| weights[..up_to].iter().map(|&w| f64::from(w)).sum::<f64>();
        let largest_total = super::baked::largest(texels.iter().map(|weights| sum(weights, count)));
        let texture = |value: &dyn Fn(&[f32]) -> f64| {
            Texture::of(
                captured.side(),
                [Coding::Linear],
                Depth::Sixteen,
                texels.iter().map(|weights| [value(weights)]),
            )
        };
        let share = |k: usize| {
            texture(&|weights| match sum(weights, k + 1) {
                all if all > 0.0 => f64::from(weights[k]) / all,
                _ => 0.0,
            })
        };
        let lobe = |material| {
            let lobe = closest(captured.lobe, material);
            let strongest = lobe.f0.into_iter().fold(0.0, f64::max);
            let (ior, weight) = if lobe.rises { (IOR, strongest / DIELECTRIC_F0) } else { (FLAT_IOR, strongest) };
            let tint = lobe.f0.map(|f0| if strongest > 0.0 { f0 / strongest } else { 1.0 });
            Layered::new(lobe.diffuse, weight.min(1.0), tint, lobe.alpha, ior)
        };
        Self {
            lobes: captured.materials.iter().map(lobe).collect(),
            total: texture(&|weights| sum(weights, count) / largest_total),
            largest_total,
            shares: (1..count).map(share).collect(),
        }
    }

    /// How the document reflects: [`shading`] for one surface, and `mix` as MaterialX defines it.
    fn brdf(&self, uv: [f64; 2], angles: &crate::numerics::geometry::Angles) -> [f64; 3] {
        let scale = self.total.at(uv)[0] * self.largest_total;
        let mut mixed = [0.0; 3];
        for (k, lobe) in self.lobes.iter().enumerate() {
            let share = if k == 0 { 1.0 } else { self.shares[k - 1].at(uv)[0] };
            let own = lobe.brdf(scale, angles);
            mixed = std::array::from_fn(|c| (1.0 - share) * mixed[c] + share * own[c]);
        }
        mixed
    }

    fn xml(&self) -> String {
        let mut nodes =
            image("total", "total.png") + &binary("multiply", "scale", "total", &number(self.largest_total));
        let mut top = "lobe_1".to_owned();
        for (m, lobe) in self.lobes.iter().enumerate() {
            let k = m + 1;
            nodes += &surface(k, lobe);
            if m > 0 {
                nodes += &image(&format!("share_{k}"), &share_file(m));
                let inputs = link("fg", "surfaceshader", &format!("lobe_{k}"))
                    + &link("bg", "surfaceshader", &top)
                    + &link("mix", "float", &format!("share_{k}"));
                top = format!("mix_{k}");
                nodes += &node("mix", &top, "surfaceshader", &inputs);
            }
        }
        nodes += &node("surfacematerial", "captured", "material", &link("surfaceshader", "surfaceshader", &top));
        format!(
            "<?xml version=\"1.0\"?>\n<materialx version=\"1.39\" colorspace=\"lin_rec709\">\n{nodes}</materialx>\n"
        )
    }
}

/// A standard_surface whose strength follows `scale`. It takes from the diffuse light what the highlight reflects; that is given
/// back here for normal incidence: base = scale / (1 - specular x albedo).
fn surface(k: usize, lobe: &Layered) -> String {
    let (specular, taken, left, base) =
        (format!("specular_{k}"), format!("taken_{k}"), format!("left_{k}"), format!("base_{k}"));
    let mut nodes = binary("multiply", &specular, "scale", &number(lobe.weight));
    nodes += &binary("multiply", &taken, &specular, &number(lobe.albedo()));
    nodes += &node("subtract", &left, "float", &(value("in1", "float", "1") + &link("in2", "float", &taken)));
    nodes += &node("divide", &base, "float", &(link("in1", "float", "scale") + &link("in2", "float", &left)));
    let diffuse = value("in1", "color3", &colour(lobe.diffuse)) + &link("in2", "float", &base);
    nodes += &node("multiply", &format!("base_color_{k}"), "color3", &diffuse);
    let inputs = value("base", "float", "1")
        + &link("base_color", "color3", &format!("base_color_{k}"))
        + &link("specular", "float", &specular)
        + &value("specular_color", "color3", &colour(lobe.tint))
        + &value("specular_roughness", "float", &number(lobe.alpha.sqrt()))
        + &value("specular_IOR", "float", &number(lobe.ior));
    nodes + &node("standard_surface", &format!("lobe_{k}"), "surfaceshader", &inputs)
}

fn number(value: f64) -> String {
    (value as f32).to_string()
}

fn colour(rgb: [f64; 3]) -> String {
    rgb.map(number).join(", ")
}

fn value(name: &str, kind: &str, value: &str) -> String {
    format!("    <input name=\"{name}\" type=\"{kind}\" value=\"{value}\" />\n")
}

fn link(name: &str, kind: &str, node: &str) -> String {
    format!("    <input name=\"{name}\" type=\"{kind}\" nodename=\"{node}\" />\n")
}

fn node(category: &str, name: &str, kind: &str, inputs: &str) -> String {
    format!("  <{category} name=\"{name}\" type=\"{kind}\">\n{inputs}  </{category}>\n")
}

/// A node of two floats: another node, and a number.
fn binary(category: &str, name: &str, first: &str, second: &str) -> String {
    node(category, name, "float", &(link("in1", "float", first) + &value("in2", "float", second)))
}

fn image(name: &str, file: &str) -> String {
    node("image", name, "float", &value("file", "filename", file))
}
