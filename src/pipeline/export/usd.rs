//! USD as text: a shape with the material baked to UsdPreviewSurface.

use super::baked::{Texel, baked, largest};
use super::ggx::rise;
use super::surface::Surface;
use super::texture::{Coding, Depth, Texture};
use super::{Captured, Export, File, Format, Words};
use crate::numerics::brdf::nearest::ggx_smith;
use crate::numerics::geometry::Angles;
use std::f64::consts::FRAC_1_PI;

/// The format.
pub const FORMAT: Format =
    Format { name: "usd", about: "USD with UsdPreviewSurface, a preview with one lobe a texel", make };

fn make(captured: &Captured) -> Result<Export, String> {
    let maps = Maps::of(captured.side(), &baked(captured));
    let files = vec![
        File::bytes("diffuse.png", maps.diffuse.png()?),
        File::bytes("specular.png", maps.specular.png()?),
        File::bytes("roughness.png", maps.roughness.png()?),
        File::text("material.usda", stage(&captured.surface, &maps)),
    ];
    Ok(Export { files, model: Some(Box::new(move |uv, angles| maps.brdf(uv, angles))), words: words() })
}

fn words() -> Words {
    let lines = |all: &[&str]| all.iter().map(|&line| line.to_owned()).collect();
    Words {
        carries: lines(&[
            "material.usda: a mesh with normals and texture coordinates, bound to a UsdPreviewSurface (specular workflow).",
            "diffuse.png, specular.png, roughness.png: the material baked to pictures of 8 bits, multiplied by the scale in material.usda.",
        ]),
        loses: lines(&[
            "The mixture: UsdPreviewSurface knows one lobe a texel. It has the height and the strength of all lobes there, not their shape.",
            "The model: the lobe is GGX, the closest one to each material's own, and its reflectance rises to 1 at grazing light, whatever the material's does.",
            "Rounding to 8 bits; albedos above 1 are cut. The figure is for the formulas as published: usdview's Storm adds 0.001 to the fourth power of the roughness, so that narrow highlights come out brighter there.",
        ]),
        open: lines(&["usdview material.usda, or Blender: File, Import, Universal Scene Description."]),
    }
}

/// The pictures, and the factors they are multiplied by.
struct Maps {
    diffuse_scale: [f64; 3],
    diffuse: Texture<3>,
    specular_scale: [f64; 3],
    specular: Texture<3>,
    roughness_scale: f64,
    roughness: Texture<1>,
}

impl Maps {
    fn of(side: usize, texels: &[Texel]) -> Self {
        // A reader takes from the diffuse light what the highlight reflects: it is given back here for normal incidence.
        let diffuse = |texel: &Texel| -> [f64; 3] {
            std::array::from_fn(
                |c| if texel.f0[c] < 1.0 { (texel.diffuse[c] / (1.0 - texel.f0[c])).min(1.0) } else { 0.0 },
            )
        };
        let channel = |of: &dyn Fn(&Texel) -> [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|c| largest(texels.iter().map(|texel| of(texel)[c])))
        };
        let (diffuse_scale, specular_scale) = (channel(&diffuse), channel(&|texel| texel.f0));
        let roughness_scale = largest(texels.iter().map(|texel| texel.alpha.sqrt()));
        let over = |value: [f64; 3], scale: [f64; 3]| -> [f64; 3] { std::array::from_fn(|c| value[c] / scale[c]) };
        let srgb = [Coding::Srgb; 3];
        let rough = texels.iter().map(|t| [t.alpha.sqrt() / roughness_scale]);
        Self {
            diffuse: Texture::of(side, srgb, Depth::Eight, texels.iter().map(|t| over(diffuse(t), diffuse_scale))),
            specular: Texture::of(side, srgb, Depth::Eight, texels.iter().map(|t| over(t.f0, specular_scale))),
            roughness: Texture::of(side, [Coding::Linear], Depth::Eight, rough),
            diffuse_scale,
            specular_scale,
            roughness_scale,
        }
    }

    /// UsdPreviewSurface in the specular workflow: GGX with a reflectance that rises from the specular colour to 1.
    fn brdf(&self, uv: [f64; 2], angles: &Angles) -> [f64; 3] {
        let (diffuse, specular, [roughness]) = (self.diffuse.at(uv), self.specular.at(uv), self.roughness.at(uv));
        let lobe = ggx_smith(angles, (roughness * self.roughness_scale).powi(2).max(1e-6));
        std::array::from_fn(|c| {
            let f0 = specular[c] * self.specular_scale[c];
            let fresnel = f0 + (1.0 - f0) * rise(angles);
            (1.0 - fresnel) * diffuse[c] * self.diffuse_scale[c] * FRAC_1_PI + fresnel * lobe
        })
    }
}

