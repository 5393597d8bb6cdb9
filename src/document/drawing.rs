//! Vector drawings: lines, areas, marks and texts. Text stays text, so that it can be read out, searched and copied; colours are names,
//! so that a drawing follows the page into the dark.

/// A colour by what it is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// Text and frames.
    Ink,
    /// Notes and numbers of axes.
    Soft,
    /// Grid lines.
    Faint,
    /// One of several things that are told apart, from 0; six of them.
    Series(usize),
    /// This very colour, as of a scale of values.
    Exactly([u8; 3]),
}

/// How many series have a colour of their own.
pub const SERIES: usize = 6;

/// Colours of the series on white (Okabe & Ito 2008: distinct to the colour-blind; the fourth darkened to stand out).
pub const ON_WHITE: [[u8; 3]; SERIES] =
    [[0, 114, 178], [213, 94, 0], [0, 130, 95], [170, 70, 130], [20, 20, 20], [140, 100, 0]];
/// The same on black.
pub const ON_BLACK: [[u8; 3]; SERIES] =
    [[86, 180, 233], [255, 150, 60], [60, 210, 160], [235, 150, 205], [230, 230, 230], [240, 228, 66]];

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

/// A shape; x runs right and y down, in units of the drawing.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// An open line through points.
    Line {
        /// Its corners.
        points: Vec<[f64; 2]>,
        /// Its colour.
        tone: Tone,
        /// Its width.
        width: f64,
        /// Whether it is broken.
        dashed: bool,
    },
    /// A filled polygon.
    Area {
        /// Its corners.
        points: Vec<[f64; 2]>,
        /// Its colour.
        tone: Tone,
    },
    /// A disc, or a ring where it is hollow.
    Disc {
        /// Its centre.
        at: [f64; 2],
        /// Its radius.
        radius: f64,
        /// Its colour.
        tone: Tone,
        /// Whether only its edge is drawn.
        hollow: bool,
    },
    /// A text with its baseline at a point.
    Text {
        /// The point.
        at: [f64; 2],
        /// What it says.
        text: String,
        /// Height of the letters.
        size: f64,
        /// Where it lies about the point.
        anchor: Anchor,
        /// Its colour.
        tone: Tone,
        /// Whether it reads upwards.
        upward: bool,
    },
}

/// A drawing.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    /// What it shows.
    pub caption: String,
    /// What is to be seen, for people who do not see it.
    pub alternative: String,
    /// Width and height.
    pub size: [f64; 2],
    /// From back to front.
    pub shapes: Vec<Shape>,
}

impl Drawing {
    /// Adds a line.
    pub fn line(&mut self, points: Vec<[f64; 2]>, tone: Tone, width: f64, dashed: bool) {
        self.shapes.push(Shape::Line { points, tone, width, dashed });
    }

    /// Adds a text.
    pub fn text(&mut self, at: [f64; 2], text: impl Into<String>, tone: Tone, anchor: Anchor) {
        self.shapes.push(Shape::Text { at, text: text.into(), size: TEXT, anchor, tone, upward: false });
    }

    /// Adds a text that reads upwards.
    pub fn upward(&mut self, at: [f64; 2], text: impl Into<String>) {
        let (text, tone, anchor) = (text.into(), Tone::Ink, Anchor::Middle);
        self.shapes.push(Shape::Text { at, text, size: TEXT, anchor, tone, upward: true });
    }
}

/// Height of letters.
pub const TEXT: f64 = 12.0;
