//! The file against its schema: unknown keys, wrong types, missing keys, values out of bounds; every one of them.

use crate::read::Reason;
use serde_json::Value as Json;
use toml::Value;

/// Appends to `reasons` everything in `value` that `schema` (no `$ref`) forbids; `path` is where `value` stands.
pub(crate) fn check(value: &Value, schema: &Json, path: &str, reasons: &mut Vec<Reason>) {
    let mut refuse = |what: String| reasons.push(Reason { key: path.to_owned(), what });
    match (kind(schema), value) {
        ("object", Value::Table(table)) => check_table(table, schema, path, reasons),
        ("array", Value::Array(items)) => check_array(items, schema, path, reasons),
        ("number", Value::Float(x)) => check_number(*x, schema, &mut refuse),
        ("number", Value::Integer(i)) => check_number(*i as f64, schema, &mut refuse),
        ("integer", Value::Integer(i)) => check_number(*i as f64, schema, &mut refuse),
        ("boolean", Value::Boolean(_)) => {}
        ("string", Value::String(text)) => check_text(text, schema, &mut refuse),
        (wanted, other) => refuse(format!("is {}: write {}", shown(other), article(wanted))),
    }
}

/// The type a schema asks for; optional values have `null` beside it, which TOML cannot say.
fn kind(schema: &Json) -> &str {
    let one = |t: &Json| t.as_str().filter(|t| *t != "null").is_some();
    match &schema["type"] {
        Json::Array(types) => types.iter().find(|t| one(t)).and_then(Json::as_str).unwrap_or_default(),
        Json::String(one) => one,
        _ => schema["anyOf"].as_array().into_iter().flatten().map(kind).find(|k| *k != "null").unwrap_or_default(),
    }
}

/// The schema that holds the details: an optional table is `anyOf [table, null]`.
fn details(schema: &Json) -> &Json {
    schema["anyOf"].as_array().into_iter().flatten().find(|s| s["type"] == "object").unwrap_or(schema)
}

fn check_table(table: &toml::Table, schema: &Json, path: &str, reasons: &mut Vec<Reason>) {
    let schema = details(schema);
    let Some(properties) = schema["properties"].as_object() else { return };
    let at = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    for (key, value) in table {
        match properties.get(key) {
            Some(inner) => check(value, inner, &at(key), reasons),
            None => {
                let what = match nearest(key, properties.keys().map(String::as_str)) {
                    Some(near) => format!("unknown key: did you mean `{near}`?"),
                    None => {
                        format!("unknown key: remove it (known here: {})", keys(properties.keys().map(String::as_str)))
                    }
                };
                reasons.push(Reason { key: at(&key.escape_debug().take(80).collect::<String>()), what });
            }
        }
    }
    for key in schema["required"].as_array().into_iter().flatten().filter_map(Json::as_str) {
        if !table.contains_key(key) {
            let meaning = properties[key]["description"].as_str().unwrap_or("a table");
            reasons.push(Reason { key: at(key), what: format!("missing: add it ({meaning})") });
        }
    }
}

fn check_array(items: &[Value], schema: &Json, path: &str, reasons: &mut Vec<Reason>) {
    let (least, most) = (schema["minItems"].as_u64().unwrap_or(0), schema["maxItems"].as_u64().unwrap_or(u64::MAX));
    let count = items.len() as u64;
    if count < least || count > most {
        let wanted = if least == most { format!("{least}") } else { format!("{least} to {most}") };
        reasons.push(Reason { key: path.to_owned(), what: format!("has {count} entries: write {wanted}") });
    }
    // Entries beyond the permitted number are refused as a whole, not one by one.
    for (index, item) in items.iter().take(usize::try_from(most).unwrap_or(usize::MAX)).enumerate() {
        check(item, &schema["items"], &format!("{path}[{index}]"), reasons);
    }
}

fn check_number(x: f64, schema: &Json, refuse: &mut impl FnMut(String)) {
    let bound = |key: &str| schema[key].as_f64();
    if !x.is_finite() {
        refuse(format!("is {x}: write a finite number"));
    } else if bound("exclusiveMinimum").is_some_and(|least| x <= least) {
        refuse(format!("is {x}: must be above {}", schema["exclusiveMinimum"]));
    } else if bound("minimum").is_some_and(|least| x < least) {
        refuse(format!("is {x}: must be at least {}", schema["minimum"]));
    } else if bound("maximum").is_some_and(|most| x > most) {
        refuse(format!("is {x}: must be at most {}", schema["maximum"]));
    }
}

fn check_text(text: &str, schema: &Json, refuse: &mut impl FnMut(String)) {
    let length = text.chars().count() as u64;
    if let Some(choices) = schema["enum"].as_array() {
        let mut choices = choices.iter().filter_map(Json::as_str);
        if !choices.clone().any(|c| c == text) {
            let list = keys(choices.by_ref());
            refuse(format!("is {}: choose one of {list}", shown(&Value::String(text.to_owned()))));
        }
    } else if schema["minLength"].as_u64().is_some_and(|least| length < least) {
        refuse("is empty: write something or remove the key".into());
    } else if text.chars().any(char::is_control) {
        refuse("holds a control character: remove it".into());
    } else if let Some(most) = schema["maxLength"].as_u64().filter(|most| length > *most) {
        refuse(format!("has {length} characters: write at most {most}"));
    }
}

fn keys<'a>(names: impl Iterator<Item = &'a str>) -> String {
    names.map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ")
}

fn article(kind: &str) -> &'static str {
    match kind {
        "object" => "a table ([section])",
        "array" => "an array ([...])",
        "number" => "a number",
        "integer" => "a whole number",
        "boolean" => "true or false",
        _ => "a text in quotes",
    }
}

/// A value as a person would recognise it, cut short.
fn shown(value: &Value) -> String {
    match value {
        Value::Table(_) => "a table".into(),
        Value::Array(items) => format!("an array of {}", items.len()),
        other => {
            let text = other.to_string();
            let cut: String = text.chars().take(60).collect();
            if cut.len() < text.len() { format!("{cut}...") } else { cut }
        }
    }
}

/// The known key that `key` most likely meant, if one is near.
fn nearest<'a>(key: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let key: String = key.chars().take(64).collect();
    known.map(|k| (distance(&key, k), k)).filter(|(d, k)| *d <= 1 + k.len() / 4).min().map(|(_, k)| k)
}

/// Edits (insert, delete, replace, swap neighbours) between two short words.
fn distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut rows = vec![vec![0_usize; b.len() + 1]; a.len() + 1];
    for i in 0..=a.len() {
        for j in 0..=b.len() {
            rows[i][j] = if i == 0 || j == 0 {
                i + j
            } else {
                let replace = rows[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
                let swap = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
                let best = replace.min(rows[i - 1][j] + 1).min(rows[i][j - 1] + 1);
                if swap { best.min(rows[i - 2][j - 2] + 1) } else { best }
            };
        }
    }
    rows[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_key_is_suggested_only_when_near() {
        let known = ["speed_deg_s", "settle_s", "port"];
        assert_eq!(nearest("sped_deg_s", known.into_iter()), Some("speed_deg_s"));
        assert_eq!(nearest("prot", known.into_iter()), Some("port"));
        assert_eq!(nearest("colour", known.into_iter()), None);
    }
}
