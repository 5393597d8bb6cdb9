//! The simulated board: motor, home switch and lamp as the firmware's handler sees them, and what they truly do.

use super::motion::Profile;
use crate::sim::pose::Pose;
use crate::sim::ringing::Ringing;
use firmware_protocol::{Faults, Hal, Motor};

/// The arm's mechanics. The home switch sits at the lower end of the travel and is also a mechanical stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mechanics {
    /// Greatest speed, degrees per second; homing takes half of it.
    pub speed_deg_s: f64,
    /// Acceleration, degrees per second squared.
    pub acceleration_deg_s2: f64,
    /// Permitted angles, degrees, lower and upper.
    pub travel_deg: [f64; 2],
    /// How the arm swings after a move; none: it does not.
    pub ringing: Option<Ringing>,
}

#[derive(Clone, Copy, Debug)]
struct Motion {
    profile: Profile,
    homing: bool,
    /// Time along the profile, seconds; stands still while the motor is stalled.
    along_s: f64,
    /// Time since the start, seconds.
    elapsed_s: f64,
}

/// Motor, switch and lamp.
#[derive(Clone, Debug)]
pub struct Board {
    mechanics: Mechanics,
    /// Where the controller counts the arm to be, degrees.
    counted_deg: f64,
    /// True angle minus counted angle, degrees: unknown to the controller until it homes.
    slip_deg: f64,
    /// The arm against its shaft, on which the switch sits, degrees.
    shaft_deg: f64,
    motion: Option<Motion>,
    /// Time since the last move ended (seconds), and its greatest speed (degrees per second).
    rest: Option<(f64, f64)>,
    homed: bool,
    stalled: bool,
    faults: Faults,
    lamp_permille: u16,
    moves_started: u32,
}

impl Board {
    /// A board just powered: the arm rests somewhere inside its travel, and the controller counts from zero.
    pub fn new(mechanics: Mechanics) -> Self {
        let [lower, upper] = mechanics.travel_deg;
        Self {
            mechanics,
            counted_deg: 0.0,
            slip_deg: lower + 0.37 * (upper - lower),
            shaft_deg: 0.0,
            motion: None,
            rest: None,
            homed: false,
            stalled: false,
            faults: Faults::default(),
            lamp_permille: 0,
            moves_started: 0,
        }
    }

    /// Loss and return of power: the arm stays where it is, everything else is forgotten.
    pub fn power_cycle(&mut self) {
        *self = Self {
            slip_deg: self.counted_deg + self.slip_deg,
            shaft_deg: self.shaft_deg,
            stalled: self.stalled,
            moves_started: self.moves_started,
            ..Self::new(self.mechanics)
        };
    }

    /// The physical truth.
    pub fn pose(&self) -> Pose {
        Pose { angle_deg: self.counted_deg + self.slip_deg + self.shaft_deg, lamp_permille: self.lamp_permille }
    }

    /// The swinging after the last move, and for how long the motor has been standing, seconds; none while it turns.
    pub fn swing(&self) -> Option<(Ringing, f64)> {
        let ((since_s, speed_deg_s), ringing) = (self.rest?, self.mechanics.ringing?);
        Some((ringing.scaled(speed_deg_s / self.mechanics.speed_deg_s), since_s))
    }

    /// Moves begun since the start of the simulation, homings included.
    pub fn moves_started(&self) -> u32 {
        self.moves_started
    }

    /// Blocks or frees the motor; the controller sees that it does not turn.
    pub fn stall(&mut self, stalled: bool) {
        self.stalled = stalled;
    }

    /// Turns the arm by `slip_deg` degrees without the controller counting it.
    pub fn slip(&mut self, slip_deg: f64) {
        self.slip_deg += slip_deg;
    }

    /// Turns the arm on its shaft by `degrees`: no homing mends that.
    pub fn slip_on_shaft(&mut self, degrees: f64) {
        self.shaft_deg += degrees;
    }

    /// Lets `dt_s` seconds pass for the motor.
    pub fn advance(&mut self, dt_s: f64) {
        let Some(mut motion) = self.motion.take() else {
            self.rest = self.rest.map(|(since_s, speed_deg_s)| (since_s + dt_s, speed_deg_s));
            return;
        };
        motion.elapsed_s += dt_s;
        motion.along_s += if self.stalled { 0.0 } else { dt_s };
        self.counted_deg = motion.profile.at(motion.along_s).0;
        if motion.homing && self.at_switch() {
            self.counted_deg = self.mechanics.travel_deg[0];
            (self.slip_deg, self.homed) = (0.0, true);
        } else if motion.homing && motion.elapsed_s >= motion.profile.duration_s() {
            self.faults = self.faults.union(Faults::HOME_FAILED);
        } else if motion.along_s < motion.profile.duration_s() {
            self.motion = Some(motion);
        } else {
            self.rest = Some((motion.along_s - motion.profile.duration_s(), motion.profile.peak_speed()));
        }
    }

    fn at_switch(&self) -> bool {
        self.counted_deg + self.slip_deg <= self.mechanics.travel_deg[0]
    }

    fn start(&mut self, profile: Profile, homing: bool) {
        self.rest = None;
        self.motion = Some(Motion { profile, homing, along_s: 0.0, elapsed_s: 0.0 });
    }
}

impl Hal for Board {
    fn motor(&self) -> Motor {
        Motor {
            position_mdeg: to_mdeg(self.counted_deg),
            moving: self.motion.is_some(),
            homed: self.homed,
            at_switch: self.at_switch(),
            faults: self.faults,
        }
    }

