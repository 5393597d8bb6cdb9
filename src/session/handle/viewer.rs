//! What a viewer needs to show a fitted material as `rigd render` and `rigd relight` do.

use super::{EngineError, EngineHandle};
use crate::numerics::geometry::Light;
use crate::numerics::radiometry::response::Response;
use crate::numerics::render::mesh::Mesh;
use crate::numerics::render::shapes;
use crate::numerics::render::tile::Tile;
use crate::pipeline::dataset::Geometry;
use crate::pipeline::mesh::{self, Format, glb};
use crate::pipeline::surface::{Window, planes};
use crate::session::calibration::file::CalibrationFile;
use crate::store::dataset;
use crate::store::exr::{Planes, encode_planes, read_planes, read_radiance};
use crate::store::result::{StoredMaterial, read_material, read_sigma};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use utoipa::ToSchema;

/// Parameters of one material, as shading needs them; with their standard errors they are in `.../material`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Shading {
    /// Diffuse albedo, red, green, blue.
    pub rho_d: [f64; 3],
    /// Specular albedo; zero where the model has no lobe.
    pub rho_s: [f64; 3],
    /// Roughness; 1 where the model has no lobe.
    pub beta: f64,
}

/// The weight map as a texture that repeats without a seam (paper 3.7), with all that shading needs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Texture {
    /// Name of the BRDF model.
    pub model: String,
    /// One set of parameters a material.
    pub materials: Vec<Shading>,
    /// Columns and rows of the texture.
    pub side: usize,
    /// Left column of the square of the weight map that it was cut from.
    pub x: usize,
    /// Its top row.
    pub y: usize,
    /// Weights, texel by texel from the top left, row by row; of a texel one a material.
    pub weights: Vec<f32>,
}

/// The camera's response, through which radiance x exposure time becomes levels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Curves {
    /// Number of the calibration that measured it; null: none is known, levels are those of sRGB.
    pub calibration: Option<u64>,
    /// ln(radiance x seconds) of the levels 0 to 255 of red, green and blue; level 128 is at 0.
    pub log_exposure: [Vec<f64>; 3],
}

/// A light of a session, camera frame: a small lamp, or a distant light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ShownLight {
    /// Position of a lamp, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub position_mm: Option<[f64; 3]>,
    /// Its intensity per channel, radiance units x mm^2: irradiance is intensity / distance^2.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub intensity: Option<[f64; 3]>,
    /// Unit direction towards a distant light.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub direction: Option<[f64; 3]>,
    /// Its irradiance per channel, radiance units.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub irradiance: Option<[f64; 3]>,
}

impl ShownLight {
    fn of(light: &Light) -> Self {
        let none = Self { position_mm: None, intensity: None, direction: None, irradiance: None };
        match light {
            Light::Point { position, intensity } => {
                Self { position_mm: Some((*position).into()), intensity: Some(*intensity), ..none }
            }
            Light::Distant { direction, irradiance } => {
                Self { direction: Some((*direction).into()), irradiance: Some(*irradiance), ..none }
            }
        }
    }
}

fn storage(error: impl ToString) -> EngineError {
    EngineError::Storage(error.to_string())
}

impl EngineHandle {
    /// Directory of a session, and of its result; none where it has no material.
    fn fitted(&self, id: &str) -> Result<Option<(PathBuf, PathBuf)>, EngineError> {
        let directory = self.book.lock().session(id)?.directory.clone();
        let result = directory.join("result");
        Ok(result.join("material.json").is_file().then_some((directory, result)))
    }

    /// The texture of `side` texels that `rigd render --patch side` cuts, with the parameters; none where there is no material.
    ///
    /// # Errors
    /// No such session; no square of that side was measured throughout; the result cannot be read.
    pub fn texture(&self, id: &str, side: usize) -> Result<Option<Texture>, EngineError> {
        let Some((_, result)) = self.fitted(id)? else { return Ok(None) };
        let StoredMaterial { material, weights } = read_material(&result).map_err(storage)?;
        let sigma = read_sigma(&result, &material).map_err(storage)?;
        let (tile, patch) = Tile::cut(&weights, &sigma, side).map_err(|error| {
            let reason = format!("{error}: ask for a smaller patch; a quarter of it is needed for its seams as well");
            EngineError::Unshown { reason }
        })?;
        let of_a_texel = material.materials.len();
        let shading = |m: &crate::numerics::brdf::Material| Shading { rho_d: m.rho_d, rho_s: m.rho_s, beta: m.beta };
        Ok(Some(Texture {
            materials: material.materials().iter().map(shading).collect(),
            model: material.model,
            side,
            x: patch.x,
            y: patch.y,
            weights: tile.texels().weights.iter().flat_map(|texel| &texel[..of_a_texel]).copied().collect(),
        }))
    }

    /// The response of the calibration that a session used, or levels as sRGB has them.
    ///
    /// # Errors
    /// No such session; its calibration cannot be read.
    pub fn response(&self, id: &str) -> Result<Curves, EngineError> {
        let directory = self.book.lock().session(id)?.directory.clone();
        let calibration = CalibrationFile::of_session(&directory).map_err(storage)?;
        let response = calibration.as_ref().map(|file| file.response.response()).transpose().map_err(storage)?;
        let Response { log_exposure } = response.unwrap_or_else(Response::srgb);
        Ok(Curves { calibration: calibration.map(|file| file.version), log_exposure })
    }

