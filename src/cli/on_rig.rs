//! The rig and the sessions of a command that runs beside the daemon or in its place.

use super::serve::read_rig;
use rig_config::Rig;
use std::path::PathBuf;

/// Arguments that say which.
#[derive(clap::Args, Debug)]
pub struct OnRig {
    /// Rig file.
    #[arg(long)]
    pub config: PathBuf,
    /// Directory of all sessions, as for rigd serve. Wins over the rig file.
    #[arg(long)]
    data: Option<PathBuf>,
}

impl OnRig {
    /// The rig, with the data directory that is meant.
    ///
    /// # Errors
    /// A rig file that is refused.
    pub fn read(&self) -> anyhow::Result<Rig> {
        let (mut rig, _) = read_rig(&self.config)?;
        if let Some(data) = &self.data {
            rig.storage.data.clone_from(data);
        }
        Ok(rig)
    }
}
