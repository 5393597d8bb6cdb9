//! What an export says of itself: README.txt for people, loss.json for programs.

use super::loss::{Loss, SCENE};
use super::{Captured, Format, Words};
use serde_json::json;

/// loss.json.
pub(super) fn loss_json(format: &Format, loss: Option<&Loss>, words: &Words) -> String {
    let told = json!({
        "format": format.name,
        "same_numbers": loss.is_none(),
        "mean_relative_difference": loss.map_or(0.0, |loss| loss.mean),
        "highlight_relative_difference": loss.map_or(Some(0.0), |loss| loss.highlight),
        "scene": SCENE,
        "loses": words.loses,
    });
    format!("{told:#}\n")
}

/// The measured loss as a sentence.
pub fn sentence(loss: Option<&Loss>) -> String {
    let Some(loss) = loss else {
        return "Nothing is lost: the numbers are those of the result, bit by bit.".to_owned();
    };
    let highlight = match loss.highlight {
        Some(part) => format!(", in highlights {}", percent(part)),
        None => String::new(),
    };
    format!("Measured: radiance differs from rigd's own by {} in the mean{highlight}.", percent(loss.mean))
}

/// A part as per cent, three digits; what is rounding alone is said to be less than a ten-thousandth.
fn percent(part: f64) -> String {
    match 100.0 * part {
        p if p < 1e-4 => "less than 0.0001 %".to_owned(),
        p if p < 1.0 => format!("{p:.4} %"),
        p => format!("{p:.2} %"),
    }
}

/// Text of unknown origin as a comment of a scene may hold it: one line, without what would end the comment.
pub(super) fn comment(text: &str) -> String {
    text.chars().filter(|c| !c.is_control() && !"<>&-".contains(*c)).collect()
}

/// README.txt.
pub(super) fn readme(captured: &Captured, format: &Format, loss: Option<&Loss>, words: &Words) -> String {
    let Captured { description, patch, .. } = captured;
    let head = format!(
        "A captured material, exported by {} as {} ({})\n\n{} materials of the BRDF model {}. The texture is a seamless square of {} x {} weights, cut at column {}, row {} of weights.exr.\n",
        description.provenance.software,
        format.name,
        format.about,
        description.materials.len(),
        description.model,
        captured.side(),
        captured.side(),
        patch.x,
        patch.y,
    );
    let mut words = words.clone();
    words.loses.push(sentence(loss));
    if loss.is_some() {
        words.loses.push(format!("Measured on {SCENE}."));
    }
    readme_of(&head, &words)
}

/// README.txt with this head.
pub fn readme_of(head: &str, words: &Words) -> String {
    let mut text = head.to_owned();
    for (title, lines) in
        [("What the files carry", &words.carries), ("What is lost", &words.loses), ("How to open it", &words.open)]
    {
        text += &format!("\n{title}\n");
        lines.iter().for_each(|line| text += &format!("- {line}\n"));
    }
    text
}
