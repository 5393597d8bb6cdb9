//! glTF 2.0, by the crate `gltf`: the triangles of the default scene, every node where its transformations put it.

use super::{MeshFileError, check_room, cut};
use crate::numerics::geometry::Vec3;
use crate::numerics::render::mesh::{MeshError, Parts};
use crate::pipeline::contain::contained;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use gltf::accessor::{DataType, Dimensions};
use gltf::buffer::Source;
use gltf::mesh::Mode;
use gltf::{Gltf, Node, Primitive, Semantic};
use nalgebra::{Matrix3, Matrix4, Point3};
use percent_encoding::percent_decode_str;
use std::panic::AssertUnwindSafe;

/// Gives the bytes of a file by its name relative to the mesh's, or says why not.
pub type Open<'a> = &'a dyn Fn(&str) -> Result<Vec<u8>, String>;

/// All surfaces of the default scene.
pub fn read(bytes: &[u8], open: Open<'_>) -> Result<Parts, MeshFileError> {
    check_description(bytes)?;
    let parsed = contained(|| Gltf::from_slice(bytes)).ok_or_else(gave_up)?;
    let gltf = parsed.map_err(|error| unreadable(error.to_string()))?;
    let buffers = buffers(&gltf, open)?;
    contained(AssertUnwindSafe(|| gather(&gltf, &buffers))).unwrap_or_else(|| Err(gave_up()))
}

fn unreadable(reason: impl Into<String>) -> MeshFileError {
    MeshFileError::Unreadable { format: "glTF", reason: cut(reason.into()) }
}

fn gave_up() -> MeshFileError {
    unreadable("the decoder gave up")
}

fn unsupported(what: impl Into<String>) -> MeshFileError {
    MeshFileError::Unsupported { what: what.into() }
}

/// Most objects of a description: nodes, meshes, accessors, materials. Each takes a hundred times its text in memory.
const MOST_OBJECTS: usize = 1 << 18;

/// Counts the objects of the description before memory is taken for them; text may hold a brace as well.
fn check_description(bytes: &[u8]) -> Result<(), MeshFileError> {
    let description = match bytes {
        [b'g', b'l', b'T', b'F', _, _, _, _, _, _, _, _, a, b, c, d, _, _, _, _, rest @ ..] => {
            let length = u32::from_le_bytes([*a, *b, *c, *d]) as usize;
            &rest[..length.min(rest.len())]
        }
        whole => whole,
    };
    let objects = description.iter().filter(|&&byte| byte == b'{').count();
    if objects > MOST_OBJECTS {
        return Err(unsupported(format!("its description has {objects} objects, more than {MOST_OBJECTS}")));
    }
    Ok(())
}

/// Most bytes of all buffers together: those of the largest mesh several times over.
const MOST_BYTES: usize = 1 << 29;

/// The numbers that the description speaks of.
fn buffers(gltf: &Gltf, open: Open<'_>) -> Result<Vec<Vec<u8>>, MeshFileError> {
    let mut inside = gltf.blob.clone();
    let (mut buffers, mut total) = (Vec::new(), 0);
    for buffer in gltf.buffers() {
        let (name, bytes) = match buffer.source() {
            Source::Bin => ("inside the file", inside.take().ok_or_else(|| "it is missing".to_owned())),
            Source::Uri(uri) => match uri.strip_prefix("data:") {
                Some(data) => ("in the description", embedded(data)),
                None => (uri, decoded(uri).and_then(|name| open(&name))),
            },
        };
        let refused =
            |reason| MeshFileError::Buffer { buffer: format!("{} ({})", buffer.index(), cut(name.to_owned())), reason };
        let bytes = bytes.map_err(refused)?;
        if bytes.len() < buffer.length() {
            let reason = format!("{} bytes where {} are described: copy the files again", bytes.len(), buffer.length());
            return Err(refused(reason));
        }
        total += bytes.len();
        if total > MOST_BYTES {
            return Err(refused(format!("with it there are more than {MOST_BYTES} bytes: simplify the mesh")));
        }
        buffers.push(bytes);
    }
    Ok(buffers)
}

/// The name that an address stands for (glTF 2.0, 3.6.1.1; RFC 3986): `my%20buffer.bin`, `./buffer.bin`.
fn decoded(uri: &str) -> Result<String, String> {
    let name = percent_decode_str(uri.strip_prefix("./").unwrap_or(uri)).decode_utf8();
    name.map(Into::into).map_err(|_| "its address is not UTF-8: rename it".to_owned())
}

