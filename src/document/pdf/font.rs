//! The standard fonts of every PDF reader (ISO 32000-1, 9.6.2.2) and the signs they have.

use pdf_writer::Name;

/// A font.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Font {
    /// Helvetica.
    Plain,
    /// Helvetica, bold.
    Bold,
}

impl Font {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Plain, Self::Bold];

    /// Its name among the resources of a page.
    pub fn key(self) -> Name<'static> {
        match self {
            Self::Plain => Name(b"P"),
            Self::Bold => Name(b"B"),
        }
    }

    /// Its name in the standard.
    pub fn name(self) -> Name<'static> {
        match self {
            Self::Plain => Name(b"Helvetica"),
            Self::Bold => Name(b"Helvetica-Bold"),
        }
    }

    /// Width of encoded text of a size.
    pub fn width(self, text: &[u8], size: f64) -> f64 {
        let widths = match self {
            Self::Plain => &PLAIN,
            Self::Bold => &BOLD,
        };
        let one = |code: &u8| usize::from(*code).checked_sub(FIRST).map_or(0, |index| u32::from(widths[index]));
        f64::from(text.iter().map(one).sum::<u32>()) * size / 1000.0
    }
}

/// The text in WinAnsiEncoding; a sign that the fonts lack becomes a question mark.
pub fn encode(text: &str) -> Vec<u8> {
    text.chars().map(code).collect()
}

fn code(c: char) -> u8 {
    match c {
        ' '..='~' | '\u{a0}'..='\u{ff}' => u8::try_from(u32::from(c)).unwrap_or(b'?'),
        '\u{2212}' => b'-',
        c => SPECIAL.iter().find(|(_, known)| *known == c).map_or(b'?', |(code, _)| *code),
    }
}

/// Signs at the codes where WinAnsiEncoding differs from Latin-1 (ISO 32000-1, annex D).
const SPECIAL: [(u8, char); 27] = [
    (128, '\u{20ac}'),
    (130, '\u{201a}'),
    (131, '\u{192}'),
    (132, '\u{201e}'),
    (133, '\u{2026}'),
    (134, '\u{2020}'),
    (135, '\u{2021}'),
    (136, '\u{2c6}'),
    (137, '\u{2030}'),
    (138, '\u{160}'),
    (139, '\u{2039}'),
    (140, '\u{152}'),
    (142, '\u{17d}'),
    (145, '\u{2018}'),
    (146, '\u{2019}'),
    (147, '\u{201c}'),
    (148, '\u{201d}'),
    (149, '\u{2022}'),
    (150, '\u{2013}'),
    (151, '\u{2014}'),
    (152, '\u{2dc}'),
    (153, '\u{2122}'),
    (154, '\u{161}'),
    (155, '\u{203a}'),
    (156, '\u{153}'),
    (158, '\u{17e}'),
    (159, '\u{178}'),
];

/// Code of the first width.
const FIRST: usize = 32;

/// Widths of Helvetica from code 32 on, thousandths of the size (Adobe's metrics of the core 14 fonts).
#[rustfmt::skip]
const PLAIN: [u16; 224] = [
    278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278,
    556, 556, 556, 556, 556, 556, 556, 556, 556, 556, 278, 278, 584, 584, 584, 556,
    1015, 667, 667, 722, 722, 667, 611, 778, 722, 278, 500, 667, 556, 833, 722, 778,
    667, 778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 278, 278, 278, 469, 556,
    333, 556, 556, 500, 556, 556, 278, 556, 556, 222, 222, 500, 222, 833, 556, 556,
    556, 556, 333, 500, 278, 556, 500, 722, 500, 500, 500, 334, 260, 334, 584, 350,
    556, 350, 222, 556, 333, 1000, 556, 556, 333, 1000, 667, 333, 1000, 350, 611, 350,
    350, 222, 222, 333, 333, 350, 556, 1000, 333, 1000, 500, 333, 944, 350, 500, 667,
    278, 333, 556, 556, 556, 556, 260, 556, 333, 737, 370, 556, 584, 333, 737, 333,
    400, 584, 333, 333, 333, 556, 537, 278, 333, 333, 365, 556, 834, 834, 834, 611,
    667, 667, 667, 667, 667, 667, 1000, 722, 667, 667, 667, 667, 278, 278, 278, 278,
    722, 722, 778, 778, 778, 778, 778, 584, 778, 722, 722, 722, 722, 667, 667, 611,
    556, 556, 556, 556, 556, 556, 889, 500, 556, 556, 556, 556, 278, 278, 278, 278,
    556, 556, 556, 556, 556, 556, 556, 584, 611, 556, 556, 556, 556, 500, 556, 500,
];

/// Widths of Helvetica-Bold from code 32 on, thousandths of the size (Adobe's metrics of the core 14 fonts).
#[rustfmt::skip]
const BOLD: [u16; 224] = [
    278, 333, 474, 556, 556, 889, 722, 238, 333, 333, 389, 584, 278, 333, 278, 278,
    556, 556, 556, 556, 556, 556, 556, 556, 556, 556, 333, 333, 584, 584, 584, 611,
    975, 722, 722, 722, 722, 667, 611, 778, 722, 278, 556, 722, 611, 833, 722, 778,
    667, 778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 333, 278, 333, 584, 556,
    333, 556, 611, 556, 611, 556, 333, 611, 611, 278, 278, 556, 278, 889, 611, 611,
    611, 611, 389, 556, 333, 611, 556, 778, 556, 556, 500, 389, 280, 389, 584, 350,
    556, 350, 278, 556, 500, 1000, 556, 556, 333, 1000, 667, 333, 1000, 350, 611, 350,
    350, 278, 278, 500, 500, 350, 556, 1000, 333, 1000, 556, 333, 944, 350, 500, 667,
    278, 333, 556, 556, 556, 556, 280, 556, 333, 737, 370, 556, 584, 333, 737, 333,
    400, 584, 333, 333, 333, 611, 556, 278, 333, 333, 365, 556, 834, 834, 834, 611,
    722, 722, 722, 722, 722, 722, 1000, 722, 667, 667, 667, 667, 278, 278, 278, 278,
    722, 722, 778, 778, 778, 778, 778, 584, 778, 722, 722, 722, 722, 667, 667, 611,
    556, 556, 556, 556, 556, 556, 889, 556, 556, 556, 556, 556, 278, 278, 278, 278,
    611, 611, 611, 611, 611, 611, 611, 584, 611, 611, 611, 611, 611, 556, 611, 556,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_fonts_lack_is_a_question_mark() {
        assert_eq!(encode("a\u{e9} \u{20ac} \u{2013} \u{4e2d}\u{1f600}\u{fffd}"), b"a\xe9 \x80 \x96 ???");
        assert_eq!(encode("\u{0}\n\u{7f}\u{81}"), b"????");
        assert!((0..=255_u8).all(|code| Font::Bold.width(&[code], 10.0) <= 10.15));
    }
}
