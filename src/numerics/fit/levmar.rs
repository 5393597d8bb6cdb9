//! Levenberg-Marquardt with bounds on few unknowns; the problem supplies its normal equations (paper 3.5-3.6).

use nalgebra::{DMatrix, DVector};
use std::ops::ControlFlow;

/// Normal equations at a point.
#[derive(Clone, Debug)]
pub struct Normal {
    /// Sum of weighted squared residuals.
    pub cost: f64,
    /// J'r: half the gradient of the cost.
    pub gradient: DVector<f64>,
    /// J'J.
    pub hessian: DMatrix<f64>,
}

/// A least-squares problem.
pub trait Problem {
    /// Cost, gradient and Gauss-Newton matrix.
    fn normal(&self, x: &DVector<f64>) -> Normal;

    /// Rounding noise of the cost, relative: a step that raises it by less may have lowered it.
    fn noise(&self) -> f64 {
        0.0
    }

    /// Damping of the first step, in parts of the diagonal.
    fn damping(&self) -> f64 {
        1e-3
    }
}

/// Box of permitted values and the greatest change of a step, one entry an unknown.
#[derive(Clone, Debug)]
pub struct Bounds {
    /// Least value.
    pub lower: DVector<f64>,
    /// Greatest value.
    pub upper: DVector<f64>,
    /// Greatest change in one step.
    pub step: DVector<f64>,
}

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub struct Stop {
    /// Two successive relative decreases of the cost below this mean convergence, as does a step that promises less than
    /// a tenth of it.
    pub relative_decrease: f64,
    /// Most accepted or refused steps.
    pub iterations: usize,
}

/// Where it ended.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The unknowns.
    pub x: DVector<f64>,
    /// Their cost.
    pub cost: f64,
    /// True when it stopped because nothing more was to be gained.
    pub converged: bool,
    /// Steps tried.
    pub iterations: usize,
}

/// Callback of a search: steps tried so far, unknowns and their cost; it can break off.
pub type OnStep<'a> = &'a mut dyn FnMut(usize, &DVector<f64>, f64) -> ControlFlow<()>;

/// Minimises `problem` from `start`, which is first moved into the box.
pub fn minimise(problem: &dyn Problem, start: &DVector<f64>, bounds: &Bounds, stop: Stop) -> Outcome {
    minimise_watched(problem, start, bounds, stop, &mut |_, _, _| ControlFlow::Continue(()))
}

/// The same; `on_step` looks on, and changes nothing but when it ends.
pub fn minimise_watched(
    problem: &dyn Problem,
    start: &DVector<f64>,
    bounds: &Bounds,
    stop: Stop,
    on_step: OnStep<'_>,
) -> Outcome {
    let mut x = clamp(start, bounds);
    let mut normal = problem.normal(&x);
    let mut scale: DVector<f64> = DVector::from_element(x.len(), 1e-300);
    let mut lambda = problem.damping();
    let mut small_steps = 0;
    for iterations in 0..stop.iterations {
        for i in 0..x.len() {
            scale[i] = scale[i].max(normal.hessian[(i, i)]);
        }
        let ended = |x, cost| Outcome { x, cost, converged: true, iterations };
        let free = free_unknowns(&x, &normal, bounds);
        let candidate = step(&x, &normal, &free, &scale, lambda, bounds);
        if free.is_empty() || lambda > 1e12 {
            return ended(x, normal.cost);
        }
        if let Some(candidate) = &candidate
            && lambda <= 1e-3
        {
            let gain = promised(&normal, &(candidate - &x));
            if gain < 0.1 * stop.relative_decrease * normal.cost {
                // So small a step is as good as the linear model: it is taken unseen.
                return ended(candidate.clone(), normal.cost - gain);
            }
        }
        // Nearly every step is accepted: evaluating it whole at once saves the pass that only asks for its cost.
        let evaluated = candidate.map(|candidate| (problem.normal(&candidate), candidate));
        let most = normal.cost * (1.0 + problem.noise());
        if let Some((next, candidate)) = evaluated.filter(|(next, _)| next.cost < most) {
            let decrease = (normal.cost - next.cost) / normal.cost.max(f64::MIN_POSITIVE);
            small_steps = if decrease < stop.relative_decrease { small_steps + 1 } else { 0 };
            x = candidate;
            normal = next;
            lambda = (lambda * 0.1_f64).max(1e-15);
            if small_steps == 2 {
                return Outcome { x, cost: normal.cost, converged: true, iterations: iterations + 1 };
            }
        } else {
            lambda *= 10.0;
        }
        if on_step(iterations + 1, &x, normal.cost).is_break() {
            return Outcome { x, cost: normal.cost, converged: false, iterations: iterations + 1 };
        }
    }
    Outcome { x, cost: normal.cost, converged: false, iterations: stop.iterations }
}

