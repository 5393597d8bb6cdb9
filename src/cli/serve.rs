//! `rigd serve`: the daemon.

use super::daemon::Daemon;
use super::error::bad_input;
use crate::session::handle::check_rig;
use anyhow::Context;
use listenfd::ListenFd;
use rig_config::Rig;
use std::io::Write;
use std::net::SocketAddr;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use tokio::signal::unix::{SignalKind, signal};

/// Run the daemon for a rig.
#[derive(clap::Args)]
pub struct Args {
    /// Rig file (see rig-config/rigs for the shipped ones).
    #[arg(long)]
    config: PathBuf,
    /// Address and port, loopback only unless there are tokens; port 0 takes any free one. Wins over the rig file.
    #[arg(long)]
    listen: Option<SocketAddr>,
    /// Directory of all sessions. Wins over the rig file.
    #[arg(long)]
    data: Option<PathBuf>,
}

/// Reads a rig file and its text; refuses also what only this program can know to be wrong.
pub fn read_rig(path: &Path) -> anyhow::Result<(Rig, String)> {
    let text = Rig::read_text(path)?;
    let rig = Rig::from_toml(&text, &path.display().to_string())?;
    check_rig(&rig.fit).map_err(|e| bad_input(format!("{}: {}", path.display(), e.reasons.join("\n"))))?;
    Ok((rig, text))
}

/// How glibc shall keep house: as it comes, each of the fit's threads keeps its own freed memory, and the daemon idles at 50 to
/// 90 MB after a session, at half of it this way. Other allocators ignore it.
const ALLOCATOR: [(&str, &str); 3] =
    [("MALLOC_ARENA_MAX", "1"), ("MALLOC_TRIM_THRESHOLD_", "131072"), ("MALLOC_MMAP_THRESHOLD_", "131072")];

/// Runs this program anew, as the same process, with [`ALLOCATOR`]: it is read only when a program starts. Comes back if that was
/// done already, here or by whoever started the daemon, or if it cannot be done.
fn keep_house() {
    if ALLOCATOR.iter().any(|(name, _)| std::env::var_os(name).is_some()) {
        return;
    }
    let Ok(program) = std::env::current_exe() else { return };
    let error = Command::new(program).args(std::env::args_os().skip(1)).envs(ALLOCATOR).exec();
    tracing::warn!(%error, "the daemon will keep more memory than it needs");
}

/// Serves until SIGINT or SIGTERM, then cleans up.
pub fn run(args: &Args) -> anyhow::Result<()> {
    keep_house();
    let (mut rig, text) = read_rig(&args.config)?;
    if let Some(listen) = args.listen {
        rig.server.listen = listen;
    }
    if let Some(data) = &args.data {
        rig.storage.data.clone_from(data);
    }
    // Before there are threads: it takes its variables out of the environment.
    let handed = ListenFd::from_env().take_tcp_listener(0).context("the socket handed over is none to listen on")?;
    runtime()?.block_on(async {
        // Listening for signals before anything is on, so that none comes too early to be cleaned up after.
        let mut interrupt = signal(SignalKind::interrupt())?;
        let mut terminate = signal(SignalKind::terminate())?;
        let daemon = Daemon::start(rig, text, Some(&args.config), handed).await?;
        let mut out = std::io::stdout();
        // Whoever started the daemon may have stopped reading; it serves all the same.
        let _ = writeln!(out, "listening on {}", daemon.url).and_then(|()| out.flush());
        tokio::select! {
            _ = interrupt.recv() => tracing::info!("SIGINT: ending"),
            _ = terminate.recv() => tracing::info!("SIGTERM: ending"),
        }
        daemon.stop().await
    })
}

/// Threads that ask the engine for requests: their questions are short, and a thousand clients at once must not mean a thousand
/// threads.
const BLOCKING_THREADS: usize = 32;

/// The async runtime of a daemon: two threads are plenty, the work happens on threads of its own.
pub fn runtime() -> anyhow::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .max_blocking_threads(BLOCKING_THREADS)
        .enable_all()
        .build()
        .context("the async runtime cannot be started")
}
