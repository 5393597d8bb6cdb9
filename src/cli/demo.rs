//! `rigd demo`: both simulated balls, captured through the daemon's own REST surface, fitted, and held against the truth.

mod truth;

use super::daemon::Daemon;
use super::error::print_line;
use super::serve::runtime;
use super::session::{Client, how_it_ended, watch};
use crate::session::plan::StartRequest;
use crate::session::state::SessionState;
use crate::store::result;
use anyhow::{Context, bail};
use rig_config::{Rig, Scene};
use std::fmt::Display;
use std::path::PathBuf;
use std::time::Instant;
use tokio::signal::unix::{SignalKind, signal};
use truth::{Verdict, compare};

/// Capture and fit the simulated marble and wooden balls, and compare with the truth. Needs no hardware.
#[derive(clap::Args)]
pub struct Args {
    /// Which ball; both, one after the other, if left out.
    #[arg(long)]
    scene: Option<Ball>,
    /// Directory of the sessions.
    #[arg(long, default_value = "rigd-demo")]
    data: PathBuf,
    /// Leave the daemons running until Ctrl-C.
    #[arg(long)]
    keep: bool,
}

/// A simulated ball.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Ball {
    /// Veins, sharp lobes.
    Marble,
    /// Stripes, soft lobes.
    Wood,
}

impl Ball {
    fn name(self) -> &'static str {
        match self {
            Self::Marble => "marble",
            Self::Wood => "wood",
        }
    }

    fn scene(self) -> Scene {
        match self {
            Self::Marble => Scene::Marble,
            Self::Wood => Scene::Wood,
        }
    }

    /// Mean relative error the paper reports for such a ball (section 4).
    fn papers_error(self) -> f64 {
        match self {
            Self::Marble => 0.0589,
            Self::Wood => 0.0434,
        }
    }
}

/// Runs the demo; fails when a material was not recovered.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let begin = Instant::now();
    let balls = args.scene.map_or(vec![Ball::Marble, Ball::Wood], |ball| vec![ball]);
    runtime()?.block_on(async {
        let mut interrupt = signal(SignalKind::interrupt())?;
        let mut daemons = Vec::new();
        let mut verdicts = Vec::new();
        for ball in balls {
            let rig = rig(ball, args)?;
            let daemon = Daemon::start(rig.0.clone(), rig.1).await?;
            let url = daemon.url.clone();
            daemons.push(daemon);
            let shot = tokio::task::spawn_blocking(move || acquire(ball, &rig.0, &url));
            let verdict = tokio::select! {
                verdict = shot => verdict?,
                _ = interrupt.recv() => Err(anyhow::anyhow!("interrupted")),
            };
            let failed = verdict.is_err();
            verdicts.push(verdict);
            if failed {
                break;
            }
        }
        say(format!("{:.0} s in all", begin.elapsed().as_secs_f64()));
        if args.keep && verdicts.iter().all(Result::is_ok) {
            say("the daemons keep running; Ctrl-C ends them");
            interrupt.recv().await;
        }
        for daemon in daemons {
            daemon.stop().await?;
        }
        let verdicts = verdicts.into_iter().collect::<anyhow::Result<Vec<Verdict>>>()?;
        if verdicts.iter().any(|verdict| !verdict.recovered()) {
            bail!("the material was not recovered: see the lines marked with ! above");
        }
        Ok(())
    })
}

/// A line for whoever reads along; the demo goes on, and cleans up, without a reader.
fn say(line: impl Display) {
    let _ = print_line(line);
}

/// The shipped simulated rig with this ball, on a free port, with its sessions under `--data`.
fn rig(ball: Ball, args: &Args) -> anyhow::Result<(Rig, String)> {
    let shipped = rig_config::SHIPPED.iter().find(|(name, _)| *name == "simulated");
    let (_, text) = shipped.context("the simulated rig is not shipped")?;
    let text = text.replace("scene = \"marble\"", &format!("scene = \"{}\"", ball.name()));
    let mut rig = Rig::from_toml(&text, "rigs/simulated.toml")?;
    rig.server.listen.set_port(0);
    rig.storage.data = args.data.join(ball.name());
    match &rig.simulation {
        Some(simulation) if simulation.scene == ball.scene() => Ok((rig, text)),
        _ => bail!("rigs/simulated.toml does not name its scene as expected"),
    }
}

/// One acquisition over REST, from the start request to the comparison.
fn acquire(ball: Ball, rig: &Rig, url: &str) -> anyhow::Result<Verdict> {
    let client = Client::new(url)?;
    let request = StartRequest { name: Some(format!("simulated {} ball", ball.name())), ..StartRequest::default() };
    let started = client.start(&request)?;
    say(format!("{} ball: {} frames, session {} at {url}", ball.name(), started.frames_planned, started.id));
    let ended = watch(url, &started.id)?;
    if ended.state != SessionState::Completed {
        bail!("session {} {}", started.id, how_it_ended(&ended));
    }
    let directory = rig.storage.data.join("sessions").join(&started.id).join("result");
    let stored = result::read_material(&directory)?;
    let error = ended.mean_relative_error.context("the session has no fit")?;
    let verdict = compare(rig, &stored, error, ball.papers_error())?;
    let _ = verdict.print(&mut std::io::stdout().lock());
    say(format!("result in {}\nweb page  {url}/ (stays open with --keep)", directory.display()));
    Ok(verdict)
}
