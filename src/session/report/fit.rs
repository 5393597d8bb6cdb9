//! How well the material explains the measurements, light by light, and how long that took.

use super::sources::Fitted;
use super::summary::PAPERS_ERRORS;
use super::words::{duration, or, percent, shorten};
use crate::document::plot::{Axis, Plot, Series, Style};
use crate::document::{Block, Table};
use crate::pipeline::report::{LightReport, Report};

/// What the paper's fit took (Zheng, Ma, Zeng 2008, section 4): Matlab on an Athlon 3000+, seconds.
const PAPERS_SECONDS: f64 = 2700.0;

pub fn section(fitted: &Fitted) -> Vec<Block> {
    let report = &fitted.report;
    let mut blocks = vec![Block::Section("The fit".into()), Block::Table(errors(report))];
    blocks.extend(lights(report));
    blocks.extend([Block::Heading("Speed and accuracy".into()), speed_and_accuracy(report)]);
    blocks.push(Block::Table(how(report)));
    if !report.candidates.is_empty() {
        blocks.push(Block::Table(candidates(report)));
    }
    if !report.notes.is_empty() {
        blocks.extend([Block::Heading("Notes of the solver".into()), Block::List(report.notes.clone())]);
    }
    blocks
}

fn errors(report: &Report) -> Table {
    let mut table = Table::new("Errors: mean of |measured - model| / measured", ["On", "Error", "What it tells"]);
    let mut row = |on: &str, error: String, tells: &str| table.row([on.to_owned(), error, tells.to_owned()]);
    row(
        "all samples",
        percent(report.mean_relative_error),
        "how well the model explains what was measured; noise is in it",
    );
    let none = "none: no highlight was sampled";
    row(
        "highlights (half angle below 6 degrees)",
        or(report.highlight_relative_error.map(percent), none),
        "whether gloss is right",
    );
    let none = "none: no light was left out";
    row(
        "left-out lights",
        or(report.left_out_relative_error.map(percent), none),
        "how well it relights under lights that were not used",
    );
    let none = if report.left_out_relative_error.is_some() { "none: they have no highlight" } else { none };
    row("their highlights", or(report.left_out_highlight_relative_error.map(percent), none), "the same for gloss");
    row(
        "chi\u{b2} a degree of freedom",
        format!("{:.3}", report.reduced_chi2),
        "about 1 where noise and a model floor of 2 % explain all; far above: the model does not fit",
    );
    table
}

fn lights(report: &Report) -> Vec<Block> {
    let head = Block::Heading("Light by light".into());
    if report.lights.is_empty() {
        return vec![
            head,
            Block::text("This result was made by a version that kept no error for each light: fit again to have them."),
        ];
    }
    let mut table = Table::new("Error of each light", ["Light", "Image", "Used", "Samples", "Error"]);
    for (index, light) in report.lights.iter().enumerate() {
        let used = if light.left_out { "left out, predicted" } else { "fitted" };
        let error = or(light.mean_relative_error.map(percent), "none: it lights no sample");
        table.row([index.to_string(), light.image.clone(), used.into(), light.samples.to_string(), error]);
    }
    shorten(&mut table, "report.json");
    vec![head, by_light(&report.lights), Block::Table(table)]
}

fn by_light(lights: &[LightReport]) -> Block {
    let of = |left_out: bool| -> Vec<[f64; 3]> {
        let here = lights.iter().enumerate().filter(|(_, light)| light.left_out == left_out);
        here.filter_map(|(index, light)| Some([index as f64, 100.0 * light.mean_relative_error?, 0.0])).collect()
    };
    let series = [("fitted", 0, Style::Discs, of(false)), ("left out", 1, Style::Rings, of(true))];
    let named = |(name, colour, style, points): (&str, usize, Style, Vec<[f64; 3]>)| Series {
        name: Some(name.into()),
        colour,
        style,
        points,
    };
    Block::Drawing(
        Plot {
            caption: "Error of each light. One that stands out may have been elsewhere, or of another strength, than the dataset says; one that grazes the object has few, dim samples and is worse anyway.".into(),
            alternative: "Mean relative error against the number of the light, fitted lights as discs, left-out ones as rings".into(),
            x: Axis::named("light", (0..lights.len()).map(|i| i.to_string()).collect()),
            y: Axis::linear("mean relative error, %", &[0.0]),
            series: series.into_iter().filter(|(_, _, _, points)| !points.is_empty()).map(named).collect(),
        }
        .drawn(),
    )
}

fn speed_and_accuracy(report: &Report) -> Block {
    let point = |name: &str, colour, style, seconds: f64, error: f64| Series {
        name: Some(name.to_owned()),
        colour,
        style,
        points: vec![[seconds, 100.0 * error, 0.0]],
    };
    let mut series: Vec<Series> = PAPERS_ERRORS
        .iter()
        .zip([4, 5])
        .map(|((name, error), colour)| {
            point(&format!("the paper's {name}"), colour, Style::Rings, PAPERS_SECONDS, *error)
        })
        .collect();
    series.push(point("this fit", 0, Style::Discs, report.cpu_seconds, report.mean_relative_error));
    Block::Drawing(
        Plot {
            caption: "Time and error of this fit beside those that the method's paper reports for its own balls, on a computer of 2008. Lower left is better.".into(),
            alternative: format!(
                "This fit took {} of processor time and has an error of {}; the paper's took 45 minutes and have 5.89 and 4.34 %",
                duration(report.cpu_seconds),
                percent(report.mean_relative_error)
            ),
            x: Axis::logarithmic("processor time, s"),
            y: Axis::logarithmic("mean relative error, %"),
            series,
        }
        .drawn(),
    )
}

fn how(report: &Report) -> Table {
    let mut table = Table::new("How it was fitted", ["What", "Value"]);
    let seconds = &report.seconds;
    let gains =
        report.light_gains.as_ref().map(|gains| gains.iter().map(|g| format!("{g:.4}")).collect::<Vec<_>>().join(", "));
    for (what, value) in [
        ("Model, lobe", format!("{}, {}", report.model, report.lobe)),
        ("Solver, weights, objective", format!("{}, {}, {}", report.solver, report.weights, report.objective)),
        ("Ended", format!("{} after {} iterations, cost {:.6e}", report.termination, report.iterations, report.cost)),
        ("Points, samples", format!("{}, {}", report.pixels, report.samples)),
        ("Samples that could not be used", report.unusable_samples.to_string()),
        ("Least cosine of incidence and reflection", report.cosine_cutoff.to_string()),
        ("Gains of the lights", or(gains, "none fitted")),
        (
            "Time",
            format!(
                "loading {}, sampling {}, choosing {}, fitting {}; {} of processor time",
                duration(seconds.load),
                duration(seconds.observe),
                duration(seconds.initialise),
                duration(seconds.fit),
                duration(report.cpu_seconds)
            ),
        ),
    ] {
        table.row([what.into(), value]);
    }
    table
}

fn candidates(report: &Report) -> Table {
    let mut table = Table::new(
        "What was tried, and what lights left out in turn said of it",
        ["Materials, model, lobe", "Left-out error", "Taken", "Why"],
    );
    for one in &report.candidates {
        let gains = if one.light_gains { ", light gains" } else { "" };
        table.row([
            format!("{}, {}, {}{gains}", one.materials, one.model, one.lobe),
            or(one.left_out_relative_error.map(percent), "no light can be left out"),
            if one.taken { "yes".into() } else { "no".into() },
            one.reason.clone(),
        ]);
    }
    shorten(&mut table, "report.json");
    table
}
