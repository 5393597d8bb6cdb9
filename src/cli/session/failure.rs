//! Why a call to the daemon failed, and what to do about it.

use crate::http::Problem;
use crate::session::state::Verb;

/// Why a call failed.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// What was asked for cannot be an address or id.
    #[error("{0}")]
    Usage(String),
    /// The daemon refused.
    #[error("{}", describe(.0))]
    Refused(Box<Problem>),
    /// No connection, or it broke.
    #[error("no answer from {base}: is the daemon running, and --url right?")]
    Unreachable {
        /// The daemon's address.
        base: String,
        /// What happened.
        source: Box<ureq::Error>,
    },
    /// Something answered that is no rigd of this version.
    #[error("{base} answered what this client does not understand ({what}): is it a rigd of the same version?")]
    Foreign {
        /// The address.
        base: String,
        /// What was wrong.
        what: String,
    },
}

impl ClientError {
    /// True when what was asked for is wrong, false when the daemon or the rig cannot do it now.
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::Usage(_) => true,
            Self::Refused(problem) => matches!(problem.status, 400 | 401 | 403 | 404 | 413 | 415 | 421 | 422),
            Self::Unreachable { .. } | Self::Foreign { .. } => false,
        }
    }

    /// What the caller of a command can do about it; nothing where the daemon's own words say it.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::Unreachable { .. } => Some(
                "`rigd serve --config rig.toml` starts a daemon (as a service: `systemctl status rigd`); one that listens elsewhere is named \
                 with --url, as its first line says",
            ),
            Self::Refused(problem) if problem.status == 401 => Some(
                "give one of this daemon's tokens, with --token-file FILE (the token and nothing else in it) or in RIGD_TOKEN; whoever set the \
                 daemon up has them (docs/operations.md)",
            ),
            Self::Usage(_) | Self::Refused(_) | Self::Foreign { .. } => None,
        }
    }
}

fn describe(problem: &Problem) -> String {
    match (&problem.reasons, &problem.allowed) {
        (Some(reasons), _) if reasons.len() > 1 => format!("{}:\n  {}", problem.title, reasons.join("\n  ")),
        (_, Some(allowed)) if allowed.is_empty() => format!("{}; nothing more can be asked of it", problem.detail),
        (_, Some(allowed)) => {
            let verbs: Vec<_> = allowed.iter().map(Verb::to_string).collect();
            format!("{}; possible now: {}", problem.detail, verbs.join(", "))
        }
        _ => problem.detail.clone(),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_problem_becomes_one_message() {
        let problem = |extra: serde_json::Value| {
            let mut body =
                serde_json::json!({"type": "t", "title": "The plan is refused", "status": 422, "detail": "d"});
            body.as_object_mut().unwrap().extend(extra.as_object().unwrap().clone());
            describe(&serde_json::from_value(body).unwrap())
        };
        assert_eq!(problem(serde_json::json!({})), "d");
        assert_eq!(problem(serde_json::json!({"reasons": ["a", "b"]})), "The plan is refused:\n  a\n  b");
        assert_eq!(problem(serde_json::json!({"allowed": ["stop", "abort"]})), "d; possible now: stop, abort");
    }
}
