//! `rigd simulate arm`: the simulated arm by itself, for other programs to talk to.

use crate::cli::error::bad_input;
use crate::sim::arm::{ArmConfig, SimulatedArm};
use crate::sim::pose::SharedPose;
use anyhow::Context;
use std::fs;
use std::io::{self, Write};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use tokio::signal::unix::{SignalKind, signal};

/// Runs the simulated arm on a PTY until SIGINT or SIGTERM.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Rig file: its [arm] gives speed and travel, its [simulation] how fast time runs.
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// Also make this symbolic link to the PTY; removed at the end.
    #[arg(long, value_name = "PATH")]
    link: Option<PathBuf>,
}

/// Prints the PTY's path as the only line of stdout, then runs until a signal ends it.
pub fn run(args: Args) -> anyhow::Result<()> {
    let rig = rig_config::Rig::read(&args.config)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        // Listening before anyone can know the path, so that no signal comes too early.
        let mut interrupt = signal(SignalKind::interrupt())?;
        let mut terminate = signal(SignalKind::terminate())?;
        let arm = SimulatedArm::spawn(ArmConfig::from_rig(&rig, SharedPose::default())).context("no PTY can be had")?;
        let _link = args.link.as_deref().map(|link| Link::make(link, arm.port(), "--link")).transpose()?;
        writeln!(io::stdout(), "{}", arm.port().display())?;
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        }
        Ok(())
    })
}

/// A symbolic link to the PTY, removed when dropped.
pub(super) struct Link<'a>(&'a Path);

impl<'a> Link<'a> {
    /// A link left by an earlier run is replaced; anything else by that name is refused.
    pub(super) fn make(link: &'a Path, target: &Path, option: &str) -> anyhow::Result<Self> {
        match fs::symlink_metadata(link) {
            Ok(found) if found.is_symlink() => fs::remove_file(link)?,
            Ok(_) => {
                let name = link.display();
                return Err(bad_input(format!(
                    "{name}: there is a file by that name: remove it or choose another {option}"
                )));
            }
            Err(_) => {}
        }
        symlink(target, link).with_context(|| format!("{}: the link cannot be made", link.display()))?;
        Ok(Self(link))
    }
}

impl Drop for Link<'_> {
    fn drop(&mut self) {
        let _ = fs::remove_file(self.0);
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;

    #[test]
    fn a_stale_link_is_replaced_and_a_file_is_not() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("arm");
        symlink("/dev/gone", &path).unwrap();
        {
            let _link = Link::make(&path, Path::new("/dev/null"), "--link").unwrap();
            assert_eq!(fs::read_link(&path).unwrap(), Path::new("/dev/null"));
        }
        assert!(fs::symlink_metadata(&path).is_err());
        fs::write(&path, "mine").unwrap();
        assert!(Link::make(&path, Path::new("/dev/null"), "--link").is_err());
        assert_eq!(fs::read_to_string(&path).unwrap(), "mine");
    }
}
