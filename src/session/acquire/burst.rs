//! A burst right after a move, for the settle time: nothing is waited for but the delay that staggers it against the others.

use super::{Acquisition, Trouble};
use crate::session::calibration::plan::Approach;
use crate::session::calibration::settle::plan::REST_S;

impl Acquisition<'_> {
    /// Comes to a station as planned and shoots its burst; the first one tells the time between two frames.
    pub(super) fn burst(&mut self, station: usize, angle_deg: f64, approach: Approach) -> Result<(), Trouble> {
        self.move_to(station, approach.from_deg)?;
        self.rest(REST_S)?;
        self.move_to(station, angle_deg)?;
        self.rest(approach.delay * self.period_s)?;
        self.shoot_bracket(station, angle_deg)?;
        if self.period_s == 0.0 {
            self.period_s = self.usual_period(station);
        }
        Ok(())
    }

    /// The median time between two frames of a station: one that is held up does not count.
    fn usual_period(&self, station: usize) -> f64 {
        let frames = self.book.look(self.id, |entry| entry.ledger.bracket(station)).flatten().unwrap_or_default();
        let asked: Vec<f64> = frames.iter().filter_map(|frame| Some(frame.since_rest_s?[0])).collect();
        let mut periods: Vec<f64> = asked.iter().zip(asked.iter().skip(1)).map(|(a, b)| b - a).collect();
        periods.sort_by(f64::total_cmp);
        periods.get(periods.len() / 2).copied().unwrap_or_default()
    }
}
