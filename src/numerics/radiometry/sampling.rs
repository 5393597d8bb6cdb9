//! Which pixels a response is solved from: all levels covered, away from edges, the same choice every time.

use super::bracket::Bracket;

/// Candidates looked at, at most: enough to fill the quota of every level from any frame size.
const MAX_CANDIDATES: usize = 60_000;
/// Samples wanted of every level and channel.
const QUOTA: u16 = 120;

/// Indices of the pixels chosen from `bracket`, flattest neighbourhood first, until every level that occurs has its quota.
pub fn choose_pixels(bracket: &Bracket) -> Vec<usize> {
    let mut seen = vec![[0_u16; 256]; 3];
    candidates(bracket)
        .into_iter()
        .filter(|&pixel| {
            let mut wanted = false;
            for frame in bracket.exposures() {
                for (count, &level) in seen.iter().zip(&frame.levels.pixels[pixel]) {
                    wanted |= (1..255).contains(&level) && count[usize::from(level)] < QUOTA;
                }
            }
            if wanted {
                for frame in bracket.exposures() {
                    for (count, &level) in seen.iter_mut().zip(&frame.levels.pixels[pixel]) {
                        count[usize::from(level)] = count[usize::from(level)].saturating_add(1);
                    }
                }
            }
            wanted
        })
        .collect()
}

/// A regular grid of inner pixels, flattest first, ties in reading order.
fn candidates(bracket: &Bracket) -> Vec<usize> {
    let (width, height) = (bracket.width(), bracket.height());
    let step = ((width * height / MAX_CANDIDATES) as f64).sqrt().ceil().max(1.0) as usize;
    let inner = |size: usize| (1..size.saturating_sub(1)).step_by(step);
    let mut found: Vec<(u8, usize)> = inner(height)
        .flat_map(|y| inner(width).map(move |x| y * width + x))
        .map(|pixel| (edge(bracket, pixel), pixel))
        .collect();
    found.sort_unstable();
    found.into_iter().map(|(_, pixel)| pixel).collect()
}

/// The greatest step of green to one of the four neighbours, over all frames, levels.
fn edge(bracket: &Bracket, pixel: usize) -> u8 {
    let width = bracket.width();
    let neighbours = [pixel - width, pixel - 1, pixel + 1, pixel + width];
    bracket
        .exposures()
        .iter()
        .flat_map(|frame| {
            let green = |at: usize| frame.levels.pixels[at][1];
            neighbours.map(|at| green(at).abs_diff(green(pixel)))
        })
        .max()
        .unwrap_or(0)
}
