//! Round outlines anywhere in an image: gradient Hough transform (Ballard 1981; votes along the gradient, Kimme 1975).

use crate::numerics::image::Image;

/// A round outline, roughly.
#[derive(Clone, Copy, Debug)]
pub(super) struct Circle {
    /// Centre, pixels.
    pub center: [f64; 2],
    /// Radius, pixels.
    pub radius: f64,
    /// Share of the outline on which edges point at the centre.
    pub covered: f64,
}

/// Longest side of the image that is searched, pixels.
const SIDE: usize = 640;
/// Least radius there, pixels.
const LEAST_RADIUS: f64 = 8.0;
/// Least share of an outline that must be seen.
const LEAST_COVERED: f64 = 0.3;

/// Pixel size of the searched image in pixels of the given one.
pub(super) fn reduction(image: &Image<f32>) -> usize {
    image.width.max(image.height).div_ceil(SIDE).max(1)
}

/// Up to `most` round outlines, the best covered first.
pub(super) fn circles(image: &Image<f32>, most: usize) -> Vec<Circle> {
    let factor = reduction(image);
    let small = reduce(image, factor);
    let mut edges = edges(&small);
    let mut found = Vec::new();
    while found.len() < most {
        let Some(circle) = best(&edges, &small) else { break };
        // Inside a ball are its shading and its highlights.
        edges.retain(|edge| circle.distance(edge) / circle.radius > 0.1);
        let scale = factor as f64;
        let [x, y] = circle.center;
        found.push(Circle { center: [x * scale, y * scale], radius: circle.radius * scale, ..circle });
    }
    found
}

/// Means over squares of `factor` pixels, as logarithms over the noise floor: a dim limb counts like a bright one.
fn reduce(image: &Image<f32>, factor: usize) -> Image<f32> {
    let (width, height) = (image.width / factor, image.height / factor);
    let mut small = Image::filled(width, height, 0.0_f32);
    for y in 0..height {
        for x in 0..width {
            let mut sum = 0.0;
            for row in 0..factor {
                let from = (y * factor + row) * image.width + x * factor;
                sum += image.pixels[from..from + factor].iter().sum::<f32>();
            }
            small.pixels[y * width + x] = sum / (factor * factor) as f32;
        }
    }
    let mut sorted = small.pixels.clone();
    sorted.sort_unstable_by(f32::total_cmp);
    let rank = |part: f64| sorted.get((part * (sorted.len() as f64 - 1.0)) as usize).copied().unwrap_or(0.0);
    let floor = (0.05 * (rank(0.98) - rank(0.02))).max(f32::MIN_POSITIVE);
    let dark = rank(0.02);
    small.pixels.iter_mut().for_each(|p| *p = ((*p - dark).max(0.0) / floor).ln_1p());
    blur(&blur(&small))
}

/// Binomial 3 x 3 blur; the border stays.
fn blur(image: &Image<f32>) -> Image<f32> {
    let mut out = image.clone();
    for y in 1..image.height.saturating_sub(1) {
        for x in 1..image.width.saturating_sub(1) {
            let row = |y: usize| image.at(x - 1, y) + 2.0 * image.at(x, y) + image.at(x + 1, y);
            out.pixels[y * image.width + x] = (row(y - 1) + 2.0 * row(y) + row(y + 1)) / 16.0;
        }
    }
    out
}

struct Edge {
    at: [f64; 2],
    /// Unit gradient.
    normal: [f64; 2],
}

impl Circle {
    fn distance(&self, edge: &Edge) -> f64 {
        (edge.at[0] - self.center[0]).hypot(edge.at[1] - self.center[1]) - self.radius
    }
}

/// Ridges of the gradient that stand out of its noise.
fn edges(image: &Image<f32>) -> Vec<Edge> {
    let gradient = |x: usize, y: usize| {
        [image.at(x + 1, y) - image.at(x - 1, y), image.at(x, y + 1) - image.at(x, y - 1)].map(f64::from)
    };
    let size = |g: [f64; 2]| g[0].hypot(g[1]);
    let (width, height) = (image.width, image.height);
    let (columns, rows) = (2..width.saturating_sub(2), 2..height.saturating_sub(2));
    let all: Vec<f64> =
        rows.clone().flat_map(|y| columns.clone().map(move |x| (x, y))).map(|(x, y)| size(gradient(x, y))).collect();
    let strongest = all.iter().copied().fold(0.0, f64::max);
    let threshold = (5.0 * super::outline::median(all)).min(0.5 * strongest).max(0.02 * strongest).max(1e-9);
    let mut edges = Vec::new();
    for y in rows {
        for x in columns.clone() {
            let g = gradient(x, y);
            let own = size(g);
            if own < threshold {
                continue;
            }
            let normal = [g[0] / own, g[1] / own];
            let beside = |sign: f64| {
                let (u, v) = (x as f64 + sign * normal[0], y as f64 + sign * normal[1]);
                size(gradient(u.round() as usize, v.round() as usize))
            };
            if own >= beside(1.0) && own >= beside(-1.0) {
                edges.push(Edge { at: [x as f64 + 0.5, y as f64 + 0.5], normal });
            }
        }
    }
    edges
}

