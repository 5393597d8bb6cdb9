//! Charts as SVG and PNG, drawn by the same paths: text is set in outlines of a bundled font, so that both look alike on a
//! machine without any.

pub mod axis;
mod svg;
mod text;

use std::path::Path;
use tiny_skia::{Color, FillRule, LineCap, LineJoin, Paint, PathBuilder, Pixmap, Rect, Stroke, StrokeDash, Transform};

/// Pixels of the PNG per unit of the chart.
const PNG_SCALE: f32 = 2.0;

/// A colour: red, green, blue.
pub type Rgb = [u8; 3];

/// Text and axes.
pub const INK: Rgb = [34, 34, 34];
/// Notes and frames.
pub const GREY: Rgb = [120, 120, 120];
/// Grid lines.
pub const FAINT: Rgb = [228, 228, 228];
/// Background.
pub const WHITE: Rgb = [255, 255, 255];

/// Why there is no chart.
#[derive(Debug, thiserror::Error)]
pub enum ChartError {
    /// The font in the program cannot be read, or the size is out of range.
    #[error("the chart cannot be drawn: {0}")]
    Drawing(String),
    /// The file cannot be written.
    #[error("{path}: {source}: give a directory that can be written")]
    Write {
        /// Which file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
}

/// Where a text lies about its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// The point is its left end.
    Start,
    /// The point is its middle.
    Middle,
    /// The point is its right end.
    End,
}

/// How a text looks.
#[derive(Clone, Copy, Debug)]
pub struct Font {
    /// Size, units of the chart.
    pub size: f64,
    /// Bold face.
    pub bold: bool,
    /// Colour.
    pub color: Rgb,
}

impl Font {
    /// Plain text of a size.
    pub fn plain(size: f64) -> Self {
        Self { size, bold: false, color: INK }
    }

    /// Bold text of a size.
    pub fn bold(size: f64) -> Self {
        Self { size, bold: true, color: INK }
    }

    /// The same in another colour.
    pub fn colored(self, color: Rgb) -> Self {
        Self { color, ..self }
    }
}

/// How a shape is painted.
#[derive(Clone, Copy, Debug)]
struct Look {
    fill: Option<Rgb>,
    stroke: Option<(Rgb, f32)>,
    dashed: bool,
}

struct Shape {
    path: tiny_skia::Path,
    look: Look,
    /// What a text says, for readers of the SVG that cannot see outlines.
    label: Option<String>,
}

/// A chart under construction; the origin is at the top left, y runs down.
pub struct Figure {
    width: f64,
    height: f64,
    fonts: text::Fonts,
    shapes: Vec<Shape>,
}

/// The mark of a data point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// A disc.
    Circle,
    /// A square.
    Square,
    /// A triangle, point up.
    Triangle,
    /// A square on its corner.
    Diamond,
    /// A five-pointed star.
    Star,
}

impl Figure {
    /// An empty chart.
    pub fn new(width: f64, height: f64) -> Result<Self, ChartError> {
        Ok(Self { width, height, fonts: text::Fonts::load()?, shapes: Vec::new() })
    }

    fn add(&mut self, path: Option<tiny_skia::Path>, look: Look, label: Option<&str>) {
        // An empty path (a text of spaces) draws nothing.
        self.shapes.extend(path.map(|path| Shape { path, look, label: label.map(str::to_owned) }));
    }

    /// A filled rectangle.
    pub fn rectangle(&mut self, [x, y, width, height]: [f64; 4], fill: Rgb) {
        let rect = Rect::from_xywh(x as f32, y as f32, width as f32, height as f32);
        self.add(rect.map(PathBuilder::from_rect), Look { fill: Some(fill), stroke: None, dashed: false }, None);
    }

    /// An open line through points.
    pub fn line(&mut self, points: &[[f64; 2]], color: Rgb, width: f64, dashed: bool) {
        let look = Look { fill: None, stroke: Some((color, width as f32)), dashed };
        self.add(polygon(points, false), look, None);
    }

    /// A data point of a radius, filled or hollow, with an outline.
    pub fn mark(&mut self, mark: Mark, [x, y]: [f64; 2], radius: f64, fill: Rgb, outline: Rgb) {
        let path = match mark {
            Mark::Circle => PathBuilder::from_circle(x as f32, y as f32, radius as f32),
            _ => polygon(&corners(mark, [x, y], radius), true),
        };
        self.add(path, Look { fill: Some(fill), stroke: Some((outline, 1.4)), dashed: false }, None);
    }

