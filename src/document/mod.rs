//! A document for people: headings, paragraphs, tables, vector drawings and pictures, written as one HTML file ([`html`]) or one PDF
//! ([`pdf`]). Both back ends show the same blocks in the same order, and the same document gives the same bytes.
//!
//! Texts may come from anywhere: the back ends make harmless what their format could take for something else.

pub mod drawing;
pub mod html;
pub mod pdf;
pub mod plot;

pub use drawing::Drawing;

/// Longest text that is shown whole, characters; of a longer one its beginning, and how much is missing.
const LONGEST: usize = 2000;

/// A document.
#[derive(Clone, Debug, PartialEq)]
pub struct Document {
    /// What it is about.
    pub title: String,
    /// In reading order.
    pub blocks: Vec<Block>,
}

/// A part of a document.
#[derive(Clone, Debug, PartialEq)]
pub enum Block {
    /// Begins a section.
    Section(String),
    /// Begins a part of a section.
    Heading(String),
    /// Plain text.
    Paragraph(String),
    /// What must not be overlooked.
    Warning(String),
    /// Texts, one below the other.
    List(Vec<String>),
    /// Rows and columns.
    Table(Table),
    /// A vector drawing.
    Drawing(Drawing),
    /// Pixels.
    Picture(Picture),
}

impl Block {
    /// Plain text.
    pub fn text(text: impl Into<String>) -> Self {
        Self::Paragraph(text.into())
    }
}

/// Rows and columns; the first column names the row.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// What it shows.
    pub caption: String,
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Cells, as many a row as there are columns.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// A table without rows.
    pub fn new<const N: usize>(caption: &str, columns: [&str; N]) -> Self {
        Self { caption: caption.to_owned(), columns: columns.map(str::to_owned).to_vec(), rows: Vec::new() }
    }

    /// Adds a row.
    pub fn row<const N: usize>(&mut self, cells: [String; N]) {
        self.rows.push(cells.to_vec());
    }
}

/// Pixels, three bytes each.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// What it shows, for people who see it.
    pub caption: String,
    /// The same for people who do not.
    pub alternative: String,
    /// Columns and rows.
    pub size: [u32; 2],
    /// A PNG file of 8 bits a channel, red green blue, not interlaced.
    pub png: Vec<u8>,
    /// The scale of its colours, never parted from it.
    pub scale: Option<Drawing>,
}

/// A text as it may be shown: no control characters, nothing that changes the direction of reading, no code point that is no character, and no
/// longer than a page can take. What is taken out leaves a replacement character, so that it is seen.
fn shown(text: &str) -> String {
    let harmless = |c: char| match c {
        '\n' | '\t' => ' ',
        c if c.is_control() => '\u{fffd}',
        '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{feff}' => '\u{fffd}',
        '\u{fdd0}'..='\u{fdef}' => '\u{fffd}',
        c if u32::from(c) & 0xfffe == 0xfffe => '\u{fffd}',
        c => c,
    };
    let begin: String = text.chars().take(LONGEST).map(harmless).collect();
    match text.chars().skip(LONGEST).count() {
        0 => begin,
        more => format!("{begin} [{more} more characters]"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_could_mislead_is_taken_out_and_seen_to_be() {
        assert_eq!(
            shown("a\u{202e}b\0c\u{1b}[31m\u{fdd0}\u{1ffff}\u{85}"),
            "a\u{fffd}b\u{fffd}c\u{fffd}[31m\u{fffd}\u{fffd}\u{fffd}"
        );
        assert_eq!(shown("two\nlines\tand \u{e9}\u{4e2d}"), "two lines and \u{e9}\u{4e2d}");
        assert_eq!(shown(&"x".repeat(LONGEST)).len(), LONGEST);
        assert!(shown(&"x".repeat(LONGEST + 7)).ends_with("x [7 more characters]"));
    }
}
