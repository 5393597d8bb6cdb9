//! Homing, moves, stops and the check for lost steps, against the simulated arm's own truth.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod bench;

use arm_logic::{Mechanics, Settings, rig};
use arm_sim::{Board, World};
use bench::{FAST, INFO, count, homed, run, start};
use firmware_protocol::{Faults, Hal};
use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};

fn runner(cases: u32) -> TestRunner {
    let config = ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() };
    TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha))
}

/// Where the arm truly is, steps of angle: the vane's edge is at the settings' angle.
fn true_count(board: &Board) -> i64 {
    board.world().place - board.world().edge + i64::from(count(FAST.edge_mdeg))
}

#[test]
fn homing_from_anywhere_makes_the_count_true_to_the_step_of_the_edge() {
    let travel = i64::from(count(FAST.travel_mdeg[0]))..=i64::from(count(FAST.travel_mdeg[1]));
    runner(200)
        .run(&(travel, 0..=FAST.steady_us), |(from, bounce_us)| {
            let mut board = start(from, bounce_us);
            board.arm_mut().start_home();
            run(&mut board);
            let motor = board.motor();
            prop_assert!(motor.homed && motor.faults.is_empty() && !motor.at_switch, "{:?} from {}", motor, from);
            prop_assert_eq!(motor.position_mdeg, FAST.edge_mdeg + FAST.clear_mdeg);
            // The bounces may hide the first touch for one slow step.
            let off = true_count(&board) - i64::from(count(motor.position_mdeg));
            prop_assert!(off.abs() <= 1, "off by {} steps from {} with {} us", off, from, bounce_us);
            Ok(())
        })
        .unwrap();
}

#[test]
fn homing_is_repeatable_to_the_step_without_bounces() {
    let mut board = homed();
    let first = true_count(&board);
    for target in [80_000, -20_000, -85_000] {
        board.arm_mut().start_move(target);
        run(&mut board);
        board.arm_mut().start_home();
        run(&mut board);
        assert_eq!(true_count(&board), first);
    }
}

#[test]
fn moves_end_exactly_and_never_leave_the_travel_nor_exceed_speed() {
    let ends = FAST.travel_mdeg.map(|mdeg| i64::from(count(mdeg)));
    // 10^6 us a second, rounded up to the next whole one.
    let soonest_us = (360_000_000_000u64).div_ceil(u64::from(FAST.steps_per_turn) * u64::from(FAST.speed_mdeg_s));
    runner(60)
        .run(&(prop::collection::vec((-200_000..200_000i32, 0..300u32), 1..6), any::<u64>()), |(moves, seed)| {
            let mut board = homed();
            let zero = true_count(&board) - board.world().place;
            let mut random = seed;
            for (target_mdeg, late_us) in moves {
                board.world_mut().steps.clear();
                board.arm_mut().start_move(target_mdeg);
                // A processor that comes late, by up to `late_us` each time.
                while board.motor().moving {
                    random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                    let late = u32::try_from(random >> 33).unwrap() % (late_us + 1);
                    board.pass(board.wait_us() + late);
                }
                let reached = i64::from(count(target_mdeg.clamp(FAST.travel_mdeg[0], FAST.travel_mdeg[1])));
                prop_assert_eq!(i64::from(count(board.motor().position_mdeg)), reached);
                prop_assert!((true_count(&board) - reached).abs() <= 1);
                for pair in board.world().steps.windows(2) {
                    prop_assert!(u64::from(pair[1].0.wrapping_sub(pair[0].0)) >= soonest_us);
                }
                let places = board.world().steps.iter().map(|step| step.1 + zero);
                prop_assert!(places.clone().all(|place| (ends[0] - 1..=ends[1] + 1).contains(&place)));
                prop_assert!(board.motor().faults.is_empty());
            }
            Ok(())
        })
        .unwrap();
}

#[test]
fn a_stop_anywhere_ends_within_the_braking_distance_and_keeps_the_count() {
    let steps_a_mdeg = f64::from(FAST.steps_per_turn) / 360_000.0;
    let speed = f64::from(FAST.speed_mdeg_s) * steps_a_mdeg;
    let braking = speed * speed / (2.0 * f64::from(FAST.acceleration_mdeg_s2) * steps_a_mdeg);
    runner(100)
        .run(&(0..1_500_000u32), |us| {
            let mut board = homed();
            board.arm_mut().start_move(90_000);
            board.advance(us);
            let before = board.world().place;
            board.arm_mut().decelerate();
            run(&mut board);
            // The step already under way belongs to the motion before.
            prop_assert!((board.world().place - before) as f64 <= braking.ceil() + 1.0);
            prop_assert_eq!(i64::from(count(board.motor().position_mdeg)), true_count(&board));
            prop_assert!(board.motor().homed);
            Ok(())
        })
        .unwrap();
}

