//! Studies: how fast, how accurate and how stable the solvers are, on scenes of known truth and on photographs.

pub mod accuracy;
pub mod bench;
pub mod chart;
pub mod clock;
pub mod csv;
pub mod forward;
pub mod lights;
pub mod merge;
pub mod method;
pub mod relit;
pub mod scene;
pub mod score;
pub mod speed;
pub mod stability;

/// The median; infinite values count as large ones, an even count takes the mean of the middle two.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => f64::NAN,
        count if count % 2 == 1 => values[middle],
        _ if values[middle].is_infinite() => values[middle],
        _ => 0.5 * (values[middle - 1] + values[middle]),
    }
}
