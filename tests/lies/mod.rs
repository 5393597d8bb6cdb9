//! Boards that lie, behind a port.
#![allow(dead_code, clippy::unwrap_used)]

pub mod grbl;
pub mod rigproto;

use std::io::{Read, Write};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// A board: hears bytes, answers bytes.
pub trait Board: Send {
    fn hear(&mut self, byte: u8) -> Vec<u8>;
}

/// A running board behind a port.
pub struct Peer {
    folder: tempfile::TempDir,
    heard: Arc<Mutex<Vec<String>>>,
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Peer {
    /// `make` is handed the list of what the board hears.
    pub fn new<B: Board + 'static>(make: impl FnOnce(Arc<Mutex<Vec<String>>>) -> B) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (heard, end) = (Arc::new(Mutex::new(Vec::new())), Arc::new(AtomicBool::new(false)));
        let (mut port, mut board, stop) =
            (crate::line::appear(&folder.path().join("arm")), make(heard.clone()), end.clone());
        let run = move || {
            let mut buffer = [0; 256];
            while !stop.load(Ordering::SeqCst) {
                match port.read(&mut buffer) {
                    Ok(count) => {
                        let said: Vec<u8> = buffer[..count].iter().flat_map(|byte| board.hear(*byte)).collect();
                        let _ = port.write_all(&said);
                    }
                    Err(_) => thread::sleep(Duration::from_millis(2)),
                }
            }
        };
        Self { folder, heard, end, thread: Some(thread::spawn(run)) }
    }

    pub fn port(&self) -> PathBuf {
        self.folder.path().join("arm")
    }

    /// What it heard that starts so.
    pub fn heard(&self, start: &str) -> Vec<String> {
        self.heard.lock().unwrap().iter().filter(|line| line.starts_with(start)).cloned().collect()
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        self.end.store(true, Ordering::SeqCst);
        let _ = self.thread.take().unwrap().join();
    }
}
