//! The file of tokens the daemon is started with: the rig file's, or the one that systemd hands over.

use super::secret;
use crate::cli::error::bad_input;
use crate::http::Tokens;
use crate::store::files::shown;
use rig_config::Server;
use std::path::{Path, PathBuf};

/// Name of the file in systemd's directory of credentials, as rigd.service has it.
const CREDENTIAL: &str = "tokens";

/// The tokens that clients need; none when neither the rig file nor systemd names a file.
///
/// # Errors
/// The file cannot be read, may be read by everyone on this machine, or holds something else; never with what it holds.
pub fn load(server: &Server) -> anyhow::Result<Tokens> {
    if let Some(path) = &server.tokens {
        let tokens = read(path).map_err(|what| bad_input(format!("server.tokens: {}: {what}", shown(path))))?;
        if tokens.is_empty() {
            return Err(bad_input(format!("server.tokens: {}: there is no token in it", shown(path))));
        }
        return Ok(tokens);
    }
    // What an installation without tokens hands over is an empty file.
    match handed_over().filter(|path| path.exists()) {
        Some(path) => read(&path).map_err(|what| bad_input(format!("credential {CREDENTIAL}: {what}"))),
        None => Ok(Tokens::default()),
    }
}

fn handed_over() -> Option<PathBuf> {
    std::env::var_os("CREDENTIALS_DIRECTORY").map(|directory| Path::new(&directory).join(CREDENTIAL))
}

fn read(path: &Path) -> Result<Tokens, String> {
    Tokens::parse(&secret::read(path)?).map_err(|e| e.to_string())
}
