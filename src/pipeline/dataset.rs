//! A dataset in memory: camera, object, lights and a radiance image a light (docs/dataset.md).

use crate::numerics::geometry::{Light, Projection, Shape};
use crate::numerics::image::{Image, RadianceImage};

/// Where everything stands: a dataset without its radiance images.
#[derive(Clone, Debug)]
pub struct Geometry {
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
    /// The camera.
    pub projection: Projection,
    /// The sampled object, camera frame.
    pub object: Shape,
    /// True on the object; absent means everywhere the geometry says so.
    pub mask: Option<Image<bool>>,
    /// One entry a light position.
    pub lights: Vec<NamedLight>,
    /// Samples with cos theta_i or cos theta_r at or below this are not used.
    pub cosine_cutoff: f64,
}

/// A light and the name of the picture taken under it.
#[derive(Clone, Debug)]
pub struct NamedLight {
    /// Image path relative to the dataset.
    pub name: String,
    /// Position and strength.
    pub light: Light,
}

/// Everything a fit looks at.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Camera, object, lights.
    pub geometry: Geometry,
    /// The radiance under each light, in the order of `geometry.lights`.
    pub images: Vec<RadianceImage>,
}
