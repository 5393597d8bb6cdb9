//! From radiance to a picture as the camera would have taken it (paper 3.7): radiance x time = exposure, through the response
//! to levels.

use crate::numerics::image::Image;
use crate::numerics::radiometry::response::Response;
use rayon::prelude::*;

/// Levels of an image of radiance exposed for `time_s` seconds; rounded to whole ones, as a camera's are.
pub fn exposed(radiance: &Image<[f32; 3]>, response: &Response, time_s: f64) -> Image<[u8; 3]> {
    let level = |channel: usize, radiance: f32| {
        // Nothing gives level 0: its logarithm lies below any curve.
        response.level(channel, (f64::from(radiance) * time_s).ln()).round() as u8
    };
    let pixels = radiance.pixels.par_iter().map(|pixel| std::array::from_fn(|c| level(c, pixel[c]))).collect();
    Image { width: radiance.width, height: radiance.height, pixels }
}
