//! The bundle adjustment: interior and all poses at once by Levenberg-Marquardt. The poses, each of which meets only its own
//! view, are eliminated by the Schur complement (Triggs et al. 2000, "Bundle adjustment - a modern synthesis", section 6.1).

use super::interior::{Freedom, Interior, UNKNOWNS};
use super::pose::Pose;
use super::{Corner, View};
use nalgebra::{Matrix6, SMatrix, SVector, Vector6};

/// Most steps; a sound set of views takes about ten.
const ITERATIONS: usize = 100;
/// A relative decrease of the cost below this is a small one; three in succession end the search.
const CONVERGED: f64 = 1e-12;

type Square = SMatrix<f64, UNKNOWNS, UNKNOWNS>;
type Column = SVector<f64, UNKNOWNS>;
type Coupling = SMatrix<f64, UNKNOWNS, 6>;

/// Which unknowns of the interior are free.
pub(super) type Free = [bool; UNKNOWNS];

/// The unknowns of some freedoms.
pub(super) fn free(freedoms: &[Freedom]) -> Free {
    let mut free = [false; UNKNOWNS];
    freedoms.iter().flat_map(|f| f.unknowns()).for_each(|&i| free[i] = true);
    free
}

/// Where the adjustment ended.
#[derive(Clone, Debug)]
pub(super) struct Adjusted {
    pub interior: Interior,
    /// One a view.
    pub poses: Vec<Pose>,
    /// Sum of squared residuals over sigma.
    pub cost: f64,
    /// False when the steps ran out.
    pub converged: bool,
    normal: Normal,
}

/// One view's part of the normal equations.
#[derive(Clone, Debug)]
struct ViewNormal {
    hessian: Matrix6<f64>,
    gradient: Vector6<f64>,
    coupling: Coupling,
}

#[derive(Clone, Debug)]
struct Normal {
    cost: f64,
    /// Of the interior; rows of held unknowns are those of the identity.
    hessian: Square,
    gradient: Column,
    views: Vec<ViewNormal>,
}

/// Minimises the squared residuals over sigma from a start; None if a corner starts behind the camera.
pub(super) fn adjust(views: &[&View], free: &Free, interior: Interior, poses: Vec<Pose>) -> Option<Adjusted> {
    let corners: Vec<&[Corner]> = views.iter().map(|v| v.corners.as_slice()).collect();
    minimise(&corners, free, interior, poses)
}

/// Refines one pose under a known interior; the pose and its cost.
pub(super) fn pose(corners: &[Corner], interior: &Interior, start: Pose) -> Option<(Pose, f64)> {
    let found = minimise(&[corners], &[false; UNKNOWNS], *interior, vec![start])?;
    Some((*found.poses.first()?, found.cost))
}

/// What one view says of the interior by itself, its pose eliminated: half the second derivatives and the gradient of its cost by
/// the interior's unknowns, and the cost. None if its pose is open.
pub(super) fn alone(corners: &[Corner], interior: &Interior, pose: &Pose) -> Option<(Square, Column, f64)> {
    let normal = Normal::at(&[corners], &[true; UNKNOWNS], interior, std::slice::from_ref(pose))?;
    let (view, inverse) = (normal.views.first()?, *normal.pose_inverses(0.0)?.first()?);
    let hessian = normal.hessian - view.coupling * inverse * view.coupling.transpose();
    let gradient = normal.gradient - view.coupling * (inverse * view.gradient);
    Some((hessian, gradient, normal.cost - view.gradient.dot(&(inverse * view.gradient))))
}

fn minimise(views: &[&[Corner]], free: &Free, interior: Interior, poses: Vec<Pose>) -> Option<Adjusted> {
    let normal = Normal::at(views, free, &interior, &poses)?;
    let mut best = Adjusted { interior, poses, cost: normal.cost, converged: false, normal };
    let (mut lambda, mut small_steps) = (1e-3, 0);
    for _ in 0..ITERATIONS {
        let next = best.normal.step(lambda).and_then(|(by, poses_by)| {
            let interior = Interior(best.interior.0 + by);
            let poses: Vec<Pose> = best.poses.iter().zip(&poses_by).map(|(pose, by)| pose.moved(by)).collect();
            let normal = Normal::at(views, free, &interior, &poses)?;
            Some(Adjusted { interior, poses, cost: normal.cost, converged: false, normal })
        });
        match next {
            Some(next) if next.cost <= best.cost => {
                let small = best.cost - next.cost <= CONVERGED * best.cost;
                small_steps = if small { small_steps + 1 } else { 0 };
                best = next;
                if small_steps == 3 {
                    best.converged = true;
                    break;
                }
                lambda = (lambda * 0.1_f64).max(1e-12);
            }
            // At the minimum rounding may refuse every step.
            _ if lambda > 1e9 => {
                best.converged = true;
                break;
            }
            _ => lambda *= 10.0,
        }
    }
    Some(best)
}

