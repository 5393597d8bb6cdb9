//! Weight maps and the residual map as pictures.

use super::ReportError;
use super::sources::Fitted;
use super::words::percent;
use crate::document::drawing::{Anchor, Shape, Tone};
use crate::document::{Block, Drawing, Picture};
use crate::numerics::image::Image;
use crate::store::exr::Planes;
use crate::store::files::shown;
use crate::store::png;

/// Longest side of a picture, pixels.
const LONGEST: usize = 420;
/// Part of the residuals that the scale ends at: a few stray points would darken all others.
const MOST: f64 = 0.98;
/// Colours of a scale from low to high (viridis: even steps to the eye, also without colour vision).
const SCALE: [[f64; 3]; 5] =
    [[68.0, 1.0, 84.0], [59.0, 82.0, 139.0], [33.0, 145.0, 140.0], [94.0, 201.0, 98.0], [253.0, 231.0, 37.0]];
/// Where there is no value.
const NOTHING: [u8; 3] = [128; 3];

pub fn section(fitted: &Fitted) -> Result<Vec<Block>, ReportError> {
    let mut blocks = vec![Block::Section("Maps".into())];
    let Some(part) = Part::of(&fitted.weights) else {
        blocks.push(Block::text("No point of the object has a weight: there is nothing to show."));
        return Ok(blocks);
    };
    for (index, map) in fitted.weights.iter().enumerate() {
        let value = |x: usize, y: usize| Some(f64::from(*map.at(x, y))).filter(|_| any(&fitted.weights, x, y));
        blocks.push(part.picture(
            value,
            1.0,
            format!(
                "Weight of material {} over the object, from 0 (dark) to 1 (bright); grey: not measured.",
                index + 1
            ),
            fitted,
            scale("weight", |part| format!("{part:.2}")),
        )?);
    }
    match &fitted.residual {
        Some(residual) => blocks.push(residuals(&part, residual, fitted)?),
        None => {
            blocks.push(Block::text("residual.exr is missing, so there is no map of the errors: fit again to have it."))
        }
    }
    Ok(blocks)
}

fn residuals(part: &Part, residual: &Planes, fitted: &Fitted) -> Result<Block, ReportError> {
    let (width, count) = (residual.size.0, residual.channels.len().max(1) as f64);
    let value = |x: usize, y: usize| {
        let (column, row) = (x.checked_sub(residual.origin.0)?, y.checked_sub(residual.origin.1)?);
        let inside = column < width && row < residual.size.1 && any(&fitted.weights, x, y);
        let index = row * width + column;
        inside.then(|| residual.channels.iter().map(|(_, pixels)| f64::from(pixels[index])).sum::<f64>() / count)
    };
    let high = part.high(value);
    let caption = "Mean error of every point over its lights. Even is good; edges or patches that stand out are where geometry, shadow or model fail.";
    let scale = scale("mean relative error", |part| percent(high * part));
    part.picture(value, high, caption.into(), fitted, scale)
}

fn any(weights: &[Image<f32>], x: usize, y: usize) -> bool {
    weights.iter().any(|map| *map.at(x, y) > 0.0)
}

/// The part of the frame that has values, and how many of its pixels make one of a picture.
struct Part {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
    step: usize,
}

impl Part {
    fn of(weights: &[Image<f32>]) -> Option<Self> {
        let first = weights.first()?;
        let (mut low, mut high) = ([usize::MAX; 2], [0, 0]);
        for (x, y) in (0..first.height).flat_map(|y| (0..first.width).map(move |x| (x, y))) {
            if any(weights, x, y) {
                low = [low[0].min(x), low[1].min(y)];
                high = [high[0].max(x), high[1].max(y)];
            }
        }
        let [width, height] = [high[0].checked_sub(low[0])? + 1, high[1].checked_sub(low[1])? + 1];
        Some(Self { x: low[0], y: low[1], width, height, step: width.max(height).div_ceil(LONGEST) })
    }

    /// Value below which most pixels lie.
    fn high(&self, value: impl Fn(usize, usize) -> Option<f64>) -> f64 {
        let all = (0..self.height).flat_map(|y| (0..self.width).map(move |x| (x, y)));
        let mut values: Vec<f64> =
            all.filter_map(|(x, y)| value(self.x + x, self.y + y)).filter(|v| v.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let index = (MOST * values.len() as f64) as usize;
        values.get(index.min(values.len().saturating_sub(1))).copied().filter(|v| *v > 0.0).unwrap_or(1.0)
    }

    /// Means of squares of pixels, as colours; `high` is the end of the scale.
    fn picture(
        &self,
        value: impl Fn(usize, usize) -> Option<f64>,
        high: f64,
        caption: String,
        fitted: &Fitted,
        scale: Drawing,
    ) -> Result<Block, ReportError> {
        let [width, height] = [self.width, self.height].map(|side| side.div_ceil(self.step));
        let mut picture = Image::filled(width, height, NOTHING);
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let square =
                (0..self.step * self.step).map(|i| (self.step * x + i % self.step, self.step * y + i / self.step));
            let inside = square.filter(|(x, y)| *x < self.width && *y < self.height);
            let (mut sum, mut count) = (0.0, 0.0);
            for value in inside.filter_map(|(x, y)| value(self.x + x, self.y + y)).filter(|v| v.is_finite()) {
                (sum, count) = (sum + value, count + 1.0);
            }
            if count > 0.0 {
                picture.pixels[y * width + x] = colour(sum / count / high);
            }
        }
        let png = png::encode(&picture).map_err(|reason| ReportError::Damaged {
            path: shown(&fitted.directory),
            reason: format!("no picture can be made of its maps: {reason}"),
        })?;
        let alternative = caption.clone();
        let size = [width as u32, height as u32];
        Ok(Block::Picture(Picture { caption, alternative, size, png, scale: Some(scale) }))
    }
}

/// Colour of a part of the scale, 0 to 1.
fn colour(part: f64) -> [u8; 3] {
    let place = part.clamp(0.0, 1.0) * (SCALE.len() - 1) as f64;
    let below = (place as usize).min(SCALE.len() - 2);
    let t = place - below as f64;
    std::array::from_fn(|c| (SCALE[below][c] + t * (SCALE[below + 1][c] - SCALE[below][c])).round() as u8)
}

/// The scale of a picture, with its numbers.
fn scale(what: &str, number: impl Fn(f64) -> String) -> Drawing {
    const STEPS: usize = 64;
    let (left, width, bottom) = (24.0, 360.0, 22.0);
    let mut drawing = Drawing {
        caption: format!("Scale: {what}."),
        alternative: format!("Colours of the {what} from {} to {}", number(0.0), number(1.0)),
        size: [640.0, 44.0],
        shapes: Vec::new(),
    };
    for step in 0..STEPS {
        let [from, to] = [step, step + 1].map(|i| left + width * i as f64 / STEPS as f64);
        let tone = Tone::Exactly(colour((step as f64 + 0.5) / STEPS as f64));
        let points = vec![[from, 4.0], [to, 4.0], [to, bottom], [from, bottom]];
        drawing.shapes.push(Shape::Area { points, tone });
    }
    for part in [0.0, 0.25, 0.5, 0.75, 1.0] {
        drawing.text([left + width * part, bottom + 15.0], number(part), Tone::Ink, Anchor::Middle);
    }
    drawing
}
