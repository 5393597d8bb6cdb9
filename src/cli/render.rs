//! `rigd render`: a mesh with a captured material, as radiance and as the camera would have taken it (paper 3.7).

mod arguments;
pub(super) mod response;

pub use arguments::Args;

use super::error::{bad_input, print_json, print_line};
use super::place;
use super::progress::Progress;
use crate::numerics::brdf;
use crate::numerics::image::{Image, RadianceImage};
use crate::numerics::render::camera::{Camera, View};
use crate::numerics::render::mesh::Mesh;
use crate::numerics::render::patch::Patch;
use crate::numerics::render::tile::Tile;
use crate::numerics::render::tree::Tree;
use crate::numerics::render::{Picture, Scene, render, shapes};
use crate::pipeline::render::exposed;
use crate::store::files::{self, shown};
use crate::store::mesh::{self, StoredMesh};
use crate::store::{exr, png, result};
use response::Found;
use std::fmt::Display;
use std::path::{Path, PathBuf};

/// What is written.
const FILES: [&str; 2] = ["render.exr", "render.png"];

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let result = &place::result(&args.result).map_err(bad_input)?;
    let stored = result::read_material(result).map_err(bad_input)?;
    let sigma = result::read_sigma(result, &stored.material).map_err(bad_input)?;
    let (tile, patch) = tile(result, args.patch, &stored.weights, &sigma)?;
    let StoredMesh { mesh, files: mesh_files } = read_mesh(&args.mesh)?;
    let found = response::find(args.response.as_deref(), result).map_err(bad_input)?;
    let camera = camera(args, &mesh)?;
    let mut inputs = mesh_files;
    inputs.extend(result::inputs(result));
    inputs.push(result::sigma_file(result));
    inputs.extend(found.file.clone());
    files::make_ready(&args.out, FILES, &inputs).map_err(at_path).map_err(bad_input)?;
    let Some(lobe) = brdf::by_name(&stored.material.model) else {
        return Err(bad_input(format!("unknown BRDF model {}", stored.material.model)));
    };
    let scene = Scene {
        mesh: &mesh,
        tree: &Tree::new(&mesh),
        tile: &tile,
        repeats: f64::from(args.repeats),
        lobe,
        materials: &stored.material.materials(),
        light: &args.light.light(),
    };
    let progress = Progress::stages_unless(args.json);
    progress.stage("rendering");
    let picture = render(&scene, &camera, usize::from(args.samples));
    progress.end();
    check_finite(&picture)?;
    if !picture.seen.pixels.contains(&true) {
        return Err(bad_input("nothing of the mesh is in the picture: change --camera, --look-at or --field"));
    }
    write(args, picture, &found)?;
    if args.json {
        return print_json(&serde_json::json!({
            "files": FILES.map(|name| shown(&args.out.join(name))), "triangles": mesh.triangles(), "without_area": mesh.dropped(),
            "textured": mesh.is_textured(), "patch": { "x": patch.x, "y": patch.y, "side": args.patch },
            "exposure_s": args.exposure, "response": found.name,
        }));
    }
    Ok(print_line(summary(args, &mesh, patch, &found))?)
}

/// The texture, and where in the weight map it comes from.
pub(super) fn tile(
    result: &Path,
    side: u16,
    weights: &[Image<f32>],
    sigma: &[Image<f32>],
) -> anyhow::Result<(Tile, Patch)> {
    Tile::cut(weights, sigma, usize::from(side)).map_err(|error| {
        let path = shown(&result.join("weights.exr"));
        bad_input(format!("{path}: {error}: give a smaller --patch; a quarter of it is needed for its seams as well"))
    })
}

fn read_mesh(path: &Path) -> anyhow::Result<StoredMesh> {
    let Some(parts) = path.to_str().and_then(shapes::by_name) else {
        return mesh::read(path)
            .map_err(|error| bad_input(format!("{error} (shapes that come with rigd: {})", shapes::NAMES.join(", "))));
    };
    Ok(StoredMesh { mesh: Mesh::new(parts).map_err(bad_input)?, files: Vec::new() })
}

fn camera(args: &Args, mesh: &Mesh) -> anyhow::Result<Camera> {
    let (size, whole) = (args.view.size, View::of(mesh, args.view.field, args.view.size));
    let position = args.view.camera.unwrap_or(whole.position);
    let view = View { position, look_at: args.view.look_at.unwrap_or(whole.look_at), ..whole };
    Camera::new(&view, size).map_err(|error| bad_input(format!("--camera, --look-at, --field, --size: {error}")))
}

fn check_finite(picture: &Picture) -> anyhow::Result<()> {
    let radiance = &picture.radiance;
    let Some(pixel) = radiance.pixels.iter().position(|p| !p.iter().all(|v| v.is_finite())) else { return Ok(()) };
    let (x, y) = (pixel % radiance.width, pixel / radiance.width);
    Err(bad_input(format!(
        "the radiance at column {x}, row {y} is beyond 3.4e38: give the light less strength, or put it farther away"
    )))
}

fn write(args: &Args, picture: Picture, found: &Found) -> anyhow::Result<()> {
    let levels = exposed(&picture.radiance, &found.response, args.exposure);
    let image = RadianceImage { radiance: picture.radiance, valid: picture.seen, variance: None };
    let about = [("rendered", format!("{} with the material of {}", shown(&args.mesh), shown(&args.result)))];
    let mut unfinished = files::Unfinished::within(&args.out);
    let [radiance, shot] = FILES.map(|name| unfinished.path(name));
    exr::write_radiance(&radiance, &image, (0, 0), args.view.size, &about)?;
    png::write(&shot, &levels).map_err(|reason| anyhow::anyhow!("{}: {reason}", shown(&shot)))?;
    unfinished.finish().map_err(at_path).map_err(anyhow::Error::msg)
}

/// What a person wants to know of the picture.
fn summary(args: &Args, mesh: &Mesh, patch: Patch, found: &Found) -> String {
    let dropped = match mesh.dropped() {
        0 => String::new(),
        dropped => format!(" ({dropped} without area left out)"),
    };
    let projected = if mesh.is_textured() { "" } else { ", without texture coordinates: projected along x, y and z" };
    format!(
        "{} triangles{dropped}{projected}\ntexture: {} x {} weights from column {}, row {} of weights.exr\nlevels: {} s through {}\n{} in {}",
        mesh.triangles(),
        args.patch,
        args.patch,
        patch.x,
        patch.y,
        args.exposure,
        found.name,
        FILES.join(", "),
        args.out.display()
    )
}

/// A path and what is wrong with it, as one line.
fn at_path((path, reason): (PathBuf, impl Display)) -> String {
    format!("{}: {reason}", shown(&path))
}
