//! Numbers as a report says them.

use crate::document::Table;
use jiff::Timestamp;

/// Most rows of a table of events: the journal has them all.
const MOST_ROWS: usize = 100;

/// A part as percent, three significant digits or so.
pub fn percent(part: f64) -> String {
    let value = 100.0 * part;
    let decimals = match value.abs() {
        v if v >= 10.0 => 1,
        v if v >= 0.1 => 2,
        _ => 3,
    };
    format!("{value:.decimals$} %")
}

/// A figure that may be missing.
pub fn or(value: Option<String>, why_not: &str) -> String {
    value.unwrap_or_else(|| why_not.to_owned())
}

/// Seconds as people say them.
pub fn duration(seconds: f64) -> String {
    match seconds.abs() {
        s if s < 120.0 => format!("{seconds:.2} s"),
        s if s < 7200.0 => format!("{:.1} minutes", seconds / 60.0),
        _ => format!("{:.1} hours", seconds / 3600.0),
    }
}

/// A value with its standard error: two digits of that, and as many decimals of the value.
pub fn plus_minus(value: f64, error: f64) -> String {
    if !(error.is_finite() && error > 0.0) {
        return format!("{value:.4}");
    }
    let decimals = (1.0 - error.log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{value:.decimals$} \u{b1} {error:.decimals$}")
}

/// A time of the journal, to the second; as it stands where it is none.
pub fn moment(text: &str) -> String {
    match text.parse::<Timestamp>() {
        Ok(time) => time.strftime("%Y-%m-%d %H:%M:%S UTC").to_string(),
        Err(_) => text.to_owned(),
    }
}

/// Seconds from one time of the journal to another; none where either is none.
pub fn between(from: &str, to: &str) -> Option<f64> {
    let [from, to] = [from, to].map(|text| text.parse::<Timestamp>().ok());
    Some(to?.duration_since(from?).as_secs_f64())
}

/// "1 frame", "2 frames".
pub fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// Three numbers, as of a place or of three channels.
pub fn three(values: [f64; 3], decimals: usize) -> String {
    values.map(|v| format!("{v:.decimals$}")).join(", ")
}

/// Cuts a table that nobody would read to its end.
pub fn shorten(table: &mut Table, rest_in: &str) {
    if table.rows.len() > MOST_ROWS {
        let more = table.rows.len() - MOST_ROWS;
        table.rows.truncate(MOST_ROWS);
        table.caption += &format!(" (the first {MOST_ROWS}; {more} more are in {rest_in})");
    }
}

/// Red, green, blue.
pub const CHANNELS: [&str; 3] = ["red", "green", "blue"];
/// Colours of the series that stand for them.
pub const CHANNEL_SERIES: [usize; 3] = [1, 2, 0];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        assert_eq!([0.0055, 0.12345, 0.00012].map(percent), ["0.55 %", "12.3 %", "0.012 %"]);
        assert_eq!(plus_minus(0.061_234, 0.000_32), "0.06123 \u{b1} 0.00032");
        assert_eq!(plus_minus(12.3, 4.0), "12.3 \u{b1} 4.0");
        assert_eq!(plus_minus(1.0, 0.0), "1.0000");
        assert_eq!([1.5, 150.0, 9000.0].map(duration), ["1.50 s", "2.5 minutes", "2.5 hours"]);
        assert_eq!(moment("2026-11-30T22:10:24.714943572Z"), "2026-11-30 22:10:24 UTC");
        assert_eq!(moment("<yesterday>"), "<yesterday>");
        assert_eq!(between("2026-11-30T22:10:24Z", "2026-11-30T23:10:25.5Z"), Some(3601.5));
    }
}
