//! What computer and camera say before a session: memory, clock, card, battery. Estimates warn; only a card that is too small refuses.

use super::book::Inner;
use super::crop;
use super::plan::{CapturePlan, FRAME_BYTES_PER_PIXEL, RADIANCE_BYTES_PER_PIXEL, frame_pixels};
use crate::devices::camera::Supplies;
use crate::numerics::fit::observations::Row;
use crate::numerics::fit::prepared::ReadyRow;
use crate::numerics::simd::LANES;
use crate::store::memory;
use jiff::Timestamp;
use rig_config::Rig;
use std::path::Path;

/// No rigd is older: 2026-01-01, seconds.
pub const OLDEST_S: i64 = 1_767_225_600;

/// Frames that are decoded at a time, and bytes of a decoded pixel.
const DECODED: u64 = 2;
const LEVEL_BYTES: u64 = 3;
/// Bytes of a sample while it is fitted: as observed, and made ready.
const SAMPLE_BYTES: u64 = ((size_of::<Row>() + size_of::<ReadyRow>()) / LANES) as u64;
/// A battery that is no fuller will not last a night, percent.
const BATTERY: u32 = 50;

/// What is known of this computer.
#[derive(Clone, Copy, Debug)]
pub struct Machine {
    /// Memory that can be had, bytes, if the kernel tells.
    pub memory_bytes: Option<u64>,
    /// What the clock says.
    pub now: Timestamp,
}

/// What speaks against shooting `plan` now, on this computer, after what there is already.
pub(super) fn of_machine(rig: &Rig, plan: &CapturePlan, inner: &Inner) -> Vec<String> {
    // By id, so the one that the latest clock started.
    let last = inner.runs.values().next_back().and_then(|entry| entry.manifest.started.parse().ok());
    let machine = Machine { memory_bytes: memory::available(Path::new("/proc")).ok(), now: inner.store.clock().now() };
    warnings(rig, plan, &machine, last)
}

/// What speaks against shooting `plan` on such a computer, where the last run was started at `last`.
pub fn warnings(rig: &Rig, plan: &CapturePlan, machine: &Machine, last: Option<Timestamp>) -> Vec<String> {
    let memory = machine.memory_bytes.and_then(|available| lack_of_memory(rig, plan, available));
    memory.into_iter().chain(wrong_clock(machine.now, last)).collect()
}

/// Memory that developing and fitting take at most, bytes.
pub fn memory_bytes(rig: &Rig, plan: &CapturePlan) -> u64 {
    developing_bytes(rig, plan).max(fitting_bytes(rig, plan))
}

/// The files of a bracket, the frames decoded at a time, and what is kept of all of them.
fn developing_bytes(rig: &Rig, plan: &CapturePlan) -> u64 {
    let exposures = plan.exposures.len() as u64;
    frame_pixels(rig) * (exposures * FRAME_BYTES_PER_PIXEL + DECODED * LEVEL_BYTES)
        + part_pixels(rig, plan) * (exposures * LEVEL_BYTES + RADIANCE_BYTES_PER_PIXEL)
}

/// The radiance under all lights, and all samples of the object.
fn fitting_bytes(rig: &Rig, plan: &CapturePlan) -> u64 {
    let part = part_pixels(rig, plan);
    // A ball fills pi/4 of what surrounds it.
    let object = crop::of_object(rig).map_or(part, |c| c.width as u64 * c.height as u64) * 785 / 1000;
    plan.stations.len() as u64 * (part * RADIANCE_BYTES_PER_PIXEL + object * SAMPLE_BYTES)
}

/// Pixels of a frame that are developed.
fn part_pixels(rig: &Rig, plan: &CapturePlan) -> u64 {
    let part = crop::of_session(rig, plan.calibration.is_some());
    part.map_or(frame_pixels(rig), |c| c.width as u64 * c.height as u64)
}

/// A lack of memory in words.
pub fn lack_of_memory(rig: &Rig, plan: &CapturePlan, available: u64) -> Option<String> {
    let (needed, gb) = (memory_bytes(rig, plan), |bytes: u64| bytes as f64 / 1e9);
    (available < needed).then(|| {
        format!(
            "developing and fitting take up to {:.2} GB of memory, {:.2} GB are available: end other programs, or shoot fewer stations",
            gb(needed),
            gb(available)
        )
    })
}