    /// A text with its baseline at `at`.
    pub fn text(&mut self, at: [f64; 2], text: &str, font: Font, anchor: Anchor) {
        self.set(at, text, font, anchor, 0.0);
    }

    /// A text that reads upwards.
    pub fn upward(&mut self, at: [f64; 2], text: &str, font: Font, anchor: Anchor) {
        self.set(at, text, font, anchor, -90.0);
    }

    fn set(&mut self, [x, y]: [f64; 2], text: &str, font: Font, anchor: Anchor, degrees: f32) {
        let shift = match anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => -0.5,
            Anchor::End => -1.0,
        };
        let (outline, width) = self.fonts.outline(text, font);
        let place = Transform::from_translate((shift * width) as f32, 0.0)
            .post_rotate(degrees)
            .post_translate(x as f32, y as f32);
        let path = outline.and_then(|path| path.transform(place));
        self.add(path, Look { fill: Some(font.color), stroke: None, dashed: false }, Some(text));
    }

    /// Width of a text.
    pub fn width_of(&self, text: &str, font: Font) -> f64 {
        self.fonts.outline(text, font).1
    }

    /// Writes `stem.svg` and `stem.png` into `directory`.
    pub fn write(&self, directory: &Path, stem: &str) -> Result<(), ChartError> {
        let save = |name: String, bytes: Vec<u8>| {
            let path = directory.join(name);
            std::fs::write(&path, bytes)
                .map_err(|source| ChartError::Write { path: path.display().to_string(), source })
        };
        save(format!("{stem}.svg"), svg::document(self).into_bytes())?;
        save(format!("{stem}.png"), self.png()?)
    }

    fn png(&self) -> Result<Vec<u8>, ChartError> {
        let pixels = |length: f64| (length as f32 * PNG_SCALE).ceil() as u32;
        let mut image = Pixmap::new(pixels(self.width), pixels(self.height))
            .ok_or_else(|| ChartError::Drawing(format!("{} x {} is no size", self.width, self.height)))?;
        image.fill(Color::WHITE);
        let scale = Transform::from_scale(PNG_SCALE, PNG_SCALE);
        for Shape { path, look, .. } in &self.shapes {
            if let Some(fill) = look.fill {
                image.fill_path(path, &paint(fill), FillRule::Winding, scale, None);
            }
            if let Some((color, width)) = look.stroke {
                let dash = if look.dashed { StrokeDash::new(vec![5.0, 4.0], 0.0) } else { None };
                let (line_cap, line_join) = (LineCap::Butt, LineJoin::Round);
                let stroke = Stroke { width, dash, line_cap, line_join, ..Stroke::default() };
                image.stroke_path(path, &paint(color), &stroke, scale, None);
            }
        }
        image.encode_png().map_err(|error| ChartError::Drawing(error.to_string()))
    }
}

fn paint([r, g, b]: Rgb) -> Paint<'static> {
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    paint.set_color_rgba8(r, g, b, 255);
    paint
}

fn polygon(points: &[[f64; 2]], closed: bool) -> Option<tiny_skia::Path> {
    let mut builder = PathBuilder::new();
    for (i, [x, y]) in points.iter().enumerate() {
        let (x, y) = (*x as f32, *y as f32);
        if i == 0 { builder.move_to(x, y) } else { builder.line_to(x, y) }
    }
    if closed {
        builder.close();
    }
    builder.finish()
}

/// Corners of a mark of about the area of a disc of this radius.
fn corners(mark: Mark, [x, y]: [f64; 2], radius: f64) -> Vec<[f64; 2]> {
    let (count, first_deg, reach) = match mark {
        Mark::Square => (4, 45.0, [1.25, 1.25]),
        Mark::Diamond | Mark::Circle => (4, 0.0, [1.3, 1.3]),
        Mark::Triangle => (3, -90.0, [1.4, 1.4]),
        Mark::Star => (10, -90.0, [1.6, 0.7]),
    };
    let corner = |i: usize| {
        let angle = f64::to_radians(first_deg + 360.0 * i as f64 / count as f64);
        let r = radius * reach[i % 2];
        [x + r * angle.cos(), y + r * angle.sin()]
    };
    (0..count).map(corner).collect()
}
