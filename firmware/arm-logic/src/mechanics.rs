//! The arm as its builder describes it, and the same checked and in steps.

use crate::ramp::Pace;

/// The arm as its builder describes it. Angles are millidegrees, speeds millidegrees a second.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Steps of the motor to a turn of the arm: full steps x microsteps x gear ratio.
    pub steps_per_turn: u32,
    /// Greatest speed.
    pub speed_mdeg_s: u32,
    /// Acceleration of every motion, millidegrees per second squared.
    pub acceleration_mdeg_s2: u32,
    /// Speed of the first pass to the switch.
    pub seek_mdeg_s: u32,
    /// Speed of the second pass, which measures.
    pub approach_mdeg_s: u32,
    /// Permitted angles, lower and upper. The arm can turn a little farther without harm.
    pub travel_mdeg: [i32; 2],
    /// Where the vane's edge passes the switch, inside the travel: pressed at this angle and below, open above.
    pub edge_mdeg: i32,
    /// How far above the edge homing turns round, and ends.
    pub clear_mdeg: i32,
    /// The farthest from its place that the edge may be seen on a move; farther away, steps were lost.
    pub tolerance_mdeg: i32,
    /// How long the switch must stand still to be believed, microseconds.
    pub steady_us: u32,
}

/// Longest time between two looks at the switch, microseconds.
pub const SAMPLE_US: u32 = 1000;

/// Settings that were checked, in steps and microseconds.
#[derive(Clone, Copy, Debug)]
pub struct Mechanics {
    steps_per_turn: u32,
    pub(crate) move_pace: Pace,
    pub(crate) seek_pace: Pace,
    pub(crate) approach_pace: Pace,
    /// Permitted counts, lower and upper.
    pub(crate) travel: [i32; 2],
    pub(crate) edge: i32,
    pub(crate) clear: u32,
    pub(crate) tolerance: i32,
    /// Steps that may pass before the switch is believed.
    pub(crate) late: i32,
    pub(crate) steady_us: u32,
    travel_mdeg: [i32; 2],
}

/// Ten turns: far beyond any arm, and steps still fit.
const FARTHEST_MDEG: i32 = 3_600_000;
const MOST_STEPS: u32 = 10_000_000;

impl Mechanics {
    /// Checks the settings; meant for a constant, so that a wrong arm does not compile.
    ///
    /// # Errors
    /// What is wrong with them.
    pub const fn new(settings: Settings) -> Result<Self, &'static str> {
        let Settings { steps_per_turn, acceleration_mdeg_s2, travel_mdeg, edge_mdeg, clear_mdeg, .. } = settings;
        let [lower, upper] = travel_mdeg;
        if steps_per_turn == 0 || steps_per_turn > MOST_STEPS {
            return Err("steps_per_turn must be from 1 to 10000000");
        }
        if lower < -FARTHEST_MDEG || upper > FARTHEST_MDEG || lower >= upper {
            return Err("travel_mdeg must be lower, upper within ten turns");
        }
        if clear_mdeg <= 0 || settings.tolerance_mdeg <= 0 || clear_mdeg > upper - lower {
            return Err("clear_mdeg and tolerance_mdeg must be above 0, clear_mdeg at most the travel");
        }
        if edge_mdeg < lower || edge_mdeg > upper - clear_mdeg {
            return Err("edge_mdeg must lie inside the travel, with clear_mdeg above it");
        }
        let Some(move_pace) = Pace::new(steps_per_turn, settings.speed_mdeg_s, acceleration_mdeg_s2) else {
            return Err("speed_mdeg_s and acceleration_mdeg_s2 must be above 0 and a ramp shorter than 18 minutes");
        };
        let Some(seek_pace) = Pace::new(steps_per_turn, settings.seek_mdeg_s, acceleration_mdeg_s2) else {
            return Err("seek_mdeg_s must be above 0 and a ramp shorter than 18 minutes");
        };
        let Some(approach_pace) = Pace::new(steps_per_turn, settings.approach_mdeg_s, acceleration_mdeg_s2) else {
            return Err("approach_mdeg_s must be above 0 and a step shorter than 18 minutes");
        };
        let tolerance = to_count(settings.tolerance_mdeg, steps_per_turn);
        let late = move_pace.steps_within(settings.steady_us.saturating_add(SAMPLE_US));
        if late >= tolerance.unsigned_abs() {
            return Err("tolerance_mdeg must be more than the arm turns at speed_mdeg_s within steady_us and 1 ms");
        }
        let clear = to_count(clear_mdeg, steps_per_turn);
        if clear <= tolerance {
            return Err("clear_mdeg must be more than tolerance_mdeg");
        }
        Ok(Self {
            steps_per_turn,
            move_pace,
            seek_pace,
            approach_pace,
            travel: [to_count(lower, steps_per_turn), to_count(upper, steps_per_turn)],
            edge: to_count(edge_mdeg, steps_per_turn),
            clear: clear.unsigned_abs(),
            tolerance,
            late: late.cast_signed(),
            steady_us: settings.steady_us,
            travel_mdeg,
        })
    }

    /// Permitted angles, millidegrees, lower and upper.
    pub const fn travel_mdeg(&self) -> [i32; 2] {
        self.travel_mdeg
    }

    /// The whole step nearest to an angle inside the travel; angles outside count as its ends.
    pub fn count(&self, angle_mdeg: i32) -> i32 {
        let [lower, upper] = self.travel_mdeg;
        to_count(angle_mdeg.clamp(lower, upper), self.steps_per_turn)
    }

    /// The angle of a count, millidegrees; saturates far outside any travel.
    pub fn angle_mdeg(&self, count: i32) -> i32 {
        let mdeg = rounded(count as i64 * 360_000, self.steps_per_turn as i64);
        mdeg.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32
    }

    /// How far the first pass looks for the switch, steps: from anywhere, with slack.
    pub(crate) fn seek_steps(&self) -> u32 {
        let travel = self.travel[1].abs_diff(self.travel[0]);
        travel + travel / 2
    }

    /// How far a pressed switch is followed upwards before it counts as stuck, steps: from the lower end of the travel, and
    /// as far below it as clear and braking reach.
    pub(crate) fn release_steps(&self) -> u32 {
        self.edge.abs_diff(self.travel[0]) + self.turn_round_steps()
    }

    /// How far the second pass looks for the edge it has just left, steps.
    pub(crate) fn approach_steps(&self) -> u32 {
        2 * self.turn_round_steps()
    }

    fn turn_round_steps(&self) -> u32 {
        self.clear + self.seek_pace.braking_steps() + self.seek_pace.steps_within(self.steady_us + SAMPLE_US)
    }
}

/// Limits of [`Mechanics::new`] keep the result within 10^8.
const fn to_count(angle_mdeg: i32, steps_per_turn: u32) -> i32 {
    rounded(angle_mdeg as i64 * steps_per_turn as i64, 360_000) as i32
}

const fn rounded(numerator: i64, denominator: i64) -> i64 {
    (numerator + numerator.signum() * (denominator / 2)) / denominator
}
