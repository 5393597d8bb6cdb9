//! A document as one HTML file: no script, nothing loaded from anywhere, light and dark, for paper as well.

use super::drawing::{Anchor, Drawing, ON_BLACK, ON_WHITE, SERIES, Shape, Tone};
use super::{Block, Document, Picture, Table, shown};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Write as _;

/// What the file may load: its own pictures and its own style.
pub const POLICY: &str =
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'";

const STYLE: &str = include_str!("report.css");

/// The document as HTML.
pub fn write(document: &Document) -> String {
    let title = escape(&document.title);
    let mut out = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n\
         <style>\n{}</style>\n</head>\n<body>\n<main>\n<h1>{title}</h1>\n",
        style()
    );
    let sections = document.blocks.iter().filter_map(|b| if let Block::Section(text) = b { Some(text) } else { None });
    out += "<nav aria-label=\"Sections\"><ul>\n";
    for (number, text) in sections.enumerate() {
        put(&mut out, format_args!("<li><a href=\"#s{number}\">{}</a></li>\n", escape(text)));
    }
    out += "</ul></nav>\n";
    let mut at = Numbers::default();
    for block in &document.blocks {
        put_block(&mut out, block, &mut at);
    }
    out + "</main>\n</body>\n</html>\n"
}

/// Sections and drawings so far: their names within the file.
#[derive(Default)]
struct Numbers {
    sections: usize,
    figures: usize,
}

/// Writing to a String cannot fail.
fn put(out: &mut String, text: std::fmt::Arguments<'_>) {
    let _ = out.write_fmt(text);
}

fn style() -> String {
    let variables = |colours: [[u8; 3]; SERIES]| -> String {
        colours.iter().enumerate().map(|(i, c)| format!("--s{i}: {}; ", hex(*c))).collect()
    };
    let mut classes = String::new();
    let names = (0..SERIES).map(|i| format!("s{i}")).chain(["ink", "soft", "faint"].map(str::to_owned));
    for name in names {
        put(
            &mut classes,
            format_args!(".f-{name} {{ fill: var(--{name}); }} .l-{name} {{ stroke: var(--{name}); fill: none; }}\n"),
        );
    }
    STYLE
        .replace("@LIGHT@", &variables(ON_WHITE))
        .replace("@DARK@", &variables(ON_BLACK))
        .replace("@COLOURS@\n", &classes)
}

fn put_block(out: &mut String, block: &Block, at: &mut Numbers) {
    match block {
        Block::Section(text) => {
            put(out, format_args!("<h2 id=\"s{}\">{}</h2>\n", at.sections, escape(text)));
            at.sections += 1;
        }
        Block::Heading(text) => put(out, format_args!("<h3>{}</h3>\n", escape(text))),
        Block::Paragraph(text) => put(out, format_args!("<p>{}</p>\n", escape(text))),
        Block::Warning(text) => {
            put(out, format_args!("<p class=\"warning\"><strong>Warning:</strong> {}</p>\n", escape(text)))
        }
        Block::List(items) => {
            *out += "<ul>\n";
            for item in items {
                put(out, format_args!("<li>{}</li>\n", escape(item)));
            }
            *out += "</ul>\n";
        }
        Block::Table(table) => put_table(out, table),
        Block::Drawing(drawing) => {
            put_drawing(out, drawing, at.figures);
            at.figures += 1;
        }
        Block::Picture(picture) => {
            put_picture(out, picture, at.figures);
            at.figures += 1;
        }
    }
}

/// A table that is wider than the window is moved within its own frame, by keyboard as well.
fn put_table(out: &mut String, table: &Table) {
    let caption = escape(&table.caption);
    put(
        out,
        format_args!(
            "<div class=\"wide\" tabindex=\"0\" role=\"region\" aria-label=\"{caption}\">\n<table>\n<caption>{caption}</caption>\n<thead><tr>"
        ),
    );
    for column in &table.columns {
        put(out, format_args!("<th scope=\"col\">{}</th>", escape(column)));
    }
    *out += "</tr></thead>\n<tbody>\n";
    for row in &table.rows {
        *out += "<tr>";
        for (i, cell) in row.iter().enumerate() {
            let (open, close) = if i == 0 { ("th scope=\"row\"", "th") } else { ("td", "td") };
            put(out, format_args!("<{open}>{}</{close}>", escape(cell)));
        }
        *out += "</tr>\n";
    }
    *out += "</tbody>\n</table>\n</div>\n";
}

