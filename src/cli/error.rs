//! Exit statuses: 0 done, 1 the work failed, 2 wrong usage or bad input. And lines for people.

use super::merge::MergeInputError;
use super::session::ClientError;
use super::terminal::Tone;
use crate::store::files::escaped;
use rig_config::ReadError;
use serde::Serialize;
use std::error::Error;
use std::fmt::Display;
use std::io::{self, ErrorKind, Write};
use std::process::ExitCode;

/// Bad input or wrong usage: what, which file or key, what to do.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct BadInput(pub String);

/// Marks an error as bad input.
pub fn bad_input(error: impl ToString) -> anyhow::Error {
    BadInput(error.to_string()).into()
}

/// Prints a failure and gives the exit status it stands for. A closed pipe downstream is no failure.
pub fn exit_code(outcome: anyhow::Result<()>) -> ExitCode {
    let Err(error) = outcome else { return ExitCode::SUCCESS };
    let status = status(&error);
    if status != 0 {
        let mut err = io::stderr();
        // Nothing can be done about a closed stderr.
        let _ = writeln!(err, "{} {}", Tone::Bad.err("error:"), printable(&format!("{error:#}")));
        if let Some(hint) = hint(&error) {
            let _ = writeln!(err, "{} {hint}", Tone::Advice.err("hint:"));
        }
    }
    ExitCode::from(status)
}

/// What to do next, where the error is one that a command line can mend.
fn hint(error: &anyhow::Error) -> Option<&'static str> {
    error.chain().find_map(|cause| cause.downcast_ref::<ClientError>()?.hint())
}

/// Says on stderr what is worth knowing beside the result.
pub fn warn(warnings: &[String]) {
    for warning in warnings {
        // Nothing can be done about a closed stderr.
        let _ = writeln!(io::stderr(), "{} {}", Tone::Doubtful.err("warning:"), escaped(warning));
    }
}

/// Prints a value as JSON.
///
/// # Errors
/// stdout is closed or full.
pub fn print_json(value: &impl Serialize) -> anyhow::Result<()> {
    Ok(print_line(serde_json::to_string_pretty(value)?)?)
}

/// Names of files and lines of broken ones come into messages: their control characters must not reach the terminal.
fn printable(message: &str) -> String {
    message.split('\n').map(escaped).collect::<Vec<String>>().join("\n")
}

/// Exit status of a command that ends with this error.
fn status(error: &anyhow::Error) -> u8 {
    if error.chain().any(is_closed_pipe) {
        0
    } else if error.chain().any(is_bad_input) {
        2
    } else {
        1
    }
}

/// True when whoever read our output has seen enough (`| head`).
fn is_closed_pipe(cause: &(dyn Error + 'static)) -> bool {
    cause.downcast_ref::<io::Error>().is_some_and(|e| e.kind() == ErrorKind::BrokenPipe)
}

fn is_bad_input(cause: &(dyn Error + 'static)) -> bool {
    cause.is::<BadInput>()
        || cause.is::<MergeInputError>()
        || cause.is::<ReadError>()
        || cause.downcast_ref::<ClientError>().is_some_and(ClientError::is_bad_input)
}

/// Prints a line at once.
///
/// # Errors
/// stdout is closed or full.
pub fn print_line(line: impl Display) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}")?;
    out.flush()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::cli::merge::merge_folder;
    use anyhow::Context;
    use std::path::Path;

    #[test]
    fn bad_input_of_every_kind_gives_2_also_below_a_context() {
        let missing = Path::new("/nonexistent");
        let all: [anyhow::Error; 4] = [
            bad_input("x"),
            merge_folder(missing).map(|_| ()).unwrap_err().into(),
            rig_config::Rig::read(missing).unwrap_err().into(),
            ClientError::Usage("x".into()).into(),
        ];
        for error in all {
            assert_eq!(status(&error), 2, "{error}");
            assert_eq!(status(&error.context("at the first step")), 2);
        }
    }

    #[test]
    fn a_closed_pipe_is_no_failure_and_other_trouble_is() {
        let io = |kind| io::Error::from(kind);
        assert_eq!(status(&io(ErrorKind::BrokenPipe).into()), 0);
        assert_eq!(status(&Err::<(), _>(io(ErrorKind::BrokenPipe)).context("list").unwrap_err()), 0);
        assert_eq!(status(&io(ErrorKind::NotFound).into()), 1);
    }
}
