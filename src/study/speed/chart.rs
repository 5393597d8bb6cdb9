//! The chart of speed against accuracy: a panel a scene, log-log, with the Pareto front.

mod panel;

use super::Measurement;
use crate::study::chart::{Anchor, ChartError, Figure, Font, GREY, INK, Mark, Rgb};
use crate::study::median;
use crate::study::method::Method;
use std::collections::BTreeMap;

const PANEL: [f64; 2] = [600.0, 470.0];
const MARGIN: f64 = 84.0;
const HEAD: f64 = 118.0;
const LEGEND: f64 = 210.0;
/// Below a panel: its axis, the head of the key of its front, and the title of the next.
const FOOT: f64 = 164.0;
const KEY_LINE: f64 = 19.0;

/// Ending of the names of robust objectives.
const ROBUST: &str = "-cauchy";

/// Colours of the solvers in their order (Okabe & Ito 2008: distinct to the colour-blind).
const COLORS: [Rgb; 8] = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [204, 121, 167],
    [230, 159, 0],
    [86, 180, 233],
    [120, 94, 40],
    [90, 90, 90],
];

/// Marks of the objectives in their order; the robust ones are hollow.
const MARKS: [Mark; 4] = [Mark::Square, Mark::Triangle, Mark::Circle, Mark::Diamond];

/// The median of a method on a scene.
struct Point {
    method: Method,
    cpu_s: f64,
    error_pct: f64,
}

/// A scene with its points.
struct Panel {
    title: String,
    axis: &'static str,
    /// Published for the same kind of object: seconds and percent.
    anchor: Option<(f64, f64)>,
    points: Vec<Point>,
}

/// What the chart says of each method: solver and rounds, objective, points.
fn name(method: &Method) -> String {
    let points = method.points.map_or("all points".to_owned(), |points| format!("{points} points"));
    format!("{}, {}, {points}", method.solver_label(), method.objective.name())
}

/// What has which colour and mark: solvers and objectives in the order they appear.
struct Legend {
    solvers: Vec<String>,
    objectives: Vec<&'static str>,
}

impl Legend {
    fn new(measured: &[Measurement]) -> Self {
        let mut legend = Self { solvers: Vec::new(), objectives: Vec::new() };
        for method in measured.iter().map(|one| &one.method) {
            if !legend.solvers.contains(&method.solver_label()) {
                legend.solvers.push(method.solver_label());
            }
            if !legend.objectives.contains(&method.objective.name()) {
                legend.objectives.push(method.objective.name());
            }
        }
        legend
    }

    fn color(&self, solver: &str) -> Rgb {
        COLORS[self.solvers.iter().position(|known| known == solver).unwrap_or(0) % COLORS.len()]
    }

    /// The mark of an objective, and whether it is hollow.
    fn mark(&self, objective: &str) -> (Mark, bool) {
        let plain = objective.trim_end_matches(ROBUST);
        let of_plain = self.objectives.iter().filter(|name| !name.ends_with(ROBUST));
        let at = of_plain.clone().position(|known| *known == plain).unwrap_or(of_plain.count());
        (MARKS[at.min(MARKS.len() - 1)], plain != objective)
    }
}

/// Draws the medians over seeds, or over left-out lights.
pub fn draw(measured: &[Measurement]) -> Result<Figure, ChartError> {
    let panels = panels(measured);
    let legend = Legend::new(measured);
    let longest = panels.iter().map(|panel| panel::front(&panel.points).len()).max().unwrap_or(0);
    let step = [PANEL[0] + MARGIN, PANEL[1] + FOOT + KEY_LINE * longest as f64];
    let columns = panels.len().min(2);
    let width = columns as f64 * step[0] + LEGEND + 40.0;
    let mut figure = Figure::new(width, HEAD + step[1] * panels.len().div_ceil(2) as f64 - 20.0)?;
    figure.text([24.0, 38.0], "Speed against accuracy of the fit", Font::bold(22.0), Anchor::Start);
    let note = "Every solver, objective and size of subset; medians over seeds or left-out lights. \
                Numbered: the Pareto front, where more accuracy (by 1 % or more) costs more time.";
    figure.text([24.0, 62.0], note, Font::plain(13.0).colored(GREY), Anchor::Start);
    for (at, panel) in panels.iter().enumerate() {
        let origin = [MARGIN + (at % 2) as f64 * step[0], HEAD + (at / 2) as f64 * step[1]];
        panel::draw(&mut figure, panel, &legend, origin);
    }
    draw_legend(&mut figure, &legend, [width - LEGEND - 8.0, HEAD]);
    Ok(figure)
}

