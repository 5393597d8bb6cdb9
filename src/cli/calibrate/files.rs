//! Picture files of a calibration's folder.

use crate::store::files::read_bytes;
use std::path::Path;

/// A larger file is no camera's frame, bytes.
const MAX_FILE: u64 = 256 << 20;

/// Bytes of a picture file.
///
/// # Errors
/// It cannot be read, or is too large to be a picture.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, String> {
    read_bytes(path, "picture", MAX_FILE)
}

/// Name and bytes of every JPEG, PNG and BMP file of a folder, by name.
///
/// # Errors
/// The folder or a picture in it cannot be read, or there is none; the reason names it.
pub(super) fn pictures(folder: &Path) -> Result<Vec<(String, Vec<u8>)>, String> {
    let unreadable = |e: std::io::Error| format!("{}: {e}: give a folder of photographs", folder.display());
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        if ["jpg", "jpeg", "png", "bmp"].contains(&ending.as_str()) {
            let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            found.push((name, read(&path).map_err(|reason| format!("{}: {reason}", path.display()))?));
        }
    }
    found.sort();
    if found.is_empty() {
        return Err(format!("{}: no .jpg, .png or .bmp file in it: give a folder of photographs", folder.display()));
    }
    Ok(found)
}
