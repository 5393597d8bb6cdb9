//! Meshes: what is checked when one is made, and what files of both formats say.

use base64::Engine;
use rigd::numerics::geometry::Vec3;
use rigd::numerics::render::mesh::{MAX_VERTICES, Mesh, MeshError, Parts};
use rigd::pipeline::mesh::{Format, MeshFileError, read};

fn unopened(_: &str) -> Result<Vec<u8>, String> {
    Err("no file beside this one".to_owned())
}

pub fn obj(text: &str) -> Result<Mesh, MeshFileError> {
    read(Format::Obj, text.as_bytes(), &unopened)
}

pub fn gltf(json: &str) -> Result<Mesh, MeshFileError> {
    read(Format::Gltf, json.as_bytes(), &unopened)
}

fn right_triangle() -> Parts {
    Parts { positions: vec![Vec3::zeros(), Vec3::x(), Vec3::y()], triangles: vec![[0, 1, 2]], ..Parts::default() }
}

/// What is wrong with parts that are sound otherwise.
type Change = fn(&mut Parts);

#[test]
fn what_is_no_surface_is_refused() {
    let changed = |change: Change| {
        let mut parts = right_triangle();
        change(&mut parts);
        Mesh::new(parts).map(|mesh| mesh.triangles()).map_err(|error| error.to_string())
    };
    assert_eq!(changed(|_| {}), Ok(1));
    let refusals: [(Change, &str); 8] = [
        (|p| p.triangles.clear(), "no triangle"),
        (|p| p.triangles[0][2] = 3, "corner at vertex 3, but there are 3 vertices"),
        (|p| p.positions[1].y = f64::NAN, "the position of vertex 1 is NaN"),
        (|p| p.positions[2].y = 1e31, "the position of vertex 2 is 1e31"),
        (|p| p.normals = vec![Vec3::zeros(); 2], "2 normals for 3 vertices"),
        (|p| p.normals = vec![Vec3::repeat(f64::INFINITY); 3], "the normal of vertex 0 is inf"),
        (|p| p.uv = vec![[0.0, -2e6]; 3], "a texture coordinate of vertex 0 is -2e6"),
        (|p| p.positions[2] = 2.0 * Vec3::x(), "none of its 1 triangles has an area"),
    ];
    for (change, words) in refusals {
        let refused = changed(change).unwrap_err();
        assert!(refused.contains(words), "{words}: {refused}");
    }
    let huge = Parts { positions: vec![Vec3::zeros(); MAX_VERTICES + 1], ..right_triangle() };
    assert!(matches!(Mesh::new(huge), Err(MeshError::TooLarge { .. })));
}

#[test]
fn triangles_without_area_are_left_out() {
    let mut parts = right_triangle();
    parts.triangles.extend([[0, 0, 1], [1, 1, 1], [2, 1, 0]]);
    let mesh = Mesh::new(parts).unwrap();
    assert_eq!((mesh.triangles(), mesh.dropped()), (2, 2));
}

const CUBE: &str = "\
# a cube of side 2, four of its faces as quadrilaterals
mtllib nowhere.mtl
v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1
o sides
f 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8
usemtl unknown
f -8 -5 -6\nf -8 -6 -7
f 5 6 7\nf 5 7 8
p 1\nl 1 2\n";

#[test]
fn an_obj_file_of_quadrilaterals_triangles_and_relative_corners() {
    let cube = obj(CUBE).unwrap();
    assert_eq!((cube.triangles(), cube.dropped(), cube.is_textured()), (12, 0, false));
    assert_eq!((cube.middle(), cube.extent()), (Vec3::zeros(), 2.0));
    assert!((cube.radius() - 3_f64.sqrt()).abs() < 1e-12);
}

#[test]
fn texture_coordinates_of_an_obj_file_count_where_all_corners_have_them() {
    let textured = obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\nf 1/1/1 2/2/1 3/3/1\n").unwrap();
    assert!(textured.is_textured());
    let mixed = obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nf 1/1 2/2 3\n").unwrap();
    assert!(!mixed.is_textured());
}

