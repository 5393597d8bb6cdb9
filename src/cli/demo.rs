//! `rigd demo`: both simulated balls, captured through the daemon's own REST surface, fitted, and held against the truth; with
//! `--calibrate` after a calibration of a rig whose file does not know the truth.

mod calibration;
pub mod truth;

use super::daemon::Daemon;
use super::error::print_line;
use super::progress::Progress;
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
    /// Calibrate first: with board, card and balls on the simulated stage, a rig whose file states camera, lamp and object only
    /// roughly. Nothing but the radius of the balls, board and card is known.
    #[arg(long)]
    calibrate: bool,
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
        for (index, ball) in balls.into_iter().enumerate() {
            let rig = rig(ball, args)?;
            if args.calibrate {
                // Both balls use one data directory, and with it one calibration.
                for earlier in daemons.drain(..) {
                    Daemon::stop(earlier).await?;
                }
            }
            let daemon = Daemon::start(rig.0.clone(), rig.1.clone(), None, None).await?;
            let url = daemon.url.clone();
            daemons.push(daemon);
            let first = args.calibrate && index == 0;
            let demonstrated = move || {
                let calibrated = if first { Some(calibrated(&rig.0, &url)?) } else { None };
                let (verdict, page) = acquire(ball, &rig.0, &url)?;
                Ok(Demonstrated { recovered: verdict.recovered(), calibrated, page: (ball, page) })
            };
            let shot = tokio::task::spawn_blocking(demonstrated);
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
        let pages: Vec<&(Ball, String)> = verdicts.iter().flatten().map(|shown| &shown.page).collect();
        if args.keep && pages.len() == verdicts.len() {
            show(&pages, args.calibrate);
            interrupt.recv().await;
        } else if !args.keep {
            say("with --keep the daemon stays, and its page shows the result");
        }
        for daemon in daemons {
            daemon.stop().await?;
        }
        let verdicts = verdicts.into_iter().collect::<anyhow::Result<Vec<Demonstrated>>>()?;
        if verdicts.iter().any(|verdict| !verdict.recovered) {
            bail!("the material was not recovered: see the lines marked with ! above");
        }
        if verdicts.iter().any(|verdict| verdict.calibrated == Some(false)) {
            bail!("the calibration missed its limits: see the lines marked with ! above");
        }
        Ok(())
    })
}

/// Whether one ball's material, and the calibration before it, kept their limits.
struct Demonstrated {
    recovered: bool,
    calibrated: Option<bool>,
    page: (Ball, String),
}

/// Calibrates and prints the comparison; whether its limits hold.
fn calibrated(rig: &Rig, url: &str) -> anyhow::Result<bool> {
    let begin = Instant::now();
    let found = calibration::calibrate(url)?;
    let compared = calibration::Calibrated::compare(rig, &found)?;
    let _ = compared.print(&mut std::io::stdout().lock());
    say(format!("calibrated in {:.0} s", begin.elapsed().as_secs_f64()));
    Ok(compared.holds())
}

/// Where to look, last of all, so that it is seen. Of two calibrated balls the last one's daemon runs and knows both.
fn show(pages: &[&(Ball, String)], one_daemon: bool) {
    say("\nopen the result in a browser:");
    let last = pages.last().map_or("", |(_, page)| page.split('#').next().unwrap_or_default());
    for (ball, page) in pages {
        let view = page.split_once('#').map_or("", |(_, view)| view);
        say(format!("  {:7} {}", ball.name(), if one_daemon { format!("{last}#{view}") } else { page.clone() }));
    }
    say("Ctrl-C ends it");
}

/// A line for whoever reads along; the demo goes on, and cleans up, without a reader.
fn say(line: impl Display) {
    let _ = print_line(line);
}

/// Relighting must be this good, mean relative error: with the geometry known, and with it measured.
const RELIGHT_LIMIT: f64 = 0.03;
const RELIGHT_LIMIT_CALIBRATED: f64 = 0.015;

/// The shipped simulated rig with this ball, on a free port, with its sessions under `--data`.
fn rig(ball: Ball, args: &Args) -> anyhow::Result<(Rig, String)> {
    let shipped = if args.calibrate { "simulated-calibration" } else { "simulated" };
    let (_, text) =
        rig_config::SHIPPED.iter().find(|(name, _)| *name == shipped).context("the simulated rig is not shipped")?;
    let text = text.replace("scene = \"marble\"", &format!("scene = \"{}\"", ball.name()));
    let mut rig = Rig::from_toml(&text, &format!("rigs/{shipped}.toml"))?;
    rig.server.listen.set_port(0);
    rig.storage.data = args.data.join(if args.calibrate { "calibrated" } else { ball.name() });
    match &rig.simulation {
        Some(simulation) if simulation.scene == ball.scene() => Ok((rig, text)),
        _ => bail!("rigs/{shipped}.toml does not name its scene as expected"),
    }
}

/// One acquisition over REST, from the start request to the comparison; and the address at which the daemon's page shows it.
fn acquire(ball: Ball, rig: &Rig, url: &str) -> anyhow::Result<(Verdict, String)> {
    let client = Client::new(url, None)?;
    let request = StartRequest { name: Some(format!("simulated {} ball", ball.name())), ..StartRequest::default() };
    let started = client.start(&request)?;
    say(format!("{} ball: {} frames, session {} at {url}", ball.name(), started.frames_planned, started.id));
    let ended = watch(&client, &started.id, &Progress::counted("frames"))?;
    if ended.state != SessionState::Completed {
        bail!("session {} {}", started.id, how_it_ended(&ended));
    }
    let directory = rig.storage.data.join("sessions").join(&started.id).join("result");
    let stored = result::read_material(&directory)?;
    let error = ended.mean_relative_error.context("the session has no fit")?;
    let hidden = rig.simulation.as_ref().is_some_and(|simulation| simulation.hidden);
    let relight_limit = if hidden { RELIGHT_LIMIT_CALIBRATED } else { RELIGHT_LIMIT };
    let verdict = compare(rig, &stored, error, (ball.papers_error(), relight_limit))?;
    let _ = verdict.print(&mut std::io::stdout().lock());
    say(format!("result in {}", directory.display()));
    Ok((verdict, format!("{url}/#/results/{}", started.id)))
}
