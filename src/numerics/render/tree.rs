//! Which triangle a ray meets first: a tree of boxes, split where the surface area heuristic says (Wald 2007, binned).

use super::mesh::{Mesh, bounds};
use crate::numerics::geometry::{Ray, Vec3};

/// Most triangles of a leaf.
const LEAF: usize = 4;
/// Places on the longest axis at which a split is tried.
const BINS: usize = 16;
/// Below this depth splits halve the number of triangles, whatever they look like: it bounds the depth.
const FREE_DEPTH: usize = 40;
/// Most boxes that wait for their turn: one a level, [`FREE_DEPTH`] and 21 for two million triangles.
const STACK: usize = 64;
/// How far outside a triangle, in parts of its sides, a ray still meets it: no ray slips through a shared edge.
const EDGE: f64 = 1e-9;
/// Farther than any surface, and nearer than infinity, where the boxes are that a ray misses.
pub(super) const FAR: f64 = 1e300;
/// What rounding may take from the distance to a box.
const SLACK: f64 = 1.0 + 1e-12;

/// Where a ray meets a triangle: at `corner 0 + u (corner 1 - corner 0) + v (corner 2 - corner 0)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray, in lengths of its direction.
    pub distance: f64,
    /// The triangle of the mesh.
    pub triangle: usize,
    /// Part of the first side.
    pub u: f64,
    /// Part of the second side.
    pub v: f64,
}

/// A triangle as a ray wants it.
#[derive(Clone, Debug)]
pub struct Face {
    corner: Vec3,
    sides: [Vec3; 2],
    triangle: u32,
}

impl Face {
    /// The triangle of this number.
    pub fn new(mesh: &Mesh, triangle: usize) -> Self {
        let [a, b, c] = mesh.corners(triangle);
        Self { corner: a, sides: [b - a, c - a], triangle: triangle as u32 }
    }

    /// Where a ray meets it, from either side, ahead of its origin (Möller and Trumbore 1997).
    pub fn meet(&self, ray: &Ray) -> Option<Hit> {
        let across = ray.direction.cross(&self.sides[1]);
        let scale = 1.0 / self.sides[0].dot(&across);
        let from_corner = ray.origin - self.corner;
        let u = scale * from_corner.dot(&across);
        if !(-EDGE..=1.0 + EDGE).contains(&u) {
            return None;
        }
        let along = from_corner.cross(&self.sides[0]);
        let v = scale * ray.direction.dot(&along);
        if !(v >= -EDGE && u + v <= 1.0 + EDGE) {
            return None;
        }
        let distance = scale * self.sides[1].dot(&along);
        (distance > 0.0).then_some(Hit { distance, triangle: self.triangle as usize, u, v })
    }
}

/// A box with what is in it: triangles, or two boxes, of which the first comes next in the list.
#[derive(Clone, Debug)]
struct Node {
    low: Vec3,
    high: Vec3,
    /// First triangle, or the second box.
    first: u32,
    /// Triangles; 0 for boxes.
    count: u32,
}

impl Node {
    /// Distance at which a ray enters the box, 0 from inside; infinite if it misses it.
    fn entry(&self, ray: &Ray, inverse: &Vec3) -> f64 {
        let (mut near, mut far) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let backward = inverse[axis] < 0.0;
            let (first, second) =
                if backward { (self.high[axis], self.low[axis]) } else { (self.low[axis], self.high[axis]) };
            // Along a side of the box this is 0 times infinity; min and max pass over what is not a number.
            near = near.max((first - ray.origin[axis]) * inverse[axis]);
            far = far.min((second - ray.origin[axis]) * inverse[axis]);
        }
        if near <= far * SLACK { near } else { f64::INFINITY }
    }
}

/// The tree over a mesh; the same for the same mesh.
#[derive(Clone, Debug)]
pub struct Tree {
    nodes: Vec<Node>,
    faces: Vec<Face>,
}

/// A triangle while the tree grows.
struct Item {
    low: Vec3,
    high: Vec3,
    middle: Vec3,
    triangle: usize,
}

impl Tree {
    /// The tree over all triangles of `mesh`.
    pub fn new(mesh: &Mesh) -> Self {
        let item = |triangle| {
            let (low, high) = bounds(mesh.corners(triangle).iter());
            Item { low, high, middle: 0.5 * (low + high), triangle }
        };
        let mut items: Vec<Item> = (0..mesh.triangles()).map(item).collect();
        let mut tree = Self { nodes: Vec::new(), faces: Vec::with_capacity(items.len()) };
        tree.grow(mesh, &mut items, 0);
        tree
    }

    fn grow(&mut self, mesh: &Mesh, items: &mut [Item], depth: usize) {
        let (at, (low, high)) = (self.nodes.len(), around(items));
        self.nodes.push(Node { low, high, first: self.faces.len() as u32, count: items.len() as u32 });
        if items.len() <= LEAF {
            self.faces.extend(items.iter().map(|item| Face::new(mesh, item.triangle)));
            return;
        }
        let first = split(items, depth);
        let (left, right) = items.split_at_mut(first);
        self.grow(mesh, left, depth + 1);
        self.nodes[at].first = self.nodes.len() as u32;
        self.nodes[at].count = 0;
        self.grow(mesh, right, depth + 1);
    }

