//! OpenEXR with every map of the result in one file, the tile in another, and all parameters as JSON: nothing is lost.

use super::{Captured, Content, Export, File, Format, Words};
use crate::pipeline::report::{Identified, Parameter};
use serde_json::{Value, json};

/// The format.
pub const FORMAT: Format = Format { name: "exr", about: "OpenEXR maps and JSON parameters", make };

fn make(captured: &Captured) -> Result<Export, String> {
    let files = vec![
        File { name: "maps.exr".to_owned(), content: maps(captured) },
        File { name: "tile.exr".to_owned(), content: captured.tile_planes() },
        File::text("parameters.json", format!("{:#}\n", parameters(captured))),
    ];
    let words = Words {
        carries: lines(&[
            "maps.exr, the whole frame: weight.1 ... a material, sigma.1 ... their standard errors (infinite where the data do not determine a weight), valid (1 where measured), residual.R G B (mean over lights of |I - model| / I).",
            "tile.exr: weight.1 ... of the square that repeats without a seam.",
            "parameters.json: model and its formula, gauge, units, and every parameter with its standard error and whether the data determine it.",
        ]),
        loses: lines(&["The result holds standard errors of parameters, not their covariances; so does this."]),
        open: lines(&[
            "Any OpenEXR reader: `import OpenEXR; OpenEXR.File(\"maps.exr\")` in Python, Nuke, Blender's compositor, tev.",
        ]),
    };
    Ok(Export { files, model: None, words })
}

fn lines(text: &[&str]) -> Vec<String> {
    text.iter().map(|line| (*line).to_owned()).collect()
}

fn maps(captured: &Captured) -> Content {
    let mut channels = Vec::new();
    for (kind, maps) in [("weight", &captured.weights), ("sigma", &captured.sigma)] {
        channels.extend(maps.iter().enumerate().map(|(m, map)| (format!("{kind}.{}", m + 1), map.pixels.clone())));
    }
    channels.push(("valid".to_owned(), captured.valid.pixels.iter().map(|&v| f32::from(u8::from(v))).collect()));
    for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
        channels.push((format!("residual.{name}"), captured.residual.pixels.iter().map(|p| p[c]).collect()));
    }
    Content::Planes(captured.description.size, channels, "weights, standard errors, validity, residual of a fit")
}

fn parameters(captured: &Captured) -> Value {
    let file = &captured.description;
    let materials = file.materials.iter().enumerate().map(|(m, material)| {
        let list = |list: &[Parameter]| list.iter().map(parameter).collect::<Vec<Value>>();
        json!({
            "weight_channel": format!("weight.{}", m + 1),
            "share": material.share,
            "rho_d": list(&material.rho_d),
            "rho_s": list(&material.rho_s),
            "beta": material.beta.as_ref().map(parameter),
        })
    });
    json!({
        "format": 1,
        "model": file.model,
        "formula": formula(&file.model),
        "radiance": "sum over materials of weight x irradiance x cos(theta_i) x BRDF; irradiance on a surface that faces the light",
        "gauge": file.gauge,
        "units": {
            "rho_d": "1, diffuse albedo per channel R G B", "rho_s": "1, specular albedo per channel R G B",
            "beta": "1, roughness: tangent of a slope", "BRDF": "1/sr", "weight": "1", "residual": "1",
        },
        "materials": materials.collect::<Vec<Value>>(),
        "tile": { "side": captured.side(), "column": captured.patch.x, "row": captured.patch.y },
        "provenance": file.provenance,
    })
}

fn parameter(parameter: &Parameter) -> Value {
    let Parameter { value, standard_error, identified, reason } = parameter;
    let note = match identified {
        Identified::Unidentified => Some("not determined by the data: the value only completes the model"),
        _ => None,
    };
    json!({ "value": value, "standard_error": standard_error, "identified": identified, "reason": reason, "note": note })
}

/// The lobe in words that a program can be written from; s is the half angle, i and r incidence and reflection, d the angle
/// between light and half vector.
fn formula(model: &str) -> String {
    let lobe = match model {
        "lambert" => return "BRDF = rho_d / pi".to_owned(),
        "blinn-phong" => "(n + 2) / (2 pi) cos(s)^n / (4 cos i cos r), n = 2 / beta^2 - 2",
        "torrance-sparrow" => {
            "exp(-s^2 / beta^2) / (pi beta^2) G / (4 cos i cos r), G = min(1, 2 cos s cos i / cos d, 2 cos s cos r / cos d)"
        }
        "cook-torrance" => {
            "F G exp(-tan(s)^2 / beta^2) / (pi beta^2 cos(s)^4) / (4 cos i cos r), G = min(1, 2 cos s cos i / cos d, 2 cos s cos r / cos d), F = 1 + 24 (1 - cos d)^5"
        }
        "ward" => "exp(-tan(s)^2 / beta^2) / (4 pi beta^2 sqrt(cos i cos r))",
        "ward-duer" => "exp(-tan(s)^2 / beta^2) / (pi beta^2) (h.h) / (h.n)^4, h = light + view, not normalised",
        "lafortune" => "(n + 2) / (2 pi) (cos of the angle between view and mirrored light)^n, n = 2 / beta^2 - 2",
        "ggx" => {
            "F D G1(i) G1(r) / (4 cos i cos r), D = beta^2 / (pi cos(s)^4 (beta^2 + tan(s)^2)^2), G1(t) = 2 / (1 + sqrt(1 + beta^2 tan(t)^2)), F = 1 + 24 (1 - cos d)^5"
        }
        other => other,
    };
    format!(
        "BRDF = rho_d / pi + rho_s lobe, lobe = {lobe}; s half angle, i incidence, r reflection, d between light and half vector"
    )
}
