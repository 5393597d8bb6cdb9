//! A surface of triangles: checked once, when it is made, and trusted from then on.

use super::tree::Hit;
use crate::numerics::geometry::Vec3;
use std::collections::HashMap;

/// Most triangles of a mesh; with its tree such a mesh takes less than a gigabyte.
pub const MAX_TRIANGLES: usize = 2_000_000;

/// Most vertices of a mesh: three a triangle.
pub const MAX_VERTICES: usize = 3 * MAX_TRIANGLES;

/// Largest coordinate: squares of areas and distances stay finite.
const LARGEST: f64 = 1e30;

/// Largest texture coordinate: beyond, single precision has no place within a tile left.
const LARGEST_UV: f64 = 1e6;

/// A triangle is degenerate when it is lower than this part of its longest edge, squared: its normal is rounding alone.
const FLAT: f64 = 1e-24;

/// Why parts make no mesh.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// Nothing to show.
    #[error("it holds no triangle: export the surface as triangles")]
    Empty,
    /// Only triangles without area.
    #[error("none of its {0} triangles has an area: check the coordinates of its vertices")]
    Degenerate(usize),
    /// More than memory is kept for.
    #[error(
        "{triangles} triangles and {vertices} vertices are too many: {MAX_TRIANGLES} and {MAX_VERTICES} are possible; simplify the mesh"
    )]
    TooLarge {
        /// Triangles, as far as they were counted.
        triangles: usize,
        /// Vertices, as far as they were counted.
        vertices: usize,
    },
    /// A number that is none, or is too large to compute with.
    #[error("{what} of vertex {vertex} is {value:e}: it must be a number of at most {most:e}")]
    Number {
        /// Position, normal or texture coordinate.
        what: &'static str,
        /// The vertex, from 0.
        vertex: usize,
        /// What it is.
        value: f64,
        /// The limit.
        most: f64,
    },
    /// A corner that is no vertex.
    #[error(
        "triangle {triangle} has a corner at vertex {index}, but there are {vertices} vertices, numbered from 0: export the mesh again"
    )]
    Corner {
        /// The triangle, from 0.
        triangle: usize,
        /// What it refers to.
        index: u32,
        /// How many there are.
        vertices: usize,
    },
    /// Not one normal or texture coordinate a vertex.
    #[error("it has {found} {what} for {vertices} vertices: export one a vertex, or none")]
    Ragged {
        /// Normals or texture coordinates.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many vertices there are.
        vertices: usize,
    },
}

/// What a file says of a mesh, in any unit; right-handed, y up.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parts {
    /// Vertices.
    pub positions: Vec<Vec3>,
    /// Outward normals of any length, one a vertex, or none at all; a zero vector where a vertex has none.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one a vertex, or none at all; v runs down the picture.
    pub uv: Vec<[f64; 2]>,
    /// Corners, by vertex from 0.
    pub triangles: Vec<[u32; 3]>,
}

impl Parts {
    /// Without the vertices that no triangle has: a file may hold millions of them.
    pub fn used(self) -> Self {
        let mut place = vec![u32::MAX; self.positions.len()];
        for corner in self.triangles.iter().flatten() {
            if let Some(place) = place.get_mut(*corner as usize) {
                *place = 0;
            }
        }
        if !place.contains(&u32::MAX) {
            return self;
        }
        let kept = place.iter_mut().filter(|place| **place == 0).zip(0..);
        kept.for_each(|(place, number)| *place = number);
        fn of<T>(list: Vec<T>, place: &[u32]) -> Vec<T> {
            list.into_iter().zip(place).filter(|(_, place)| **place != u32::MAX).map(|(value, _)| value).collect()
        }
        let moved = |corner: u32| place.get(corner as usize).copied().unwrap_or(corner);
        Self {
            triangles: self.triangles.into_iter().map(|corners| corners.map(moved)).collect(),
            positions: of(self.positions, &place),
            normals: of(self.normals, &place),
            uv: of(self.uv, &place),
        }
    }

