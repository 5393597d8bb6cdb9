//! In which order a session shoots the stations of the rig file.

use rig_config::{CameraDriver, Rig};

/// The stations of the rig file in the order in which they are shot, degrees. With a reference patch, stations that go one way are shot in
/// three: only then do its readings tell the lamp's drift from a normal that is not quite as stated. An order that goes back and forth
/// already is somebody's own and kept, and so is that of a folder of frames, which are there in it.
pub fn of_rig(rig: &Rig) -> Vec<f64> {
    let stated = &rig.plan.stations_deg;
    let replayed = matches!(rig.camera.driver, CameraDriver::Replay { .. });
    if rig.reference_patch.is_some() && !replayed && one_way(stated) {
        return three_ways(stated);
    }
    stated.clone()
}

fn one_way(angles_deg: &[f64]) -> bool {
    let sorted = |up: bool| angles_deg.windows(2).all(|pair| (pair[1] > pair[0]) == up);
    sorted(true) || sorted(false)
}

/// Every third one on the way out, the next ones on the way back, the rest on the way out again: the way is three times as long at most.
fn three_ways(angles_deg: &[f64]) -> Vec<f64> {
    let third = |first: usize| angles_deg.iter().skip(first).step_by(3);
    third(0).chain(third(1).rev()).chain(third(2)).copied().collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use rig_config::ReferencePatch;

    fn rig(stations_deg: &[f64]) -> Rig {
        let (_, shipped) = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated").unwrap();
        let mut rig = Rig::from_toml(shipped, "simulated.toml").unwrap();
        rig.plan.stations_deg = stations_deg.to_vec();
        rig
    }

    fn with_patch(stations_deg: &[f64]) -> Rig {
        let patch = ReferencePatch { center_mm: [-47.0, 25.0, 1460.0], normal: [0.34, 0.0, -0.94], diameter_mm: 22.0 };
        Rig { reference_patch: Some(patch), ..rig(stations_deg) }
    }

    const SHIPPED: [f64; 7] = [-55.0, -20.0, 15.0, 50.0, 85.0, 115.0, 140.0];

    #[test]
    fn a_way_out_becomes_out_back_and_out_again_where_there_is_a_patch() {
        assert_eq!(of_rig(&rig(&SHIPPED)), SHIPPED);
        assert_eq!(of_rig(&with_patch(&SHIPPED)), [-55.0, 50.0, 140.0, 85.0, -20.0, 15.0, 115.0]);
        let down: Vec<f64> = SHIPPED.iter().rev().copied().collect();
        assert_eq!(of_rig(&with_patch(&down)), [140.0, 50.0, -55.0, 15.0, 115.0, 85.0, -20.0]);
        for few in [&[10.0][..], &[10.0, 20.0], &[10.0, 20.0, 30.0]] {
            assert_eq!(of_rig(&with_patch(few)), few);
        }
    }

    #[test]
    fn an_order_of_ones_own_and_that_of_a_folder_are_kept() {
        let own = [-55.0, 15.0, -20.0, 50.0];
        assert_eq!(of_rig(&with_patch(&own)), own);
        let mut replayed = with_patch(&SHIPPED);
        replayed.camera.driver = CameraDriver::Replay { directory: "frames".into() };
        assert_eq!(of_rig(&replayed), SHIPPED);
    }

    #[test]
    fn three_ways_hold_every_station_once_and_are_no_more_than_three_times_as_long() {
        for count in 2..200 {
            let angles: Vec<f64> = (0..count).map(|i| f64::from(i) * 1.25 - 60.0).collect();
            let order = three_ways(&angles);
            let travel: f64 = order.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
            assert!(travel <= 3.0 * (angles[angles.len() - 1] - angles[0]), "{count}: {travel}");
            let mut sorted = order;
            sorted.sort_by(f64::total_cmp);
            assert_eq!(sorted, angles);
        }
    }
}
