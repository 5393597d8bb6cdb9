//! Diagrams: axes, lines, points with error bars, bars.

use super::Drawing;
use super::drawing::{Anchor, Shape, Tone};

const SIZE: [f64; 2] = [640.0, 320.0];
/// Left, top, right, bottom of the panel.
const PANEL: [f64; 4] = [72.0, 14.0, 626.0, 262.0];
/// Values beyond this are not drawn: their axis would show nothing else.
const LARGEST: f64 = 1e12;
/// Values closer together, relative to themselves, are one: numbers of an axis could not tell them apart.
const CLOSEST: f64 = 1e-6;
/// About so many ticks an axis.
const TICKS: f64 = 6.0;

/// An axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// What it measures, with its unit.
    pub label: String,
    /// Whether equal steps are equal ratios; what is not positive is then not drawn.
    pub logarithmic: bool,
    /// Values that are to be on it, whatever is drawn.
    pub holds: Vec<f64>,
    /// Names of the values 0, 1, 2 ... instead of numbers; none for numbers.
    pub names: Vec<String>,
}

impl Axis {
    /// Equal steps.
    pub fn linear(label: &str, holds: &[f64]) -> Self {
        Self { label: label.to_owned(), logarithmic: false, holds: holds.to_vec(), names: Vec::new() }
    }

    /// Equal ratios.
    pub fn logarithmic(label: &str) -> Self {
        Self { logarithmic: true, ..Self::linear(label, &[]) }
    }

    /// Names at equal distances.
    pub fn named(label: &str, names: Vec<String>) -> Self {
        let ends = [-0.5, names.len() as f64 - 0.5];
        Self { names, ..Self::linear(label, &ends) }
    }

    fn usable(&self, value: f64) -> bool {
        value.abs() <= LARGEST && (!self.logarithmic || value > 1.0 / LARGEST)
    }
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// A line.
    Line,
    /// A broken line.
    Dashed,
    /// Discs.
    Discs,
    /// Rings.
    Rings,
    /// Bars from the lower end of the axis.
    Bars,
}

/// Values that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// What they are; none needs no entry in the key.
    pub name: Option<String>,
    /// Which colour.
    pub colour: usize,
    /// How they are drawn.
    pub style: Style,
    /// x, y, and how far an error bar reaches up and down; 0 for none.
    pub points: Vec<[f64; 3]>,
}

/// A diagram.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// What it shows.
    pub caption: String,
    /// What is to be seen, for people who do not see it.
    pub alternative: String,
    /// Runs to the right.
    pub x: Axis,
    /// Runs upwards.
    pub y: Axis,
    /// What is drawn, from back to front.
    pub series: Vec<Series>,
}

/// An axis with its range settled.
struct Scale<'a> {
    axis: &'a Axis,
    from: f64,
    to: f64,
    /// Positions of both ends.
    at: [f64; 2],
}

impl<'a> Scale<'a> {
    fn new(axis: &'a Axis, values: impl Iterator<Item = f64>, at: [f64; 2]) -> Self {
        let values = values.chain(axis.holds.iter().copied()).filter(|value| axis.usable(*value));
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let (from, to) = match (low <= high, axis.logarithmic) {
            (false, true) => (0.1, 10.0),
            (false, false) => (0.0, 1.0),
            (true, true) => {
                let room = (high / low).powf(0.08).max(1.5);
                (low / room, high * room)
            }
            (true, false) if !axis.names.is_empty() => (low, high),
            (true, false) => {
                let apart = high - low > CLOSEST * high.abs().max(low.abs()).max(CLOSEST);
                let room = if apart { 0.06 * (high - low) } else { high.abs().max(1.0) * 0.1 };
                // An axis of what is never negative begins at 0.
                (if low == 0.0 { 0.0 } else { low - room }, high + room)
            }
        };
        Self { axis, from, to, at }
    }

    fn place(&self, value: f64) -> f64 {
        let part = if self.axis.logarithmic {
            (value / self.from).ln() / (self.to / self.from).ln()
        } else {
            (value - self.from) / (self.to - self.from)
        };
        self.at[0] + part.clamp(0.0, 1.0) * (self.at[1] - self.at[0])
    }

