//! Mesh files, with those beside them that a .gltf speaks of.

use super::files::{read_bytes, shown};
use crate::numerics::render::mesh::Mesh;
use crate::pipeline::mesh::{self, Format};
use std::cell::RefCell;
use std::path::{Component, Path, PathBuf};

/// Largest file read, bytes: two million triangles as text.
const LARGEST: u64 = 256 << 20;

/// Why there is no mesh.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {reason}")]
pub struct MeshInputError {
    /// The file.
    pub path: String,
    /// What is wrong and what to do.
    pub reason: String,
}

/// A mesh, and the files it was read from.
pub struct StoredMesh {
    /// The mesh.
    pub mesh: Mesh,
    /// The files.
    pub files: Vec<PathBuf>,
}

/// Reads a mesh; its ending tells the format.
///
/// # Errors
/// The file, or one that it speaks of, cannot be read or holds no mesh that can be shown.
pub fn read(path: &Path) -> Result<StoredMesh, MeshInputError> {
    let refuse = |reason: String| MeshInputError { path: shown(path), reason };
    let format = path.extension().and_then(|ending| Format::of(&ending.to_string_lossy()));
    let format = format.ok_or_else(|| refuse("a mesh has a name that ends in .obj, .gltf or .glb".to_owned()))?;
    let bytes = read_bytes(path, "mesh", LARGEST).map_err(refuse)?;
    let files = RefCell::new(vec![path.to_owned()]);
    let open = |name: &str| {
        let beside = beside(path, name)?;
        let bytes = read_bytes(&beside, "buffer", LARGEST)?;
        files.borrow_mut().push(beside);
        Ok(bytes)
    };
    let mesh = mesh::read(format, &bytes, &open).map_err(|e| refuse(e.to_string()))?;
    Ok(StoredMesh { mesh, files: files.into_inner() })
}

/// The file of this name beside a mesh, or in a folder there: a mesh of unknown origin must not reach for others.
fn beside(mesh: &Path, name: &str) -> Result<PathBuf, String> {
    let relative = Path::new(name);
    if name.is_empty() || !relative.components().all(|part| matches!(part, Component::Normal(_))) {
        return Err("it must be a file beside the mesh, or in a folder there, named without detours".to_owned());
    }
    Ok(mesh.with_file_name(name))
}
