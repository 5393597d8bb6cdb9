//! `rigd doctor`: finds what would keep a session from running, before the night.

pub mod clock;
pub mod data;
mod devices;

use super::daemon;
use super::error::{print_json, print_line};
use super::on_rig::OnRig;
use super::terminal::Tone;
use crate::devices::inspect::{Finding, Grade, Host};
use crate::store::RealDisk;
use crate::store::files::escaped;
use rig_config::{CameraDriver, Rig};

/// Find what would keep a session from running: devices and who holds them, permissions, camera mode and worker, disk, clock.
///
/// The arm shakes hands and the camera is opened where nobody else holds them; the motor is not turned, the lamp not switched on.
/// Exit status: 0 all well (warnings allowed), 1 something keeps a session from running, 2 wrong usage or a bad rig file.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    on: OnRig,
    /// Print the findings as a JSON array and nothing else.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let rig = match args.on.read() {
        Ok(rig) => rig,
        Err(error) => {
            if args.json {
                let remedy = "correct the rig file; `rigd config show zheng-2008` explains the keys";
                print(&[Finding::error(args.on.config.display(), format!("{error:#}"), remedy)], true)?;
            }
            return Err(error);
        }
    };
    let mut findings = vec![Finding::ok(args.on.config.display(), format!("sound ({})", rig.name))];
    findings.extend(examine(&Host::this(), &rig)?);
    print(&findings, args.json)?;
    match findings.iter().filter(|finding| finding.grade == Grade::Error).count() {
        0 => Ok(()),
        errors => anyhow::bail!("{errors} of {} findings keep a session from running", findings.len()),
    }
}

/// Everything but the rig file itself.
fn examine(host: &Host, rig: &Rig) -> anyhow::Result<Vec<Finding>> {
    let daemon_there = data::holder(host, &rig.storage.data);
    // Dropping an arm switches its lamp off: not that of a session that another daemon may be about to start.
    let may_open = daemon_there.is_none();
    let (mut open_arm, mut open_camera) = daemon::devices(rig)?;
    let mut findings = devices::arm(host, rig, may_open.then_some(&mut open_arm));
    match &rig.camera.driver {
        CameraDriver::Gphoto2 { .. } => {
            let frames = rig.plan.stations_deg.len() * rig.plan.exposures.len();
            findings.extend(devices::gphoto2(host, rig, frames, may_open)?);
        }
        CameraDriver::Replay { .. } | CameraDriver::Simulated => {
            findings.push(devices::plain_camera(rig, &mut open_camera));
        }
    }
    findings.push(data::room(host, rig, &RealDisk));
    findings.extend(data::memory(host, rig));
    findings.extend(daemon_there);
    findings.push(clock::look(host, jiff::Timestamp::now()));
    if let Err(reason) = daemon::tls::load(&rig.server) {
        findings.push(Finding::warning("server", reason, "rigd serve refuses to start"));
    }
    if let Err(reason) = daemon::notify::targets(rig) {
        findings.push(Finding::warning(
            "notify",
            reason,
            "`rigd notify` sends a test message; rigd serve refuses to start",
        ));
    }
    Ok(findings)
}

fn print(findings: &[Finding], json: bool) -> anyhow::Result<()> {
    if json {
        return print_json(&findings);
    }
    for Finding { grade, what, place, remedy } in findings {
        let (grade, tone) = match grade {
            Grade::Ok => ("ok", Tone::Good),
            Grade::Warning => ("warning", Tone::Doubtful),
            Grade::Error => ("error", Tone::Bad),
        };
        let grade = tone.out(format!("{grade:8}"));
        // Names of devices and programs are other people's: their control characters must not reach the terminal.
        print_line(format!("{grade} {}: {}", escaped(place), escaped(what)))?;
        if let Some(remedy) = remedy {
            print_line(format!("{:8} {}", "", Tone::Advice.out(format!("-> {}", escaped(remedy)))))?;
        }
    }
    Ok(())
}
