//! A card that lies on the board: the board's pose tells its plane, and where its middle is.

use super::report::CameraCalibration;
use crate::numerics::calibration::lights::card::Card;
use crate::numerics::calibration::lights::plane::Plane;
use crate::numerics::geometry::Vec3;
use nalgebra::Rotation3;

/// Part of the card's side that is looked at, about the middle: the card may lie off the board's middle by the rest.
const LOOKED_AT: f64 = 0.6;

/// The middle of a card of this shorter side (mm) that lies on the board of view `name`, over its middle; `reflectance` with its relative
/// standard deviation. The card's thickness is left out.
///
/// # Errors
/// The calibration has no pose for that view.
pub fn card_on_board(
    camera: &CameraCalibration,
    name: &str,
    side_mm: f64,
    (reflectance, reflectance_sigma): (f64, f64),
) -> Result<Card, String> {
    let view = camera.views.iter().find(|view| view.name == name);
    let pose = view.and_then(|view| view.pose).ok_or_else(|| format!("{name}: there is no pose of its board"))?;
    let rotation = Rotation3::new(Vec3::from(pose.rotation_vector));
    let translation = Vec3::from(pose.translation_mm);
    let board = &camera.board;
    let [x, y] = [board.columns, board.rows].map(|corners| 0.5 * corners.saturating_sub(1) as f64 * board.square_mm);
    let at = |x: f64, y: f64| rotation * Vec3::new(x, y, 0.0) + translation;
    let point = at(x, y);
    let normal = rotation * Vec3::z();
    let normal = if normal.dot(&point) > 0.0 { -normal } else { normal };
    let (half, projection) = (0.5 * LOOKED_AT * side_mm, camera.projection());
    let corners_px = [(-half, -half), (half, -half), (half, half), (-half, half)]
        .map(|(u, v)| projection.project(&at(x + u, y + v)));
    Ok(Card { plane: Plane { point, normal }, corners_px, reflectance, reflectance_sigma })
}