fn panels(measured: &[Measurement]) -> Vec<Panel> {
    let mut scenes: Vec<&Measurement> = Vec::new();
    for one in measured {
        if !scenes.iter().any(|known| known.scene == one.scene) {
            scenes.push(one);
        }
    }
    scenes.into_iter().map(|first| panel_of(first, measured)).collect()
}

fn panel_of(first: &Measurement, measured: &[Measurement]) -> Panel {
    let mut groups: BTreeMap<String, Vec<&Measurement>> = BTreeMap::new();
    for one in measured.iter().filter(|one| one.scene == first.scene) {
        groups.entry(name(&one.method)).or_default().push(one);
    }
    let point = |group: &Vec<&Measurement>| Point {
        method: group[0].method,
        cpu_s: median(group.iter().map(|one| one.cpu_s).collect()),
        error_pct: 100.0 * median(group.iter().map(|one| one.outcome.unseen_error()).collect()),
    };
    let judged =
        if first.seed.is_some() { "relight error under 4 unseen lights (%)" } else { "error on left-out lights (%)" };
    Panel {
        title: format!("{}, {} points", first.scene, first.scene_points),
        axis: judged,
        anchor: match first.scene.as_str() {
            "marble" => Some((2700.0, 5.89)),
            "wood" => Some((2700.0, 4.34)),
            _ => None,
        },
        points: groups.values().map(point).collect(),
    }
}

fn draw_legend(figure: &mut Figure, legend: &Legend, [x, top]: [f64; 2]) {
    let mut y = top + 12.0;
    figure.text([x, y], "Solver", Font::bold(14.0), Anchor::Start);
    for solver in &legend.solvers {
        y += 23.0;
        let color = legend.color(solver);
        figure.mark(Mark::Circle, [x + 8.0, y - 5.0], 6.0, color, color);
        figure.text([x + 24.0, y], solver, Font::plain(14.0), Anchor::Start);
    }
    y += 40.0;
    figure.text([x, y], "Objective", Font::bold(14.0), Anchor::Start);
    for objective in &legend.objectives {
        y += 23.0;
        let (mark, hollow) = legend.mark(objective);
        figure.mark(mark, [x + 8.0, y - 5.0], 5.5, panel::fill(INK, hollow), INK);
        figure.text([x + 24.0, y], objective, Font::plain(14.0), Anchor::Start);
    }
    y += 40.0;
    figure.text([x, y], "Size", Font::bold(14.0), Anchor::Start);
    for (radius, meaning) in [(panel::LARGE, "fitted to all points"), (panel::SMALL, "fitted to a subset")] {
        y += 23.0;
        figure.mark(Mark::Circle, [x + 8.0, y - 5.0], radius, GREY, GREY);
        figure.text([x + 24.0, y], meaning, Font::plain(14.0), Anchor::Start);
    }
    y += 40.0;
    figure.mark(Mark::Star, [x + 8.0, y - 5.0], 6.5, panel::ANCHOR, INK);
    figure.text([x + 24.0, y], "Zheng et al. 2008:", Font::plain(14.0), Anchor::Start);
    for line in ["fit error, as published", "(own photographs,", "Athlon 3000+, Matlab)"] {
        y += 18.0;
        figure.text([x + 24.0, y], line, Font::plain(12.0).colored(GREY), Anchor::Start);
    }
}