/// The circle with the best covered outline, if any is covered enough.
fn best(edges: &[Edge], image: &Image<f32>) -> Option<Circle> {
    let largest = 0.5 * image.width.min(image.height) as f64;
    let (width, height) = (image.width, image.height);
    let mut votes = Image::filled(width, height, 0.0_f32);
    for edge in edges {
        for sign in [-1.0, 1.0] {
            let mut radius = LEAST_RADIUS;
            while radius < largest {
                let (x, y) = (edge.at[0] + sign * radius * edge.normal[0], edge.at[1] + sign * radius * edge.normal[1]);
                if x < 0.0 || y < 0.0 || x >= width as f64 || y >= height as f64 {
                    break;
                }
                // A circle's votes grow with its radius: weighted, all count alike.
                votes.pixels[y as usize * width + x as usize] += 1.0 / radius as f32;
                radius += 1.0;
            }
        }
    }
    let votes = blur(&blur(&votes));
    let mut candidates: Vec<usize> = (0..votes.pixels.len()).filter(|&i| is_peak(&votes, i)).collect();
    candidates.sort_by(|a, b| votes.pixels[*b].total_cmp(&votes.pixels[*a]));
    let circles = candidates
        .iter()
        .take(30)
        .filter_map(|&i| circle_about([(i % width) as f64 + 0.5, (i / width) as f64 + 0.5], edges, largest));
    circles.filter(|c| c.covered >= LEAST_COVERED).max_by(|a, b| a.covered.total_cmp(&b.covered))
}

fn is_peak(votes: &Image<f32>, i: usize) -> bool {
    let (x, y) = (i % votes.width, i / votes.width);
    if x < 2 || y < 2 || x + 2 >= votes.width || y + 2 >= votes.height || votes.pixels[i] <= 0.0 {
        return false;
    }
    (0..25).all(|k| *votes.at(x + k % 5 - 2, y + k / 5 - 2) <= votes.pixels[i])
}

/// The radius about a centre at which edges that point at it cover most of the outline; then centre and radius by their
/// mean, twice.
fn circle_about(center: [f64; 2], edges: &[Edge], largest: f64) -> Option<Circle> {
    let mut circle = Circle { center, radius: 0.0, covered: 0.0 };
    for round in 0..3 {
        let radial: Vec<(f64, f64)> = edges.iter().filter_map(|edge| radial(edge, circle.center)).collect();
        if round == 0 {
            let mut histogram = vec![0.0; largest as usize + 3];
            for (distance, _) in &radial {
                if let Some(bin) = histogram.get_mut(*distance as usize) {
                    *bin += 1.0;
                }
            }
            let share = |r: &usize| histogram[*r - 1..=*r + 1].iter().sum::<f64>() / (*r as f64 + 0.5);
            let radius = (LEAST_RADIUS as usize..largest as usize).max_by(|a, b| share(a).total_cmp(&share(b)))?;
            circle.radius = radius as f64 + 0.5;
        }
        // Edges lie farther out on the side to which the centre must move.
        let near: Vec<&(f64, f64)> = radial.iter().filter(|(d, _)| (d - circle.radius).abs() < 2.5).collect();
        let (mut shift, mut total, mut seen) = ([0.0; 2], 0.0, [false; 72]);
        for (distance, angle) in &near {
            shift[0] += (distance - circle.radius) * angle.cos();
            shift[1] += (distance - circle.radius) * angle.sin();
            total += distance - circle.radius;
            seen[((angle / std::f64::consts::TAU + 0.5) * 71.999) as usize] = true;
        }
        let count = near.len().max(1) as f64;
        circle.covered = seen.iter().filter(|s| **s).count() as f64 / 72.0;
        circle.center = [circle.center[0] + 2.0 * shift[0] / count, circle.center[1] + 2.0 * shift[1] / count];
        circle.radius += total / count;
    }
    Some(circle)
}

/// Distance and direction of an edge from a centre, if its gradient points at or away from it within 25 degrees.
fn radial(edge: &Edge, center: [f64; 2]) -> Option<(f64, f64)> {
    let (dx, dy) = (edge.at[0] - center[0], edge.at[1] - center[1]);
    let distance = dx.hypot(dy);
    let along = ((dx * edge.normal[0] + dy * edge.normal[1]) / distance.max(1e-9)).abs();
    (along > 0.906 && distance > 1.0).then(|| (distance, dy.atan2(dx)))
}
