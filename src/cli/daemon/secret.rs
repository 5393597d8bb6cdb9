//! Files that hold secrets.

use crate::store::files::check_regular;
use std::fs::File;
use std::io::Read;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

/// Largest file read, bytes: a few hundred tokens.
const LARGEST: u64 = 64 << 10;

/// The text of a file of secrets.
///
/// # Errors
/// It cannot be read, or everyone on this machine may; never with what it holds.
pub fn read(path: &Path) -> Result<String, String> {
    check_regular(path, "file of secrets")?;
    let file = File::open(path).map_err(|e| format!("cannot be opened: {e}"))?;
    let mode = file.metadata().map_err(|e| e.to_string())?.permissions().mode();
    if mode & 0o007 != 0 {
        return Err("everyone on this machine may use it: `chmod o= FILE`".into());
    }
    let mut text = String::new();
    file.take(LARGEST).read_to_string(&mut text).map_err(|e| format!("cannot be read: {e}"))?;
    Ok(text)
}
