//! The memory that is left, beside the room on the disk.

use std::io;
use std::path::Path;

/// Memory that can be had without swapping, bytes, as the kernel counts it below `proc` (`/proc`); a container's limit is not seen.
///
/// # Errors
/// The file `meminfo` cannot be read or does not tell.
pub fn available(proc: &Path) -> io::Result<u64> {
    let text = std::fs::read_to_string(proc.join("meminfo"))?;
    parse(&text).ok_or_else(|| io::Error::other("meminfo does not tell MemAvailable"))
}

/// The figure of `/proc/meminfo`, which counts in KiB.
fn parse(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn available_memory_is_read_in_bytes_or_not_at_all() {
        assert_eq!(parse("MemFree: 1 kB\nMemAvailable:   24208384 kB\nBuffers: 3 kB\n"), Some(24_208_384 * 1024));
        assert_eq!(parse("MemFree: 1 kB\n"), None);
        assert_eq!(parse("MemAvailable: many kB\n"), None);
        assert_eq!(parse("MemAvailable: 18446744073709551615 kB\n"), None);
    }
}