    /// What a ray meets first; of triangles at one distance, the one of the lowest number.
    pub fn nearest(&self, ray: &Ray) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        self.walk(ray, FAR, |face| {
            if let Some(hit) = face.meet(ray) {
                let order = |hit: &Hit| (hit.distance, hit.triangle);
                if best.as_ref().is_none_or(|best| order(&hit) < order(best)) {
                    best = Some(hit);
                }
            }
            best.as_ref().map_or(FAR, |best| best.distance)
        });
        best
    }

    /// True if anything but the triangle `from`, where the ray begins, lies between the distances `least` and `most`.
    pub fn is_blocked(&self, ray: &Ray, from: usize, least: f64, most: f64) -> bool {
        let mut blocked = false;
        self.walk(ray, most, |face| {
            blocked |=
                face.meet(ray).is_some_and(|hit| hit.triangle != from && hit.distance >= least && hit.distance <= most);
            // Nothing is nearer than this: the walk ends.
            if blocked { f64::NEG_INFINITY } else { most }
        });
        blocked
    }

    /// Shows `look` the triangles in the boxes that the ray enters before `limit`, near boxes first; `look` says the new limit.
    fn walk(&self, ray: &Ray, mut limit: f64, mut look: impl FnMut(&Face) -> f64) {
        let inverse = ray.direction.map(|component| 1.0 / component);
        let mut waiting = [(0_u32, 0.0_f64); STACK];
        waiting[0] = (0, self.nodes[0].entry(ray, &inverse));
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let (mut at, mut entry) = waiting[count];
            while entry <= limit * SLACK {
                let node = &self.nodes[at as usize];
                if node.count > 0 {
                    let first = node.first as usize;
                    for face in &self.faces[first..first + node.count as usize] {
                        limit = look(face);
                    }
                    break;
                }
                let boxes = [at + 1, node.first].map(|one| (one, self.nodes[one as usize].entry(ray, &inverse)));
                let [near, far] = if boxes[0].1 <= boxes[1].1 { boxes } else { [boxes[1], boxes[0]] };
                if far.1 <= limit * SLACK {
                    waiting[count] = far;
                    count += 1;
                }
                (at, entry) = near;
            }
        }
    }
}

/// The box around some triangles.
fn around(items: &[Item]) -> (Vec3, Vec3) {
    bounds(items.iter().flat_map(|item| [&item.low, &item.high]))
}

/// Sorts the triangles into two groups, neither empty; where the second begins.
fn split(items: &mut [Item], depth: usize) -> usize {
    let (low, high) = bounds(items.iter().map(|item| &item.middle));
    let axis = (high - low).imax();
    let scale = BINS as f64 / (high[axis] - low[axis]);
    let half = items.len() / 2;
    if depth < FREE_DEPTH && scale.is_finite() {
        let bin = |item: &Item| (((item.middle[axis] - low[axis]) * scale) as usize).min(BINS - 1);
        if let Some(cut) = cheapest(items, bin) {
            let mut first = 0;
            for i in 0..items.len() {
                if bin(&items[i]) < cut {
                    items.swap(first, i);
                    first += 1;
                }
            }
            return first;
        }
    }
    let order = |item: &Item| (item.middle[axis], item.triangle);
    items.select_nth_unstable_by(half, |a, b| {
        let ((a, first), (b, second)) = (order(a), order(b));
        a.total_cmp(&b).then(first.cmp(&second))
    });
    half
}

/// The first bin of the second group for which area times number, summed over both, is least; none if all are in one bin.
fn cheapest(items: &[Item], bin: impl Fn(&Item) -> usize) -> Option<usize> {
    let empty = (bounds(std::iter::empty()), 0_usize);
    let join = |((low, high), count): ((Vec3, Vec3), usize), ((l, h), more): ((Vec3, Vec3), usize)| {
        ((low.inf(&l), high.sup(&h)), count + more)
    };
    let mut bins = [empty; BINS];
    for item in items {
        let bin = &mut bins[bin(item)];
        *bin = join(*bin, ((item.low, item.high), 1));
    }
    let cost = |((low, high), count): ((Vec3, Vec3), usize)| {
        let side = high - low;
        (side.x * side.y + side.y * side.z + side.z * side.x) * count as f64
    };
    let whole = |part: &[((Vec3, Vec3), usize)]| part.iter().fold(empty, |sum, one| join(sum, *one));
    let cuts = (1..BINS).map(|cut| (cut, whole(&bins[..cut]), whole(&bins[cut..])));
    let possible = cuts.filter(|(_, left, right)| left.1 > 0 && right.1 > 0);
    possible
        .map(|(cut, left, right)| (cut, cost(left) + cost(right)))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(c, _)| c)
}