/// By how much the linear model says the step lowers the cost.
fn promised(normal: &Normal, step: &DVector<f64>) -> f64 {
    -2.0 * normal.gradient.dot(step) - step.dot(&(&normal.hessian * step))
}

fn clamp(x: &DVector<f64>, bounds: &Bounds) -> DVector<f64> {
    DVector::from_fn(x.len(), |i, _| x[i].clamp(bounds.lower[i], bounds.upper[i]))
}

/// The unknowns that are not pressed against a bound.
fn free_unknowns(x: &DVector<f64>, normal: &Normal, bounds: &Bounds) -> Vec<usize> {
    let pressed_down = |i: usize| x[i] <= bounds.lower[i] && normal.gradient[i] >= 0.0;
    let pressed_up = |i: usize| x[i] >= bounds.upper[i] && normal.gradient[i] <= 0.0;
    (0..x.len()).filter(|&i| normal.hessian[(i, i)] > 0.0 && !pressed_down(i) && !pressed_up(i)).collect()
}

/// The damped step on the `free` unknowns; none when rounding has made the matrix indefinite, which asks for more damping.
fn step(
    x: &DVector<f64>,
    normal: &Normal,
    free: &[usize],
    scale: &DVector<f64>,
    lambda: f64,
    bounds: &Bounds,
) -> Option<DVector<f64>> {
    let n = free.len();
    let matrix = DMatrix::from_fn(n, n, |i, j| {
        let (p, q) = (free[i], free[j]);
        normal.hessian[(p, q)] + if i == j { lambda * scale[p] } else { 0.0 }
    });
    let right = DVector::from_fn(n, |i, _| -normal.gradient[free[i]]);
    let delta = matrix.cholesky()?.solve(&right);
    let shrink = (0..n).map(|i| delta[i].abs() / bounds.step[free[i]]).fold(1.0, f64::max);
    let mut next = x.clone();
    for i in 0..n {
        next[free[i]] += delta[i] / shrink;
    }
    Some(clamp(&next, bounds))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's valley as a least-squares problem; minimum 0 at (1, 1).
    struct Rosenbrock;

    impl Problem for Rosenbrock {
        fn normal(&self, x: &DVector<f64>) -> Normal {
            let r = DVector::from_vec(vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]]);
            let j = DMatrix::from_row_slice(2, 2, &[-20.0 * x[0], 10.0, -1.0, 0.0]);
            Normal { cost: r.norm_squared(), gradient: j.transpose() * &r, hessian: j.transpose() * &j }
        }
    }

    fn within(lower: f64, upper: f64) -> Bounds {
        Bounds {
            lower: DVector::from_element(2, lower),
            upper: DVector::from_element(2, upper),
            step: DVector::from_element(2, 10.0),
        }
    }

    const STOP: Stop = Stop { relative_decrease: 1e-14, iterations: 200 };

    #[test]
    fn finds_the_free_minimum() {
        let found = minimise(&Rosenbrock, &DVector::from_vec(vec![-1.2, 1.0]), &within(-9.0, 9.0), STOP);
        assert!((found.x[0] - 1.0).abs() < 1e-6 && (found.x[1] - 1.0).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn finds_the_minimum_on_the_boundary() {
        // With both unknowns at most 0.5 the minimum is x = 0.5, y = 0.25: y free, x pressed against its bound.
        let found = minimise(&Rosenbrock, &DVector::from_vec(vec![-1.2, 0.0]), &within(-9.0, 0.5), STOP);
        assert!((found.x[0] - 0.5).abs() < 1e-9 && (found.x[1] - 0.25).abs() < 1e-6, "{found:?}");
    }
}