    /// The lights of a session, in the order of its stations; none where there is no material.
    ///
    /// # Errors
    /// No such session; its dataset.toml cannot be read.
    pub fn lights(&self, id: &str) -> Result<Option<Vec<ShownLight>>, EngineError> {
        let Some((directory, _)) = self.fitted(id)? else { return Ok(None) };
        let geometry = dataset::read_geometry(&directory).map_err(storage)?;
        Ok(Some(geometry.lights.iter().map(|light| ShownLight::of(&light.light)).collect()))
    }

    /// The object as the camera saw it, as an EXR of at most `most` columns and rows: `position`, `normal` and `view` (X, Y, Z; camera
    /// frame, mm), weights `material_1`..., their standard errors `sigma_1`..., and `residual` (R, G, B). None without a material.
    ///
    /// # Errors
    /// No such session; nothing was measured; a file of it cannot be read.
    pub fn surface(&self, id: &str, most: usize) -> Result<Option<Vec<u8>>, EngineError> {
        let Some(Seen { geometry, stored, sigma, window, result, .. }) = self.seen(id, most)? else { return Ok(None) };
        let size = (geometry.width, geometry.height);
        let mut channels = planes(&window, &geometry);
        let mut add = |name: String, pixels: &[f32]| channels.push((name, window.of_plane(size.0, pixels).collect()));
        for (kind, maps) in [("material", &stored.weights), ("sigma", &sigma)] {
            for (m, map) in maps.iter().enumerate() {
                add(format!("{kind}_{}", m + 1), &map.pixels);
            }
        }
        for (name, pixels) in read_planes(&result.join("residual.exr"), size).map_err(storage)?.channels {
            if pixels.len() != size.0 * size.1 {
                return Err(storage("residual.exr does not fill its frame: fit again"));
            }
            add(format!("residual.{name}"), &pixels);
        }
        encoded("surface.exr", &window, channels).map(Some)
    }

    /// The radiance that was measured under a light, at the pixels of [`Self::surface`], as an EXR: R, G, B, and `valid`, 1 where it
    /// is known. None without a material.
    ///
    /// # Errors
    /// No such session or light; nothing was measured; a file of it cannot be read.
    pub fn photograph(&self, id: &str, light: usize, most: usize) -> Result<Option<Vec<u8>>, EngineError> {
        let Some(Seen { geometry, window, directory, .. }) = self.seen(id, most)? else { return Ok(None) };
        let lights = geometry.lights.len();
        let named = geometry.lights.get(light).ok_or(EngineError::UnknownLight { light, lights })?;
        let image = read_radiance(&directory.join(&named.name), (geometry.width, geometry.height)).map_err(storage)?;
        let colour = |c: usize| window.pixels().map(|(x, y)| image.radiance.at(x, y)[c]).collect();
        let valid = window.pixels().map(|(x, y)| f32::from(u8::from(*image.valid.at(x, y)))).collect();
        let mut channels: Vec<_> =
            ["R", "G", "B"].iter().enumerate().map(|(c, name)| ((*name).to_owned(), colour(c))).collect();
        channels.push(("valid".to_owned(), valid));
        encoded("radiance.exr", &window, channels).map(Some)
    }

    fn seen(&self, id: &str, most: usize) -> Result<Option<Seen>, EngineError> {
        let Some((directory, result)) = self.fitted(id)? else { return Ok(None) };
        let stored = read_material(&result).map_err(storage)?;
        let sigma = read_sigma(&result, &stored.material).map_err(storage)?;
        let geometry = dataset::read_geometry(&directory).map_err(storage)?;
        if [geometry.width, geometry.height] != stored.material.size {
            return Err(storage("the material was fitted at another size than dataset.toml says: fit again"));
        }
        let window = Window::of(&stored.weights, &sigma, most).ok_or_else(|| EngineError::Unshown {
            reason: "no point of the object was measured: fit again with a lower cosine cut-off".to_owned(),
        })?;
        Ok(Some(Seen { directory, result, stored, sigma, geometry, window }))
    }
}

/// A result, and where it was seen.
struct Seen {
    directory: PathBuf,
    result: PathBuf,
    stored: StoredMaterial,
    sigma: Vec<crate::numerics::image::Image<f32>>,
    geometry: Geometry,
    window: Window,
}

fn encoded(name: &str, window: &Window, channels: Vec<(String, Vec<f32>)>) -> Result<Vec<u8>, EngineError> {
    let Window { origin, step, size } = window;
    let about =
        format!("every {step}. pixel, each way, of the frame's part from column {}, row {} on", origin.0, origin.1);
    encode_planes(name, Planes { origin: (0, 0), full: *size, size: *size, channels }, &about).map_err(storage)
}

/// A mesh that comes with rigd, as .glb; none of that name.
pub fn shape(name: &str) -> Option<Vec<u8>> {
    let mesh = Mesh::new(shapes::by_name(name)?).ok()?;
    Some(glb::write(&mesh))
}

/// The mesh in the bytes of a file with this ending (obj, gltf, glb), checked, as .glb.
///
/// # Errors
/// Why it is refused, and what to do.
pub fn checked_mesh(ending: &str, bytes: &[u8]) -> Result<Vec<u8>, EngineError> {
    let refuse = |reason: String| EngineError::Unshown { reason };
    let format = Format::of(ending).ok_or_else(|| refuse("it is neither OBJ nor glTF".to_owned()))?;
    let elsewhere = |_: &str| Err("it lies in a file of its own: export the mesh as .glb, in one piece".to_owned());
    let mesh = mesh::read(format, bytes, &elsewhere).map_err(|error| refuse(error.to_string()))?;
    Ok(glb::write(&mesh))
}
