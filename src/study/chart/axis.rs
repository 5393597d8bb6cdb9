//! Logarithmic axes.

use super::{Anchor, FAINT, Figure, Font, GREY};

/// A logarithmic axis: values `from` to `to` lie on the positions `at[0]` to `at[1]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogAxis {
    /// Least value.
    pub from: f64,
    /// Largest value.
    pub to: f64,
    /// Positions of both, units of the chart.
    pub at: [f64; 2],
}

/// An axis spans at least this ratio: closer values are no different for the eye.
const LEAST_RATIO: f64 = 2.5;

impl LogAxis {
    /// An axis that holds all positive values with some room on either side.
    pub fn around(values: impl Iterator<Item = f64>, at: [f64; 2]) -> Self {
        let (low, high) = values
            .filter(|value| value.is_finite() && *value > 0.0)
            .fold((f64::INFINITY, 0.0), |(low, high), value| (f64::min(low, value), f64::max(high, value)));
        if low > high {
            return Self { from: 0.1, to: 10.0, at };
        }
        let ratio = high / low;
        let room = ratio.powf(0.06).max((LEAST_RATIO / ratio).sqrt());
        Self { from: low / room, to: high * room, at }
    }

    /// Where a value lies.
    pub fn place(&self, value: f64) -> f64 {
        let part = (value / self.from).ln() / (self.to / self.from).ln();
        self.at[0] + part * (self.at[1] - self.at[0])
    }

    /// Ticks: decades on a long axis, more within each on a shorter one.
    pub fn ticks(&self) -> Vec<f64> {
        let steps: &[f64] = match self.to / self.from {
            ratio if ratio < 3.0 => &[1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
            ratio if ratio < 30.0 => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0],
            ratio if ratio < 300.0 => &[1.0, 2.0, 5.0],
            _ => &[1.0],
        };
        let decades = self.from.log10().floor() as i32..=self.to.log10().ceil() as i32;
        let all = decades.flat_map(|decade| steps.iter().map(move |step| step * 10f64.powi(decade)));
        all.filter(|tick| (self.from..=self.to).contains(tick)).collect()
    }
}

/// A number as an axis shows it: three significant digits at most, no needless zeros.
pub fn short(value: f64) -> String {
    if !value.is_finite() {
        return "inf".to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let exponent = value.abs().log10().floor() as i32;
    if !(-3..5).contains(&exponent) {
        return format!("{value:.0e}");
    }
    let digits = usize::try_from(2 - exponent).unwrap_or(0);
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Grid lines, numbers and frame of a panel with these axes.
pub fn grid(figure: &mut Figure, x: &LogAxis, y: &LogAxis) {
    let ([left, right], [bottom, top]) = (x.at, y.at);
    let font = Font::plain(13.0);
    for tick in x.ticks() {
        let at = x.place(tick);
        figure.line(&[[at, bottom], [at, top]], FAINT, 1.0, false);
        figure.text([at, bottom + 20.0], &short(tick), font, Anchor::Middle);
    }
    for tick in y.ticks() {
        let at = y.place(tick);
        figure.line(&[[left, at], [right, at]], FAINT, 1.0, false);
        figure.text([left - 8.0, at + 4.5], &short(tick), font, Anchor::End);
    }
    let frame = [[left, bottom], [right, bottom], [right, top], [left, top], [left, bottom]];
    figure.line(&frame, GREY, 1.0, false);
}
