//! What the camera looks at: one of the shapes whose normals are known.

use super::{Cylinder, NormalMap, Ray, Sphere, Vec3};

/// A visible surface point.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Position, mm.
    pub position: Vec3,
    /// Unit outward normal.
    pub normal: Vec3,
    /// Unit direction towards the camera.
    pub view: Vec3,
}

/// The sampled object.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A ball (paper 3.2).
    Sphere(Sphere),
    /// A round bar (paper section 5).
    Cylinder(Cylinder),
    /// Anything, given by its normals pixel by pixel (paper section 5).
    Map(NormalMap),
}

impl Shape {
    /// The point seen through the middle of the pixel in column `x`, row `y`, whose ray of sight is `ray`; none beside the
    /// object.
    pub fn at(&self, x: usize, y: usize, ray: &Ray) -> Option<SurfacePoint> {
        match self {
            Self::Sphere(sphere) => sphere.intersect(ray),
            Self::Cylinder(cylinder) => cylinder.intersect(ray),
            Self::Map(map) => map.at(x, y, ray),
        }
    }

    /// True inside the object or on it; never for a map, which has no inside.
    pub fn contains(&self, point: &Vec3) -> bool {
        match self {
            Self::Sphere(sphere) => (point - sphere.center).norm() <= sphere.radius,
            Self::Cylinder(cylinder) => cylinder.contains(point),
            Self::Map(_) => false,
        }
    }
}

impl From<Sphere> for Shape {
    fn from(sphere: Sphere) -> Self {
        Self::Sphere(sphere)
    }
}