fn embedded(data: &str) -> Result<Vec<u8>, String> {
    let encoded = data.split_once(";base64,").map(|(_, encoded)| encoded);
    let encoded = encoded.ok_or("its data are not base64: export the mesh again")?;
    STANDARD.decode(encoded).map_err(|error| format!("its base64 is damaged ({error}): export the mesh again"))
}

fn gather(gltf: &Gltf, buffers: &[Vec<u8>]) -> Result<Parts, MeshFileError> {
    let scene = gltf.default_scene().or_else(|| gltf.scenes().next());
    let scene = scene.ok_or_else(|| unsupported("it has no scene"))?;
    let mut parts = Parts::default();
    let mut met = vec![false; gltf.nodes().len()];
    let mut waiting: Vec<(Node<'_>, Matrix4<f64>)> = scene.nodes().map(|node| (node, Matrix4::identity())).collect();
    while let Some((node, above)) = waiting.pop() {
        if std::mem::replace(&mut met[node.index()], true) {
            return Err(unreadable(format!("node {} hangs on two others, or on itself", node.index())));
        }
        let own = Matrix4::from(node.transform().matrix()).map(f64::from);
        let here = above * own;
        for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
            parts.append(surface(&primitive, &here, buffers)?)?;
        }
        waiting.extend(node.children().map(|child| (child, here)));
    }
    Ok(parts)
}

fn surface(primitive: &Primitive<'_>, here: &Matrix4<f64>, buffers: &[Vec<u8>]) -> Result<Parts, MeshFileError> {
    if primitive.mode() != Mode::Triangles {
        return Err(unsupported(format!("a part of it is {:?}", primitive.mode())));
    }
    check_counts(primitive)?;
    let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(Vec::as_slice));
    let outside = || unreadable("numbers that it speaks of lie outside their buffer");
    let positions: Vec<Vec3> = reader.read_positions().ok_or_else(outside)?.map(vector).collect();
    let normals: Vec<Vec3> = match primitive.get(&Semantic::Normals) {
        Some(_) => reader.read_normals().ok_or_else(outside)?.map(vector).collect(),
        None => Vec::new(),
    };
    let uv: Vec<[f64; 2]> = match primitive.get(&Semantic::TexCoords(0)) {
        Some(_) => {
            let read = reader.read_tex_coords(0).ok_or_else(outside)?;
            read.into_f32().map(|uv| uv.map(f64::from)).collect()
        }
        None => Vec::new(),
    };
    let indices: Vec<u32> = match primitive.indices() {
        Some(_) => reader.read_indices().ok_or_else(outside)?.into_u32().collect(),
        None => (0..positions.len() as u32).collect(),
    };
    Ok(Parts {
        positions: positions.iter().map(|position| here.transform_point(&Point3::from(*position)).coords).collect(),
        normals: turned(&normals, here),
        uv,
        triangles: indices.as_chunks().0.to_vec(),
    })
}

/// Normals under a transformation; none where it has no inverse.
fn turned(normals: &[Vec3], here: &Matrix4<f64>) -> Vec<Vec3> {
    let linear: Matrix3<f64> = here.fixed_view::<3, 3>(0, 0).into();
    let turn = linear.try_inverse().map(|inverse| inverse.transpose());
    turn.map_or(Vec::new(), |turn| normals.iter().map(|normal| turn * normal).collect())
}

fn vector(v: [f32; 3]) -> Vec3 {
    Vec3::from(v.map(f64::from))
}

/// What is described must fit in memory, and be three numbers where three are read.
fn check_counts(primitive: &Primitive<'_>) -> Result<(), MeshFileError> {
    let corners = primitive.indices().map_or(0, |accessor| accessor.count());
    check_room(corners / 3, 0)?;
    for (semantic, accessor) in primitive.attributes() {
        check_room(0, accessor.count())?;
        let three = matches!(semantic, Semantic::Positions | Semantic::Normals);
        if three && (accessor.data_type(), accessor.dimensions()) != (DataType::F32, Dimensions::Vec3) {
            return Err(unreadable(format!("its {semantic:?} are not three single-precision numbers a vertex")));
        }
    }
    let empty = primitive.attributes().any(|(_, accessor)| accessor.count() == 0);
    if empty || primitive.indices().is_some_and(|accessor| accessor.count() == 0) {
        Err(MeshError::Empty.into())
    } else {
        Ok(())
    }
}