fn put_picture(out: &mut String, picture: &Picture, number: usize) {
    let ([width, height], data) = (picture.size, STANDARD.encode(&picture.png));
    put(
        out,
        format_args!(
            "<figure><img src=\"data:image/png;base64,{data}\" width=\"{width}\" height=\"{height}\" alt=\"{}\">\n",
            escape(&picture.alternative)
        ),
    );
    if let Some(scale) = &picture.scale {
        put_svg(out, scale, number);
        put(
            out,
            format_args!("<figcaption>{}</figcaption>\n", escape(&format!("{} {}", scale.caption, picture.caption))),
        );
    } else {
        put(out, format_args!("<figcaption>{}</figcaption>\n", escape(&picture.caption)));
    }
    *out += "</figure>\n";
}

fn put_drawing(out: &mut String, drawing: &Drawing, number: usize) {
    *out += "<figure>";
    put_svg(out, drawing, number);
    put(out, format_args!("<figcaption>{}</figcaption></figure>\n", escape(&drawing.caption)));
}

fn put_svg(out: &mut String, drawing: &Drawing, number: usize) {
    let [width, height] = drawing.size;
    put(
        out,
        format_args!(
            "<svg viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" role=\"img\" aria-labelledby=\"f{number}\">\
         <title id=\"f{number}\">{}</title>\n",
            escape(&drawing.alternative)
        ),
    );
    for shape in &drawing.shapes {
        put_shape(out, shape);
    }
    *out += "</svg>\n";
}

fn put_shape(out: &mut String, shape: &Shape) {
    match shape {
        Shape::Line { points, tone, width, dashed } => {
            let dash = if *dashed { " stroke-dasharray=\"6 4\"" } else { "" };
            put(
                out,
                format_args!(
                    "<polyline points=\"{}\" {} stroke-width=\"{width}\"{dash}/>\n",
                    list(points),
                    stroke(*tone)
                ),
            );
        }
        Shape::Area { points, tone } => {
            put(out, format_args!("<polygon points=\"{}\" {}/>\n", list(points), fill(*tone)));
        }
        Shape::Disc { at: [x, y], radius, tone, hollow } => {
            let look = if *hollow { format!("{} stroke-width=\"1.6\"", stroke(*tone)) } else { fill(*tone) };
            put(out, format_args!("<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius}\" {look}/>\n"));
        }
        Shape::Text { at: [x, y], text, size, anchor, tone, upward } => {
            let anchor = match anchor {
                Anchor::Start => "start",
                Anchor::Middle => "middle",
                Anchor::End => "end",
            };
            let turn = if *upward { format!(" transform=\"rotate(-90 {x:.2} {y:.2})\"") } else { String::new() };
            put(
                out,
                format_args!(
                    "<text x=\"{x:.2}\" y=\"{y:.2}\" font-size=\"{size}\" text-anchor=\"{anchor}\" {}{turn}>{}</text>\n",
                    fill(*tone),
                    escape(text)
                ),
            );
        }
    }
}

fn list(points: &[[f64; 2]]) -> String {
    let written: Vec<String> = points.iter().map(|[x, y]| format!("{x:.2},{y:.2}")).collect();
    written.join(" ")
}

/// The attributes of a shape that is filled.
fn fill(tone: Tone) -> String {
    match tone {
        Tone::Exactly(colour) => format!("fill=\"{}\"", hex(colour)),
        tone => format!("class=\"f-{}\"", class(tone)),
    }
}

/// The attributes of a shape of which the edge is drawn.
fn stroke(tone: Tone) -> String {
    match tone {
        Tone::Exactly(colour) => format!("fill=\"none\" stroke=\"{}\"", hex(colour)),
        tone => format!("class=\"l-{}\"", class(tone)),
    }
}

fn class(tone: Tone) -> String {
    match tone {
        Tone::Ink | Tone::Exactly(_) => "ink".to_owned(),
        Tone::Soft => "soft".to_owned(),
        Tone::Faint => "faint".to_owned(),
        Tone::Series(i) => format!("s{}", i % SERIES),
    }
}

fn hex([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// A text as content of an element or as the value of an attribute in double quotes.
fn escape(text: &str) -> String {
    let mut out = String::new();
    for c in shown(text).chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\'' => out += "&#39;",
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_text_gets_out_of_its_place() {
        let text = escape("</title><script>alert('1')</script>\" onload=x & \u{0}");
        assert_eq!(text, "&lt;/title&gt;&lt;script&gt;alert(&#39;1&#39;)&lt;/script&gt;&quot; onload=x &amp; \u{fffd}");
        assert!(text.chars().all(|c| !"<>\"'".contains(c)));
    }
}
