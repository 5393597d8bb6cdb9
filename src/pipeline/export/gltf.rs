//! glTF 2.0, one binary file: a shape with the material baked to base colour, roughness and KHR_materials_specular.

use super::baked::{Texel, baked, largest};
use super::ggx::{DIELECTRIC_F0, rise};
use super::surface::Surface;
use super::texture::{Coding, Depth, Texture};
use super::{Captured, Export, File, Format, Words};
use crate::numerics::brdf::nearest::ggx_smith;
use crate::numerics::geometry::Angles;
use serde_json::{Value, json};
use std::f64::consts::FRAC_1_PI;

/// The format.
pub const FORMAT: Format = Format { name: "gltf", about: "glTF 2.0 binary, a preview with one lobe a texel", make };

/// The file.
const NAME: &str = "material.glb";

fn make(captured: &Captured) -> Result<Export, String> {
    let maps = Maps::of(captured.side(), &baked(captured));
    let glb = glb(&captured.surface, &maps, &captured.description.provenance.software)?;
    Ok(Export {
        files: vec![File::bytes(NAME, glb)],
        model: Some(Box::new(move |uv, angles| maps.brdf(uv, angles))),
        words: words(),
    })
}

fn words() -> Words {
    let lines = |all: &[&str]| all.iter().map(|&line| line.to_owned()).collect();
    Words {
        carries: lines(&[
            "material.glb: a shape with normals and texture coordinates, and a preview of the material as pictures of 8 bits: base colour, roughness, and strength and colour of the highlight (KHR_materials_specular).",
            "Models whose reflectance does not rise towards grazing light get specularColorFactor 25, with which glTF's does not rise either.",
        ]),
        loses: lines(&[
            "The mixture: glTF knows one lobe a texel. It has the height and the strength of all lobes there, not their shape.",
            "The model: the lobe is GGX, the closest one to each material's own.",
            "Rounding to 8 bits; albedos above 1 are cut.",
        ]),
        open: lines(&[
            "Any glTF viewer, for instance https://gltf-viewer.donmccurdy.com, or Blender: File, Import, glTF 2.0. Light it with one lamp and no environment to see what was measured.",
        ]),
    }
}

/// The pictures, and the factors they are multiplied by.
struct Maps {
    base_factor: [f64; 3],
    base: Texture<3>,
    roughness_factor: f64,
    /// Roughness in green, metalness (none) in blue.
    roughness: Texture<3>,
    colour_factor: [f64; 3],
    strength_factor: f64,
    /// Colour of the highlight, and its strength as alpha.
    specular: Texture<4>,
}

impl Maps {
    fn of(side: usize, texels: &[Texel]) -> Self {
        // A reader takes from the diffuse light what the highlight reflects: it is given back here for normal incidence.
        let base = |texel: &Texel| {
            let taken = texel.f0.into_iter().fold(0.0, f64::max);
            texel.diffuse.map(|rho| if taken < 1.0 { (rho / (1.0 - taken)).min(1.0) } else { 0.0 })
        };
        let colour =
            |texel: &Texel| texel.f0.map(|f0| if texel.f90 > 0.0 { f0 / (DIELECTRIC_F0 * texel.f90) } else { 0.0 });
        let channel = |of: &dyn Fn(&Texel) -> [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|c| largest(texels.iter().map(|texel| of(texel)[c])))
        };
        let (base_factor, colour_factor) = (channel(&base), channel(&colour));
        let roughness_factor = largest(texels.iter().map(|texel| texel.alpha.sqrt()));
        let strength_factor = largest(texels.iter().map(|texel| texel.f90));
        let over = |value: [f64; 3], factor: [f64; 3]| -> [f64; 3] { std::array::from_fn(|c| value[c] / factor[c]) };
        let specular = |texel: &Texel| {
            let [r, g, b] = over(colour(texel), colour_factor);
            [r, g, b, texel.f90 / strength_factor]
        };
        let (linear, srgb) = (Coding::Linear, Coding::Srgb);
        Self {
            base: Texture::of(side, [srgb; 3], Depth::Eight, texels.iter().map(|t| over(base(t), base_factor))),
            roughness: Texture::of(
                side,
                [linear; 3],
                Depth::Eight,
                texels.iter().map(|t| [0.0, t.alpha.sqrt() / roughness_factor, 0.0]),
            ),
            specular: Texture::of(side, [srgb, srgb, srgb, linear], Depth::Eight, texels.iter().map(specular)),
            base_factor,
            roughness_factor,
            colour_factor,
            strength_factor,
        }
    }

    /// What glTF 2.0, appendix B, and KHR_materials_specular say of these pictures, for no metal and an index of refraction of 1.5.
    fn brdf(&self, uv: [f64; 2], angles: &Angles) -> [f64; 3] {
        let (base, [_, roughness, _], [r, g, b, strength]) =
            (self.base.at(uv), self.roughness.at(uv), self.specular.at(uv));
        let strength = strength * self.strength_factor;
        let lobe = ggx_smith(angles, (roughness * self.roughness_factor).powi(2).max(1e-6));
        let fresnel: [f64; 3] = std::array::from_fn(|c| {
            let f0 = (DIELECTRIC_F0 * [r, g, b][c] * self.colour_factor[c]).min(1.0);
            strength * (f0 + (1.0 - f0) * rise(angles))
        });
        let left = 1.0 - fresnel.into_iter().fold(0.0, f64::max);
        std::array::from_fn(|c| left * base[c] * self.base_factor[c] * FRAC_1_PI + fresnel[c] * lobe)
    }
}

