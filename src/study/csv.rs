//! Tables as comma-separated values (RFC 4180).

use std::path::Path;

/// Writes a table: a line of column names, then the rows.
///
/// # Errors
/// The file cannot be written.
pub fn write(path: &Path, columns: &[&str], rows: &[Vec<String>]) -> std::io::Result<()> {
    let names: Vec<String> = columns.iter().map(|&name| name.to_owned()).collect();
    let text: String = std::iter::once(&names).chain(rows).map(|fields| line(fields)).collect();
    std::fs::write(path, text)
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
