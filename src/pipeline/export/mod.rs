//! A fitted material in the formats of other programs. A format is a file of this folder and a line of [`FORMATS`]; what all of
//! them need is prepared once ([`Captured`]), and what a format loses is measured, not guessed ([`loss`]).

pub mod archive;
pub mod baked;
pub mod exr;
pub mod ggx;
pub mod gltf;
pub mod loss;
pub mod materialx;
pub mod merl;
pub mod mitsuba;
pub mod pbrt;
mod ply;
pub mod rti;
pub mod surface;
pub mod texture;
pub mod usd;
mod words;

use super::report::MaterialFile;
use crate::numerics::brdf::{Lobe, Material};
use crate::numerics::geometry::Angles;
use crate::numerics::image::Image;
use crate::numerics::render::patch::Patch;
use crate::numerics::render::tile::Tile;
use loss::Loss;
use surface::Surface;

pub use words::{readme_of, sentence};

/// Every format there is.
pub const FORMATS: &[Format] =
    &[exr::FORMAT, mitsuba::FORMAT, pbrt::FORMAT, merl::FORMAT, materialx::FORMAT, usd::FORMAT, gltf::FORMAT];

/// Their names.
pub fn names() -> Vec<&'static str> {
    FORMATS.iter().map(|format| format.name).collect()
}

/// The format of this name.
pub fn by_name(name: &str) -> Option<&'static Format> {
    FORMATS.iter().find(|format| format.name == name)
}

/// A format of another program.
pub struct Format {
    /// Name on the command line.
    pub name: &'static str,
    /// What it is, for people: a name, no sentence.
    pub about: &'static str,
    /// Its files. An error says what of the material the format cannot hold, and what to do.
    pub make: fn(&Captured) -> Result<Export, String>,
}

/// What is exported: a result, the tile of its weight map, and a surface to show it on.
pub struct Captured {
    /// `material.json`.
    pub description: MaterialFile,
    /// The reflection model.
    pub lobe: &'static dyn Lobe,
    /// Its parameters, one set a material.
    pub materials: Vec<Material>,
    /// Weights, whole frame, one map a material.
    pub weights: Vec<Image<f32>>,
    /// Their standard errors, likewise; infinite where the data do not determine a weight.
    pub sigma: Vec<Image<f32>>,
    /// Where the frame was measured.
    pub valid: Image<bool>,
    /// Mean over lights of |I - model| / I per channel.
    pub residual: Image<[f32; 3]>,
    /// The square of the weight map that repeats without a seam.
    pub tile: Tile,
    /// Where in the frame it was cut.
    pub patch: Patch,
    /// How often the tile repeats along one unit of the shape's own texture coordinates.
    pub repeats: u16,
    /// A shape that wears the material.
    pub surface: Surface,
}

/// What a format makes of a material.
pub struct Export {
    /// Its files.
    pub files: Vec<File>,
    /// How a reader of these files reflects; none where they hold the very numbers of the result.
    pub model: Option<Box<Model>>,
    /// What is carried, what is lost and why, how to open it: sentences for README.txt.
    pub words: Words,
}

/// BRDF of an export, 1/sr per channel, evaluated as a reader of its files does: at a place of the texture, in tiles (0 to 1 is
/// the tile, u to the right, v down), and under these angles.
pub type Model = dyn Fn([f64; 2], &Angles) -> [f64; 3] + Send + Sync;

/// What README.txt says of an export: sentences, one a line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Words {
    /// What the files carry.
    pub carries: Vec<String>,
    /// What is lost, and why.
    pub loses: Vec<String>,
    /// With which program they are opened, and how.
    pub open: Vec<String>,
}

/// A file of an export.
pub struct File {
    /// Its name in the directory of the export.
    pub name: String,
    /// What is in it.
    pub content: Content,
}

/// What is in a file.
pub enum Content {
    /// Text.
    Text(String),
    /// Bytes.
    Bytes(Vec<u8>),
    /// An OpenEXR picture of floats: columns and rows, each channel's name and pixels, and what the pixels are.
    Planes([usize; 2], Vec<(String, Vec<f32>)>, &'static str),
}

impl File {
    /// A text file.
    pub fn text(name: impl Into<String>, text: String) -> Self {
        Self { name: name.into(), content: Content::Text(text) }
    }

    /// A file of bytes.
    pub fn bytes(name: impl Into<String>, bytes: Vec<u8>) -> Self {
        Self { name: name.into(), content: Content::Bytes(bytes) }
    }
}

/// What an export says of itself, for people.
pub const README: &str = "README.txt";
/// What it loses, for programs.
pub const LOSS: &str = "loss.json";

/// An export with its loss, and README.txt and loss.json among its files.
pub struct Finished {
    /// All files, README.txt last.
    pub files: Vec<File>,
    /// How far the export's picture is from ours; none where it holds the very numbers of the result.
    pub loss: Option<Loss>,
}

impl Captured {
    /// The material in a format.
    ///
    /// # Errors
    /// The format cannot hold it: why, and what to do.
    pub fn export(&self, format: &Format) -> Result<Finished, String> {
        let Export { mut files, model, words } = (format.make)(self)?;
        let loss = model.map(|model| loss::measure(self, &*model)).transpose()?;
        files.push(File::text(LOSS, words::loss_json(format, loss.as_ref(), &words)));
        files.push(File::text(README, words::readme(self, format, loss.as_ref(), &words)));
        Ok(Finished { files, loss })
    }

    /// The tile's weights of material `m` (from 0), row by row.
    pub fn tile_weights(&self, m: usize) -> Vec<f32> {
        self.tile.texels().weights.iter().map(|texel| texel[m]).collect()
    }

    /// The tile's weights as one OpenEXR picture, weight.1 ... a material.
    pub fn tile_planes(&self) -> Content {
        let channel = |m: usize| (format!("weight.{}", m + 1), self.tile_weights(m));
        let channels = (0..self.materials.len()).map(channel).collect();
        Content::Planes([self.side(); 2], channels, "material weights of a tile without seams")
    }

    /// A map of the tile's size as an OpenEXR picture of one channel, Y, for readers that know no other names.
    pub fn tile_map(&self, pixels: Vec<f32>, about: &'static str) -> Content {
        Content::Planes([self.side(); 2], vec![("Y".to_owned(), pixels)], about)
    }

    /// Texels a side of the tile.
    pub fn side(&self) -> usize {
        self.tile.texels().size.0
    }
}
