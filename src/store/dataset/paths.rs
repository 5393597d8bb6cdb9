//! The files that a dataset is made of, and which of them are one and the same.

use super::{DatasetError, Description, FILE, Object, describe};
use crate::pipeline::dataset::NamedLight;
use crate::store::files::{Identity, escaped, identity};
use std::collections::HashMap;
use std::path::{Component, Path, PathBuf};

/// Every file that reading the dataset opens, there or not: none of them may be written over.
///
/// # Errors
/// dataset.toml cannot be read.
pub fn inputs(directory: &Path) -> Result<Vec<PathBuf>, DatasetError> {
    let Description { object, mask, lights, .. } = describe(directory)?;
    let maps = match object {
        Object::Solid(_) => [None, None],
        Object::Maps { normals, positions } => [Some(normals), positions],
    };
    let beside = maps.into_iter().flatten().chain(mask).chain(lights.into_iter().map(|light| light.name));
    Ok(std::iter::once(FILE.to_owned()).chain(beside).map(|name| directory.join(name)).collect())
}

/// What tells one image from another: the file, or, where there is none, how it is called.
#[derive(PartialEq, Eq, Hash)]
enum Which {
    File(Identity),
    Name(PathBuf),
}

/// Lights that use the same file, whatever links lead there: one of them would be fitted to a picture taken under the other.
pub(super) fn used_twice(directory: &Path, lights: &[NamedLight]) -> Vec<String> {
    let which = |light: &NamedLight| match identity(&directory.join(&light.name)) {
        Some(file) => Which::File(file),
        None => Which::Name(Path::new(&light.name).components().filter(|part| *part != Component::CurDir).collect()),
    };
    let mut first: HashMap<Which, usize> = HashMap::new();
    let mut reasons = Vec::new();
    for (index, light) in lights.iter().enumerate() {
        let earlier = *first.entry(which(light)).or_insert(index);
        if earlier != index {
            reasons.push(format!(
                "lights {earlier} and {index} use the same image {}: give each light the image taken under it",
                escaped(&light.name)
            ));
        }
    }
    reasons
}