    /// Puts another surface beside this one. Normals and texture coordinates that only one of them has: missing normals become
    /// zero, texture coordinates are given up.
    ///
    /// # Errors
    /// The other surface has ragged lists or corners outside its own vertices, or both together are too large.
    pub fn append(&mut self, other: Self) -> Result<(), MeshError> {
        other.check_lists()?;
        let (triangles, vertices) =
            (self.triangles.len() + other.triangles.len(), self.positions.len() + other.positions.len());
        if triangles > MAX_TRIANGLES || vertices > MAX_VERTICES {
            return Err(MeshError::TooLarge { triangles, vertices });
        }
        let textured = (self.positions.is_empty() || !self.uv.is_empty()) && !other.uv.is_empty();
        if textured {
            self.uv.extend(other.uv)
        } else {
            self.uv.clear()
        }
        if !(self.normals.is_empty() && other.normals.is_empty()) {
            self.normals.resize(self.positions.len(), Vec3::zeros());
            self.normals.extend(other.normals);
            self.normals.resize(vertices, Vec3::zeros());
        }
        let offset = self.positions.len() as u32;
        self.triangles.extend(other.triangles.into_iter().map(|corners| corners.map(|corner| corner + offset)));
        self.positions.extend(other.positions);
        Ok(())
    }

    fn check_lists(&self) -> Result<(), MeshError> {
        let vertices = self.positions.len();
        if self.triangles.len() > MAX_TRIANGLES || vertices > MAX_VERTICES {
            return Err(MeshError::TooLarge { triangles: self.triangles.len(), vertices });
        }
        for (what, found) in [("normals", self.normals.len()), ("texture coordinates", self.uv.len())] {
            if found != 0 && found != vertices {
                return Err(MeshError::Ragged { what, found, vertices });
            }
        }
        for (triangle, corners) in self.triangles.iter().enumerate() {
            if let Some(&index) = corners.iter().find(|&&corner| corner as usize >= vertices) {
                return Err(MeshError::Corner { triangle, index, vertices });
            }
        }
        Ok(())
    }

    fn check_numbers(&self) -> Result<(), MeshError> {
        let bad = |what: &'static str, vertex: usize, values: &[f64], most: f64| {
            let value = values.iter().copied().find(|value| value.is_nan() || value.abs() > most);
            value.map_or(Ok(()), |value| Err(MeshError::Number { what, vertex, value, most }))
        };
        let vectors = |what: &'static str, all: &[Vec3]| {
            all.iter().enumerate().try_for_each(|(vertex, v)| bad(what, vertex, v.as_slice(), LARGEST))
        };
        vectors("the position", &self.positions)?;
        vectors("the normal", &self.normals)?;
        self.uv.iter().enumerate().try_for_each(|(vertex, uv)| bad("a texture coordinate", vertex, uv, LARGEST_UV))
    }
}

/// A surface of triangles, each with an area.
#[derive(Clone, Debug)]
pub struct Mesh {
    parts: Parts,
    dropped: usize,
    middle: Vec3,
    radius: f64,
    extent: f64,
}

/// A point of a surface as a ray meets it.
#[derive(Clone, Copy, Debug)]
pub struct Met {
    /// Where.
    pub position: Vec3,
    /// Unit normal of the triangle, on the ray's side.
    pub face_normal: Vec3,
    /// Unit normal interpolated between the corners, on the ray's side; the triangle's where it would turn away from the ray.
    pub normal: Vec3,
    /// Texture coordinates, if the mesh has any.
    pub uv: Option<[f64; 2]>,
}

impl Mesh {
    /// Checks the parts, leaves out triangles without area, and makes normals where there are none: means over the triangles
    /// about a position, weighted by area.
    ///
    /// # Errors
    /// A number is none or too large, a corner is no vertex, lists do not fit each other, or nothing is left to show.
    pub fn new(mut parts: Parts) -> Result<Self, MeshError> {
        parts.check_lists()?;
        parts.check_numbers()?;
        let all = parts.triangles.len();
        if all == 0 {
            return Err(MeshError::Empty);
        }
        let positions = &parts.positions;
        parts.triangles.retain(|corners| has_area(&corners.map(|corner| positions[corner as usize])));
        if parts.triangles.is_empty() {
            return Err(MeshError::Degenerate(all));
        }
        complete_normals(&mut parts);
        let corners = || parts.triangles.iter().flatten().map(|&corner| &parts.positions[corner as usize]);
        let (low, high) = bounds(corners());
        let middle = 0.5 * (low + high);
        let radius = corners().map(|corner| (corner - middle).norm()).fold(0.0, f64::max);
        let dropped = all - parts.triangles.len();
        Ok(Self { dropped, middle, radius, extent: (high - low).max(), parts })
    }

