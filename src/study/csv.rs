//! Tables as comma-separated values (RFC 4180), and for programs.

use serde_json::{Map, Value};
use std::path::Path;

/// What a study measured, a row a case.
pub struct Table {
    /// Names of the columns.
    pub columns: &'static [&'static str],
    /// As many fields each; empty where there is nothing.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// Writes it: a line of column names, then the rows.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path) -> std::io::Result<()> {
        let names: Vec<String> = self.columns.iter().map(|&name| name.to_owned()).collect();
        let text: String = std::iter::once(&names).chain(&self.rows).map(|fields| line(fields)).collect();
        std::fs::write(path, text)
    }

    /// An object a row, by column: numbers, truths and words as such, null where there is nothing (or infinity, which JSON has not).
    pub fn records(&self) -> Vec<Map<String, Value>> {
        let record = |row: &Vec<String>| {
            self.columns.iter().zip(row).map(|(&name, field)| (name.to_owned(), value(field))).collect()
        };
        self.rows.iter().map(record).collect()
    }
}

fn value(field: &str) -> Value {
    let number = || match field.parse::<f64>() {
        Ok(number) if number.is_finite() => Value::from(number),
        Ok(_) => Value::Null,
        Err(_) => Value::from(field),
    };
    match field {
        "" => Value::Null,
        "true" | "false" => Value::from(field == "true"),
        _ => field.parse::<u64>().map_or_else(|_| number(), Value::from),
    }
}

fn line(fields: &[String]) -> String {
    let quoted: Vec<String> = fields.iter().map(|field| quote(field)).collect();
    quoted.join(",") + "\n"
}

fn quote(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}

/// A number that reads back as the same number; empty where there is none.
pub fn number(value: Option<f64>) -> String {
    value.map_or(String::new(), |value| value.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn records_hold_numbers_truths_words_and_nothing() {
        let row = ["marble, 2", "7", "-0.25", "1e-9", "inf", "", "true"].map(str::to_owned).to_vec();
        let table = Table { columns: &["name", "n", "x", "small", "far", "none", "circle"], rows: vec![row] };
        let expected = json!([{
            "name": "marble, 2", "n": 7, "x": -0.25, "small": 1e-9, "far": null, "none": null, "circle": true,
        }]);
        assert_eq!(json!(table.records()), expected);
    }
}
