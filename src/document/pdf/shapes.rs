//! Drawings on a page.

use super::font::{Font, encode};
use super::page::Pages;
use crate::document::drawing::{Anchor, Drawing, ON_WHITE, SERIES, Shape, Tone};
use crate::document::shown;
use pdf_writer::types::LineJoinStyle;
use pdf_writer::{Content, Str};

/// Distance of the control points of a quarter circle, in radii.
const QUARTER: f64 = 0.552_284_75;

/// A page that is drawn on, in the units of the drawing.
struct Canvas<'a> {
    page: &'a mut Content,
    corner: [f64; 2],
    scale: f64,
}

/// Puts a drawing where the page has got to.
pub fn put(pages: &mut Pages, drawing: &Drawing, scale: f64) {
    let (page, corner) = pages.canvas(scale * drawing.size[1]);
    page.save_state().set_line_join(LineJoinStyle::RoundJoin);
    let mut canvas = Canvas { page, corner, scale };
    for shape in &drawing.shapes {
        canvas.draw(shape);
    }
    canvas.page.restore_state();
}

impl Canvas<'_> {
    fn at(&self, [x, y]: [f64; 2]) -> [f32; 2] {
        [(self.corner[0] + self.scale * x) as f32, (self.corner[1] - self.scale * y) as f32]
    }

    fn draw(&mut self, shape: &Shape) {
        match shape {
            Shape::Line { points, tone, width, dashed } => {
                let dash: &[f32] = if *dashed { &[4.5, 3.0] } else { &[] };
                self.page.set_dash_pattern(dash.iter().copied(), 0.0);
                self.edge(*tone, *width);
                if self.path(points) {
                    self.page.stroke();
                }
                self.page.set_dash_pattern([], 0.0);
            }
            Shape::Area { points, tone } => {
                self.fill(*tone);
                if self.path(points) {
                    self.page.close_path().fill_nonzero();
                }
            }
            Shape::Disc { at, radius, tone, hollow } => {
                self.edge(*tone, 1.6);
                self.fill(*tone);
                self.circle(*at, *radius);
                if *hollow {
                    self.page.stroke()
                } else {
                    self.page.fill_nonzero()
                };
            }
            Shape::Text { at, text, size, anchor, tone, upward } => {
                self.fill(*tone);
                self.text(*at, text, *size, *anchor, *upward);
            }
        }
    }

    /// False where there is nothing to draw.
    fn path(&mut self, points: &[[f64; 2]]) -> bool {
        for (i, point) in points.iter().enumerate() {
            let [x, y] = self.at(*point);
            if i == 0 {
                self.page.move_to(x, y)
            } else {
                self.page.line_to(x, y)
            };
        }
        !points.is_empty()
    }

    fn circle(&mut self, [x, y]: [f64; 2], radius: f64) {
        let turned = |a: f64, b: f64, quarter: i32| match quarter {
            0 => [x + a, y + b],
            1 => [x - b, y + a],
            2 => [x - a, y - b],
            _ => [x + b, y - a],
        };
        let [from_x, from_y] = self.at([x + radius, y]);
        self.page.move_to(from_x, from_y);
        for quarter in 0..4 {
            let control = QUARTER * radius;
            let [a, b, to] =
                [turned(radius, control, quarter), turned(control, radius, quarter), turned(0.0, radius, quarter)]
                    .map(|point| self.at(point));
            self.page.cubic_to(a[0], a[1], b[0], b[1], to[0], to[1]);
        }
        self.page.close_path();
    }

    fn text(&mut self, [x, y]: [f64; 2], text: &str, size: f64, anchor: Anchor, upward: bool) {
        let text = encode(&shown(text));
        let shift = match anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => -0.5,
            Anchor::End => -1.0,
        } * Font::Plain.width(&text, size);
        let [x, y] = self.at(if upward { [x, y - shift] } else { [x + shift, y] });
        let matrix = if upward { [0.0, 1.0, -1.0, 0.0, x, y] } else { [1.0, 0.0, 0.0, 1.0, x, y] };
        self.page.begin_text().set_font(Font::Plain.key(), (self.scale * size) as f32);
        self.page.set_text_matrix(matrix).show(Str(&text)).end_text();
    }

    fn fill(&mut self, tone: Tone) {
        let [r, g, b] = colour(tone);
        self.page.set_fill_rgb(r, g, b);
    }

    fn edge(&mut self, tone: Tone, width: f64) {
        let [r, g, b] = colour(tone);
        self.page.set_stroke_rgb(r, g, b).set_line_width((self.scale * width) as f32);
    }
}

/// On paper.
fn colour(tone: Tone) -> [f32; 3] {
    let bytes = match tone {
        Tone::Ink => [28; 3],
        Tone::Soft => [88; 3],
        Tone::Faint => [220; 3],
        Tone::Series(i) => ON_WHITE[i % SERIES],
        Tone::Exactly(colour) => colour,
    };
    bytes.map(|byte| f32::from(byte) / 255.0)
}
