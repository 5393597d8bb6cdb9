//! Heat maps: a row a level, a column a solver, the number in the cell.

use super::{Cell, Plan};
use crate::study::chart::axis::short;
use crate::study::chart::{Anchor, ChartError, Figure, Font, GREY, INK, Rgb, WHITE};
use crate::study::score::{BEST_RELIGHT, FAILURE_FACTOR};

const CELL: [f64; 2] = [108.0, 22.0];
const LABELS: f64 = 330.0;
const HEAD: f64 = 140.0;
const FOOT: f64 = 84.0;

/// What a heat map shows.
pub struct Map {
    title: &'static str,
    /// The number of a cell.
    value: fn(&Cell) -> f64,
    /// Where a number lies on the scale, 0 to 1.
    place: fn(f64) -> f64,
    /// Numbers marked on the scale.
    ticks: &'static [f64],
    unit: &'static str,
    scale: Scale,
}

/// Two ends and a middle of a sequential scale, light to dark (ColorBrewer, safe for the colour-blind).
type Scale = [Rgb; 3];
const BLUES: Scale = [[247, 251, 255], [107, 174, 214], [8, 48, 107]];
const ORANGES: Scale = [[255, 247, 236], [253, 141, 60], [127, 39, 4]];

/// Median relight error, logarithmic from 0.5 to 50 %.
pub const RELIGHT: Map = Map {
    title: "Median relight error (%)",
    value: |cell| 100.0 * cell.relight,
    place: |percent| (percent / 0.5).ln() / 100f64.ln(),
    ticks: &[0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0],
    unit: "%, logarithmic",
    scale: BLUES,
};

/// Share of failed fits.
pub const FAILURES: Map = Map {
    title: "Failed fits (% of seeds)",
    value: |cell| 100.0 * cell.failures,
    place: |percent| percent / 100.0,
    ticks: &[0.0, 25.0, 50.0, 75.0, 100.0],
    unit: "% of seeds",
    scale: ORANGES,
};

/// Draws one map of the cells.
pub fn draw(plan: &Plan<'_>, cells: &[Vec<Cell>], map: &Map) -> Result<Figure, ChartError> {
    let width = f64::max(LABELS + CELL[0] * plan.columns.len() as f64 + 40.0, 780.0);
    let bottom = HEAD + CELL[1] * cells.len() as f64;
    let mut figure = Figure::new(width, bottom + FOOT)?;
    head(&mut figure, plan, map);
    let mut last = "";
    for (at, (row, cells)) in plan.rows.iter().zip(cells).enumerate() {
        let y = HEAD + CELL[1] * at as f64;
        if row.regime != last {
            figure.line(&[[24.0, y], [LABELS - 8.0, y]], [200, 200, 200], 0.8, false);
            figure.text([24.0, y + 15.5], row.regime, Font::plain(13.0), Anchor::Start);
            last = row.regime;
        }
        figure.text([LABELS - 14.0, y + 15.5], row.level, Font::plain(13.0), Anchor::End);
        for (column, cell) in cells.iter().enumerate() {
            draw_cell(&mut figure, map, [LABELS + CELL[0] * column as f64, y], (map.value)(cell));
        }
    }
    scale_bar(&mut figure, map, bottom + 24.0);
    Ok(figure)
}

fn head(figure: &mut Figure, plan: &Plan<'_>, map: &Map) {
    figure.text([24.0, 36.0], map.title, Font::bold(20.0), Anchor::Start);
    let seeds = if plan.seeds == 1 { "1 seed".to_owned() } else { format!("{} seeds", plan.seeds) };
    let limit = 100.0 * BEST_RELIGHT * FAILURE_FACTOR;
    let note = format!(
        "{seeds}, about {} points, marble unless said. A fit has failed above {} % relight error.",
        super::POINTS,
        short(limit)
    );
    figure.text([24.0, 60.0], &note, Font::plain(13.0).colored(GREY), Anchor::Start);
    figure.text([24.0, HEAD - 10.0], "regime", Font::bold(13.0), Anchor::Start);
    figure.text([LABELS - 14.0, HEAD - 10.0], "level", Font::bold(13.0), Anchor::End);
    for (at, column) in plan.columns.iter().enumerate() {
        let x = LABELS + CELL[0] * (at as f64 + 0.5);
        let limit = |count: Option<usize>, of: &str| count.map_or(String::new(), |n| format!("{n} {of}"));
        let small = Font::plain(12.0).colored(GREY);
        figure.text([x, HEAD - 42.0], column.solver_name(), Font::bold(13.0), Anchor::Middle);
        figure.text([x, HEAD - 26.0], column.objective.name(), small, Anchor::Middle);
        let limits = limit(column.points, "points") + &limit(column.rounds, "rounds");
        figure.text([x, HEAD - 10.0], &limits, small, Anchor::Middle);
    }
}

fn draw_cell(figure: &mut Figure, map: &Map, [x, y]: [f64; 2], value: f64) {
    let color = color(map, value);
    figure.rectangle([x + 0.75, y + 0.75, CELL[0] - 1.5, CELL[1] - 1.5], color);
    let ink = if luminance(color) > 140.0 { INK } else { WHITE };
    figure.text([x + CELL[0] / 2.0, y + 15.5], &short(value), Font::plain(13.0).colored(ink), Anchor::Middle);
}

fn color(map: &Map, value: f64) -> Rgb {
    let at = 2.0 * (map.place)(value).clamp(0.0, 1.0);
    let (from, to) = if at < 1.0 { (map.scale[0], map.scale[1]) } else { (map.scale[1], map.scale[2]) };
    let part = if at < 1.0 { at } else { at - 1.0 };
    std::array::from_fn(|c| (f64::from(from[c]) + part * (f64::from(to[c]) - f64::from(from[c]))).round() as u8)
}

fn luminance([r, g, b]: Rgb) -> f64 {
    0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b)
}

fn scale_bar(figure: &mut Figure, map: &Map, y: f64) {
    let (left, width, steps) = (LABELS, 300.0, 60);
    let (first, last) = (map.ticks[0], map.ticks[map.ticks.len() - 1]);
    let span = (map.place)(last) - (map.place)(first);
    for step in 0..steps {
        let part = (f64::from(step) + 0.5) / f64::from(steps);
        let shade = Map { place: |part| part, ..*map };
        let x = left + width * f64::from(step) / f64::from(steps);
        figure.rectangle([x, y, width / f64::from(steps) + 0.5, 14.0], color(&shade, part));
    }
    for &tick in map.ticks {
        let x = left + width * ((map.place)(tick) - (map.place)(first)) / span;
        figure.line(&[[x, y + 14.0], [x, y + 19.0]], INK, 1.0, false);
        figure.text([x, y + 33.0], &short(tick), Font::plain(12.0), Anchor::Middle);
    }
    figure.text([left - 14.0, y + 12.0], map.unit, Font::plain(12.0).colored(GREY), Anchor::End);
}
