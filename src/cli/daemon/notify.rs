//! Whom the rig file's `[notify]` names.

use super::secret;
use crate::notify::Target;
use crate::store::files::shown;
use nix::unistd::{AccessFlags, access};
use rig_config::Rig;
use std::path::PathBuf;

/// Everyone who is told; empty when the rig file names nobody.
///
/// # Errors
/// A file that holds no address or may be read by everyone, or a mail program that is not there; never with what a file holds.
pub fn targets(rig: &Rig) -> Result<Vec<Target>, String> {
    let Some(notify) = &rig.notify else { return Ok(Vec::new()) };
    let mut targets = Vec::new();
    for (key, file, target) in [
        ("webhook_file", &notify.webhook_file, Target::Webhook as fn(_) -> Target),
        ("ntfy_file", &notify.ntfy_file, Target::Ntfy as fn(_) -> Target),
    ] {
        let Some(path) = file else { continue };
        let address = secret::read(path).and_then(|text| Target::address(&text));
        targets.push(target(address.map_err(|what| format!("notify.{key}: {}: {what}", shown(path)))?));
    }
    if let Some(to) = notify.mail_to.clone() {
        let sendmail: PathBuf = notify.sendmail.clone();
        access(&sendmail, AccessFlags::X_OK).map_err(|error| {
            format!("notify.sendmail: {}: {error}: install a mail program, or name the one there is", shown(&sendmail))
        })?;
        targets.push(Target::Mail { to, sendmail });
    }
    Ok(targets)
}
