//! Meshes out of files: Wavefront OBJ and glTF 2.0, as text (.gltf) and in one piece (.glb). Of both only triangles, normals
//! and texture coordinates count; materials, pictures, bones and animations are passed over.

pub mod glb;
mod gltf;
mod obj;

pub use self::gltf::Open;

use crate::numerics::render::mesh::{MAX_TRIANGLES, MAX_VERTICES, Mesh, MeshError};

/// Why a file gives no mesh.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshFileError {
    /// Not what its ending says, or damaged.
    #[error("this is no readable {format} file ({reason}): export the mesh again")]
    Unreadable {
        /// The format that its name promises.
        format: &'static str,
        /// What the decoder says.
        reason: String,
    },
    /// Something that is not supported.
    #[error("{what}: export the mesh as plain triangles")]
    Unsupported {
        /// What it is and where.
        what: String,
    },
    /// A part of the mesh in another file is missing.
    #[error("its buffer {buffer}: {reason}")]
    Buffer {
        /// Number and name of the buffer.
        buffer: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The surface itself.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

/// What a file is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Wavefront OBJ.
    Obj,
    /// glTF 2.0, as text or in one piece: its first bytes tell.
    Gltf,
}

impl Format {
    /// The format of files with this ending.
    pub fn of(ending: &str) -> Option<Self> {
        match ending.to_lowercase().as_str() {
            "obj" => Some(Self::Obj),
            "gltf" | "glb" => Some(Self::Gltf),
            _ => None,
        }
    }
}

/// The mesh in the bytes of a file; `open` gives the files beside a .gltf that hold its numbers.
///
/// # Errors
/// The file is damaged, holds something else than triangles, is too large, or its surface is refused by [`Mesh::new`].
pub fn read(format: Format, bytes: &[u8], open: Open<'_>) -> Result<Mesh, MeshFileError> {
    let parts = match format {
        Format::Obj => obj::read(bytes),
        Format::Gltf => gltf::read(bytes, open),
    };
    Ok(Mesh::new(parts?.used())?)
}

/// What a foreign file or decoder says, in a length that a message may have.
fn cut(mut words: String) -> String {
    const MOST: usize = 300;
    if let Some((end, _)) = words.char_indices().nth(MOST) {
        words.truncate(end);
        words.push_str(" ...");
    }
    words
}

/// Refuses so many triangles and vertices before memory is taken for them.
fn check_room(triangles: usize, vertices: usize) -> Result<(), MeshError> {
    if triangles > MAX_TRIANGLES || vertices > MAX_VERTICES {
        return Err(MeshError::TooLarge { triangles, vertices });
    }
    Ok(())
}
