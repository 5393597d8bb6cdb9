//! A file written behind the back of whoever makes its bytes: in aligned blocks, by a thread of its own, so that the next rows are
//! merged meanwhile.

use std::fs::File;
use std::io::{Error, Result, Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::thread::{Builder, JoinHandle};

/// Bytes of a block; blocks begin at multiples of it. Larger ones make the page cache take larger pages, which a virtual machine may
/// first have to get from its host: up to three times the processor time from 128 KiB on.
const BLOCK: usize = 32 << 10;
/// Blocks that may wait.
const WAITING: usize = 32;

/// Bytes and where they go.
type Block = (u64, Vec<u8>);

/// The writer. What it was given is only in the file after [`Behind::finish`].
pub(super) struct Behind {
    full: SyncSender<Block>,
    empty: Receiver<Vec<u8>>,
    thread: JoinHandle<Result<()>>,
    /// Bytes not handed over yet, and the place of the first.
    bytes: Vec<u8>,
    at: u64,
}

impl Behind {
    /// Starts writing `file` from its begin.
    pub fn new(file: File) -> Result<Self> {
        let (full, blocks) = sync_channel::<Block>(WAITING);
        let (give_back, empty) = channel();
        let write = move || {
            for (at, mut bytes) in blocks {
                file.write_all_at(&bytes, at)?;
                bytes.clear();
                // Nobody wants it after the last block.
                let _ = give_back.send(bytes);
            }
            Ok(())
        };
        let thread = Builder::new().name("exr".to_owned()).spawn(write)?;
        Ok(Self { full, empty, thread, bytes: Vec::with_capacity(BLOCK), at: 0 })
    }

    /// Waits until everything is written, and says what went wrong.
    pub fn finish(mut self) -> Result<()> {
        let handed_over = self.flush();
        drop(self.full);
        // Why the thread stopped tells more than that it did.
        self.thread.join().unwrap_or_else(|_| Err(Error::other("the thread that writes the file failed")))?;
        handed_over
    }

    fn end(&self) -> u64 {
        self.at + self.bytes.len() as u64
    }
}

impl Write for Behind {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        let room = BLOCK - (self.end() % BLOCK as u64) as usize;
        let taken = &bytes[..room.min(bytes.len())];
        self.bytes.extend_from_slice(taken);
        if taken.len() == room {
            self.flush()?;
        }
        Ok(taken.len())
    }

    fn flush(&mut self) -> Result<()> {
        if self.bytes.is_empty() {
            return Ok(());
        }
        let next = self.empty.try_recv().unwrap_or_else(|_| Vec::with_capacity(BLOCK));
        let (at, end) = (self.at, self.end());
        let full = std::mem::replace(&mut self.bytes, next);
        self.at = end;
        self.full.send((at, full)).map_err(|_| Error::other("the file is not written any more"))
    }
}

impl Seek for Behind {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        let SeekFrom::Start(at) = to else { return Err(Error::other("only places from the begin are known")) };
        self.flush()?;
        self.at = at;
        Ok(at)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn blocks_of_any_size_and_a_jump_back_come_out_as_if_written_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let bytes: Vec<u8> = (0..3 * BLOCK + 77).map(|i| (i * 7 + i / 251) as u8).collect();
        let mut behind = Behind::new(File::create(&path).unwrap()).unwrap();
        let mut rest = &bytes[..];
        for size in [1, 2 * BLOCK + 3, 100, BLOCK, usize::MAX] {
            let (next, others) = rest.split_at(size.min(rest.len()));
            behind.write_all(next).unwrap();
            rest = others;
        }
        behind.seek(SeekFrom::Start(5)).unwrap();
        behind.write_all(b"again").unwrap();
        behind.finish().unwrap();
        let mut wanted = bytes.clone();
        wanted[5..10].copy_from_slice(b"again");
        assert!(std::fs::read(&path).unwrap() == wanted);
    }

    #[test]
    fn what_the_system_says_of_a_write_is_passed_on() {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let mut behind = Behind::new(full).unwrap();
        let written = behind.write_all(&vec![1; 4 * WAITING * BLOCK]);
        assert!(written.is_err(), "writing went on after the thread had failed");
        let reason = behind.finish().unwrap_err();
        assert_eq!(reason.raw_os_error(), Some(28), "{reason}");
    }
}