#[test]
fn an_obj_file_that_is_none_is_refused_in_words() {
    let refusals = [
        ("", "no triangle"),
        ("v 0 0 0\nv 1 0 0\nf 1 2 3\n", "face vertex index out of bounds"),
        ("v 0 0 0\nv 1 0 0\nv 0 x 0\nf 1 2 3\n", "position parse error"),
        ("v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n", "the position of vertex 2 is NaN"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n", "face parse error"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/7 2/7 3/7\n", "texcoord index out of bounds"),
    ];
    for (text, words) in refusals {
        let refused = obj(text).unwrap_err().to_string();
        assert!(refused.contains(words), "{words}: {refused}");
    }
    let many = format!("v 0 0 0\n{}", "f 1 1 1\n".repeat(2_000_001));
    assert!(matches!(obj(&many), Err(MeshFileError::Mesh(MeshError::TooLarge { triangles: 2_000_001, .. }))));
    // Lines and points are passed over, but memory is taken for them.
    for passed_over in ["l 1\n", "p 1\n"] {
        let many = format!("v 0 0 0\n{}", passed_over.repeat(2_000_001));
        assert!(matches!(obj(&many), Err(MeshFileError::Mesh(MeshError::TooLarge { .. }))), "{passed_over}");
    }
}

/// One triangle with indices, moved by a node; `primitive` and `nodes` as JSON.
pub fn triangle(primitive: &str, nodes: &str, count: u64) -> String {
    let mut bytes: Vec<u8> =
        [0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([0_u16, 1, 2, 0].iter().flat_map(|v| v.to_le_bytes()));
    let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
    format!(
        r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}], "nodes": {nodes},
        "meshes": [{{"primitives": [{primitive}]}}],
        "buffers": [{{"byteLength": 44, "uri": "data:application/octet-stream;base64,{data}"}}],
        "bufferViews": [{{"buffer": 0, "byteLength": 36}}, {{"buffer": 0, "byteOffset": 36, "byteLength": 6}}],
        "accessors": [
          {{"bufferView": 0, "componentType": 5126, "count": {count}, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}},
          {{"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}}]}}"#
    )
}

pub const INDEXED: &str = r#"{"attributes": {"POSITION": 0}, "indices": 1}"#;
const MOVED: &str =
    r#"[{"children": [1, 2], "translation": [10, 0, 0]}, {"mesh": 0, "scale": [2, 2, 2]}, {"mesh": 0}]"#;

#[test]
fn a_gltf_file_has_every_node_where_its_parents_put_it() {
    let mesh = gltf(&triangle(INDEXED, MOVED, 3)).unwrap();
    assert_eq!(mesh.triangles(), 2);
    assert_eq!((mesh.middle(), mesh.extent()), (Vec3::new(11.0, 1.0, 0.0), 2.0));
    let unindexed = gltf(&triangle(r#"{"attributes": {"POSITION": 0}}"#, r#"[{"mesh": 0}]"#, 3)).unwrap();
    assert_eq!(unindexed.corners(0), [Vec3::zeros(), Vec3::x(), Vec3::y()]);
}

/// The same in one piece, and with its numbers in a file beside it.
#[test]
fn a_glb_file_and_a_buffer_beside_the_description() {
    let numbers: Vec<u8> =
        [0_f32, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 4.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let json = |uri: &str| {
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],"buffers":[{{"byteLength":36{uri}}}],"bufferViews":[{{"buffer":0,"byteLength":36}}],"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[4,4,0]}}]}}"#
        )
    };
    let beside = json(r#","uri":"numbers.bin""#);
    let open = |name: &str| if name == "numbers.bin" { Ok(numbers.clone()) } else { Err("wrong name".to_owned()) };
    assert_eq!(read(Format::Gltf, beside.as_bytes(), &open).unwrap().extent(), 4.0);
    for address in ["./numbers.bin", "numb%65rs.bin", "numbers%2Ebin"] {
        let beside = json(&format!(r#","uri":"{address}""#));
        assert_eq!(read(Format::Gltf, beside.as_bytes(), &open).unwrap().extent(), 4.0, "{address}");
    }
    let missing = gltf(&beside).unwrap_err().to_string();
    assert!(missing.contains("buffer 0 (numbers.bin): no file beside this one"), "{missing}");
    let short = |_: &str| Ok(numbers[..20].to_vec());
    let short = read(Format::Gltf, beside.as_bytes(), &short).unwrap_err().to_string();
    assert!(short.contains("20 bytes where 36 are described"), "{short}");

    let mut json = json("").into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut glb = b"glTF".to_vec();
    for number in [2, (12 + 8 + json.len() + 8 + numbers.len()) as u32, json.len() as u32] {
        glb.extend(number.to_le_bytes());
    }
    glb.extend([b"JSON", json.as_slice()].concat());
    glb.extend((numbers.len() as u32).to_le_bytes());
    glb.extend([b"BIN\0", numbers.as_slice()].concat());
    assert_eq!(read(Format::Gltf, &glb, &unopened).unwrap().extent(), 4.0);
}

#[test]
fn a_gltf_file_that_cannot_be_shown_is_refused_in_words() {
    let alone = r#"[{"mesh": 0}]"#;
    let refusals = [
        ("{".to_owned(), "no readable glTF file"),
        ("glTF\u{2}\0\0\0".to_owned(), "no readable glTF file"),
        (triangle(r#"{"attributes": {"POSITION": 0}, "mode": 5}"#, alone, 3), "a part of it is TriangleStrip"),
        (triangle(INDEXED, r#"[{"mesh": 0, "children": [0]}]"#, 3), "node 0 hangs on two others, or on itself"),
        (triangle(INDEXED, alone, 4), "outside their buffer"),
        (triangle(INDEXED, alone, 2), "corner at vertex 2, but there are 2 vertices"),
        (triangle(INDEXED, alone, 1 << 60), "too many"),
        (triangle(INDEXED, r#"[{"mesh": 0, "scale": [0, 1, 1]}]"#, 3), "none of its 1 triangles has an area"),
        (triangle(INDEXED, r#"[{"mesh": 7}]"#, 3), "no readable glTF file"),
        (triangle(INDEXED, &format!("[{{}}{}]", ",{}".repeat(1 << 18)), 3), "objects, more than 262144"),
    ];
    for (json, words) in refusals {
        let refused = gltf(&json).unwrap_err().to_string();
        assert!(refused.contains(words), "{words}: {refused}");
    }
    let wrong = format!(r#"{{"asset": {{"version": "2.0"}}, "nodes": [{}{{}}]}}"#, r#"{"mesh": 9},"#.repeat(1000));
    assert!(gltf(&wrong).unwrap_err().to_string().len() < 500, "a message stays one that can be read");
}

#[test]
fn vertices_without_a_triangle_are_left_out() {
    let file = "v 9 9 9\nv 0 0 0\nv 8 8 8\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 2//1 4//1 5//1\n";
    let mesh = obj(file).unwrap();
    assert_eq!((mesh.corners(0), mesh.extent()), ([Vec3::zeros(), Vec3::x(), Vec3::y()], 1.0));
    let many = gltf(&triangle(INDEXED, r#"[{"mesh": 0}]"#, 3)).unwrap();
    assert_eq!(many.parts().positions.len(), 3);
    let loose = Parts { positions: vec![Vec3::z(); 7], uv: vec![[0.5, 0.5]; 7], ..Parts::default() };
    let parts = Parts { triangles: vec![[6, 5, 2]], ..loose }.used();
    assert_eq!((parts.positions.len(), parts.uv.len(), parts.triangles), (3, 3, vec![[2, 1, 0]]));
}

#[test]
fn the_ending_tells_the_format() {
    assert_eq!(
        ["obj", "OBJ", "gltf", "glb", "stl", ""].map(Format::of).map(|f| f.is_some()),
        [true, true, true, true, false, false]
    );
}
