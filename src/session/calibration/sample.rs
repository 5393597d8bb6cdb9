//! Where the sample ball stands, from the session's own frames: with a measured camera the rig file's centre counts no more.

use crate::numerics::calibration::lights::balls::{self, Ball};
use crate::numerics::geometry::{Projection, Vec3};
use crate::numerics::image::Image;
use crate::store::dataset::radiance_name;
use crate::store::exr::read_radiance;
use rig_config::Rig;
use std::path::Path;

/// Looks for the ball in the mean over the lights: there its whole outline is lit. `rig` has the measured camera; its object tells the
/// radius, and about where to look when several round things are seen.
///
/// # Errors
/// A station's radiance cannot be read, or nothing in it is a ball.
pub fn find(directory: &Path, rig: &Rig, stations: usize) -> Result<Ball, String> {
    let size = (rig.camera.width, rig.camera.height);
    let mut mean = Image::filled(size.0, size.1, 0.0_f32);
    for station in 0..stations {
        let image = read_radiance(&directory.join(radiance_name(station)), size).map_err(|e| e.to_string())?;
        // Without radiance a pixel counts as dark: background is, and a highlight clipped in every exposure lies inside the outline.
        for (sum, radiance) in mean.pixels.iter_mut().zip(&image.radiance.pixels) {
            *sum += radiance.iter().sum::<f32>() / (3 * stations) as f32;
        }
    }
    let projection = Projection::Pinhole {
        focal_px: rig.camera.focal_px,
        principal_px: rig.camera.principal_px,
        distortion: rig.camera.distortion,
    };
    let expected = projection.project(&Vec3::from(rig.object.center_mm));
    let away = |ball: &Ball| {
        let [x, y] = ball.outline.center_px(&projection);
        (x - expected[0]).hypot(y - expected[1])
    };
    let found = balls::find(&mean, &projection, rig.object.radius_mm, 1);
    let seen: String = found
        .rejected
        .iter()
        .map(|r| format!("; at ({:.0}, {:.0}) px something round: {}", r.center_px[0], r.center_px[1], r.reason))
        .collect();
    found.balls.into_iter().min_by(|a, b| away(a).total_cmp(&away(b))).ok_or_else(|| {
        format!(
            "the sample ball is not found in the mean of the {stations} lights{seen}: it must stand whole in the frame, in focus, near where \
             object.center_mm of the rig file puts it, before a dark background; or take the rig file's geometry (calibration = none)"
        )
    })
}
