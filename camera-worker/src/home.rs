//! The library's own memory: `$HOME/.gphoto/settings`, lines of `driver=key=value`.
//!
//! Without a line for the capture target libgphoto2 2.5.30 switches a body to its memory as soon as it is opened, and then waits
//! without end for shots to become available (camlibs/ptp2/config.c:358). So the line is written before the library reads it.

use std::fs;
use std::io;
use std::path::Path;

const KEY: &str = "ptp2=capturetarget=";

/// Makes the card the capture target that the library remembers in `home`.
pub(crate) fn remember_card(home: &Path) -> io::Result<()> {
    let directory = home.join(".gphoto");
    fs::create_dir_all(&directory)?;
    let file = directory.join("settings");
    let former = match fs::read_to_string(&file) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
        Err(error) => return Err(error),
    };
    let others = former.lines().filter(|line| !line.starts_with(KEY));
    let lines: String = others.map(|line| format!("{line}\n")).collect();
    fs::write(&file, format!("{lines}{KEY}card\n"))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn the_card_is_remembered_once_and_nothing_else_is_forgotten() {
        let home = tempfile::tempdir().unwrap();
        let file = home.path().join(".gphoto/settings");
        remember_card(home.path()).unwrap();
        assert_eq!(fs::read_to_string(&file).unwrap(), "ptp2=capturetarget=card\n");
        fs::write(&file, "gphoto2=model=X\nptp2=capturetarget=sdram\nptp2_ip=guid=00:11\n").unwrap();
        remember_card(home.path()).unwrap();
        let lines = "gphoto2=model=X\nptp2_ip=guid=00:11\nptp2=capturetarget=card\n";
        assert_eq!(fs::read_to_string(&file).unwrap(), lines);
    }
}
