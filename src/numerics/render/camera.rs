//! The camera of a rendered picture: a pinhole in the mesh's own frame (right-handed, y up, any unit).

use super::mesh::Mesh;
use crate::numerics::geometry::{Ray, Vec3};

/// Room around a mesh that is shown whole, in parts of its radius.
const ROOM: f64 = 1.05;
/// From where a mesh is looked at unless said otherwise: from its front, a little from above.
const FROM: [f64; 3] = [0.0, 0.35, 1.0];

/// Why there is no such camera.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ViewError {
    /// No direction to look in.
    #[error("the camera stands where it looks at, or at no finite place: give two different points")]
    NoDirection,
    /// No field of view.
    #[error("a field of view of {0} degrees is none: give more than 0 and less than 180")]
    Field(f64),
    /// No pixels.
    #[error("{0} x {1} pixels are no picture")]
    Size(usize, usize),
}

/// What a camera looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Where it stands.
    pub position: Vec3,
    /// The point in the middle of the picture; +y is up in it, or -z where the camera looks straight up or down.
    pub look_at: Vec3,
    /// Vertical field of view, degrees.
    pub field_deg: f64,
}

impl View {
    /// A view of a whole mesh from its front; the picture has `size` (columns, rows).
    pub fn of(mesh: &Mesh, field_deg: f64, size: (usize, usize)) -> Self {
        let half = (0.5 * field_deg.to_radians()).tan();
        let narrower = half * (size.0 as f64 / size.1 as f64).min(1.0);
        let distance = ROOM * mesh.radius() / narrower.atan().sin();
        Self { position: mesh.middle() + distance * Vec3::from(FROM).normalize(), look_at: mesh.middle(), field_deg }
    }
}

/// A camera, ready to say what its pixels see.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    position: Vec3,
    /// Unit direction of the middle of the picture; then one pixel to the right, and one down, at distance 1.
    forward: Vec3,
    right: Vec3,
    down: Vec3,
    /// Columns and rows.
    size: (usize, usize),
}

impl Camera {
    /// The camera of a view, for a picture of `size` (columns, rows).
    ///
    /// # Errors
    /// The view has no direction or field, or the picture no pixel.
    pub fn new(view: &View, size: (usize, usize)) -> Result<Self, ViewError> {
        if size.0 == 0 || size.1 == 0 {
            return Err(ViewError::Size(size.0, size.1));
        }
        if !(view.field_deg > 0.0 && view.field_deg < 180.0) {
            return Err(ViewError::Field(view.field_deg));
        }
        let forward = view.look_at - view.position;
        let distance = forward.norm();
        if !(distance > 0.0 && distance.is_finite()) {
            return Err(ViewError::NoDirection);
        }
        let forward = forward / distance;
        let across = |up: Vec3| forward.cross(&up).try_normalize(1e-6);
        let right = across(Vec3::y()).or_else(|| across(-Vec3::z())).ok_or(ViewError::NoDirection)?;
        let pixel = 2.0 * (0.5 * view.field_deg.to_radians()).tan() / size.1 as f64;
        let down = forward.cross(&right);
        Ok(Self { position: view.position, forward, right: pixel * right, down: pixel * down, size })
    }

    /// Columns and rows of the picture.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// The ray of sight through a point of the picture, pixels from its top left corner; pixel centres lie at +0.5.
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        let (right, down) = (x - 0.5 * self.size.0 as f64, y - 0.5 * self.size.1 as f64);
        let direction = self.forward + right * self.right + down * self.down;
        Ray { origin: self.position, direction: direction.normalize() }
    }
}
