//! Which directory is meant where a command takes a session or a result.

use crate::store::files::shown;
use crate::store::manifest::SESSIONS;
use std::path::{Path, PathBuf};

/// A session's directory, or any other, as it is named; DATA/ID means DATA/sessions/ID. None where there is no such directory.
pub fn directory(named: &Path) -> Option<PathBuf> {
    let in_data = || Some(named.parent()?.join(SESSIONS).join(named.file_name()?));
    if named.is_dir() { Some(named.to_owned()) } else { in_data().filter(|path| path.is_dir()) }
}

/// A dataset's directory, which a session's is as well.
///
/// # Errors
/// There is no such directory.
pub fn dataset(named: &Path) -> Result<PathBuf, String> {
    directory(named).ok_or_else(|| missing(named, "a session's directory, DATA/ID, or a folder with a dataset.toml"))
}

/// A result's directory; of a session, the one in it.
///
/// # Errors
/// There is no such directory, or a session in which nothing was fitted.
pub fn result(named: &Path) -> Result<PathBuf, String> {
    let found = directory(named)
        .ok_or_else(|| missing(named, "a directory written by `rigd fit --out`, a session's directory, or DATA/ID"))?;
    if found.join("material.json").exists() {
        return Ok(found);
    }
    let inside = found.join("result");
    if inside.join("material.json").exists() {
        return Ok(inside);
    }
    Err(format!(
        "{}: no result in it (no material.json): give a directory written by `rigd fit --out`, or a session that was fitted",
        shown(named)
    ))
}

fn missing(named: &Path, what: &str) -> String {
    format!("{}: no such directory: give {what}", shown(named))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_session_is_found_by_its_directory_and_in_the_data_directory() {
        let data = tempfile::tempdir().unwrap();
        let session = data.path().join(SESSIONS).join("7");
        std::fs::create_dir_all(session.join("result")).unwrap();
        assert_eq!(dataset(&data.path().join("7")).unwrap(), session);
        assert_eq!(dataset(&session).unwrap(), session);
        assert!(dataset(&data.path().join("8")).unwrap_err().contains("8: no such directory: give a session's"));
        for named in [data.path().join("7"), session.clone(), session.join("result")] {
            assert!(result(&named).unwrap_err().contains("no result in it"));
        }
        std::fs::write(session.join("result").join("material.json"), "{}").unwrap();
        for named in [data.path().join("7"), session.clone(), session.join("result")] {
            assert_eq!(result(&named).unwrap(), session.join("result"));
        }
    }
}
