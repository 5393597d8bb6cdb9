//! Labelled corners cropped to the known board, and which of them is the first.

use super::board::{BadPhotograph, Board, Labelled};
use super::refine::sample;
use crate::numerics::image::Image;
use std::collections::HashMap;

/// All corners of a board, row by row; pixel centres at integers.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    pub columns: usize,
    pub rows: usize,
    pub corners: Vec<[f64; 2]>,
}

/// The one window of the labels that holds exactly the board. The detector now and then adds corners beside the board: one too
/// many, taken blindly, has moved a focal length by 1.3 %.
pub(super) fn crop(labelled: &Labelled, board: &Board) -> Result<Grid, BadPhotograph> {
    let side = |corners: usize| i32::try_from(corners).unwrap_or(i32::MAX);
    let (columns, rows) = (side(board.columns), side(board.rows));
    let places: HashMap<[i32; 2], [f64; 2]> = labelled.iter().copied().collect();
    let span = |axis: usize| {
        let along = places.keys().map(|k| k[axis]);
        along.clone().min().zip(along.max()).unwrap_or((0, -1))
    };
    let ((u0, u1), (v0, v1)) = (span(0), span(1));
    let mut found = Vec::new();
    let turns: &[bool] = if board.columns == board.rows { &[false] } else { &[false, true] };
    for &turned in turns {
        let (wide, high) = if turned { (rows, columns) } else { (columns, rows) };
        for (u, v) in (u0..=u1 - wide + 1).flat_map(|u| (v0..=v1 - high + 1).map(move |v| (u, v))) {
            let at = |row: i32, column: i32| if turned { [u + row, v + column] } else { [u + column, v + row] };
            let cells = (0..rows).flat_map(|row| (0..columns).map(move |c| (row, c)));
            let corners: Option<Vec<_>> = cells.map(|(row, column)| places.get(&at(row, column)).copied()).collect();
            found.extend(corners);
        }
    }
    match found.len() {
        1 => Ok(Grid { columns: board.columns, rows: board.rows, corners: found.remove(0) }),
        0 => Err(BadPhotograph::Partial { found: labelled.len().min(board.corners() - 1), needed: board.corners() }),
        _ => Err(BadPhotograph::LargerBoard { columns: (u1 - u0 + 1) as usize, rows: (v1 - v0 + 1) as usize }),
    }
}

impl Grid {
    /// From pixels of a reduced picture to those of the whole.
    pub fn scaled(mut self, by: usize) -> Self {
        let by = by as f64;
        self.corners.iter_mut().for_each(|c| *c = c.map(|x| (x + 0.5) * by - 0.5));
        self
    }

    pub fn at(&self, column: usize, row: usize) -> [f64; 2] {
        self.corners[row * self.columns + column]
    }

    /// The centre of the square right of and below a corner.
    pub fn square(&self, column: usize, row: usize) -> [f64; 2] {
        let around = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| self.at(column + i, row + j));
        [0, 1].map(|axis| around.iter().map(|c| c[axis]).sum::<f64>() / 4.0)
    }

    /// Mean level of the squares of the first corner's colour, and of the others.
    pub fn levels(&self, grey: &Image<u8>) -> [f64; 2] {
        let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
        for (row, column) in (0..self.rows - 1).flat_map(|r| (0..self.columns - 1).map(move |c| (r, c))) {
            let colour = (row + column) % 2;
            sums[colour] += sample(grey, self.square(column, row)).unwrap_or(0.0);
            counts[colour] += 1.0;
        }
        [sums[0] / counts[0], sums[1] / counts[1]]
    }

    /// The same corners with the first one where [`super::board::find_board`] says.
    pub fn oriented(self, grey: &Image<u8>) -> Self {
        let right_handed = if self.turn() < 0.0 { self.mapped(|c, r, n, _| (n - 1 - c, r)) } else { self };
        let turned = right_handed.mapped(|c, r, n, m| (n - 1 - c, m - 1 - r));
        if (right_handed.columns + right_handed.rows) % 2 == 1 {
            let [first, other] = right_handed.levels(grey);
            return if first < other { right_handed } else { turned };
        }
        let mut candidates = vec![right_handed, turned];
        if candidates[0].columns == candidates[0].rows {
            let quarters: Vec<Self> = candidates.iter().map(|g| g.mapped(|c, r, n, _| (n - 1 - r, c))).collect();
            candidates.extend(quarters);
        }
        let far = |grid: &Self| grid.corners[0][0] + grid.corners[0][1];
        let nearest =
            (1..candidates.len()).fold(0, |n, i| if far(&candidates[i]) < far(&candidates[n]) { i } else { n });
        candidates.swap_remove(nearest)
    }

    /// Positive when columns and rows turn as x and y do.
    fn turn(&self) -> f64 {
        let [o, x, y] = [self.at(0, 0), self.at(self.columns - 1, 0), self.at(0, self.rows - 1)];
        (x[0] - o[0]) * (y[1] - o[1]) - (x[1] - o[1]) * (y[0] - o[0])
    }

    /// Relabelled: `from` gives the old column and row for (column, row, columns, rows).
    fn mapped(&self, from: impl Fn(usize, usize, usize, usize) -> (usize, usize)) -> Self {
        let cells = (0..self.rows).flat_map(|row| (0..self.columns).map(move |column| (column, row)));
        let old = |(column, row)| {
            let (column, row) = from(column, row, self.columns, self.rows);
            self.at(column, row)
        };
        Self { columns: self.columns, rows: self.rows, corners: cells.map(old).collect() }
    }
}
