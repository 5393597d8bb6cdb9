//! Damaged mesh files: every answer is a mesh or a reason. The random numbers are seeded, so a failure repeats.

use crate::meshes::{INDEXED, triangle};
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use rigd::numerics::render::tree::Tree;
use rigd::pipeline::mesh::{Format, read};

const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\nvt 0 0\nvt 1 0.5\nvn 0 0 1\no a\nf 1/1/1 2/2/1 3/1/1\nf 2/1 -1/2 3/2\ng b\nf 1 2 3 4\n";

fn mutated(random: &mut Xoshiro256PlusPlus, seed: &[u8]) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..random.random_range(1..6) {
        let at = random.random_range(0..bytes.len());
        match random.random_range(0..6) {
            0 => bytes[at] = random.random(),
            1 => bytes[at] = b"0123456789-.e/ \n{}[],:"[random.random_range(0..22)],
            2 => bytes[at] ^= 1 << random.random_range(0..8),
            3 => {
                let end = random.random_range(at..=bytes.len().min(at + 24));
                let piece = bytes[at..end].to_vec();
                bytes.splice(at..at, piece);
            }
            4 => {
                let number = ["99999999999", "-1", "1e39", "nan", "4294967295"][random.random_range(0..5)];
                bytes.splice(at..at + 1, number.bytes());
            }
            _ => bytes.truncate(at.max(1)),
        }
    }
    bytes
}

#[test]
fn a_damaged_mesh_is_a_mesh_or_a_reason() {
    let gltf = triangle(INDEXED, r#"[{"mesh": 0, "rotation": [0, 0, 1, 0]}]"#, 3);
    for (format, seed) in [(Format::Obj, OBJ), (Format::Gltf, &gltf)] {
        assert!(read(format, seed.as_bytes(), &|_| Err(String::new())).is_ok());
        let (mut meshes, mut reasons) = (0, 0);
        for number in 0..3000 {
            let mut random = Xoshiro256PlusPlus::seed_from_u64(number);
            let bytes = mutated(&mut random, seed.as_bytes());
            match read(format, &bytes, &|_| Err("there is none".to_owned())) {
                Ok(mesh) => {
                    drop(Tree::new(&mesh));
                    meshes += 1;
                }
                Err(reason) => {
                    assert!(!reason.to_string().is_empty());
                    reasons += 1;
                }
            }
        }
        println!("{format:?}: {meshes} meshes, {reasons} reasons");
        assert!(meshes > 50 && reasons > 500, "{format:?}: {meshes} meshes, {reasons} reasons");
    }
}
