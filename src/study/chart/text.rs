//! Text as outlines of DejaVu Sans (font/LICENSE), cut down to Latin letters, digits and the few signs the charts use.

use super::{ChartError, Font};
use tiny_skia::{Path, PathBuilder};
use ttf_parser::{Face, OutlineBuilder};

/// The two faces.
pub struct Fonts {
    plain: Face<'static>,
    bold: Face<'static>,
}

impl Fonts {
    pub fn load() -> Result<Self, ChartError> {
        let face = |bytes| Face::parse(bytes, 0).map_err(|error| ChartError::Drawing(error.to_string()));
        Ok(Self {
            plain: face(include_bytes!("font/DejaVuSans.ttf"))?,
            bold: face(include_bytes!("font/DejaVuSans-Bold.ttf"))?,
        })
    }

    /// Outline of a text that begins at the origin, and its width. A sign the font lacks shows as an empty box.
    pub fn outline(&self, text: &str, font: Font) -> (Option<Path>, f64) {
        let face = if font.bold { &self.bold } else { &self.plain };
        let scale = font.size as f32 / f32::from(face.units_per_em());
        let mut pen = Pen { builder: PathBuilder::new(), x: 0.0, scale };
        for sign in text.chars() {
            let glyph = face.glyph_index(sign).unwrap_or_default();
            face.outline_glyph(glyph, &mut pen);
            pen.x += scale * f32::from(face.glyph_hor_advance(glyph).unwrap_or_default());
        }
        (pen.builder.finish(), f64::from(pen.x))
    }
}

/// Draws glyphs one after the other; fonts have y up, charts have y down.
struct Pen {
    builder: PathBuilder,
    x: f32,
    scale: f32,
}

impl Pen {
    fn at(&self, x: f32, y: f32) -> (f32, f32) {
        (self.x + self.scale * x, -self.scale * y)
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.builder.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.builder.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.at(x1, y1), self.at(x, y));
        self.builder.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.at(x1, y1), self.at(x2, y2), self.at(x, y));
        self.builder.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.builder.close();
    }
}
