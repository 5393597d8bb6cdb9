//! Values and slopes of every BRDF model against an independent script in another language (tests/oracle/brdf.py).
#![allow(clippy::unwrap_used, missing_docs)]

use rigd::numerics::brdf::{MODELS, by_name};
use rigd::numerics::geometry::{Angles, Vec3};
use serde::Deserialize;

const TOLERANCE: f64 = 1e-9;

#[derive(Deserialize)]
struct Case {
    model: String,
    normal: [f64; 3],
    light: [f64; 3],
    view: [f64; 3],
    beta: f64,
    value: f64,
    slope: f64,
}

#[test]
fn every_model_and_its_slope() {
    let cases: Vec<Case> = serde_json::from_str(include_str!("oracle/brdf.json")).unwrap();
    for model in MODELS {
        assert_eq!(cases.iter().filter(|case| case.model == model.name()).count(), 40, "{}", model.name());
    }
    for (i, case) in cases.iter().enumerate() {
        let angles = Angles::new(&Vec3::from(case.normal), &Vec3::from(case.light), &Vec3::from(case.view));
        let (value, slope) = by_name(&case.model).unwrap().value_and_slope(&angles, case.beta);
        for (what, ours, theirs) in [("value", value, case.value), ("slope", slope, case.slope)] {
            // The slope passes through zero where the lobe is broadest; there its terms are as large as the value.
            let size = theirs.abs().max(case.value).max(1e-200);
            let apart = (ours - theirs).abs() / size;
            assert!(apart <= TOLERANCE, "case {i}, {} {what}: {ours} here, {theirs} there", case.model);
        }
    }
}
