//! The chart of the growth: samples against processor time, both logarithmic.

use super::{Entry, Section};
use crate::study::chart::axis::{LogAxis, grid, short};
use crate::study::chart::{Anchor, ChartError, Figure, Font, GREY, Mark, Rgb};

const SIZE: [f64; 2] = [760.0, 560.0];
const PANEL: [f64; 4] = [92.0, 92.0, 728.0, 492.0];

/// Colours of the solvers in their order (Okabe & Ito 2008: distinct to the colour-blind).
const COLORS: [Rgb; 2] = [[0, 114, 178], [213, 94, 0]];

/// Factor between the times of a point and of where its number ends.
const ROOM: f64 = 1.5;

/// A solver's times.
struct Curve<'a> {
    solver: &'a str,
    /// Samples, seconds, ns a sample.
    points: Vec<[f64; 3]>,
}

/// Draws every solver of the growth.
pub fn draw(entries: &[Entry]) -> Result<Figure, ChartError> {
    let mut figure = Figure::new(SIZE[0], SIZE[1])?;
    let curves = curves(entries);
    let all = || curves.iter().flat_map(|curve| &curve.points);
    let [left, top, right, bottom] = PANEL;
    let x = LogAxis::around(all().map(|point| point[0]), [left, right]);
    // Room for the numbers above and below the points.
    let y = LogAxis::around(all().flat_map(|point| [point[1] / ROOM, point[1] * ROOM]), [bottom, top]);
    figure.text([24.0, 38.0], "Cost of a fit against its size", Font::bold(22.0), Anchor::Start);
    let note = "Points of a marble scene over and over, materials given, one thread; numbers: ns a sample.";
    figure.text([24.0, 62.0], note, Font::plain(13.0).colored(GREY), Anchor::Start);
    grid(&mut figure, &x, &y);
    let middle = [0.5 * (left + right), 0.5 * (top + bottom)];
    figure.text([middle[0], bottom + 46.0], "samples", Font::plain(14.0), Anchor::Middle);
    figure.upward([left - 58.0, middle[1]], "processor time, median (s)", Font::plain(14.0), Anchor::Middle);
    for (index, curve) in curves.iter().enumerate() {
        let label = [left + 20.0, top + 26.0 + 22.0 * index as f64];
        // Above the first curve, below the second, so that the numbers of close curves stay apart.
        let aside = if index == 0 { -12.0 } else { 22.0 };
        draw_curve(&mut figure, curve, (COLORS[index % COLORS.len()], aside), [&x, &y], label);
    }
    Ok(figure)
}

fn curves(entries: &[Entry]) -> Vec<Curve<'_>> {
    let mut curves: Vec<Curve<'_>> = Vec::new();
    for entry in entries.iter().filter(|entry| entry.section == Section::Growth) {
        let (Ok(times), Some(ns)) = (&entry.times, entry.ns_a_sample()) else { continue };
        let point = [entry.samples as f64, times.median_s, ns];
        match curves.iter_mut().find(|curve| curve.solver == entry.work) {
            Some(curve) => curve.points.push(point),
            None => curves.push(Curve { solver: &entry.work, points: vec![point] }),
        }
    }
    curves
}

fn draw_curve(
    figure: &mut Figure,
    curve: &Curve<'_>,
    (color, aside): (Rgb, f64),
    [x, y]: [&LogAxis; 2],
    label: [f64; 2],
) {
    let places: Vec<[f64; 2]> = curve.points.iter().map(|point| [x.place(point[0]), y.place(point[1])]).collect();
    figure.line(&places, color, 1.8, false);
    for (&[px, py], point) in places.iter().zip(&curve.points) {
        figure.mark(Mark::Circle, [px, py], 5.0, color, color);
        let ns = Font::plain(12.0).colored(color);
        figure.text([px, py + aside], &short(point[2]), ns, Anchor::Middle);
    }
    figure.mark(Mark::Circle, [label[0], label[1] - 5.0], 5.0, color, color);
    figure.text([label[0] + 14.0, label[1]], curve.solver, Font::plain(14.0), Anchor::Start);
}
