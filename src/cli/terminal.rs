//! How words look on a terminal: the one place that knows of colours, and of where there may be none.

use anstyle::{AnsiColor, Style};
use clap::ColorChoice;
use std::env::var_os;
use std::ffi::OsStr;
use std::fmt::Display;
use std::io::{IsTerminal, stderr, stdout};

/// What a piece of text means, and with it how it looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// As text is.
    Plain,
    /// The names of a table's columns.
    Heading,
    /// All is well.
    Good,
    /// To be looked at.
    Doubtful,
    /// It failed.
    Bad,
    /// What to do, after what is wrong.
    Advice,
}

impl Tone {
    fn style(self) -> Style {
        let coloured = |colour: AnsiColor| Style::new().fg_color(Some(colour.into()));
        match self {
            Self::Plain => Style::new(),
            Self::Heading => Style::new().bold(),
            Self::Good => coloured(AnsiColor::Green),
            Self::Doubtful => coloured(AnsiColor::Yellow),
            Self::Bad => coloured(AnsiColor::Red).bold(),
            Self::Advice => coloured(AnsiColor::Cyan),
        }
    }

    /// The tone of a run's state, as journals and the REST surface spell it.
    pub fn of_state(state: &str) -> Self {
        match state {
            "completed" => Self::Good,
            "stopped" | "aborted" | "suspended" | "paused" | "awaiting" => Self::Doubtful,
            "failed" | "halted" | "interrupted" | "unreadable" => Self::Bad,
            _ => Self::Plain,
        }
    }

    /// The text as it goes to stdout.
    pub fn out(self, text: impl Display) -> String {
        self.on(text, has_colours(&stdout()))
    }

    /// The text as it goes to stderr.
    pub fn err(self, text: impl Display) -> String {
        self.on(text, has_colours(&stderr()))
    }

    /// The text, with this tone where there are colours.
    pub fn on(self, text: impl Display, colours: bool) -> String {
        let style = self.style();
        if colours { format!("{style}{text}{style:#}") } else { text.to_string() }
    }
}

/// True where text may have colours: a terminal that knows them, before somebody who has not said that he wants none.
pub fn has_colours(stream: &impl IsTerminal) -> bool {
    stream.is_terminal() && wanted_here()
}

/// What clap's own words, help and usage, are told: left to itself it also takes a build server's CI for a wish for colours.
pub fn choice() -> ColorChoice {
    if wanted_here() { ColorChoice::Auto } else { ColorChoice::Never }
}

fn wanted_here() -> bool {
    wanted(var_os("NO_COLOR").as_deref(), var_os("TERM").as_deref())
}

/// NO_COLOR counts whatever it holds, unless it holds nothing (no-color.org).
fn wanted(no_color: Option<&OsStr>, term: Option<&OsStr>) -> bool {
    no_color.is_none_or(OsStr::is_empty) && knows_codes(term)
}

fn knows_codes(term: Option<&OsStr>) -> bool {
    term.is_some_and(|term| !term.is_empty() && term != "dumb")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_for_who_wants_and_knows_them() {
        let wants = |no_color: Option<&str>, term: Option<&str>| wanted(no_color.map(OsStr::new), term.map(OsStr::new));
        assert!(wants(None, Some("xterm-256color")) && wants(Some(""), Some("xterm")));
        assert!(!wants(Some("0"), Some("xterm")) && !wants(Some("1"), Some("xterm")));
        assert!(!wants(None, Some("dumb")) && !wants(None, Some("")) && !wants(None, None));
    }

    #[test]
    fn plain_text_has_no_codes_and_a_tone_ends_where_it_began() {
        assert_eq!(Tone::Bad.on("error", false), "error");
        assert_eq!(Tone::Plain.on("text", true), "text");
        let bad = Tone::Bad.on("error", true);
        assert!(bad.starts_with("\u{1b}[") && bad.ends_with("error\u{1b}[0m"), "{bad:?}");
    }
}
