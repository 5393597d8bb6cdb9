//! What frames that are no bracket look like: one picture twice, nothing exposed, two files exchanged, 1/seconds for seconds.

use super::bracket::{BracketError, Exposure};

/// Green below this level is black, from that on clipped.
const BLACK: u8 = 4;
const CLIPPED: u8 = 252;
/// Share of the pixels that has to be exposed somewhere.
const EXPOSED: f64 = 0.001;

/// Refuses two frames with the same pixels, unless they are black or clipped all over.
pub fn check_different(exposures: &[Exposure]) -> Result<(), BracketError> {
    for (i, a) in exposures.iter().enumerate() {
        let flat = || a.levels.pixels.windows(2).all(|pair| pair[0] == pair[1]);
        if let Some(b) = exposures[i + 1..].iter().find(|b| a.time_s != b.time_s && a.levels == b.levels)
            && !flat()
        {
            return Err(BracketError::SamePicture { a: a.name.clone(), b: b.name.clone() });
        }
    }
    Ok(())
}

/// Refuses frames that are all black or all clipped.
pub fn check_exposed(exposures: &[Exposure]) -> Result<(), BracketError> {
    let (Some(shortest), Some(longest)) = (exposures.first(), exposures.last()) else { return Ok(()) };
    let brightest = green_at(longest, 1.0 - EXPOSED);
    if exposures.iter().all(|frame| green_at(frame, 1.0 - EXPOSED) < BLACK) {
        return Err(BracketError::NothingExposed {
            what: "black",
            frame: longest.name.clone(),
            level: brightest,
            remedy: "switch the lamp on, take the lens cap off, or expose longer",
        });
    }
    if exposures.iter().all(|frame| green_at(frame, EXPOSED) >= CLIPPED) {
        return Err(BracketError::NothingExposed {
            what: "clipped",
            frame: shortest.name.clone(),
            level: green_at(shortest, EXPOSED),
            remedy: "expose shorter, or dim the lamp",
        });
    }
    Ok(())
}

/// The green level of the darkest thousandth of a frame's pixels.
pub fn darkest_green(frame: &Exposure) -> u8 {
    green_at(frame, EXPOSED)
}

/// The green level below which `share` of the pixels lies.
fn green_at(frame: &Exposure, share: f64) -> u8 {
    let mut counts = [0_usize; 256];
    frame.levels.pixels.iter().for_each(|pixel| counts[usize::from(pixel[1])] += 1);
    let wanted = (share * frame.levels.pixels.len() as f64) as usize;
    let mut below = 0;
    let at = counts.iter().position(|count| {
        below += count;
        below > wanted
    });
    at.map_or(u8::MAX, |level| level as u8)
}

/// What the mean brightness of frames in the order of their times suggests.
pub fn remedy(exposures: &[Exposure]) -> String {
    let green = |frame: &Exposure| {
        frame.levels.pixels.iter().map(|pixel| f64::from(pixel[1])).sum::<f64>() / frame.levels.pixels.len() as f64
    };
    let means: Vec<f64> = exposures.iter().map(green).collect();
    let n = means.len();
    if n >= 3 && means.is_sorted_by(|a, b| a > b) {
        return "brightness falls as the listed time rises: the list seems to hold 1/seconds; give seconds".into();
    }
    for i in 0..n {
        for j in i + 1..n {
            let mut exchanged = means.clone();
            exchanged.swap(i, j);
            if exchanged.is_sorted_by(|a, b| a < b) {
                let (a, b) = (&exposures[i].name, &exposures[j].name);
                return format!("{a} and {b} seem to be exchanged: exchange their times or leave them out");
            }
        }
    }
    "correct the times or leave these frames out".into()
}