#[test]
fn steps_lost_are_found_at_the_next_pass_over_the_edge_and_few_are_not_mistaken_for_many() {
    let tolerance = i64::from(count(FAST.tolerance_mdeg));
    for (slip, from, to, found) in [
        (tolerance + 2, 50_000, -89_000, true),
        (-(tolerance + 2), 50_000, -89_000, true),
        (tolerance + 2, -89_000, 50_000, true),
        (-(tolerance + 2), -89_000, 50_000, true),
        (tolerance - 2, 50_000, -89_000, false),
        (-(tolerance - 2), 50_000, -89_000, false),
        (tolerance - 2, -89_000, 50_000, false),
        (-(tolerance - 2), -89_000, 50_000, false),
        (500, 50_000, -20_000, false),
    ] {
        let mut board = homed();
        board.arm_mut().start_move(from);
        run(&mut board);
        board.world_mut().slip(slip);
        board.arm_mut().start_move(to);
        run(&mut board);
        let motor = board.motor();
        assert_eq!(motor.faults.contains(Faults::STEP_LOSS), found, "{slip} steps from {from} to {to}");
        assert_eq!(motor.homed, !found, "a position that is wrong is not known");
    }
}

#[test]
fn an_arm_that_stalls_on_its_way_over_the_edge_is_found() {
    let mut board = homed();
    board.arm_mut().start_move(50_000);
    run(&mut board);
    board.world_mut().stalled = true;
    board.arm_mut().start_move(-89_000);
    run(&mut board);
    assert_eq!(board.motor().faults, Faults::STEP_LOSS);
    board.world_mut().stalled = false;
    board.arm_mut().clear_faults();
    board.arm_mut().start_home();
    run(&mut board);
    assert!(board.motor().homed && board.motor().faults.is_empty());
    assert_eq!(true_count(&board), i64::from(count(board.motor().position_mdeg)));
}

#[test]
fn homing_that_cannot_succeed_says_why() {
    for (stuck, stalled, from, fault) in [
        (Some(true), false, 4000, Faults::SWITCH_STUCK),
        (Some(false), false, 500, Faults::HOME_FAILED),
        (None, true, 500, Faults::HOME_FAILED),
        (None, true, count(FAST.edge_mdeg).into(), Faults::SWITCH_STUCK),
    ] {
        let mut board = start(from, 0);
        (board.world_mut().stuck, board.world_mut().stalled) = (stuck, stalled);
        // The contact's level is known from the start.
        board.advance(FAST.steady_us + 2000);
        let before = board.world().place;
        board.arm_mut().start_home();
        run(&mut board);
        assert_eq!((board.motor().faults, board.motor().homed), (fault, false), "stuck {stuck:?}, stalled {stalled}");
        let turned = board.world().place - before;
        let travel = i64::from(count(FAST.travel_mdeg[1]) - count(FAST.travel_mdeg[0]));
        assert!(turned.abs() <= travel * 3 / 2 && turned <= travel / 4, "searched {turned} steps");
    }
}

#[test]
fn a_switch_that_sticks_after_the_first_pass_is_told_from_one_that_is_missing() {
    let mut board = start(0, 0);
    board.arm_mut().start_home();
    while !board.motor().at_switch {
        board.advance(1000);
    }
    board.world_mut().stuck = Some(true);
    run(&mut board);
    assert_eq!(board.motor().faults, Faults::SWITCH_STUCK);
}

#[test]
fn a_stop_ends_a_homing_without_a_position() {
    let mut board = start(3000, 0);
    board.arm_mut().start_home();
    board.advance(500_000);
    board.arm_mut().decelerate();
    run(&mut board);
    assert_eq!((board.motor().homed, board.motor().faults), (false, Faults::default()));
}

#[test]
fn the_motor_has_no_current_before_its_first_motion_and_holds_after_it() {
    let mut board = Board::new(World::new(&rig::SETTINGS, 100, 0), rig::MECHANICS, INFO);
    board.advance(100_000);
    assert!(!board.world().enabled);
    board.arm_mut().start_home();
    board.arm_mut().decelerate();
    run(&mut board);
    assert!(board.world().enabled);
}

#[test]
fn settings_that_contradict_each_other_are_refused_in_words() {
    let refused: [(Settings, &str); 6] = [
        (Settings { steps_per_turn: 0, ..FAST }, "steps_per_turn"),
        (Settings { travel_mdeg: [5, 5], ..FAST }, "travel_mdeg"),
        (Settings { edge_mdeg: FAST.travel_mdeg[1], ..FAST }, "edge_mdeg"),
        (Settings { tolerance_mdeg: 100, ..FAST }, "tolerance_mdeg"),
        (Settings { clear_mdeg: FAST.tolerance_mdeg, ..FAST }, "clear_mdeg"),
        (Settings { acceleration_mdeg_s2: 0, ..FAST }, "acceleration_mdeg_s2"),
    ];
    for (settings, named) in refused {
        let said = Mechanics::new(settings).unwrap_err();
        assert!(said.contains(named), "{said:?} does not name {named}");
    }
}

#[test]
fn a_spike_on_the_switch_is_no_edge() {
    let mut board = homed();
    board.arm_mut().start_move(50_000);
    board.advance(700_000);
    board.world_mut().stuck = Some(true);
    board.advance(FAST.steady_us - 1000);
    board.world_mut().stuck = None;
    run(&mut board);
    assert_eq!((board.motor().faults, board.motor().position_mdeg), (Faults::default(), 50_000));
}