/// A list of tuples as USD writes them.
fn tuples<const N: usize>(values: impl Iterator<Item = [f32; N]>) -> String {
    let tuple = |value: [f32; N]| format!("({})", value.map(|v| v.to_string()).join(", "));
    values.map(tuple).collect::<Vec<String>>().join(", ")
}

fn stage(surface: &Surface, maps: &Maps) -> String {
    let corners: Vec<String> = surface.triangles.iter().flatten().map(u32::to_string).collect();
    let counts = vec!["3"; surface.triangles.len()].join(", ");
    let extent = |pick: fn(f32, f32) -> f32| -> [f32; 3] {
        std::array::from_fn(|c| surface.positions.iter().map(|p| p[c]).reduce(pick).unwrap_or(0.0))
    };
    // USD's texture coordinates run up the picture, ours down.
    let st = surface.uv.iter().map(|&[u, v]| [u, 1.0 - v]);
    format!(
        r#"#usda 1.0
(
    defaultPrim = "Captured"
    doc = "Preview of a captured material: baked, one lobe a texel"
    metersPerUnit = 1
    upAxis = "Y"
)

def Xform "Captured"
{{
    def Mesh "Shape" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {{
        uniform token subdivisionScheme = "none"
        uniform token orientation = "rightHanded"
        float3[] extent = [{extent}]
        int[] faceVertexCounts = [{counts}]
        int[] faceVertexIndices = [{corners}]
        point3f[] points = [{points}]
        normal3f[] normals = [{normals}] (
            interpolation = "vertex"
        )
        texCoord2f[] primvars:st = [{st}] (
            interpolation = "vertex"
        )
        rel material:binding = </Captured/Material>
    }}

    def Material "Material"
    {{
        token outputs:surface.connect = </Captured/Material/Surface.outputs:surface>

        def Shader "Surface"
        {{
            uniform token info:id = "UsdPreviewSurface"
            int inputs:useSpecularWorkflow = 1
            color3f inputs:diffuseColor.connect = </Captured/Material/Diffuse.outputs:rgb>
            color3f inputs:specularColor.connect = </Captured/Material/Specular.outputs:rgb>
            float inputs:roughness.connect = </Captured/Material/Roughness.outputs:r>
            token outputs:surface
        }}

        def Shader "Coordinates"
        {{
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }}
{diffuse}{specular}{roughness}    }}
}}
"#,
        extent = tuples([extent(f32::min), extent(f32::max)].into_iter()),
        corners = corners.join(", "),
        points = tuples(surface.positions.iter().copied()),
        normals = tuples(surface.normals.iter().copied()),
        st = tuples(st),
        diffuse = texture("Diffuse", "diffuse.png", "sRGB", maps.diffuse_scale, "float3 outputs:rgb"),
        specular = texture("Specular", "specular.png", "sRGB", maps.specular_scale, "float3 outputs:rgb"),
        roughness = texture("Roughness", "roughness.png", "raw", [maps.roughness_scale; 3], "float outputs:r"),
    )
}

fn texture(name: &str, file: &str, space: &str, scale: [f64; 3], output: &str) -> String {
    let [r, g, b] = scale.map(|factor| factor as f32);
    format!(
        r#"
        def Shader "{name}"
        {{
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @./{file}@
            token inputs:sourceColorSpace = "{space}"
            float4 inputs:scale = ({r}, {g}, {b}, 1)
            token inputs:wrapS = "repeat"
            token inputs:wrapT = "repeat"
            float2 inputs:st.connect = </Captured/Material/Coordinates.outputs:result>
            {output}
        }}
"#
    )
}