    fn ticks(&self) -> Vec<(f64, String)> {
        if !self.axis.names.is_empty() {
            return self.axis.names.iter().enumerate().map(|(i, name)| (i as f64, name.clone())).collect();
        }
        if !self.axis.logarithmic {
            return linear_ticks(self.from, self.to);
        }
        let decades = self.to.log10() - self.from.log10();
        let steps: &[f64] = if decades < 1.0 {
            &[1.0, 1.5, 2.0, 3.0, 5.0, 7.0]
        } else if decades < 3.0 {
            &[1.0, 2.0, 5.0]
        } else {
            &[1.0]
        };
        let range = self.from.log10().floor() as i32..=self.to.log10().ceil() as i32;
        let all = range.flat_map(|decade| steps.iter().map(move |step| step * 10f64.powi(decade)));
        all.filter(|tick| (self.from..=self.to).contains(tick)).map(|tick| (tick, short(tick))).collect()
    }
}

/// Multiples of 1, 2 or 5 times a power of ten.
fn linear_ticks(from: f64, to: f64) -> Vec<(f64, String)> {
    let rough = (to - from) / TICKS;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|s| s * power).into_iter().find(|s| *s >= rough).unwrap_or(10.0 * power);
    let decimals = usize::try_from(-(step.log10().floor() as i32)).unwrap_or(0);
    let first = (from / step).ceil() as i64;
    (first..first + 2 * TICKS as i64)
        .map(|i| i as f64 * step)
        .take_while(|tick| *tick <= to)
        .map(|tick| (tick, format!("{tick:.decimals$}")))
        .collect()
}

/// A number of a logarithmic axis.
fn short(value: f64) -> String {
    if (1e-3..1e5).contains(&value) {
        let text = format!("{value:.4}");
        return text.trim_end_matches('0').trim_end_matches('.').to_owned();
    }
    format!("{value:.0e}")
}

impl Plot {
    /// The diagram as a drawing.
    pub fn drawn(&self) -> Drawing {
        let shapes = Vec::new();
        let mut drawing =
            Drawing { caption: self.caption.clone(), alternative: self.alternative.clone(), size: SIZE, shapes };
        let points = || self.series.iter().flat_map(|series| self.usable(series));
        let [left, top, right, bottom] = PANEL;
        let x = Scale::new(&self.x, points().map(|p| p[0]), [left, right]);
        let y = Scale::new(&self.y, points().flat_map(|[_, y, error]| [y - error, y + error]), [bottom, top]);
        self.frame(&mut drawing, &x, &y);
        for series in &self.series {
            self.draw(&mut drawing, series, &x, &y);
        }
        self.key(&mut drawing);
        drawing
    }

    fn usable<'a>(&'a self, series: &'a Series) -> impl Iterator<Item = [f64; 3]> + 'a {
        let usable = |[x, y, error]: &[f64; 3]| self.x.usable(*x) && self.y.usable(*y) && error.abs() <= LARGEST;
        series.points.iter().copied().filter(usable)
    }

    fn frame(&self, drawing: &mut Drawing, x: &Scale<'_>, y: &Scale<'_>) {
        let [left, top, right, bottom] = PANEL;
        let ticks = x.ticks();
        // Names that would overlap are left out evenly.
        let longest = ticks.iter().map(|(_, name)| name.chars().count()).max().unwrap_or(1) as f64;
        let every = (ticks.len() as f64 * (6.0 * longest + 6.0) / (right - left)).ceil().max(1.0) as usize;
        for (value, name) in ticks.into_iter().step_by(every) {
            let at = x.place(value);
            drawing.line(vec![[at, bottom], [at, top]], Tone::Faint, 1.0, false);
            drawing.text([at, bottom + 16.0], name, Tone::Soft, Anchor::Middle);
        }
        for (value, name) in y.ticks() {
            let at = y.place(value);
            drawing.line(vec![[left, at], [right, at]], Tone::Faint, 1.0, false);
            drawing.text([left - 6.0, at + 4.0], name, Tone::Soft, Anchor::End);
        }
        drawing.line(vec![[left, top], [left, bottom], [right, bottom]], Tone::Soft, 1.0, false);
        drawing.text([0.5 * (left + right), bottom + 34.0], self.x.label.as_str(), Tone::Ink, Anchor::Middle);
        drawing.upward([16.0, 0.5 * (top + bottom)], self.y.label.as_str());
    }

