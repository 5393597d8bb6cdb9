//! The firmware in real time behind a pseudo terminal, for trying a host against it: prints the port, ends with its input.

use arm_logic::rig;
use arm_sim::{Board, Pty, World};
use firmware_protocol::caps;
use std::io::{self, Read};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Where the arm stands at the start, steps above the edge: nowhere in particular.
const START: i64 = 2345;

static INPUT_ENDED: AtomicBool = AtomicBool::new(false);

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("arm-sim: no pseudo terminal: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> io::Result<()> {
    let mut pty = Pty::open()?;
    println!("port {}", pty.path().display());
    thread::spawn(|| {
        let _ = io::stdin().read_to_end(&mut Vec::new());
        INPUT_ENDED.store(true, Ordering::SeqCst);
    });
    let nonce = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.subsec_nanos());
    let info = rig::info(caps::DIMMING | caps::REBOOT_DETECT, 0, nonce);
    let mut board = Board::new(World::new(&rig::SETTINGS, START, 0), rig::MECHANICS, info);
    let mut last = Instant::now();
    let mut buffer = [0; 64];
    while !INPUT_ENDED.load(Ordering::SeqCst) {
        let count = pty.read(&mut buffer, Duration::from_micros(u64::from(board.wait_us())));
        // A host that slept for hours lets the board catch up second by second.
        let passed = last.elapsed().min(Duration::from_secs(1));
        last += passed;
        board.pass(passed.as_micros() as u32);
        board.world_mut().steps.clear();
        for byte in buffer.iter().take(count) {
            if let Some(answer) = board.hear(*byte) {
                pty.write(answer.as_slice());
            }
        }
    }
    Ok(())
}
