//! The chessboard in its views, and the grey card that is laid on it.

use crate::numerics::geometry::{Light, Projection, Ray, Vec3};
use nalgebra::Rotation3;
use std::f64::consts::PI;

/// The board: inner corners along its sides and the side of a square, mm.
pub const BOARD: (usize, usize, f64) = (9, 6, 15.0);
/// Reflectance of the grey card.
pub const CARD_REFLECTANCE: f64 = 0.18;

/// Reflectance of the board's paper and of its black squares.
const PAPER: f64 = 0.75;
const INK: f64 = 0.04;
/// White margin around the squares, squares.
const MARGIN: f64 = 1.0;
/// Nothing of the board comes nearer to the picture's edge, pixels.
const CLEAR_PX: f64 = 10.0;

/// What is printed on a flat thing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Print {
    /// A chessboard with its white margin.
    Chessboard,
    /// Even grey.
    Grey,
}

/// A flat, matt thing of the board's size somewhere before the camera.
#[derive(Clone, Debug)]
pub struct Flat {
    print: Print,
    /// Camera axes of its x (columns), y (rows) and back side.
    turn: Rotation3<f64>,
    /// Its middle, mm.
    middle: Vec3,
}

impl Flat {
    /// The board as it is held for a view: tilted by 20 to 30 degrees, every time in another direction and elsewhere in the picture,
    /// but for view 0, which nearly faces camera and lamps, near the middle. Who holds it sees the picture, and moves it towards the
    /// middle until all of it is in view.
    pub fn view(print: Print, view: usize, stage_mm: f64, projection: &Projection, size: (usize, usize)) -> Self {
        let round = |base: u32| radical_inverse(base, view + 1);
        let (tilt, spread) = if view == 0 { (6.0, 0.2) } else { (20.0 + 10.0 * round(5), 1.0) };
        // Golden angle: any number of views looks from all sides.
        let towards = view as f64 * PI * (3.0 - 5.0_f64.sqrt());
        let tilted = Rotation3::from_scaled_axis(Vec3::new(towards.cos(), towards.sin(), 0.0) * f64::to_radians(tilt));
        let turn = tilted * Rotation3::from_scaled_axis(Vec3::z() * (round(7) - 0.5) * 0.5);
        let depth = stage_mm * (0.92 + 0.12 * round(11));
        let place = [2.0 * round(2) - 1.0, 2.0 * round(3) - 1.0].map(|side| spread * side);
        let at = |reach: f64| {
            let pixel = [0, 1].map(|i| {
                let whole = [size.0, size.1][i] as f64;
                0.5 * whole * (1.0 + reach * place[i])
            });
            let sight = projection.ray(pixel[0], pixel[1]).direction;
            Self { print, turn, middle: sight * (depth / sight.z) }
        };
        let steps = (0..=50).rev().map(|step| at(f64::from(step) / 50.0));
        steps.into_iter().find(|board| board.is_whole(projection, size)).unwrap_or_else(|| at(0.0))
    }

    /// True if all of it, margin included, is in the picture.
    pub fn is_whole(&self, projection: &Projection, size: (usize, usize)) -> bool {
        self.outline().iter().all(|corner| {
            let [x, y] = projection.project(corner);
            x > CLEAR_PX && y > CLEAR_PX && x < size.0 as f64 - CLEAR_PX && y < size.1 as f64 - CLEAR_PX
        })
    }

    /// Its four corners, mm.
    pub fn outline(&self) -> [Vec3; 4] {
        let [half_x, half_y] = half_size();
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[x, y]| self.middle + self.turn * Vec3::new(x * half_x, y * half_y, 0.0))
    }

    /// Unit normal of its printed side.
    pub fn normal(&self) -> Vec3 {
        -(self.turn * Vec3::z())
    }

    /// Radiance along a ray: Lambert's law; black beside it.
    pub(crate) fn radiance(&self, ray: &Ray, light: &Light) -> [f64; 3] {
        let normal = self.normal();
        let along = normal.dot(&self.middle) / normal.dot(&ray.direction);
        if !(along.is_finite() && along > 0.0) {
            return [0.0; 3];
        }
        let point = ray.direction * along;
        let on = self.turn.inverse() * (point - self.middle);
        let [half_x, half_y] = half_size();
        if on.x.abs() > half_x || on.y.abs() > half_y {
            return [0.0; 3];
        }
        let (direction, irradiance) = light.at(&point);
        let cosine = normal.dot(&direction).max(0.0);
        irradiance.map(|e| self.reflectance(on.x, on.y) / PI * e * cosine)
    }

    fn reflectance(&self, x: f64, y: f64) -> f64 {
        let (columns, rows, square) = BOARD;
        let (squares_x, squares_y) = (columns as f64 + 1.0, rows as f64 + 1.0);
        let (u, v) = (x / square + 0.5 * squares_x, y / square + 0.5 * squares_y);
        match self.print {
            Print::Grey => CARD_REFLECTANCE,
            Print::Chessboard if u < 0.0 || v < 0.0 || u >= squares_x || v >= squares_y => PAPER,
            Print::Chessboard if (u as usize + v as usize).is_multiple_of(2) => INK,
            Print::Chessboard => PAPER,
        }
    }
}

/// Half its width and height, mm.
fn half_size() -> [f64; 2] {
    let (columns, rows, square) = BOARD;
    [columns, rows].map(|corners| square * (0.5 * (corners as f64 + 1.0) + MARGIN))
}

/// The van der Corput sequence: evenly spread over [0, 1) however many are taken.
fn radical_inverse(base: u32, mut index: usize) -> f64 {
    let (mut part, mut sum) = (1.0 / f64::from(base), 0.0);
    while index > 0 {
        sum += part * (index % base as usize) as f64;
        index /= base as usize;
        part /= f64::from(base);
    }
    sum
}
