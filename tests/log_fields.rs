//! What the log says of a session: events with fields of their own, as the journal keeps them, the same as the session's journal.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod support;

use rigd::session::state::SessionState as S;
use serde_json::{Map, Value, json};
use std::fmt::Debug;
use std::sync::{Arc, Mutex};
use support::{Act, Fakes, begin, events, wait_for};
use tracing::field::{Field, Visit};
use tracing::{Event, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;
use tracing_subscriber::prelude::*;

/// Keeps every event with its fields.
#[derive(Clone, Default)]
struct Kept(Arc<Mutex<Vec<Map<String, Value>>>>);

struct Fields(Map<String, Value>);

impl Visit for Fields {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        self.0.insert(field.name().into(), format!("{value:?}").into());
    }
    fn record_u64(&mut self, field: &Field, value: u64) {
        self.0.insert(field.name().into(), value.into());
    }
    fn record_str(&mut self, field: &Field, value: &str) {
        self.0.insert(field.name().into(), value.into());
    }
}

impl<S: Subscriber> Layer<S> for Kept {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut fields = Fields(Map::new());
        event.record(&mut fields);
        fields.0.insert("level".into(), event.metadata().level().as_str().into());
        self.0.lock().unwrap().push(fields.0);
    }
}

#[test]
fn every_frame_and_every_trouble_can_be_searched_for() {
    let kept = Kept::default();
    tracing_subscriber::registry().with(kept.clone()).init();
    let (fakes, data) = (Fakes::default(), tempfile::tempdir().unwrap());
    // The second frame is the first once more: it is refused and shot again.
    fakes.on_shot(|_, count, _| if count == 1 { Act::Repeat } else { Act::Good });
    let engine = fakes.engine(data.path());
    let id = begin(&engine);
    wait_for(&engine, &id, S::Completed);
    let said = |what: &str| -> Vec<Map<String, Value>> {
        let all = kept.0.lock().unwrap();
        all.iter()
            .filter(|event| event.get("message") == Some(&json!(what)) && event.get("session") == Some(&json!(id)))
            .cloned()
            .collect()
    };
    let committed = said("frame.committed");
    let journal = events(&engine, &id, "frame.committed");
    assert_eq!((committed.len(), journal.len()), (6, 6));
    for (event, record) in committed.iter().zip(&journal) {
        for (field, key) in [("seq", "seq"), ("station", "station"), ("exposure", "exposure"), ("frame", "file")] {
            assert_eq!(event[field], record[key], "{event:?}");
        }
        assert_eq!(event["level"], "INFO");
    }
    let refused = said("frame.rejected");
    assert_eq!(refused.len(), 1);
    assert_eq!(
        (&refused[0]["level"], &refused[0]["station"], &refused[0]["exposure"]),
        (&json!("WARN"), &json!(0), &json!(1))
    );
    assert_eq!(refused[0]["reason"], events(&engine, &id, "frame.rejected")[0]["reason"]);
    assert!(said("session.state").iter().any(|event| event["state"] == "completed"));
}
