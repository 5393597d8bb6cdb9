//! Photographs of chessboards for the tests: rendered ones of a known camera, and OpenCV's.
#![allow(dead_code, missing_docs, clippy::unwrap_used)]

use nalgebra::Rotation3;
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rigd::numerics::geometry::{Projection, Vec3};
use rigd::numerics::image::Image;
use rigd::pipeline::calibration::camera::{
    Board, CameraCalibration, CameraCalibrationError, Photograph, calibrate_camera,
};
use std::path::PathBuf;
use std::sync::LazyLock;

pub const BOARD: Board = Board { columns: 9, rows: 6, square_mm: 20.0 };
pub const SIZE: (usize, usize) = (480, 360);
pub const CAMERA: Projection =
    Projection::Pinhole { focal_px: [900.0; 2], principal_px: [246.0, 177.0], distortion: [-0.2, 0.0, 0.0, 0.0, 0.0] };

/// The folder of the chessboard photographs; None, said aloud, where it is missing.
pub fn photographs() -> Option<PathBuf> {
    let root = std::env::var_os("RIGD_SHARED").map_or_else(|| PathBuf::from("../shared"), PathBuf::from);
    let folder = root.join("data/chessboard");
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: {} is not there; set RIGD_SHARED to the folder that holds data/", folder.display());
    None
}

pub fn side(folder: &std::path::Path, side: &str) -> Vec<(String, Vec<u8>)> {
    let numbers = [1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 13, 14];
    let names = numbers.map(|n| format!("{side}{n:02}.jpg"));
    names.into_iter().map(|name| (name.clone(), std::fs::read(folder.join(&name)).unwrap())).collect()
}

pub fn calibrated(files: &[(String, Vec<u8>)], board: &Board) -> Result<CameraCalibration, CameraCalibrationError> {
    let photographs: Vec<_> = files.iter().map(|(name, bytes)| Photograph { name, bytes }).collect();
    calibrate_camera(&photographs, board)
}

/// Where the board lies: tilt (degrees) about an axis in its plane, spin, and its middle (mm).
#[derive(Clone, Copy)]
pub struct Place {
    pub tilt_deg: f64,
    pub axis: f64,
    pub spin: f64,
    pub middle: [f64; 3],
}

impl Place {
    pub fn rotation(&self) -> Rotation3<f64> {
        let axis = Vec3::new(self.axis.cos(), self.axis.sin(), 0.0);
        Rotation3::from_scaled_axis(axis * self.tilt_deg.to_radians())
            * Rotation3::from_scaled_axis(Vec3::z() * self.spin)
    }

    /// A board point, mm from its first corner, in the camera frame.
    pub fn at(&self, board_mm: [f64; 2]) -> Vec3 {
        self.rotation() * Vec3::new(board_mm[0] - 80.0, board_mm[1] - 50.0, 0.0) + Vec3::from(self.middle)
    }
}

pub fn places(count: usize) -> Vec<Place> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(5);
    let mut place = |i: usize| Place {
        tilt_deg: 12.0 + 3.0 * (i % 7) as f64,
        axis: 2.4 * i as f64,
        spin: random.random_range(-0.4..0.4),
        middle: [random.random_range(-35.0..35.0), random.random_range(-25.0..25.0), random.random_range(560.0..640.0)],
    };
    (0..count).map(&mut place).collect()
}

/// Levels of white and black, blur (px, a box), and noise (levels).
#[derive(Clone, Copy)]
pub struct Look {
    pub white: f64,
    pub black: f64,
    pub blur: usize,
    pub noise: f64,
}

pub const CLEAR: Look = Look { white: 200.0, black: 30.0, blur: 1, noise: 1.0 };

/// Rays a pixel in each direction.
const RAYS: usize = 4;

/// Directions of sight, pixel by pixel.
static DIRECTIONS: LazyLock<Vec<Vec3>> = LazyLock::new(|| {
    let of_pixel = |p: usize| {
        let (x, y) = ((p % SIZE.0) as f64, (p / SIZE.0) as f64);
        // Slanted, so that an edge along the rows meets 16 heights of rays and not four.
        let at = |a: usize, b: usize| (a as f64 + (b as f64 + 0.5) / RAYS as f64) / RAYS as f64;
        let ray = move |(a, b)| CAMERA.ray(x + at(a, b), y + at(b, a)).direction;
        (0..RAYS).flat_map(|a| (0..RAYS).map(move |b| (a, b))).map(ray)
    };
    (0..SIZE.0 * SIZE.1).flat_map(of_pixel).collect()
});

/// Squares of 10 x 7 in a white margin on grey, 4 x 4 rays a pixel; the first corner's square is black.
pub fn render(place: &Place, look: Look, seed: u64) -> Image<[u8; 3]> {
    let rotation = place.rotation();
    let origin = place.at([0.0, 0.0]);
    let normal = rotation * Vec3::z();
    let level = |direction: &Vec3| {
        let hit = rotation.inverse() * (direction * (origin.dot(&normal) / direction.dot(&normal)) - origin);
        let (i, j) = ((hit.x / BOARD.square_mm).floor(), (hit.y / BOARD.square_mm).floor());
        if (-1.0..9.0).contains(&i) && (-1.0..6.0).contains(&j) {
            if (i + j).rem_euclid(2.0) == 0.0 { look.black } else { look.white }
        } else if (-2.0..10.0).contains(&i) && (-2.0..7.0).contains(&j) {
            look.white
        } else {
            0.5 * (look.black + look.white)
        }
    };
    let mean = |rays: &[Vec3]| rays.iter().map(level).sum::<f64>() / rays.len() as f64;
    let fine: Vec<f64> = DIRECTIONS.chunks(RAYS * RAYS).map(mean).collect();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let side = 2 * look.blur + 1;
    let pixels = (0..SIZE.0 * SIZE.1).map(|p| {
        let (x, y) = (p % SIZE.0, p / SIZE.0);
        let near = |v: usize, d: usize, size: usize| (v + d).saturating_sub(look.blur).min(size - 1);
        let window = (0..side).flat_map(|dy| (0..side).map(move |dx| (dx, dy)));
        let sum: f64 = window.map(|(dx, dy)| fine[near(y, dy, SIZE.1) * SIZE.0 + near(x, dx, SIZE.0)]).sum();
        let noise: f64 = StandardNormal.sample(&mut random);
        let level = sum / (side * side) as f64 + look.noise * noise;
        [level.round().clamp(0.0, 255.0) as u8; 3]
    });
    Image { width: SIZE.0, height: SIZE.1, pixels: pixels.collect() }
}

pub fn png(picture: &Image<[u8; 3]>) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let (width, height) = (picture.width as u32, picture.height as u32);
    let samples = picture.pixels.as_flattened();
    let (kind, format) = (image::ExtendedColorType::Rgb8, image::ImageFormat::Png);
    image::write_buffer_with_format(&mut bytes, samples, width, height, kind, format).unwrap();
    bytes.into_inner()
}

pub fn files(count: usize) -> Vec<(String, Vec<u8>)> {
    let places = places(count).into_iter().enumerate();
    places.map(|(i, place)| (format!("view{i:02}.png"), png(&render(&place, CLEAR, i as u64)))).collect()
}
