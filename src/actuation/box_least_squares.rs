//! The point nearest to a target among all torques of a box: `min |A x - b|, lower <= x <= upper`.
//!
//! Exact and finite: a bounded-variable active set in the manner of Stark & Parker (1995).
//! A variable is set free only when the residual has a component along its column, and at
//! that moment the residual is orthogonal to all free columns; so the free columns stay
//! independent and there are never more than three of them, whatever the rank of `A`.
//! The nearest point is unique; the variables that give it need not be.

use crate::notation::{ActuatorVector, MAX_ACTUATORS, MAX_FREEDOMS, PlaneVector, ReferenceMatrix};

/// Relative size below which a component counts as rounding.
pub(super) const ROUNDING: f64 = 1e-13;

/// Bound on the work: each round changes the active set, and few changes suffice.
const MAX_ROUNDS: usize = 8 * MAX_ACTUATORS;

/// Variables within the box whose image is nearest to `target`. Only the first `count`
/// columns are used; the other variables are zero. What is not finite gives the point of
/// the box nearest to zero.
pub fn nearest_in_box(
    matrix: &ReferenceMatrix,
    target: &PlaneVector,
    lower: &ActuatorVector,
    upper: &ActuatorVector,
    count: usize,
) -> ActuatorVector {
    let count = count.min(MAX_ACTUATORS);
    let mut x = ActuatorVector::zeros();
    for i in 0..count {
        x[i] = 0.0f64.min(upper[i]).max(lower[i]);
    }
    let finite = |part: &f64| part.is_finite();
    if matrix.iter().all(finite) && target.iter().all(finite) {
        let length = std::array::from_fn(|i| if i < count { matrix.column(i).norm() } else { 0.0 });
        let free = [false; MAX_ACTUATORS];
        Search { matrix, target, lower, upper, count, length, free }.run(&mut x);
    }
    x
}

struct Search<'a> {
    matrix: &'a ReferenceMatrix,
    target: &'a PlaneVector,
    lower: &'a ActuatorVector,
    upper: &'a ActuatorVector,
    count: usize,
    /// Of each column.
    length: [f64; MAX_ACTUATORS],
    free: [bool; MAX_ACTUATORS],
}

impl Search<'_> {
    fn run(&mut self, x: &mut ActuatorVector) {
        let mut tried = [false; MAX_ACTUATORS];
        for _ in 0..MAX_ROUNDS {
            let Some(entering) = self.most_useful(x, &tried) else {
                return;
            };
            self.free[entering] = true;
            tried[entering] = true;
            let before = *x;
            self.settle(x);
            if *x != before {
                tried = [false; MAX_ACTUATORS];
            }
        }
    }

    fn residual(&self, x: &ActuatorVector) -> PlaneVector {
        let mut residual = *self.target;
        for i in (0..self.count).filter(|&i| x[i] != 0.0) {
            residual -= self.matrix.column(i) * x[i];
        }
        residual
    }

    /// The pinned variable whose release brings the image fastest towards the target.
    fn most_useful(&self, x: &ActuatorVector, tried: &[bool; MAX_ACTUATORS]) -> Option<usize> {
        let residual = self.residual(x);
        let mut scale = self.target.norm();
        for i in 0..self.count {
            scale += self.length[i] * x[i].abs();
        }
        let mut best = (ROUNDING * scale, None);
        let movable = |i: &usize| !self.free[*i] && !tried[*i] && self.lower[*i] < self.upper[*i];
        for i in (0..self.count).filter(movable) {
            let length = self.length[i];
            let slope = self.matrix.column(i).dot(&residual);
            let room = if slope > 0.0 { x[i] < self.upper[i] } else { x[i] > self.lower[i] };
            if room && length > 0.0 && slope.abs() / length > best.0 {
                best = (slope.abs() / length, Some(i));
            }
        }
        best.1
    }

    /// Moves the free variables to their least-squares values, pinning those that meet a
    /// bound on the way, until none does.
    fn settle(&mut self, x: &mut ActuatorVector) {
        for _ in 0..=MAX_FREEDOMS {
            let goal = self.free_solution(x);
            let mut share = 1.0;
            let mut blocking = None;
            for i in (0..self.count).filter(|&i| self.free[i]) {
                let bound = if goal[i] > self.upper[i] {
                    self.upper[i]
                } else if goal[i] < self.lower[i] {
                    self.lower[i]
                } else {
                    continue;
                };
                let reach = ((bound - x[i]) / (goal[i] - x[i])).clamp(0.0, 1.0);
                if blocking.is_none() || reach < share {
                    share = reach;
                    blocking = Some((i, bound));
                }
            }
            for i in (0..self.count).filter(|&i| self.free[i]) {
                x[i] += share * (goal[i] - x[i]);
                x[i] = x[i].min(self.upper[i]).max(self.lower[i]);
            }
            let Some((i, bound)) = blocking else { return };
            x[i] = bound;
            self.free[i] = false;
        }
    }

    /// Least squares over the free columns by modified Gram-Schmidt. A column that depends
    /// on the others to within rounding keeps its value.
    fn free_solution(&mut self, x: &ActuatorVector) -> ActuatorVector {
        let mut basis = [PlaneVector::zeros(); MAX_FREEDOMS];
        let mut triangle = [[0.0; MAX_FREEDOMS]; MAX_FREEDOMS];
        let mut columns = [0; MAX_FREEDOMS];
        let mut rank = 0;
        for i in 0..self.count {
            if !self.free[i] || rank == MAX_FREEDOMS {
                continue;
            }
            let mut column: PlaneVector = self.matrix.column(i).into_owned();
            let length = self.length[i];
            let mut parts = [0.0; MAX_FREEDOMS];
            let mut rest = length;
            // Again where much was taken away: that leaves the rounding of nearly parallel
            // columns in the rest.
            for _ in 0..2 {
                let before = rest;
                for k in 0..rank {
                    let part = basis[k].dot(&column);
                    parts[k] += part;
                    column -= basis[k] * part;
                }
                rest = if rank == 0 { length } else { column.norm() };
                if rest > 0.5 * before {
                    break;
                }
            }
            if rest <= ROUNDING * length {
                self.free[i] = false;
                continue;
            }
            parts[rank] = rest;
            basis[rank] = column / rest;
            triangle[rank] = parts;
            columns[rank] = i;
            rank += 1;
        }
        let mut rest = self.residual(x);
        for &i in &columns[..rank] {
            rest += self.matrix.column(i) * x[i];
        }
        let mut goal = *x;
        for k in (0..rank).rev() {
            let value = basis[k].dot(&rest) / triangle[k][k];
            goal[columns[k]] = value;
            rest -= self.matrix.column(columns[k]) * value;
        }
        goal
    }
}
