//! Pages that are filled from top to bottom.

use super::font::{Font, encode};
use super::lines::wrap;
use crate::document::shown;
use pdf_writer::{Content, Name, Str};

/// A4, points.
pub const PAPER: [f32; 2] = [595.0, 842.0];
/// Left margin.
pub const LEFT: f64 = 54.0;
/// Between the margins.
pub const WIDTH: f64 = 487.0;
/// Between the margins.
pub const HEIGHT: f64 = 734.0;
const TOP: f64 = 788.0;
const BOTTOM: f64 = TOP - HEIGHT;

const INK: f32 = 0.11;
const FAINT: f32 = 0.8;

/// Font, size, and distance from line to line.
#[derive(Clone, Copy, Debug)]
pub struct Style {
    /// Which font.
    pub font: Font,
    /// Points.
    pub size: f64,
    /// Points.
    pub lead: f64,
}

/// Pages so far.
pub struct Pages {
    done: Vec<Content>,
    now: Content,
    /// The lower end of what is written.
    y: f64,
}

impl Pages {
    /// One empty page.
    pub fn new() -> Self {
        Self { done: Vec::new(), now: Content::new(), y: TOP }
    }

    /// Index of the page that is being filled.
    pub fn number(&self) -> usize {
        self.done.len()
    }

    /// Page and height where the next line begins.
    pub fn place(&self) -> (usize, f64) {
        (self.number(), self.y)
    }

    /// Turns the page unless so much room is left.
    pub fn ensure(&mut self, room: f64) {
        if self.y - room < BOTTOM && self.y < TOP {
            self.done.push(std::mem::replace(&mut self.now, Content::new()));
            self.y = TOP;
        }
    }

    /// Leaves room.
    pub fn skip(&mut self, height: f64) {
        self.y -= height;
    }

    /// A line of encoded text that hangs from here.
    pub fn show(&mut self, text: &[u8], style: Style, x: f64) {
        let baseline = self.y - style.size;
        show(&mut self.now, text, style, [x, baseline]);
    }

    /// A text beside what comes next.
    pub fn mark(&mut self, text: &str, style: Style, x: f64) {
        self.show(&encode(text), style, x);
    }

    /// A text as lines, and some room.
    pub fn paragraph(&mut self, text: &str, style: Style, x: f64, width: f64) {
        let text = encode(&shown(text));
        for line in wrap(&text, style, width) {
            self.ensure(style.lead);
            self.show(line, style, x);
            self.skip(style.lead);
        }
        self.skip(0.35 * style.lead);
    }

    /// A thin line from margin to margin.
    pub fn rule(&mut self) {
        let (left, right, y) = (LEFT as f32, (LEFT + WIDTH) as f32, (self.y + 0.5) as f32);
        self.now.set_stroke_gray(FAINT).set_line_width(0.5).move_to(left, y).line_to(right, y).stroke();
        self.skip(2.0);
    }

    /// Picture number `index`.
    pub fn picture(&mut self, index: usize, [width, height]: [f64; 2]) {
        self.skip(height);
        let place = [width as f32, 0.0, 0.0, height as f32, LEFT as f32, self.y as f32];
        self.now.save_state().transform(place).x_object(Name(picture_name(index).as_bytes())).restore_state();
        self.skip(4.0);
    }

    /// Room of a height, and the page to draw on; the point is its top left corner.
    pub fn canvas(&mut self, height: f64) -> (&mut Content, [f64; 2]) {
        let corner = [LEFT, self.y];
        self.skip(height + 4.0);
        (&mut self.now, corner)
    }

    /// What is on every page, with its number.
    pub fn finish(mut self) -> Vec<Vec<u8>> {
        self.done.push(self.now);
        let count = self.done.len();
        let numbered = |(index, mut page): (usize, Content)| {
            let text = encode(&format!("{} of {count}", index + 1));
            let style = Style { font: Font::Plain, size: 8.0, lead: 10.0 };
            let x = LEFT + WIDTH - style.font.width(&text, style.size);
            show(&mut page, &text, style, [x, BOTTOM - 22.0]);
            page.finish().to_vec()
        };
        self.done.into_iter().enumerate().map(numbered).collect()
    }
}

fn show(page: &mut Content, text: &[u8], style: Style, [x, y]: [f64; 2]) {
    page.begin_text().set_fill_gray(INK).set_font(style.font.key(), style.size as f32);
    page.next_line(x as f32, y as f32).show(Str(text)).end_text();
}

/// Name of a picture among the resources of the pages.
pub fn picture_name(index: usize) -> String {
    format!("I{index}")
}
