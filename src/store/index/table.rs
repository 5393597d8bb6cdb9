//! The tables: their columns in one place, and rows in and out of them. Every table's first column is the run's id.

use rusqlite::types::{Value as Sql, ValueRef};
use rusqlite::{Connection, Row, params_from_iter};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

/// What a column holds.
#[derive(Clone, Copy)]
enum Kind {
    Text,
    Integer,
    Real,
    /// True or false, as 1 or 0.
    Flag,
    /// JSON, as text.
    Json,
}

/// A table. Columns are the fields of its rows.
pub(super) struct Table {
    pub(super) name: &'static str,
    columns: &'static [(&'static str, Kind)],
    /// The column that tells rows of one run apart, and orders them.
    key: Option<&'static str>,
}

use Kind::{Flag, Integer, Json, Real, Text};

pub(super) const RUNS: Table = Table {
    name: "runs",
    columns: &[
        ("kind", Text),
        ("name", Text),
        ("state", Text),
        ("reason", Text),
        ("simulated", Flag),
        ("started", Text),
        ("ended", Text),
        ("rig", Text),
        ("calibration", Text),
        ("calibration_version", Integer),
        ("stations", Integer),
        ("frames_planned", Integer),
        ("frames_committed", Integer),
        ("records", Integer),
        ("hash", Text),
        ("fault", Text),
        // Of all rows of the run.
        ("digest", Text),
    ],
    key: None,
};

pub(super) const FRAMES: Table = Table {
    name: "frames",
    columns: &[
        ("file", Text),
        ("station", Integer),
        ("exposure", Integer),
        ("attempt", Integer),
        ("bracket", Integer),
        ("angle_deg", Real),
        ("shutter", Text),
        ("true_s", Real),
        ("bytes", Integer),
        ("blake3", Text),
        ("taken", Text),
        ("state", Text),
    ],
    key: Some("file"),
};

pub(super) const FITS: Table = Table {
    name: "fits",
    columns: &[
        ("seq", Integer),
        ("time", Text),
        ("model", Text),
        ("materials", Integer),
        ("mean_relative_error", Real),
        ("left_out_relative_error", Real),
        ("iterations", Integer),
        ("termination", Text),
        ("parameters", Json),
    ],
    key: Some("seq"),
};

pub(super) const ALL: [&Table; 3] = [&RUNS, &FRAMES, &FITS];

impl Table {
    /// The statement that makes it. No second index: what is asked for by anything but the run is rare, and a scan cannot disagree with
    /// its table.
    pub(super) fn create(&self) -> String {
        let kind = |kind: Kind| match kind {
            Text | Json => "TEXT",
            Integer | Flag => "INTEGER",
            Real => "REAL",
        };
        let columns: String = self.columns.iter().map(|(name, of)| format!(", {name} {}", kind(*of))).collect();
        let key: String = self.key.iter().map(|key| format!(", {key}")).collect();
        format!("CREATE TABLE {}(run TEXT{columns}, PRIMARY KEY (run{key})) STRICT, WITHOUT ROWID;", self.name)
    }

    /// `SELECT` of the run's id and all columns.
    pub(super) fn select(&self, rest: &str) -> String {
        let columns: String = self.columns.iter().map(|(name, _)| format!(", {0}.{name}", self.name)).collect();
        format!("SELECT {0}.run{columns} FROM {0} {rest}", self.name)
    }

    /// Rows of a run, ordered by their key.
    pub(super) fn of_run<T: DeserializeOwned>(&self, connection: &Connection, id: &str) -> rusqlite::Result<Vec<T>> {
        let order: String = self.key.iter().map(|key| format!(" ORDER BY {key}")).collect();
        let mut statement = connection.prepare(&self.select(&format!("WHERE run = ?1{order}")))?;
        statement.query_map([id], |row| self.row(row))?.collect()
    }

    /// What a row of [`Table::select`] holds.
    pub(super) fn row<T: DeserializeOwned>(&self, row: &Row<'_>) -> rusqlite::Result<T> {
        let mut object = Map::new();
        for (i, (name, kind)) in self.columns.iter().enumerate() {
            let wrong = |kind| rusqlite::Error::InvalidColumnType(i + 1, (*name).to_owned(), kind);
            let found = row.get_ref(i + 1)?;
            let value = from_sql(*kind, found).ok_or_else(|| wrong(found.data_type()))?;
            object.insert((*name).to_owned(), value);
        }
        let converted = T::deserialize(Value::Object(object));
        converted.map_err(|e| rusqlite::Error::FromSqlConversionFailure(0, rusqlite::types::Type::Text, e.into()))
    }

    /// Writes a row in place of the one with its key.
    pub(super) fn put(&self, connection: &Connection, id: &str, row: &impl Serialize) -> rusqlite::Result<()> {
        let row = serde_json::to_value(row).map_err(|e| rusqlite::Error::ToSqlConversionFailure(e.into()))?;
        let values = self.columns.iter().map(|(name, kind)| to_sql(*kind, &row[*name]));
        let places = ", ?".repeat(self.columns.len());
        let mut statement = connection.prepare(&format!("REPLACE INTO {} VALUES (?{places})", self.name))?;
        statement.execute(params_from_iter(std::iter::once(Sql::Text(id.to_owned())).chain(values))).map(|_| ())
    }
}

fn to_sql(kind: Kind, value: &Value) -> Sql {
    match (kind, value) {
        (_, Value::Null) => Sql::Null,
        (Json, value) => Sql::Text(value.to_string()),
        (_, Value::Bool(flag)) => Sql::Integer(i64::from(*flag)),
        (_, Value::Number(number)) => {
            number.as_i64().map(Sql::Integer).or_else(|| number.as_f64().map(Sql::Real)).unwrap_or(Sql::Null)
        }
        (_, Value::String(text)) => Sql::Text(text.clone()),
        (_, other) => Sql::Text(other.to_string()),
    }
}

fn from_sql(kind: Kind, value: ValueRef<'_>) -> Option<Value> {
    Some(match (kind, value) {
        (_, ValueRef::Null) => Value::Null,
        (Json, ValueRef::Text(text)) => serde_json::from_slice(text).ok()?,
        (Text, ValueRef::Text(text)) => Value::from(std::str::from_utf8(text).ok()?),
        (Flag, ValueRef::Integer(flag)) => Value::from(flag != 0),
        (Integer, ValueRef::Integer(number)) => Value::from(number),
        (Real, ValueRef::Real(number)) => Value::from(number),
        _ => return None,
    })
}
