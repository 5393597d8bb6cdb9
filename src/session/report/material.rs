//! The parameters with their errors, and how well the data determine each.

use super::sources::Fitted;
use super::words::{CHANNELS, percent, plus_minus};
use crate::document::plot::{Axis, Plot, Series, Style};
use crate::document::{Block, Table};
use crate::pipeline::report::{Identified, MaterialFile, MaterialReport, Parameter};

pub fn section(fitted: &Fitted) -> Vec<Block> {
    let material = &fitted.material;
    let mut blocks = vec![
        Block::Section("The material".into()),
        Block::text(
            "Diffuse albedo is the colour of the matt part, specular albedo the strength of the highlight, roughness its width. Standard errors are \
             statistical: what calibration and model are off by comes on top, and left-out lights show it.",
        ),
        chart(material),
    ];
    blocks.extend(material.materials.iter().enumerate().map(|(index, one)| Block::Table(table(index, one))));
    blocks.push(Block::text(format!("What was pinned to make them unique: {}.", material.gauge)));
    blocks
}

/// Parameters in the order of the chart and the tables.
fn named(material: &MaterialReport) -> Vec<(String, &Parameter)> {
    let channels = |name: &'static str, list: &'static [&'static str; 3]| {
        move |i: usize| format!("{name} {}", list.get(i).unwrap_or(&"?"))
    };
    let (diffuse, specular) = (channels("diffuse", &CHANNELS), channels("specular", &CHANNELS));
    let all = material.rho_d.iter().enumerate().map(|(i, p)| (diffuse(i), p));
    let all = all.chain(material.rho_s.iter().enumerate().map(|(i, p)| (specular(i), p)));
    all.chain(material.beta.iter().map(|p| ("roughness".to_owned(), p))).collect()
}

fn chart(material: &MaterialFile) -> Block {
    let names = material.materials.first().map(named).unwrap_or_default();
    let shortened = |name: &str| name.replace("diffuse", "diff.").replace("specular", "spec.");
    let names: Vec<String> = names.into_iter().map(|(name, _)| shortened(&name)).collect();
    let count = material.materials.len();
    let of = |index: usize, flag: Identified| -> Vec<[f64; 3]> {
        let aside = 0.5 * ((index as f64 + 1.0) / (count as f64 + 1.0) - 0.5);
        let all = named(&material.materials[index]);
        let here = all.iter().enumerate().filter(|(_, (_, parameter))| parameter.identified == flag);
        here.map(|(i, (_, p))| [i as f64 + aside, p.value, p.standard_error.unwrap_or(0.0)]).collect()
    };
    let series = (0..count).flat_map(|index| {
        let sound = Series {
            name: Some(format!("material {}", index + 1)),
            colour: index,
            style: Style::Discs,
            points: of(index, Identified::Identified),
        };
        let weak = Series { name: None, style: Style::Rings, points: of(index, Identified::Weak), ..sound.clone() };
        [sound, weak]
    });
    Block::Drawing(
        Plot {
            caption: "Parameters with their standard errors. Rings are determined weakly; what the data do not determine is not shown.".into(),
            alternative: "Values of the parameters with error bars, as in the tables below".into(),
            x: Axis::named("", names),
            y: Axis::linear("value", &[0.0]),
            series: series.collect(),
        }
        .drawn(),
    )
}

fn table(index: usize, material: &MaterialReport) -> Table {
    let caption = format!("Material {}: {} of the object", index + 1, percent(material.share));
    let mut table =
        Table::new(&caption, ["Parameter", "Value \u{b1} standard error", "Determined by the data", "Why not"]);
    for (name, parameter) in named(material) {
        let (value, flag) = match parameter.identified {
            // Its value only completes the model: shown, it would pass for a measurement.
            Identified::Unidentified => ("not determined".into(), "no"),
            flag => {
                let value = match parameter.standard_error {
                    Some(error) => plus_minus(parameter.value, error),
                    None => format!("{:.4} (held)", parameter.value),
                };
                (value, if flag == Identified::Weak { "weakly" } else { "yes" })
            }
        };
        table.row([name, value, flag.into(), parameter.reason.clone().unwrap_or_default()]);
    }
    table
}