    fn draw(&self, drawing: &mut Drawing, series: &Series, x: &Scale<'_>, y: &Scale<'_>) {
        let tone = Tone::Series(series.colour);
        let points: Vec<[f64; 3]> = self.usable(series).collect();
        for [at, value, error] in points.iter().filter(|point| point[2] > 0.0) {
            // The lower end of a bar on a logarithmic axis may have no place.
            let low = if self.y.usable(value - error) { value - error } else { y.from };
            let at = x.place(*at);
            drawing.line(vec![[at, y.place(low)], [at, y.place(value + error)]], tone, 1.4, false);
        }
        let placed: Vec<[f64; 2]> = points.iter().map(|[a, b, _]| [x.place(*a), y.place(*b)]).collect();
        match series.style {
            Style::Line => drawing.line(placed, tone, 1.8, false),
            Style::Dashed => drawing.line(placed, tone, 1.4, true),
            Style::Discs | Style::Rings => {
                let hollow = series.style == Style::Rings;
                drawing.shapes.extend(placed.into_iter().map(|at| Shape::Disc { at, radius: 4.0, tone, hollow }));
            }
            Style::Bars => {
                let half = 0.36 * (x.at[1] - x.at[0]) / (x.to - x.from).max(1.0);
                let base = y.at[0];
                drawing.shapes.extend(placed.into_iter().map(|[a, b]| {
                    let points = vec![[a - half, base], [a - half, b], [a + half, b], [a + half, base]];
                    Shape::Area { points, tone }
                }));
            }
        }
    }

    /// What the colours mean, below the diagram.
    fn key(&self, drawing: &mut Drawing) {
        let mut at = PANEL[0];
        for series in &self.series {
            let Some(name) = &series.name else { continue };
            let (y, tone) = (SIZE[1] - 6.0, Tone::Series(series.colour));
            match series.style {
                Style::Line | Style::Dashed => {
                    drawing.line(vec![[at, y - 4.0], [at + 16.0, y - 4.0]], tone, 2.0, series.style == Style::Dashed);
                }
                style => {
                    let hollow = style == Style::Rings;
                    drawing.shapes.push(Shape::Disc { at: [at + 8.0, y - 4.0], radius: 4.0, tone, hollow });
                }
            }
            drawing.text([at + 22.0, y], name.as_str(), Tone::Ink, Anchor::Start);
            at += 44.0 + 6.6 * name.chars().count() as f64;
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn of(y: Axis, values: &[f64]) -> Drawing {
        let points = values.iter().enumerate().map(|(i, v)| [i as f64, *v, 0.1]).collect();
        let series = vec![Series { name: Some("one".into()), colour: 0, style: Style::Discs, points }];
        Plot { caption: String::new(), alternative: String::new(), x: Axis::linear("x", &[]), y, series }.drawn()
    }

    fn discs(drawing: &Drawing) -> Vec<[f64; 2]> {
        let disc = |shape: &Shape| if let Shape::Disc { at, .. } = shape { Some(*at) } else { None };
        let mut all: Vec<_> = drawing.shapes.iter().filter_map(disc).collect();
        all.pop(); // the key's
        all
    }

    /// Equal steps of the values are equal steps on paper, or equal ratios are.
    #[test]
    fn values_lie_where_their_axis_has_them() {
        for (axis, values) in [(Axis::linear("y", &[]), [1.0, 2.0, 3.0]), (Axis::logarithmic("y"), [1.0, 10.0, 100.0])]
        {
            let at = discs(&of(axis, &values));
            assert!(at[0][1] > at[1][1] && at[1][1] > at[2][1], "y runs upwards: {at:?}");
            assert!((at[0][1] - 2.0 * at[1][1] + at[2][1]).abs() < 1e-9, "{at:?}");
            assert!((at[0][0] - 2.0 * at[1][0] + at[2][0]).abs() < 1e-9, "{at:?}");
        }
    }

    #[test]
    fn ticks_are_round_and_inside() {
        let names = |from, to| linear_ticks(from, to).into_iter().map(|(_, name)| name).collect::<Vec<_>>();
        assert_eq!(names(0.0, 1.06), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(names(-7.0, 12.0), ["-5", "0", "5", "10"]);
        assert_eq!(names(0.9931, 1.0012), ["0.994", "0.996", "0.998", "1.000"]);
    }

    /// Whatever numbers come, every coordinate can be written.
    #[test]
    fn no_number_leads_out_of_the_drawing() {
        let wild = [f64::NAN, f64::INFINITY, -f64::INFINITY, 1e308, -1e308, 0.0, -1.0, 5e-324, 3.0];
        for axis in [Axis::linear("y", &wild), Axis::logarithmic("y"), Axis::named("y", vec!["a".into()])] {
            for values in [&wild[..], &[], &[0.0; 3], &[-2.0]] {
                for shape in of(axis.clone(), values).shapes {
                    let points = match shape {
                        Shape::Line { points, .. } | Shape::Area { points, .. } => points,
                        Shape::Disc { at, .. } | Shape::Text { at, .. } => vec![at],
                    };
                    assert!(points.iter().flatten().all(|v| (-10.0..700.0).contains(v)), "{points:?}");
                }
            }
        }
    }
}
