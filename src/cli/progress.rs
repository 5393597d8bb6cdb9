//! How far something long is: a bar on a terminal, lines anywhere else, both on stderr; results go to stdout.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{Write, stderr};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// What is shown of it.
pub struct Progress {
    bar: ProgressBar,
    /// Of what there are so many; nothing where they cannot be counted.
    unit: &'static str,
    /// The line that was written last, where lines are; nothing where nobody wants to see any.
    last: Option<Mutex<String>>,
}

impl Progress {
    /// So many of something countable ("frames").
    pub fn counted(unit: &'static str) -> Self {
        Self::shown(unit, &format!("[{{bar:30}}] {{pos}}/{{len}} {unit}  {{msg}}"))
    }

    /// Stages, one after the other.
    pub fn stages() -> Self {
        Self::shown("", "{spinner} {msg}")
    }

    /// For somebody who wants the result alone.
    pub fn unseen() -> Self {
        Self { bar: ProgressBar::hidden(), unit: "", last: None }
    }

    /// [`Progress::unseen`] where the result is for a program, else stages.
    pub fn stages_unless(json: bool) -> Self {
        if json { Self::unseen() } else { Self::stages() }
    }

    /// [`Progress::unseen`] where the result is for a program, else so many of something.
    pub fn counted_unless(json: bool, unit: &'static str) -> Self {
        if json { Self::unseen() } else { Self::counted(unit) }
    }

    fn shown(unit: &'static str, template: &str) -> Self {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style.progress_chars("=> "));
        }
        // No terminal, or one whose lines cannot be drawn over (TERM=dumb).
        let last = bar.is_hidden().then(Mutex::default);
        if last.is_none() {
            bar.enable_steady_tick(Duration::from_millis(100));
        }
        Self { bar, unit, last }
    }

    /// Another stage.
    pub fn stage(&self, name: &str) {
        self.bar.set_message(name.to_owned());
        self.line(name, name);
    }

    /// What the stage is at; too fast for lines.
    pub fn detail(&self, text: String) {
        self.bar.set_message(text);
    }

    /// `done` of `all`, and nothing else to say: a line at every tenth.
    pub fn count(&self, done: usize, all: usize) {
        self.set(done, all);
        let (tenth, unit) = (10 * done / all.max(1), self.unit);
        self.line(&tenth.to_string(), &format!("{done}/{all} {unit}"));
    }

    /// `done` of `all`, with what is going on, and what changes too often for lines of its own.
    pub fn counts(&self, (done, all): (usize, usize), now: &str, more: &str) {
        self.set(done, all);
        self.bar.set_message(format!("{now}{more}"));
        self.line(now, &format!("{done}/{all} {}  {now}{more}", self.unit));
    }

    /// Takes the bar away.
    pub fn end(&self) {
        self.bar.finish_and_clear();
    }

    fn set(&self, done: usize, all: usize) {
        self.bar.set_length(all as u64);
        self.bar.set_position(done as u64);
    }

    /// Writes a line if something else stands for it than for the last one.
    fn line(&self, stands: &str, line: &str) {
        let Some(last) = &self.last else { return };
        let mut last = last.lock().unwrap_or_else(PoisonError::into_inner);
        if *last != stands {
            stands.clone_into(&mut last);
            // Nothing can be done about a closed stderr.
            let _ = writeln!(stderr(), "{line}");
        }
    }
}
