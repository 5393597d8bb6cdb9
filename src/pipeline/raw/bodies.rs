//! Sensor facts by body, as data: `bodies.toml`.

use serde::Deserialize;
use std::sync::LazyLock;

/// What is known of a body's sensor.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// Model as the EXIF of its files says.
    pub model: String,
    /// Column of the first lit photosite, which is red.
    pub left: usize,
    /// Row of the first lit photosite.
    pub top: usize,
    /// Lit columns, at most.
    pub width: usize,
    /// Lit rows, at most.
    pub height: usize,
    /// First masked column and the one after the last.
    pub masked_columns: (usize, usize),
    /// First masked row and the one after the last.
    pub masked_rows: (usize, usize),
    /// Bits of a count.
    pub bits: u32,
    /// What the geometry rests on.
    pub geometry_basis: Basis,
    /// Where it was found.
    pub geometry_source: String,
    /// Count at which a photosite saturates.
    pub white: Fact,
    /// Charge at that count at ISO 100, electrons.
    pub full_well_e: Fact,
    /// Read noise by ISO speed, ascending, electrons rms.
    pub read_noise_e: Vec<AtIso>,
}

/// A figure, and what it rests on.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fact {
    /// The figure.
    pub value: f64,
    /// What it rests on.
    pub basis: Basis,
    /// Where it was found.
    pub source: String,
}

/// A figure at an ISO speed.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AtIso {
    /// ISO speed.
    pub iso: u32,
    /// The figure.
    pub value: f64,
    /// What it rests on.
    pub basis: Basis,
    /// Where it was found.
    pub source: String,
}

/// What a figure rests on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Basis {
    /// Measured by us on a body.
    Measured,
    /// Read in the source.
    Published,
    /// Neither.
    Guessed,
}

impl std::fmt::Display for Basis {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Measured => "measured",
            Self::Published => "published",
            Self::Guessed => "guessed",
        })
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    body: Vec<Body>,
}

/// Read once; a test reads it as well, so that it is never found broken in the field.
static BODIES: LazyLock<Vec<Body>> = LazyLock::new(|| {
    toml::from_str(include_str!("bodies.toml")).map_or_else(|_| Vec::new(), |table: Table| table.body)
});

/// Every body known.
pub fn bodies() -> &'static [Body] {
    &BODIES
}

impl Body {
    /// The body of that model, if it is known.
    pub fn of(model: &str) -> Option<&'static Self> {
        bodies().iter().find(|body| body.model == model)
    }

    /// Charge at saturation at an ISO speed, electrons.
    pub fn full_well_at(&self, iso: u32) -> f64 {
        self.full_well_e.value * 100.0 / f64::from(iso)
    }

    /// Expected read noise at an ISO speed, electrons: the figure of the nearest speed known.
    pub fn read_noise_at(&self, iso: u32) -> Option<&AtIso> {
        let stops = |at: &&AtIso| (f64::from(at.iso) / f64::from(iso)).log2().abs();
        self.read_noise_e.iter().min_by(|a, b| stops(a).total_cmp(&stops(b)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_read_and_every_entry_makes_sense() {
        assert!(!bodies().is_empty(), "bodies.toml cannot be read");
        for body in bodies() {
            assert!(body.left % 2 == 0 && body.top % 2 == 0, "{}: red must be at the top left", body.model);
            assert!(body.masked_columns.1 <= body.left && body.masked_rows.1 <= body.top, "{}", body.model);
            assert!(body.white.value < f64::from(1 << body.bits), "{}", body.model);
            assert!(!body.read_noise_e.is_empty() && body.full_well_e.value > 0.0, "{}", body.model);
        }
    }
}
