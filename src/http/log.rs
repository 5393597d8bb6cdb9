//! The daemon's last log lines, in memory: whoever has no shell on the machine reads them here.

use super::HttpState;
use super::extract::Query;
use super::problem::Problem;
use axum::extract::State;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};
use utoipa::{IntoParams, ToSchema};

/// Lines that are kept.
const LINES: usize = 500;
/// Characters of a line that are kept.
const CHARACTERS: usize = 1000;

/// A line of the log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LogLine {
    /// Number of the line, from 1 at the daemon's start.
    pub seq: u64,
    /// RFC 3339.
    pub time: String,
    /// `ERROR`, `WARN` or `INFO`.
    pub level: String,
    /// The part of the program that says it.
    pub target: String,
    /// What it says, with its fields, cut after a thousand characters.
    pub text: String,
}

/// The last lines: bounded, whatever is logged.
#[derive(Debug, Default)]
pub struct LogTail(Mutex<(u64, VecDeque<LogLine>)>);

impl LogTail {
    /// Adds a line.
    pub fn push(&self, time: String, level: &str, target: &str, text: &str) {
        let plain = |c: char| if c.is_control() { ' ' } else { c };
        let text = text.chars().take(CHARACTERS).map(plain).collect();
        let (last, lines) = &mut *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        *last += 1;
        if lines.len() == LINES {
            lines.pop_front();
        }
        lines.push_back(LogLine { seq: *last, time, level: level.into(), target: target.into(), text });
    }

    /// The newest `most` lines after number `after`, oldest first.
    pub fn after(&self, after: u64, most: usize) -> Vec<LogLine> {
        let lines = &self.0.lock().unwrap_or_else(PoisonError::into_inner).1;
        let later: Vec<LogLine> = lines.iter().rev().take_while(|line| line.seq > after).take(most).cloned().collect();
        later.into_iter().rev().collect()
    }
}

#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct Part {
    /// Most lines in the answer; 200 if left out.
    #[param(minimum = 1, maximum = 500, required = false, nullable = false)]
    lines: Option<u32>,
    /// Only lines with a number above this.
    #[param(minimum = 0, maximum = 9_007_199_254_740_991_u64, required = false, nullable = false)]
    after: Option<u64>,
}

/// Lines of the log.
#[derive(Serialize, Deserialize, ToSchema)]
pub(super) struct LogPage {
    /// Oldest first.
    lines: Vec<LogLine>,
}

/// The daemon's log
///
/// Its last lines, warnings and what happened to sessions, at most 500, whatever RIGD_LOG says. As long as the daemon lives; the whole log is in the
/// journal or where stderr goes.
#[utoipa::path(get, path = "/v1/log", tag = "health", params(Part), responses(
    (status = 200, body = LogPage, description = "The newest lines."),
    (status = 400, description = "A wrong query."),
))]
pub(super) async fn log(
    State(state): State<HttpState>,
    Query(part): Query<Part>,
) -> Result<axum::Json<LogPage>, Problem> {
    let (lines, after) = (part.lines.unwrap_or(200) as usize, part.after.unwrap_or(0));
    if !(1..=LINES).contains(&lines) {
        return Err(Problem::bad_request("lines: write 1 to 500"));
    }
    if after > super::events::LARGEST_SEQ {
        return Err(Problem::bad_request("after: write the seq of a line, or leave it out"));
    }
    Ok(axum::Json(LogPage { lines: state.log.after(after, lines) }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tail_is_bounded_in_lines_and_characters() {
        let tail = LogTail::default();
        for number in 1..=3 * LINES {
            tail.push(String::new(), "INFO", "here", &format!("{number}\n\u{1b}[31m{}", "x".repeat(5000)));
        }
        let all = tail.after(0, usize::MAX);
        let numbers: Vec<u64> = all.iter().map(|line| line.seq).collect();
        assert_eq!(numbers, (2 * LINES as u64 + 1..=3 * LINES as u64).collect::<Vec<_>>());
        assert!(
            all.iter().all(|line| line.text.chars().count() == CHARACTERS && !line.text.contains(char::is_control))
        );
        assert_eq!(tail.after(0, 2), all[LINES - 2..]);
        assert_eq!(tail.after(3 * LINES as u64 - 1, 500), all[LINES - 1..]);
        assert!(tail.after(u64::MAX, 500).is_empty());
    }
}
