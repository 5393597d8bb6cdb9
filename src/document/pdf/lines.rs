//! Text broken into lines, and room shared among columns.

use super::page::Style;

/// Points that a width may be off by.
const ROUNDING: f64 = 1e-6;

/// Encoded text as lines no wider than `width`, broken between words, or within a word that is wider. At least one line.
pub fn wrap(text: &[u8], style: Style, width: f64) -> Vec<&[u8]> {
    // A column as wide as its longest text is not to break it for a rounding.
    let width = width + ROUNDING;
    let wide = |part: &[u8]| style.font.width(part, style.size);
    let (mut lines, mut begin, mut end) = (Vec::new(), 0, 0);
    for word in words(text) {
        let (from, to) = word;
        if wide(&text[begin..to]) <= width {
            end = to;
            continue;
        }
        if end > begin {
            lines.push(&text[begin..end]);
        }
        (begin, end) = (from, to);
        while wide(&text[begin..end]) > width && end > begin + 1 {
            let fits = begin + fitting(&text[begin..end], style, width);
            lines.push(&text[begin..fits]);
            begin = fits;
        }
    }
    lines.push(&text[begin..end]);
    lines
}

/// How many signs of a text that is too wide fit: at least one.
fn fitting(text: &[u8], style: Style, width: f64) -> usize {
    let mut so_far = 0.0;
    let fits = text.iter().take_while(|sign| {
        so_far += style.font.width(&[**sign], style.size);
        so_far <= width
    });
    fits.count().max(1)
}

/// Begin and end of every word.
fn words(text: &[u8]) -> Vec<(usize, usize)> {
    let mut words = Vec::new();
    let mut begin = None;
    for (at, byte) in text.iter().enumerate() {
        match (byte, begin) {
            (b' ', Some(from)) => {
                words.push((from, at));
                begin = None;
            }
            (b' ', None) | (_, Some(_)) => {}
            (_, None) => begin = Some(at),
        }
    }
    words.extend(begin.map(|from| (from, text.len())));
    words
}

/// Widths of columns that would like to be so wide: those below an equal share get what they want, the others share the rest.
pub fn fit_columns(natural: &[f64], width: f64) -> Vec<f64> {
    let mut settled: Vec<Option<f64>> = vec![None; natural.len()];
    loop {
        let taken: f64 = settled.iter().flatten().sum();
        let open = settled.iter().filter(|column| column.is_none()).count();
        if open == 0 {
            break;
        }
        let share = (width - taken) / open as f64;
        let mut more = false;
        for (column, wanted) in settled.iter_mut().zip(natural) {
            if column.is_none() && *wanted <= share {
                (*column, more) = (Some(*wanted), true);
            }
        }
        if !more {
            settled.iter_mut().for_each(|column| *column = column.or(Some(share)));
        }
    }
    settled.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::super::font::Font;
    use super::*;

    const STYLE: Style = Style { font: Font::Plain, size: 10.0, lead: 12.0 };

    #[test]
    fn lines_hold_all_words_and_keep_to_their_width() {
        let text = b"The lamp  drifted by 1.2 %; aVeryLongWordThatNoColumnHolds0123456789abcdef is broken ".as_slice();
        let solid = |text: &[u8]| text.iter().copied().filter(|b| *b != b' ').collect::<Vec<u8>>();
        for width in [5.0, 20.0, 60.0, 200.0, 1000.0] {
            let lines = wrap(text, STYLE, width);
            assert_eq!(solid(&lines.concat()), solid(text), "{width}");
            for line in &lines {
                assert!(line.len() == 1 || STYLE.font.width(line, STYLE.size) <= width + ROUNDING, "{width}: {line:?}");
            }
        }
        assert_eq!(wrap(b"", STYLE, 50.0), [b""]);
        let whole = STYLE.font.width(b"0.000 %", STYLE.size);
        assert_eq!(wrap(b"0.000 %", STYLE, (whole + 8.0) - 8.0), [b"0.000 %"]);
    }

    #[test]
    fn columns_share_what_narrow_ones_leave() {
        assert_eq!(fit_columns(&[30.0, 40.0], 500.0), [30.0, 40.0]);
        assert_eq!(fit_columns(&[50.0, 900.0, 60.0, 700.0], 510.0), [50.0, 200.0, 60.0, 200.0]);
    }
}