    fn start_move(&mut self, target_mdeg: i32) {
        let Mechanics { speed_deg_s, acceleration_deg_s2, .. } = self.mechanics;
        let target_deg = f64::from(target_mdeg) / 1000.0;
        self.moves_started += 1;
        self.start(Profile::between(self.counted_deg, target_deg, speed_deg_s, acceleration_deg_s2), false);
    }

    fn start_home(&mut self) {
        let Mechanics { speed_deg_s, acceleration_deg_s2, travel_deg: [lower, upper], .. } = self.mechanics;
        let farthest_deg = self.counted_deg - 1.5 * (upper - lower);
        self.moves_started += 1;
        self.homed = false;
        self.start(Profile::between(self.counted_deg, farthest_deg, speed_deg_s / 2.0, acceleration_deg_s2), true);
    }

    fn decelerate(&mut self) {
        let Some(motion) = self.motion.take().filter(|_| !self.stalled) else { return };
        let (angle_deg, velocity) = motion.profile.at(motion.along_s);
        self.start(Profile::stopping(angle_deg, velocity, self.mechanics.acceleration_deg_s2), false);
    }

    fn set_lamp(&mut self, permille: u16) {
        self.lamp_permille = permille;
    }

    fn clear_faults(&mut self) {
        self.faults = Faults::default();
    }
}

/// Whole millidegrees; saturates far outside any travel.
pub fn to_mdeg(angle_deg: f64) -> i32 {
    (angle_deg * 1000.0).round() as i32
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    const MECHANICS: Mechanics =
        Mechanics { speed_deg_s: 30.0, acceleration_deg_s2: 100.0, travel_deg: [-90.0, 90.0], ringing: None };

    fn run(board: &mut Board) -> f64 {
        let mut time_s = 0.0;
        while board.motor().moving && time_s < 100.0 {
            board.advance(0.01);
            time_s += 0.01;
        }
        time_s
    }

    fn homed() -> Board {
        let mut board = Board::new(MECHANICS);
        board.start_home();
        run(&mut board);
        board
    }

    #[test]
    fn homing_makes_the_count_true() {
        let board = homed();
        assert!(board.motor().homed && board.motor().at_switch);
        assert_eq!((board.motor().position_mdeg, board.pose().angle_deg), (-90_000, -90.0));
    }

    #[test]
    fn a_move_takes_the_time_of_the_measured_controller() {
        let mut board = homed();
        board.start_move(-50_000);
        assert!((run(&mut board) - 1.633).abs() < 0.02, "40 degrees at 30 deg/s and 100 deg/s^2");
        assert_eq!(board.motor().position_mdeg, -50_000);
    }

    #[test]
    fn an_arm_that_slipped_on_its_shaft_stays_wrong_whatever_is_done() {
        let mut board = homed();
        board.slip_on_shaft(7.0);
        board.start_home();
        run(&mut board);
        assert_eq!((board.motor().position_mdeg, board.pose().angle_deg), (-90_000, -83.0));
        board.power_cycle();
        assert_eq!(board.pose().angle_deg, -83.0);
    }

    #[test]
    fn lost_steps_show_only_in_the_truth_and_homing_cures_them() {
        let mut board = homed();
        board.slip(11.3);
        board.start_move(0);
        run(&mut board);
        assert_eq!(board.motor().position_mdeg, 0);
        assert!((board.pose().angle_deg - 11.3).abs() < 1e-9);
        board.start_home();
        run(&mut board);
        assert_eq!((board.motor().position_mdeg, board.pose().angle_deg), (-90_000, -90.0));
    }

    #[test]
    fn a_stalled_motor_keeps_turning_in_vain_and_fails_to_home() {
        let mut board = homed();
        board.start_move(0);
        board.advance(0.5);
        board.stall(true);
        let before = board.motor().position_mdeg;
        board.advance(50.0);
        assert_eq!((board.motor().moving, board.motor().position_mdeg), (true, before));
        board.decelerate();
        assert!(!board.motor().moving);
        board.start_home();
        run(&mut board);
        assert_eq!((board.motor().faults, board.motor().homed), (Faults::HOME_FAILED, false));
    }

    #[test]
    fn an_arm_rings_from_the_instant_of_its_stop_and_a_slow_move_less() {
        let ringing = Ringing { amplitude_deg: 0.5, frequency_hz: 3.0, decay_s: 0.7 };
        let mut board = Board::new(Mechanics { ringing: Some(ringing), ..MECHANICS });
        board.start_home();
        run(&mut board);
        assert!(board.swing().is_none(), "the switch stops it");
        // 40 degrees take 40 / 30 + 30 / 100 s; looked at 0.25 s later, in one step as by a sleepy host.
        board.start_move(-50_000);
        assert!(board.swing().is_none());
        board.advance(40.0 / 30.0 + 0.3 + 0.25);
        let (found, since_s) = board.swing().unwrap();
        assert!((since_s - 0.25).abs() < 1e-9 && found == ringing, "{found:?} {since_s}");
        board.advance(0.1);
        assert!((board.swing().unwrap().1 - 0.35).abs() < 1e-9);
        // A degree is too short to reach the greatest speed: sqrt(1 x 100) of 30 degrees a second.
        board.start_move(-49_000);
        run(&mut board);
        assert!((board.swing().unwrap().0.amplitude_deg - 0.5 / 3.0).abs() < 1e-9);
    }

    #[test]
    fn a_power_cycle_forgets_all_but_where_the_arm_is() {
        let mut board = homed();
        board.set_lamp(700);
        board.start_move(0);
        board.advance(1.0);
        let before = board.pose().angle_deg;
        board.power_cycle();
        let motor = board.motor();
        assert_eq!((motor.position_mdeg, motor.homed, motor.moving), (0, false, false));
        assert_eq!(board.pose(), Pose { angle_deg: before, lamp_permille: 0 });
    }
}