    /// What it is made of: every triangle has an area, and there are as many normals as vertices, of length 1 or 0.
    pub fn parts(&self) -> &Parts {
        &self.parts
    }

    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        self.parts.triangles.len()
    }

    /// Number of triangles without area, which were left out.
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// True when it has texture coordinates.
    pub fn is_textured(&self) -> bool {
        !self.parts.uv.is_empty()
    }

    /// Corners of a triangle.
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.parts.triangles[triangle].map(|corner| self.parts.positions[corner as usize])
    }

    /// Middle of the box around it.
    pub fn middle(&self) -> Vec3 {
        self.middle
    }

    /// Radius of the sphere about [`Mesh::middle`] that holds it.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Longest side of the box around it.
    pub fn extent(&self) -> f64 {
        self.extent
    }

    /// The surface where a ray of this unit direction met it.
    pub fn at(&self, hit: &Hit, direction: &Vec3) -> Met {
        let corners = self.parts.triangles[hit.triangle].map(|corner| corner as usize);
        let part = [1.0 - hit.u - hit.v, hit.u, hit.v];
        let [a, b, c] = corners.map(|corner| self.parts.positions[corner]);
        let blend = |of: &[Vec3]| part[0] * of[corners[0]] + part[1] * of[corners[1]] + part[2] * of[corners[2]];
        let towards = |normal: Vec3, side: &Vec3| if normal.dot(side) < 0.0 { -normal } else { normal };
        let view = -direction;
        let face_normal = towards((b - a).cross(&(c - a)).normalize(), &view);
        let smooth = blend(&self.parts.normals).try_normalize(0.0).map(|normal| towards(normal, &face_normal));
        let uv = self.is_textured().then(|| {
            let along = |i: usize| (0..3).map(|k| part[k] * self.parts.uv[corners[k]][i]).sum();
            [along(0), along(1)]
        });
        Met {
            position: blend(&self.parts.positions),
            face_normal,
            normal: smooth.filter(|normal| normal.dot(&view) > 0.0).unwrap_or(face_normal),
            uv,
        }
    }
}

fn has_area([a, b, c]: &[Vec3; 3]) -> bool {
    let longest2 = [b - a, c - b, a - c].map(|edge| edge.norm_squared()).into_iter().fold(0.0, f64::max);
    (b - a).cross(&(c - a)).norm_squared() > FLAT * longest2 * longest2
}

/// Lowest and highest coordinates of some points.
pub(super) fn bounds<'a>(points: impl Iterator<Item = &'a Vec3>) -> (Vec3, Vec3) {
    let none = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
    points.fold(none, |(low, high), point| (low.inf(point), high.sup(point)))
}

/// Unit normals; zero where triangles about a position cancel.
fn complete_normals(parts: &mut Parts) {
    parts.normals.resize(parts.positions.len(), Vec3::zeros());
    for normal in &mut parts.normals {
        *normal = normal.try_normalize(0.0).unwrap_or_default();
    }
    if parts.normals.iter().all(|normal| *normal != Vec3::zeros()) {
        return;
    }
    // By position: vertices that differ in their texture coordinates alone are one point of the surface. -0 is 0.
    let place = |point: &Vec3| [point.x, point.y, point.z].map(|c| (c + 0.0).to_bits());
    let mut sums: HashMap<[u64; 3], Vec3> = HashMap::new();
    for corners in &parts.triangles {
        let [a, b, c] = corners.map(|corner| parts.positions[corner as usize]);
        let twice_area = (b - a).cross(&(c - a));
        for corner in [a, b, c] {
            *sums.entry(place(&corner)).or_default() += twice_area;
        }
    }
    for (normal, position) in parts.normals.iter_mut().zip(&parts.positions) {
        if *normal == Vec3::zeros() {
            *normal = sums.get(&place(position)).and_then(|sum| sum.try_normalize(0.0)).unwrap_or_default();
        }
    }
}
