//! Certificate and key of the rig file's `[server]`.

use super::secret;
use crate::http::Tls;
use crate::store::files::{read_text, shown};
use rig_config::Server;

/// What the daemon proves with who it is; none when the rig file names nothing.
///
/// # Errors
/// A file that cannot be read or holds something else, a key that everyone may read, a build without TLS; never with what a file holds.
pub fn load(server: &Server) -> Result<Option<Tls>, String> {
    let Some(files) = &server.tls else { return Ok(None) };
    let at = |key: &str, path: &std::path::Path, what: String| format!("server.{key}: {}: {what}", shown(path));
    let certificate =
        read_text(&files.certificate, "certificate").map_err(|e| at("certificate", &files.certificate, e))?;
    let key = secret::read(&files.key).map_err(|e| at("key", &files.key, e))?;
    Tls::new(certificate.as_bytes(), key.as_bytes()).map(Some)
}