impl Normal {
    fn at(views: &[&[Corner]], free: &Free, interior: &Interior, poses: &[Pose]) -> Option<Self> {
        let mut total = Self {
            cost: 0.0,
            hessian: Square::zeros(),
            gradient: Column::zeros(),
            views: Vec::with_capacity(views.len()),
        };
        for (corners, pose) in views.iter().zip(poses) {
            let view = total.add(corners, interior, pose)?;
            total.views.push(view);
        }
        (0..UNKNOWNS).filter(|&i| !free[i]).for_each(|i| total.hold(i));
        total.cost.is_finite().then_some(total)
    }

    /// Adds a view to cost and interior, and gives the view's own part.
    fn add(&mut self, corners: &[Corner], interior: &Interior, pose: &Pose) -> Option<ViewNormal> {
        let mut view =
            ViewNormal { hessian: Matrix6::zeros(), gradient: Vector6::zeros(), coupling: Coupling::zeros() };
        for corner in corners {
            let arm = pose.place(corner.board_mm) - pose.translation_mm;
            let projected = interior.project(&(arm + pose.translation_mm))?;
            let weight = 1.0 / corner.sigma_px;
            let residual = (projected.pixel - nalgebra::Vector2::from(corner.pixel)) * weight;
            let by_interior = projected.by_interior * weight;
            let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
            by_pose.fixed_columns_mut::<3>(0).copy_from(&(-projected.by_point * arm.cross_matrix() * weight));
            by_pose.fixed_columns_mut::<3>(3).copy_from(&(projected.by_point * weight));
            self.cost += residual.norm_squared();
            self.hessian += by_interior.transpose() * by_interior;
            self.gradient += by_interior.transpose() * residual;
            view.hessian += by_pose.transpose() * by_pose;
            view.gradient += by_pose.transpose() * residual;
            view.coupling += by_interior.transpose() * by_pose;
        }
        Some(view)
    }

    /// Takes an unknown out of the equations.
    fn hold(&mut self, i: usize) {
        self.hessian.row_mut(i).fill(0.0);
        self.hessian.column_mut(i).fill(0.0);
        self.hessian[(i, i)] = 1.0;
        self.gradient[i] = 0.0;
        self.views.iter_mut().for_each(|view| view.coupling.row_mut(i).fill(0.0));
    }

    /// The damped step of the interior and of every pose.
    fn step(&self, lambda: f64) -> Option<(Column, Vec<Vector6<f64>>)> {
        let inverses = self.pose_inverses(lambda)?;
        let mut damped = self.hessian;
        (0..UNKNOWNS).for_each(|i| damped[(i, i)] *= 1.0 + lambda);
        let mut right = -self.gradient;
        for (view, inverse) in self.views.iter().zip(&inverses) {
            damped -= view.coupling * inverse * view.coupling.transpose();
            right += view.coupling * (inverse * view.gradient);
        }
        let by = damped.cholesky()?.solve(&right);
        let poses = self.views.iter().zip(&inverses);
        let poses_by =
            poses.map(|(view, inverse)| -(inverse * (view.gradient + view.coupling.transpose() * by))).collect();
        Some((by, poses_by))
    }

    fn pose_inverses(&self, lambda: f64) -> Option<Vec<Matrix6<f64>>> {
        let inverse = |view: &ViewNormal| {
            let mut damped = view.hessian;
            (0..6).for_each(|i| damped[(i, i)] *= 1.0 + lambda);
            Some(damped.cholesky()?.inverse())
        };
        self.views.iter().map(inverse).collect()
    }
}

impl Adjusted {
    /// Covariance of the interior's unknowns (rows of held ones zero) and of each pose's rotation vector (camera axes, rad) and
    /// translation (mm), for corners whose sigma is as stated. None when the views do not determine the free unknowns.
    pub fn covariance(&self, free: &Free) -> Option<(Square, Vec<Matrix6<f64>>)> {
        let inverses = self.normal.pose_inverses(0.0)?;
        let mut reduced = self.normal.hessian;
        for (view, inverse) in self.normal.views.iter().zip(&inverses) {
            reduced -= view.coupling * inverse * view.coupling.transpose();
        }
        // In units of each unknown's own accuracy, so that rounding is judged alike for pixels and k3.
        let scale = Column::from_fn(|i, _| 1.0 / self.normal.hessian[(i, i)].sqrt());
        let scaled = Square::from_fn(|i, j| reduced[(i, j)] * scale[i] * scale[j]);
        let inverse = scaled.cholesky()?.inverse();
        let interior =
            Square::from_fn(|i, j| if free[i] && free[j] { inverse[(i, j)] * scale[i] * scale[j] } else { 0.0 });
        let poses = self.normal.views.iter().zip(&inverses).map(|(view, inverse)| {
            let pull = inverse * view.coupling.transpose();
            inverse + pull * interior * pull.transpose()
        });
        Some((interior, poses.collect()))
    }

    /// Root mean square distance (px) between the corners of view `i` and their reprojection.
    pub fn rms_px(&self, view: &View, i: usize) -> f64 {
        let distance2 = |corner: &Corner| {
            let projected = self.interior.project(&self.poses[i].place(corner.board_mm));
            projected.map_or(f64::INFINITY, |p| (p.pixel - nalgebra::Vector2::from(corner.pixel)).norm_squared())
        };
        (view.corners.iter().map(distance2).sum::<f64>() / view.corners.len().max(1) as f64).sqrt()
    }
}