/// Signs of a binary glTF file and of its two chunks.
const MAGIC: &[u8; 4] = b"glTF";
const JSON_CHUNK: &[u8; 4] = b"JSON";
const BINARY_CHUNK: &[u8; 4] = b"BIN\0";
/// Types of numbers, and uses of a buffer, as glTF numbers them.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY: u32 = 34962;
const ELEMENT_ARRAY: u32 = 34963;

/// The binary part of a file, and what the description says of its pieces.
#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    /// Adds bytes as a view.
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let mut view = json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bytes.extend_from_slice(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    fn accessor(&mut self, mut described: Value, bytes: &[u8], target: u32) -> usize {
        described["bufferView"] = json!(self.view(bytes, Some(target)));
        self.accessors.push(described);
        self.accessors.len() - 1
    }

    fn floats<const N: usize>(&mut self, kind: &str, values: &[[f32; N]], bounded: bool) -> usize {
        let bytes: Vec<u8> = values.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
        let mut described = json!({"componentType": FLOAT, "count": values.len(), "type": kind});
        if bounded {
            let bound = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
                (0..N).map(|c| values.iter().map(|value| value[c]).reduce(pick).unwrap_or(0.0)).collect()
            };
            described["min"] = json!(bound(f32::min));
            described["max"] = json!(bound(f32::max));
        }
        self.accessor(described, &bytes, ARRAY)
    }
}

fn glb(surface: &Surface, maps: &Maps, software: &str) -> Result<Vec<u8>, String> {
    let mut buffer = Buffer::default();
    let attributes = json!({
        "POSITION": buffer.floats("VEC3", &surface.positions, true),
        "NORMAL": buffer.floats("VEC3", &surface.normals, false),
        "TEXCOORD_0": buffer.floats("VEC2", &surface.uv, false),
    });
    let corners: Vec<u8> = surface.triangles.iter().flatten().flat_map(|corner| corner.to_le_bytes()).collect();
    let described = json!({"componentType": UNSIGNED_INT, "count": 3 * surface.triangles.len(), "type": "SCALAR"});
    let indices = buffer.accessor(described, &corners, ELEMENT_ARRAY);
    let mut images = Vec::new();
    for (name, png) in
        [("base colour", maps.base.png()?), ("roughness", maps.roughness.png()?), ("specular", maps.specular.png()?)]
    {
        images.push(json!({"name": name, "mimeType": "image/png", "bufferView": buffer.view(&png, None)}));
    }
    let (length, textures) =
        (buffer.bytes.len(), (0..images.len()).map(|source| json!({"sampler": 0, "source": source})));
    let described = json!({
        "asset": {"version": "2.0", "generator": software},
        "extensionsUsed": ["KHR_materials_specular"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "preview of a captured material"}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}],
        "materials": [material(maps)],
        "textures": textures.collect::<Vec<Value>>(),
        "samplers": [{"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497}],
        "images": images,
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": length}],
    });
    Ok(chunks(described.to_string().into_bytes(), buffer.bytes))
}

fn material(maps: &Maps) -> Value {
    let [r, g, b] = maps.base_factor;
    json!({
        "name": "preview of a captured material",
        "pbrMetallicRoughness": {
            "baseColorFactor": [r, g, b, 1.0],
            "baseColorTexture": {"index": 0},
            "metallicFactor": 0.0,
            "roughnessFactor": maps.roughness_factor,
            "metallicRoughnessTexture": {"index": 1},
        },
        "extensions": {"KHR_materials_specular": {
            "specularFactor": maps.strength_factor,
            "specularTexture": {"index": 2},
            "specularColorFactor": maps.colour_factor,
            "specularColorTexture": {"index": 2},
        }},
    })
}

/// Header, description padded with spaces, buffer padded with zeros (glTF 2.0, section 4).
fn chunks(mut described: Vec<u8>, mut binary: Vec<u8>) -> Vec<u8> {
    described.resize(described.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let size = |bytes: usize| (bytes as u32).to_le_bytes();
    let whole = 12 + 8 + described.len() + 8 + binary.len();
    let mut glb = [&MAGIC[..], &2_u32.to_le_bytes(), &size(whole)].concat();
    for (kind, chunk) in [(JSON_CHUNK, described), (BINARY_CHUNK, binary)] {
        glb.extend(size(chunk.len()));
        glb.extend(kind);
        glb.extend(chunk);
    }
    glb
}
