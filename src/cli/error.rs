//! Exit statuses (CONTRACT.md): 0 done, 1 the work failed, 2 wrong usage or bad input.

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
    let broken_pipe = |cause: &(dyn std::error::Error + 'static)| {
        cause.downcast_ref::<std::io::Error>().is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
    };
    if error.chain().any(broken_pipe) {
        return ExitCode::SUCCESS;
    }
    eprintln!("error: {error:#}");
    if error.chain().any(|cause| cause.is::<BadInput>()) { ExitCode::from(2) } else { ExitCode::from(1) }
}
