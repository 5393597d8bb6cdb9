//! Images as plain row-major arrays; pixel (x, y) covers the square whose centre is (x + 0.5, y + 0.5).

/// A row-major image of `width * height` pixels of `T`.
#[derive(Clone, Debug, PartialEq)]
pub struct Image<T> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` pixels, row by row from the top left.
    pub pixels: Vec<T>,
}

impl<T: Clone> Image<T> {
    /// An image of one value everywhere.
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Self { width, height, pixels: vec![value; width * height] }
    }

    /// The pixel at column `x`, row `y`.
    pub fn at(&self, x: usize, y: usize) -> &T {
        &self.pixels[y * self.width + x]
    }

    /// The pixels of row `y`.
    pub fn row(&self, y: usize) -> &[T] {
        &self.pixels[y * self.width..][..self.width]
    }
}

/// Linear RGB radiance with what is known of its uncertainty.
#[derive(Clone, Debug)]
pub struct RadianceImage {
    /// Radiance per channel, linear, in units in which the response's reference level is exposure 1 (radiance x seconds).
    pub radiance: Image<[f32; 3]>,
    /// Variance of the radiance per channel, same unit squared; absent when the source gave none.
    pub variance: Option<Image<[f32; 3]>>,
    /// False where the value must not be used: clipped in every exposure, too dark, or outside the image's data.
    pub valid: Image<bool>,
}

impl RadianceImage {
    /// An image of nothing, with room for a variance: no pixel is valid.
    pub fn empty(width: usize, height: usize) -> Self {
        Self {
            radiance: Image::filled(width, height, [0.0; 3]),
            variance: Some(Image::filled(width, height, [0.0; 3])),
            valid: Image::filled(width, height, false),
        }
    }
}
