//! A dataset in memory: camera, object, lights and a radiance image a light (CONTRACT.md, "Dataset directory").

use crate::numerics::geometry::{Light, Projection, Sphere};
use crate::numerics::image::{Image, RadianceImage};

/// Everything a fit looks at.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
    /// The camera.
    pub projection: Projection,
    /// The sampled object, camera frame.
    pub object: Sphere,
    /// True on the object; absent means everywhere the geometry says so.
    pub mask: Option<Image<bool>>,
    /// One entry a light position.
    pub lights: Vec<LightImage>,
    /// Samples with cos theta_i or cos theta_r at or below this are not used.
    pub cosine_cutoff: f64,
}

/// A light and the picture taken under it.
#[derive(Clone, Debug)]
pub struct LightImage {
    /// Name for messages: the image's file name.
    pub name: String,
    /// Position and strength of the light.
    pub light: Light,
    /// The radiance under it.
    pub image: RadianceImage,
}
