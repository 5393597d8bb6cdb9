//! A square made to repeat without a seam, by minimum error boundary cuts (Efros and Freeman 2001, image quilting).
//!
//! The square comes with more columns and rows than the tile. Its last columns show what lies beyond the tile's right edge;
//! they are laid over its first columns, and the cut between both runs where they differ least. The tile's right edge
//! then goes on at its left one as it does in the measured map. Rows likewise, with a cut whose ends meet. Along the cut one
//! side passes into the other over half of the overlap: a mixture of two measured weights is one that may lie between them.

use super::tile::Texels;

/// Columns and rows that a tile of `side` texels is cut from beyond its own: a quarter of it.
pub fn overlap(side: usize) -> usize {
    (side / 4).max(MIN_OVERLAP)
}

/// Fewer leave a cut no choice.
const MIN_OVERLAP: usize = 2;

/// The tile of `side` texels out of a square that has [`overlap`] more columns and rows.
pub(super) fn closed(square: &Texels, side: usize) -> Texels {
    let columns = joined(square, side, false);
    joined(&columns.transposed(), side, true).transposed()
}

/// Lays the columns from `side` on over the first ones. `meets`: the cut ends, below, where it begins, above.
fn joined(square: &Texels, side: usize, meets: bool) -> Texels {
    let (width, height) = square.size;
    let overlap = width - side;
    // From one side to the other it is twice this far; with 1 the cut is a sharp one.
    let half = (overlap / 4).max(1);
    let apart = |x: usize, y: usize| -> f64 {
        let (own, beyond) = (square.at(x, y), square.at(x + side, y));
        own.iter().zip(beyond).map(|(a, b)| f64::from(a - b).powi(2)).sum()
    };
    // A cut at c has c in the middle of its passage; the first and the last column belong to one side each.
    let cost = |c: usize, y: usize| (c - half..c + half).map(|x| apart(x, y)).sum();
    let costs = (0..height).map(|y| (half..=overlap - half).map(|c| cost(c, y)).collect());
    let cut = cut(&costs.collect::<Vec<Vec<f64>>>(), meets);
    let mut weights = Vec::with_capacity(side * height);
    for y in 0..height {
        let past = |x: usize| (x as f32 + 0.5 - (cut[y] + half) as f32) / (2 * half - 1) as f32;
        weights.extend((0..side).map(|x| {
            let (own, part) = (square.at(x, y), (0.5 - past(x)).clamp(0.0, 1.0));
            if part == 0.0 {
                return *own;
            }
            let beyond = square.at(x + side, y);
            std::array::from_fn(|m| part * beyond[m] + (1.0 - part) * own[m])
        }));
    }
    Texels { size: (side, height), weights }
}

/// The choice in every row for which the sum of `costs[row][choice]` is least, from row to row by at most one place.
fn cut(costs: &[Vec<f64>], meets: bool) -> Vec<usize> {
    if !meets {
        return path(costs, |_| true, |_| true).1;
    }
    let choices = costs.first().map_or(0, Vec::len);
    let through = |start: usize| path(costs, |first| first == start, |last| last.abs_diff(start) <= 1);
    (0..choices).map(through).min_by(|a, b| a.0.total_cmp(&b.0)).map_or(Vec::new(), |(_, path)| path)
}

/// The cheapest way from an allowed first to an allowed last choice, and its cost.
fn path(costs: &[Vec<f64>], first: impl Fn(usize) -> bool, last: impl Fn(usize) -> bool) -> (f64, Vec<usize>) {
    let choices = costs.first().map_or(0, Vec::len);
    let start = |choice: usize| if first(choice) { 0.0 } else { f64::INFINITY };
    let mut sums: Vec<f64> = (0..choices).map(start).collect();
    let mut origins: Vec<Vec<usize>> = Vec::with_capacity(costs.len());
    for (row, cost) in costs.iter().enumerate() {
        let before = |choice: usize| if row == 0 { choice..choice + 1 } else { near(choice, choices) };
        let cheapest = |choice| before(choice).min_by(|&a, &b| sums[a].total_cmp(&sums[b])).unwrap_or(choice);
        let origin: Vec<usize> = (0..choices).map(cheapest).collect();
        sums = (0..choices).map(|choice| sums[origin[choice]] + cost[choice]).collect();
        origins.push(origin);
    }
    let ends = (0..choices).filter(|&choice| last(choice));
    let mut at = ends.min_by(|&a, &b| sums[a].total_cmp(&sums[b])).unwrap_or(0);
    let cost = sums.get(at).copied().unwrap_or(f64::INFINITY);
    let mut found = vec![0; costs.len()];
    for row in (0..costs.len()).rev() {
        found[row] = at;
        at = origins[row][at];
    }
    (cost, found)
}

/// A choice and those beside it.
fn near(choice: usize, choices: usize) -> std::ops::Range<usize> {
    choice.saturating_sub(1)..(choice + 2).min(choices)
}
