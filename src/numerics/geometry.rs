//! Pinhole and orthographic cameras, shapes, lights, and the angles of a sample (paper Fig. 1).
//! Camera frame: x right, y down, z forward, millimetres.

mod cylinder;
mod normal_map;
mod shape;
mod sphere;

pub use cylinder::Cylinder;
pub use normal_map::NormalMap;
pub use shape::{Shape, SurfacePoint};
pub use sphere::Sphere;

use nalgebra::Vector3;

/// A point or direction in the camera frame.
pub type Vec3 = Vector3<f64>;

/// How points meet pixels. Pixel coordinates have their origin at the top left corner; pixel centres lie at +0.5.
#[derive(Clone, Debug, PartialEq)]
pub enum Projection {
    /// Perspective camera at the origin.
    Pinhole {
        /// Focal length, pixels.
        focal_px: [f64; 2],
        /// Principal point, pixels.
        principal_px: [f64; 2],
        /// Brown distortion k1 k2 p1 p2 k3.
        distortion: [f64; 5],
    },
    /// Parallel rays along +z; pixel (0, 0) corner lies at x = y = 0.
    Orthographic {
        /// Size of a pixel on the object, mm.
        mm_per_px: f64,
    },
}

/// The ray of sight through a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// A point on the ray.
    pub origin: Vec3,
    /// Unit direction, away from the camera.
    pub direction: Vec3,
}

/// Grid of pixels, each way, at which a projection is checked, and by how many pixels it may miss one.
const CHECKED: usize = 16;
const LOST_PX: f64 = 0.01;

impl Projection {
    /// The ray through pixel coordinates (x, y).
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        match self {
            Self::Pinhole { focal_px, principal_px, distortion } => {
                let distorted = [(x - principal_px[0]) / focal_px[0], (y - principal_px[1]) / focal_px[1]];
                let [u, v] = undistort(distorted, distortion);
                Ray { origin: Vec3::zeros(), direction: Vec3::new(u, v, 1.0).normalize() }
            }
            Self::Orthographic { mm_per_px } => {
                Ray { origin: Vec3::new(x * mm_per_px, y * mm_per_px, 0.0), direction: Vec3::z() }
            }
        }
    }

    /// The first of some pixels of a frame whose ray does not lead back to it: there the distortion has no inverse.
    pub fn lost_pixel(&self, width: usize, height: usize) -> Option<[f64; 2]> {
        let step = |i: usize, size: usize| (i as f64 / CHECKED as f64) * size as f64;
        let lost = |&[x, y]: &[f64; 2]| {
            let ray = self.ray(x, y);
            let back = self.project(&(ray.origin + ray.direction));
            // A ray that is not a number leads nowhere.
            !((back[0] - x).abs() < LOST_PX && (back[1] - y).abs() < LOST_PX)
        };
        let grid = (0..=CHECKED).flat_map(|j| (0..=CHECKED).map(move |i| [step(i, width), step(j, height)]));
        grid.into_iter().find(|pixel| lost(pixel))
    }

    /// Pixel coordinates of a point in front of the camera.
    pub fn project(&self, point: &Vec3) -> [f64; 2] {
        match self {
            Self::Pinhole { focal_px, principal_px, distortion } => {
                let [u, v] = distort([point.x / point.z, point.y / point.z], distortion);
                [u * focal_px[0] + principal_px[0], v * focal_px[1] + principal_px[1]]
            }
            Self::Orthographic { mm_per_px } => [point.x / mm_per_px, point.y / mm_per_px],
        }
    }
}

/// Brown's model on normalised image coordinates, ideal to distorted.
fn distort([u, v]: [f64; 2], k: &[f64; 5]) -> [f64; 2] {
    let r2 = u * u + v * v;
    let radial = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
    [
        u * radial + 2.0 * k[2] * u * v + k[3] * (r2 + 2.0 * u * u),
        v * radial + k[2] * (r2 + 2.0 * v * v) + 2.0 * k[3] * u * v,
    ]
}

/// Inverse of [`distort`] by fixed-point iteration; converges for the mild distortion a rig lens has.
fn undistort(distorted: [f64; 2], k: &[f64; 5]) -> [f64; 2] {
    let mut ideal = distorted;
    if k.iter().all(|&c| c == 0.0) {
        return ideal;
    }
    for _ in 0..50 {
        let again = distort(ideal, k);
        ideal = [ideal[0] + distorted[0] - again[0], ideal[1] + distorted[1] - again[1]];
    }
    ideal
}

/// A light position with its strength per channel.
#[derive(Clone, Debug, PartialEq)]
pub enum Light {
    /// A small lamp: irradiance at distance d (facing it) is intensity / d^2.
    Point {
        /// Where, mm.
        position: Vec3,
        /// Radiance units x mm^2.
        intensity: [f64; 3],
    },
    /// A far light: the same irradiance everywhere.
    Distant {
        /// Unit direction from the object towards the light.
        direction: Vec3,
        /// Radiance units.
        irradiance: [f64; 3],
    },
}

impl Light {
    /// Unit direction from `point` to the light, and the irradiance on a surface facing it (l_c of paper Eq. 3, with fall-off).
    pub fn at(&self, point: &Vec3) -> (Vec3, [f64; 3]) {
        match self {
            Self::Point { position, intensity } => {
                let to_light = position - point;
                let distance2 = to_light.norm_squared();
                (to_light / distance2.sqrt(), intensity.map(|i| i / distance2))
            }
            Self::Distant { direction, irradiance } => (*direction, *irradiance),
        }
    }
}

/// The angles of one sample: all that an isotropic BRDF depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angles {
    /// Cosine between normal and light.
    pub cos_i: f64,
    /// Cosine between normal and view.
    pub cos_r: f64,
    /// tan^2 of the half angle sigma: half vector against the normal.
    pub tan2_half: f64,
    /// Cosine between light and view.
    pub cos_iv: f64,
}

impl Angles {
    /// Angles of unit vectors normal, towards the light, towards the view.
    pub fn new(normal: &Vec3, light: &Vec3, view: &Vec3) -> Self {
        let half = light + view;
        // |n x h|^2 / (n.h)^2 keeps its digits where 1 / cos^2 - 1 would cancel.
        let along = normal.dot(&half);
        let tan2_half = normal.cross(&half).norm_squared() / (along * along);
        Self { cos_i: normal.dot(light), cos_r: normal.dot(view), tan2_half, cos_iv: light.dot(view) }
    }

    /// Angles of a half angle, the angle between light and half vector, and the light's turn about the half vector (Rusinkiewicz
    /// 1998), radians. Cosines below zero lie below the horizon.
    pub fn of_half(half: f64, difference: f64, turn: f64) -> Self {
        let along = difference.cos() * half.cos();
        let across = difference.sin() * half.sin() * turn.cos();
        let tan2_half = half.tan() * half.tan();
        Self { cos_i: along - across, cos_r: along + across, tan2_half, cos_iv: (2.0 * difference).cos() }
    }

    /// Cosine of the angle between light, or view, and half vector.
    pub fn cos_difference(&self) -> f64 {
        (0.5 * (1.0 + self.cos_iv)).clamp(0.0, 1.0).sqrt()
    }

    /// The half angle sigma, radians.
    pub fn half_angle(&self) -> f64 {
        self.tan2_half.sqrt().atan()
    }
}
