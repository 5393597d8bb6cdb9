//! One panel: grid, points, front and its key.

use super::{KEY_LINE, Legend, PANEL, Panel, Point, name};
use crate::study::chart::axis::{LogAxis, grid, short};
use crate::study::chart::{Anchor, Figure, Font, GREY, INK, Rgb, WHITE};

/// Radius of a point fitted to everything, and to a subset.
pub const LARGE: f64 = 6.5;
/// See [`LARGE`].
pub const SMALL: f64 = 4.0;
/// Fill of the published point.
pub const ANCHOR: Rgb = [240, 228, 66];

/// Fits worse than this tell nothing about speed and would squeeze the rest, percent.
const WORST_PCT: f64 = 30.0;

/// Fill of a mark.
pub fn fill(color: Rgb, hollow: bool) -> Rgb {
    if hollow { WHITE } else { color }
}

/// A slower point belongs to the front only if its error is below this part of the best faster one's.
const GAIN: f64 = 0.99;

/// The points that no other beats in both time and error, fastest first, without near ties.
pub fn front(points: &[Point]) -> Vec<&Point> {
    let mut sorted: Vec<&Point> = points.iter().filter(|point| point.error_pct.is_finite()).collect();
    sorted.sort_by(|a, b| a.cpu_s.total_cmp(&b.cpu_s).then(a.error_pct.total_cmp(&b.error_pct)));
    let mut best = f64::INFINITY;
    sorted.retain(|point| {
        let better = point.error_pct < GAIN * best;
        best = if better { point.error_pct } else { best };
        better
    });
    sorted
}

/// Draws `panel` with its top left corner at `origin`.
pub fn draw(figure: &mut Figure, panel: &Panel, legend: &Legend, [left, top]: [f64; 2]) {
    let shown: Vec<&Point> = panel.points.iter().filter(|p| p.error_pct <= WORST_PCT && p.cpu_s > 0.0).collect();
    let anchor = panel.anchor;
    let x = LogAxis::around(shown.iter().map(|p| p.cpu_s).chain(anchor.map(|a| a.0)), [left, left + PANEL[0]]);
    let y = LogAxis::around(shown.iter().map(|p| p.error_pct).chain(anchor.map(|a| a.1)), [top + PANEL[1], top]);
    figure.text([left, top - 14.0], &panel.title, Font::bold(16.0), Anchor::Start);
    grid(figure, &x, &y);
    figure.text(
        [left + PANEL[0] / 2.0, top + PANEL[1] + 48.0],
        "processor time of one thread (s)",
        Font::plain(14.0),
        Anchor::Middle,
    );
    figure.upward([left - 50.0, top + PANEL[1] / 2.0], panel.axis, Font::plain(14.0), Anchor::Middle);
    let front = front(&panel.points);
    let steps = steps(&front, &x, &y);
    figure.line(&steps, [150, 150, 150], 1.6, true);
    for point in &shown {
        let (mark, hollow) = legend.mark(point.method.objective.name());
        let radius = if point.method.points.is_some() { SMALL } else { LARGE };
        let color = legend.color(&point.method.solver_label());
        figure.mark(mark, [x.place(point.cpu_s), y.place(point.error_pct)], radius, fill(color, hollow), color);
    }
    if let Some((seconds, percent)) = anchor {
        let at = [x.place(seconds), y.place(percent)];
        figure.mark(crate::study::chart::Mark::Star, at, 8.0, ANCHOR, INK);
        figure.text([at[0] - 14.0, at[1] + 5.0], "2700 s", Font::plain(12.0), Anchor::End);
    }
    number_front(figure, panel, &front, &shown, &x, &y);
    key(figure, legend, &front, [left, top + PANEL[1] + 84.0]);
    let hidden = panel.points.len() - shown.len();
    if hidden > 0 {
        let note = format!("{hidden} above {WORST_PCT} % not shown");
        figure.text([left + PANEL[0], top - 14.0], &note, Font::plain(12.0).colored(GREY), Anchor::End);
    }
}

/// The front as a staircase: what one gets for at most this time.
fn steps(front: &[&Point], x: &LogAxis, y: &LogAxis) -> Vec<[f64; 2]> {
    let mut line = Vec::new();
    let mut last = y.at[1];
    for point in front {
        let (at, level) = (x.place(point.cpu_s), y.place(point.error_pct).max(y.at[1]));
        line.extend([[at, last], [at, level]]);
        last = level;
    }
    line.extend(front.last().map(|_| [x.at[1], last]));
    line
}

/// Writes the numbers of the front beside its points, where they cover nothing.
fn number_front(figure: &mut Figure, panel: &Panel, front: &[&Point], shown: &[&Point], x: &LogAxis, y: &LogAxis) {
    let place = |point: &Point| [x.place(point.cpu_s), y.place(point.error_pct)];
    let mut taken: Vec<[f64; 2]> = shown.iter().map(|point| place(point)).collect();
    taken.extend(panel.anchor.map(|(seconds, percent)| [x.place(seconds), y.place(percent)]));
    for (index, point) in front.iter().enumerate().filter(|(_, point)| point.error_pct <= WORST_PCT) {
        let [px, py] = place(point);
        let candidates = [12.0, 17.0, 22.0, 28.0].iter().flat_map(|&r| {
            [225.0, 200.0, 250.0, 180.0, 270.0, 135.0, 45.0, 315.0f64].map(|deg| {
                let angle = deg.to_radians();
                [px + r * angle.cos(), py - r * angle.sin()]
            })
        });
        let room = |at: &[f64; 2]| {
            let inside =
                at[0] > x.at[0] + 7.0 && at[0] < x.at[1] - 7.0 && at[1] < y.at[0] - 7.0 && at[1] > y.at[1] + 7.0;
            let nearest = taken.iter().map(|t| (t[0] - at[0]).hypot(t[1] - at[1])).fold(f64::INFINITY, f64::min);
            if inside { nearest.min(12.0) } else { -1.0 }
        };
        // The first of the roomiest: max_by would give the last.
        let best = candidates.fold(None, |best: Option<([f64; 2], f64)>, at| {
            let room = room(&at);
            if best.is_some_and(|(_, known)| known >= room) { best } else { Some((at, room)) }
        });
        if let Some((at, _)) = best {
            figure.text([at[0], at[1] + 4.5], &(index + 1).to_string(), Font::bold(12.0), Anchor::Middle);
            taken.push(at);
        }
    }
}

fn key(figure: &mut Figure, legend: &Legend, front: &[&Point], [left, top]: [f64; 2]) {
    let (name_at, time_at, error_at) = (left + 26.0, left + 470.0, left + 560.0);
    let small = Font::plain(12.5);
    let head = small.colored(GREY);
    figure.text([name_at, top], "Pareto front", head, Anchor::Start);
    figure.text([time_at, top], "time (s)", head, Anchor::End);
    figure.text([error_at, top], "error (%)", head, Anchor::End);
    for (index, point) in front.iter().enumerate() {
        let y = top + KEY_LINE * (index + 1) as f64;
        figure.text([left + 18.0, y], &(index + 1).to_string(), Font::bold(12.5), Anchor::End);
        figure.text(
            [name_at, y],
            &name(&point.method),
            small.colored(legend.color(&point.method.solver_label())),
            Anchor::Start,
        );
        figure.text([time_at, y], &short(point.cpu_s), small, Anchor::End);
        figure.text([error_at, y], &short(point.error_pct), small, Anchor::End);
    }
}