fn wrong_clock(now: Timestamp, last: Option<Timestamp>) -> Option<String> {
    let why = if now.as_second() < OLDEST_S {
        "that is before this program was written".to_owned()
    } else {
        format!("the last session was started at {}", last.filter(|last| *last > now)?)
    };
    Some(format!("the computer's clock says {now}, but {why}: sessions are ordered and dated by it; set it first"))
}

/// Why the card will not do for so many shots.
pub(super) fn small_card(supplies: &Supplies, shots: usize) -> Option<String> {
    let left = supplies.shots_left.filter(|&left| (left as usize) < shots)?;
    Some(format!(
        "the camera's card takes {left} more shots at the quality set on the body, the session needs {shots}: put an empty card in, \
         rigd deletes nothing on a camera"
    ))
}

/// A battery that may not last, in words; bodies say `50%` or `Low`, and 100% on an AC adapter.
pub(super) fn weak_battery(supplies: &Supplies, seconds: f64) -> Option<String> {
    let battery = supplies.battery.as_deref()?;
    let percent = battery.trim().strip_suffix('%').and_then(|number| number.trim().parse::<u32>().ok());
    let weak = percent.map_or_else(|| battery.eq_ignore_ascii_case("low"), |percent| percent <= BATTERY);
    weak.then(|| {
        let hours = seconds / 3600.0;
        format!(
            "the camera's battery is at {battery}, and the session takes {hours:.1} h: charge it, or use the AC adapter"
        )
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]
    use super::*;
    use crate::session::plan::StartRequest;

    fn paper() -> (Rig, CapturePlan) {
        let rig = Rig::from_toml(rig_config::SHIPPED[0].1, "zheng-2008").unwrap();
        let plan = CapturePlan::new(&rig, &StartRequest::default()).unwrap();
        (rig, plan)
    }

    /// `rigd bench merge` measured 226 MB for developing brackets of ten such frames (docs/merge.md).
    #[test]
    fn developing_takes_what_was_measured_and_a_night_is_fitted_with_more_memory_than_an_evening() {
        let (rig, plan) = paper();
        let developing = developing_bytes(&rig, &plan);
        assert!((226_000_000..350_000_000).contains(&developing), "{developing}");
        let mut night = plan.clone();
        night.stations = (0..181).map(|_| plan.stations[0].clone()).collect();
        assert_eq!(memory_bytes(&rig, &night) / 181, fitting_bytes(&rig, &plan) / 7);
        let needed = memory_bytes(&rig, &plan);
        assert_eq!(lack_of_memory(&rig, &plan, needed), None);
        let words = lack_of_memory(&rig, &plan, 100_000_000).unwrap();
        assert!(words.contains(&format!("{:.2} GB of memory, 0.10 GB are available", needed as f64 / 1e9)), "{words}");
    }

    #[test]
    fn a_clock_that_went_back_is_told_with_both_times() {
        let (rig, plan) = paper();
        let at = |now: &str, last: Option<&str>| {
            let machine = Machine { memory_bytes: None, now: now.parse().unwrap() };
            warnings(&rig, &plan, &machine, last.map(|last| last.parse().unwrap()))
        };
        assert!(at("2026-11-30T20:00:00Z", None).is_empty());
        assert!(at("2026-11-30T20:00:00Z", Some("2026-11-30T19:59:59Z")).is_empty());
        let back = at("2026-11-30T20:00:00Z", Some("2026-12-01T06:00:00Z"));
        assert!(back[0].contains("2026-11-30T20:00:00Z") && back[0].contains("2026-12-01T06:00:00Z"), "{back:?}");
        assert!(at("1970-01-01T00:03:00Z", None)[0].contains("before this program"));
    }

    #[test]
    fn card_and_battery_are_judged_by_what_the_body_says() {
        let told = |shots_left, battery: Option<&str>| Supplies { shots_left, battery: battery.map(str::to_owned) };
        assert_eq!(small_card(&told(None, None), 1810), None);
        assert_eq!(small_card(&told(Some(70), None), 70), None);
        let words = small_card(&told(Some(69), None), 70).unwrap();
        assert!(words.contains("69 more shots") && words.contains("needs 70"), "{words}");
        for (battery, weak) in
            [("100%", false), ("75%", false), ("50%", true), ("25 %", true), ("Low", true), ("?", false)]
        {
            assert_eq!(weak_battery(&told(None, Some(battery)), 5400.0).is_some(), weak, "{battery}");
        }
        assert!(
            weak_battery(&told(None, Some("Low")), 5400.0).unwrap().contains("at Low, and the session takes 1.5 h")
        );
        assert_eq!(weak_battery(&told(Some(1), None), 5400.0), None);
    }
}
