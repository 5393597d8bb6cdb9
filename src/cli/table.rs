//! Lists for people: columns as wide as what stands in them.

use super::error::print_line;
use super::terminal::{Tone, has_colours};
use crate::store::files::escaped;
use jiff::Timestamp;
use jiff::tz::TimeZone;
use std::io::{self, stdout};

/// On which side of its column something stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Words.
    Left,
    /// Numbers.
    Right,
}

/// A field of a row.
pub struct Cell {
    text: String,
    tone: Tone,
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self { text: escaped(&text), tone: Tone::Plain }
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        text.to_owned().into()
    }
}

/// The state of a run, in its tone.
pub fn state(state: &str) -> Cell {
    Cell { text: escaped(state), tone: Tone::of_state(state) }
}

/// A table; what others wrote comes into it with its control characters made visible.
pub struct Table<const N: usize> {
    sides: [Side; N],
    lines: Vec<Line<N>>,
}

enum Line<const N: usize> {
    Row([Cell; N]),
    Below(String),
}

impl<const N: usize> Table<N> {
    /// A table of these columns.
    pub fn new(columns: [(&str, Side); N]) -> Self {
        let names = columns.map(|(name, _)| Cell { text: name.to_owned(), tone: Tone::Heading });
        Self { sides: columns.map(|(_, side)| side), lines: vec![Line::Row(names)] }
    }

    /// A row more.
    pub fn row(&mut self, cells: [Cell; N]) {
        self.lines.push(Line::Row(cells));
    }

    /// A line below the last row, outside the columns.
    pub fn below(&mut self, text: &str) {
        self.lines.push(Line::Below(escaped(text)));
    }

    /// Prints it, the names of the columns first.
    ///
    /// # Errors
    /// stdout is closed or full.
    pub fn print(&self) -> io::Result<()> {
        let colours = has_colours(&stdout());
        self.text(colours).iter().try_for_each(print_line)
    }

    /// A line each, without spaces at its end.
    fn text(&self, colours: bool) -> Vec<String> {
        let mut widths = [0; N];
        for line in &self.lines {
            if let Line::Row(cells) = line {
                for (width, cell) in widths.iter_mut().zip(cells) {
                    *width = (*width).max(cell.text.chars().count());
                }
            }
        }
        self.lines
            .iter()
            .map(|line| match line {
                Line::Below(text) => format!("  {text}"),
                Line::Row(cells) => self.aligned(cells, widths, colours),
            })
            .collect()
    }

    fn aligned(&self, cells: &[Cell; N], widths: [usize; N], colours: bool) -> String {
        let mut line = String::new();
        for ((cell, side), width) in cells.iter().zip(self.sides).zip(widths) {
            let gap = " ".repeat(width - cell.text.chars().count());
            // Codes end with the word: the spaces after the last one can be taken off.
            let text = if cell.text.is_empty() { String::new() } else { cell.tone.on(&cell.text, colours) };
            line += &match side {
                Side::Left => format!("{text}{gap}  "),
                Side::Right => format!("{gap}{text}  "),
            };
        }
        line.trim_end().to_owned()
    }
}

/// A time of a journal as clocks here show it.
pub fn here(time: &str) -> String {
    let here = |time: Timestamp| time.to_zoned(TimeZone::system()).strftime("%Y-%m-%d %H:%M").to_string();
    time.parse().map_or_else(|_| time.to_owned(), here)
}

/// An error as a share of the whole; empty where there is none.
pub fn percent(error: Option<f64>) -> String {
    error.map(|error| format!("{:.2} %", 100.0 * error)).unwrap_or_default()
}

/// What a run is called, and behind it why it is in its state, where that needs a reason.
pub fn with_reason(name: &str, reason: Option<&str>) -> String {
    name.to_owned() + &reason.map(|reason| format!("  ({reason})")).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_what_stands_in_them_and_codes_have_no_width() {
        let mut table = Table::new([("state", Side::Left), ("frames", Side::Right), ("name", Side::Left)]);
        table.row([state("completed"), "7/70".into(), "Kugel \u{fc}".into()]);
        table.row(["".into(), "".into(), "".into()]);
        table.below("note");
        table.row([state("failed"), "1400/1810".into(), "a\u{1b}[31mb".into()]);
        let plain = table.text(false);
        assert_eq!(plain[0], "state         frames  name");
        assert_eq!(plain[1], "completed       7/70  Kugel \u{fc}");
        assert_eq!((plain[2].as_str(), plain[3].as_str()), ("", "  note"));
        assert!(plain[4].starts_with("failed     1400/1810  a") && !plain[4].contains('\u{1b}'), "{}", plain[4]);
        let coloured = table.text(true);
        let codes = [Tone::Heading, Tone::Good, Tone::Bad].map(|tone| tone.on("", true));
        let bare = |line: &String| {
            codes.iter().fold(line.clone(), |line, codes| {
                codes.split_inclusive('m').fold(line, |line, code| line.replace(code, ""))
            })
        };
        assert!(coloured[1].contains('\u{1b}'));
        assert_eq!(coloured.iter().map(bare).collect::<Vec<_>>(), plain);
    }
}
