//! A figure as an SVG document.

use super::{Figure, Look, Rgb, Shape};
use std::fmt::Write;
use tiny_skia::{Path, PathSegment, Point};

pub fn document(figure: &Figure) -> String {
    let (width, height) = (figure.width, figure.height);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    for Shape { path, look, label } in &figure.shapes {
        let label = label.as_ref().map_or(String::new(), |text| format!(" aria-label=\"{}\"", escape(text)));
        out += &format!("<path d=\"{}\" {}{label}/>\n", data(path), style(*look));
    }
    out + "</svg>\n"
}

fn hex([r, g, b]: Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn style(look: Look) -> String {
    let fill = look.fill.map_or("none".to_owned(), hex);
    let stroke = look.stroke.map_or(String::new(), |(color, width)| {
        format!(" stroke=\"{}\" stroke-width=\"{width}\" stroke-linejoin=\"round\"", hex(color))
    });
    let dash = if look.dashed { " stroke-dasharray=\"5 4\"" } else { "" };
    format!("fill=\"{fill}\"{stroke}{dash}")
}

fn data(path: &Path) -> String {
    let mut out = String::new();
    for segment in path.segments() {
        let (command, points): (char, &[Point]) = match &segment {
            PathSegment::MoveTo(p) => ('M', &[*p]),
            PathSegment::LineTo(p) => ('L', &[*p]),
            PathSegment::QuadTo(p, q) => ('Q', &[*p, *q]),
            PathSegment::CubicTo(p, q, r) => ('C', &[*p, *q, *r]),
            PathSegment::Close => ('Z', &[]),
        };
        out.push(command);
        for (i, point) in points.iter().enumerate() {
            // Writing to a String cannot fail.
            let _ = write!(out, "{}{} {}", if i > 0 { " " } else { "" }, round(point.x), round(point.y));
        }
    }
    out
}

/// To a hundredth of a unit.
fn round(value: f32) -> f32 {
    (value * 100.0).round() / 100.0
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}
