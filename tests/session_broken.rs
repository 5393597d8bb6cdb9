//! A bracket that a crash broke: it goes on where it was under the same light, and is shot again whole under any other.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod lamp;

use lamp::{Stage, events, request, small_rig, wait_for};
use rigd::session::handle::EngineHandle;
use rigd::session::state::SessionState as S;
use serde_json::Value;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

const ANGLES_DEG: [f64; 3] = [-30.0, 10.0, 50.0];
const EXPOSURES: [&str; 4] = ["1/15", "1/6", "0.6", "1.6"];
const FRAMES: usize = ANGLES_DEG.len() * EXPOSURES.len();

/// A rig whose lamp has a brightness that the test sets, and a session of which a crash left so many frames.
struct Broken {
    stage: Stage,
    brightness: Arc<AtomicU64>,
    id: String,
}

impl Broken {
    fn after(frames: usize) -> Self {
        Self::with(&EXPOSURES, frames)
    }

    fn with(exposures: &[&str; 4], frames: usize) -> Self {
        let brightness = Arc::new(AtomicU64::new(1.0_f64.to_bits()));
        let lamp = Arc::clone(&brightness);
        let stage = Stage::new(small_rig(), move |_| [f64::from_bits(lamp.load(Ordering::SeqCst)); 3]);
        let engine = stage.engine();
        let id = engine.start(&request(&ANGLES_DEG, exposures), None).unwrap().snapshot.id;
        wait_for(&engine, &id, S::Completed);
        engine.shutdown().unwrap();
        let path = stage.directory(&id).join("journal.jsonl");
        let text = std::fs::read_to_string(&path).unwrap();
        let is_frame = |line: &&str| line.contains("\"type\":\"frame.committed\"");
        let mut seen = 0;
        let kept: Vec<&str> = text
            .lines()
            .take_while(|line| {
                let more = seen < frames;
                seen += usize::from(is_frame(line));
                more
            })
            .collect();
        std::fs::write(&path, kept.join("\n") + "\n").unwrap();
        stage.burnt.lock().unwrap().clear();
        Self { stage, brightness, id }
    }

    /// The session goes on and is completed: its engine, the pictures that were taken for it, and the frames of station 1 that count.
    fn goes_on(&self) -> (EngineHandle, usize, Vec<Value>) {
        let engine = self.stage.engine();
        let end = wait_for(&engine, &self.id, S::Completed);
        assert_eq!(end.frames_committed, FRAMES);
        let frames = engine.frames(&self.id).unwrap();
        let counts = |frame: &&Value| frame["state"] == "committed" && frame["station"] == 1;
        let counting: Vec<Value> = frames.iter().filter(counts).cloned().collect();
        let brackets: BTreeSet<_> = counting.iter().map(|frame| frame["bracket"].as_u64()).collect();
        assert_eq!((counting.len(), brackets.len()), (EXPOSURES.len(), 1), "{counting:?}");
        (engine, self.stage.shots(), counting)
    }

    /// It goes on with its bracket shot again whole, for a reason with these words.
    fn begins_anew(&self, words: &str) {
        let (engine, shots, frames) = self.goes_on();
        let refused = events(&engine, &self.id, "bracket.rejected");
        assert!(refused.len() == 1 && refused[0]["reason"].as_str().unwrap().contains(words), "{refused:?}");
        assert_eq!(events(&engine, &self.id, "bracket.resumed").len(), 0);
        assert_eq!(shots, 1 + 8);
        assert!(frames.iter().all(|frame| frame["bracket"] == 3), "{frames:?}");
    }
}

#[test]
fn under_the_same_light_it_goes_on_after_one_exposure_shot_again() {
    for (kept, proof) in [(2, 1), (3, 2)] {
        let broken = Broken::after(EXPOSURES.len() + kept);
        let (engine, shots, frames) = broken.goes_on();
        let resumed = events(&engine, &broken.id, "bracket.resumed");
        assert_eq!(resumed.len(), 1, "{:?}", events(&engine, &broken.id, "bracket.rejected"));
        assert_eq!((&resumed[0]["station"], &resumed[0]["exposure"]), (&1.into(), &proof.into()), "{resumed:?}");
        assert!(resumed[0]["change"].as_f64().unwrap().abs() < 0.006, "{resumed:?}");
        assert_eq!(shots, 1 + FRAMES - EXPOSURES.len() - kept);
        assert!(frames.iter().all(|frame| frame["bracket"] == 2 && frame["attempt"] == 1), "{frames:?}");
    }
}

#[test]
fn under_a_lamp_that_is_one_percent_off_it_is_shot_again_whole() {
    for off in [0.99, 1.01] {
        let broken = Broken::after(EXPOSURES.len() + 3);
        broken.brightness.store(f64::to_bits(off), Ordering::SeqCst);
        broken.begins_anew("the lamp changed by");
    }
}

#[test]
fn a_sample_that_was_moved_meanwhile_is_seen() {
    let mut broken = Broken::after(EXPOSURES.len() + 3);
    broken.stage.true_rig.object.center_mm[0] += 2.0;
    broken.begins_anew("something moved");
}

#[test]
fn a_lamp_that_burnt_out_meanwhile_is_called_out() {
    let broken = Broken::after(EXPOSURES.len() + 3);
    broken.brightness.store(f64::to_bits(0.0), Ordering::SeqCst);
    let engine = broken.stage.engine();
    let end = wait_for(&engine, &broken.id, S::Interrupted);
    assert!(end.reason.clone().unwrap().starts_with("the lamp is out: replace it"), "{end:?}");
    assert_eq!(end.frames_committed, EXPOSURES.len() + 3);
}

/// What is dark tells nothing of the light: no picture is spent on a proof.
#[test]
fn frames_too_dark_to_tell_are_shot_again() {
    let broken = Broken::with(&["1/1000", "1/15", "1/6", "0.6"], 5);
    let (engine, shots, frames) = broken.goes_on();
    let told = ["bracket.resumed", "bracket.rejected"].map(|kind| events(&engine, &broken.id, kind).len());
    assert_eq!((told, shots), ([0, 0], 8));
    assert!(frames.iter().all(|frame| frame["bracket"] == 3), "{frames:?}");
}
