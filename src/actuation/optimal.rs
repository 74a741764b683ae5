//! The nearest achievable force, and among all torques that give it those of least norm.
//!
//! Two exact steps. First the nearest point of the zonotope `R tau`
//! ([`nearest_in_box`](super::nearest_in_box)); it is unique. Then the least weighted norm
//! among the torques that give it: an actuator with a slope towards the target is at its
//! bound in *every* optimum and stays there; for the others the dual in at most three
//! multipliers, `tau_i = clip(a_i . lambda / w_i)`, is convex and piecewise quadratic and is
//! solved by Newton steps with an exact line search. Should those not converge within their
//! bound, the first step's torques are returned: the force is exact either way.

use nalgebra::Matrix3;

use super::box_least_squares::{ROUNDING, nearest_in_box};
use super::{Allocation, Bounds, Capability};
use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector, ReferenceMatrix};

/// Slope towards the target, relative, above which an actuator counts as pinned.
const PINNED: f64 = 1e-10;

/// Newton steps; problems met so far needed at most nine.
const MAX_STEPS: usize = 32;

/// Torques within the bounds whose wrench is nearest to `desired`, least norm among equals.
pub fn optimal(capability: &Capability, desired: &PlaneVector) -> Allocation {
    optimal_weighted(capability, desired, &ActuatorVector::repeat(1.0))
}

/// As [`optimal`], with the least `sum w_i tau_i^2` among equals. Weights are positive.
pub fn optimal_weighted(
    capability: &Capability,
    desired: &PlaneVector,
    weights: &ActuatorVector,
) -> Allocation {
    let (matrix, target) = scaled(capability, desired);
    let Bounds { lower_Nm, upper_Nm } = &capability.bounds;
    let count = capability.actuators;
    let nearest = nearest_in_box(&matrix, &target, lower_Nm, upper_Nm, count);
    let least =
        Face::of(&matrix, &target, &nearest, &capability.bounds, weights, count).least_norm();
    let fixed = ActuatorVector::from_fn(|i, _| if i < count { nearest[i] } else { 0.0 });
    capability.allocation(least.unwrap_or(fixed))
}

/// Moments in units of force, and nothing in the rows that do not count.
pub(super) fn scaled(
    capability: &Capability,
    desired: &PlaneVector,
) -> (ReferenceMatrix, PlaneVector) {
    let share = if capability.freedoms > 2 { 1.0 / capability.moment_length_m } else { 0.0 };
    let (mut matrix, mut target) = (capability.reference, *desired);
    matrix.row_mut(2).scale_mut(share);
    target.z *= share;
    if capability.freedoms < 2 {
        matrix.row_mut(1).fill(0.0);
        target.y = 0.0;
    }
    (matrix, target)
}

/// All torques that give the nearest force: some are pinned, the rest may trade.
struct Face<'a> {
    matrix: &'a ReferenceMatrix,
    bounds: &'a Bounds,
    weights: &'a ActuatorVector,
    count: usize,
    /// Torques of the pinned, zero for the rest.
    pinned: ActuatorVector,
    trades: [bool; MAX_ACTUATORS],
    /// What the trading ones have to give together.
    share: PlaneVector,
    scale: f64,
}

impl<'a> Face<'a> {
    fn of(
        matrix: &'a ReferenceMatrix,
        target: &PlaneVector,
        nearest: &ActuatorVector,
        bounds: &'a Bounds,
        weights: &'a ActuatorVector,
        count: usize,
    ) -> Self {
        let image = matrix * nearest;
        let residual = target - image;
        let scale = (0..count).map(|i| matrix.column(i).norm() * nearest[i].abs()).sum::<f64>();
        let floor = (scale + target.norm()) * ROUNDING * 10.0;
        let mut face = Self {
            matrix,
            bounds,
            weights,
            count,
            pinned: ActuatorVector::zeros(),
            trades: [false; MAX_ACTUATORS],
            share: PlaneVector::zeros(),
            scale,
        };
        for i in 0..count {
            let column = matrix.column(i);
            let slope = column.dot(&residual).abs();
            face.trades[i] = slope <= column.norm() * (PINNED * residual.norm() + floor)
                && bounds.upper_Nm[i] > bounds.lower_Nm[i];
            if face.trades[i] {
                face.share += column * nearest[i];
            } else {
                face.pinned[i] = nearest[i];
            }
        }
        face
    }

    fn column(&self, i: usize) -> PlaneVector {
        self.matrix.column(i).into_owned()
    }

    fn trading(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.count).filter(|&i| self.trades[i])
    }

    /// Torque of a trading actuator under these multipliers.
    fn torque(&self, i: usize, lambda: &PlaneVector) -> f64 {
        let free = self.column(i).dot(lambda) / self.weights[i];
        free.min(self.bounds.upper_Nm[i]).max(self.bounds.lower_Nm[i])
    }

    fn least_norm(&self) -> Option<ActuatorVector> {
        // As if no bound were met: often right at once, and never far.
        let all = self.curvature(|_| true);
        let mut lambda = solve_in_range(&all, &self.share).0;
        for _ in 0..MAX_STEPS {
            let missing = self.missing(&lambda);
            if missing.norm() <= 4.0 * ROUNDING * (self.scale + self.share.norm()) {
                let mut torque = self.pinned;
                self.trading().for_each(|i| torque[i] = self.torque(i, &lambda));
                return Some(torque);
            }
            let direction = self.direction(&lambda, &missing);
            lambda += direction * self.line_search(&lambda, &direction)?;
        }
        None
    }

    fn missing(&self, lambda: &PlaneVector) -> PlaneVector {
        self.trading().fold(self.share, |rest, i| rest - self.column(i) * self.torque(i, lambda))
    }

    /// Newton's direction; where the free columns cannot give what is missing, the part of
    /// it that they cannot give, which brings a clipped actuator back.
    fn direction(&self, lambda: &PlaneVector, missing: &PlaneVector) -> PlaneVector {
        let curvature = self.curvature(|i| {
            let free = self.column(i).dot(lambda) / self.weights[i];
            free > self.bounds.lower_Nm[i] && free < self.bounds.upper_Nm[i]
        });
        let (newton, out_of_reach) = solve_in_range(&curvature, missing);
        if out_of_reach.norm() > 1e-9 * missing.norm() { out_of_reach } else { newton }
    }

    /// Curvature of the dual where these of the trading actuators are between their bounds.
    fn curvature(&self, between: impl Fn(usize) -> bool) -> Matrix3<f64> {
        let mut sum = Matrix3::zeros();
        for i in self.trading().filter(|&i| between(i)) {
            let column = self.column(i);
            sum += column * column.transpose() / self.weights[i];
        }
        sum
    }

    /// Step that minimises the dual along `direction`: its slope falls piecewise linearly,
    /// with a kink where an actuator meets or leaves a bound.
    fn line_search(&self, lambda: &PlaneVector, direction: &PlaneVector) -> Option<f64> {
        let mut kinks = [f64::INFINITY; 2 * MAX_ACTUATORS];
        let mut count = 0;
        for i in self.trading() {
            let rate = self.column(i).dot(direction) / self.weights[i];
            let value = self.column(i).dot(lambda) / self.weights[i];
            for bound in [self.bounds.lower_Nm[i], self.bounds.upper_Nm[i]] {
                let step = (bound - value) / rate;
                if step > 0.0 && step.is_finite() {
                    kinks[count] = step;
                    count += 1;
                }
            }
        }
        kinks[..count].sort_unstable_by(f64::total_cmp);
        let slope = |step: f64| self.missing(&(lambda + direction * step)).dot(direction);
        let (mut from, mut slope_from) = (0.0, slope(0.0));
        for &to in &kinks[..count] {
            let slope_to = slope(to);
            if slope_to <= 0.0 {
                return Some(from + (to - from) * slope_from / (slope_from - slope_to));
            }
            (from, slope_from) = (to, slope_to);
        }
        let beyond = from + from.abs().max(1.0);
        let fall = (slope_from - slope(beyond)) / (beyond - from);
        (fall > 0.0).then(|| from + slope_from / fall)
    }
}

/// Solves `curvature * x = b` on the range of a symmetric positive semidefinite 3x3 matrix,
/// by pivoted Gram-Schmidt on its columns; also returns the part of `b` outside that range.
fn solve_in_range(curvature: &Matrix3<f64>, b: &PlaneVector) -> (PlaneVector, PlaneVector) {
    let largest = curvature.diagonal().amax();
    let mut left = *curvature;
    let (mut x, mut rest) = (PlaneVector::zeros(), *b);
    let mut directions = [PlaneVector::zeros(); 3];
    let mut basis = [PlaneVector::zeros(); 3];
    let mut rank = 0;
    for _ in 0..3 {
        let pivot = left.diagonal().imax();
        if left[(pivot, pivot)] <= 1e-12 * largest || largest == 0.0 {
            break;
        }
        // A curvature-conjugate direction for each independent column.
        let mut direction = PlaneVector::ith(pivot, 1.0);
        for known in &directions[..rank] {
            let image = curvature * known;
            direction -= known * (image.dot(&direction) / image.dot(known));
        }
        let image = curvature * direction;
        x += direction * (direction.dot(b) / direction.dot(&image));
        left -= image * image.transpose() / direction.dot(&image);
        let mut unit = image;
        for _ in 0..2 {
            for known in &basis[..rank] {
                unit -= known * known.dot(&unit);
            }
        }
        basis[rank] = unit.normalize();
        rest -= basis[rank] * basis[rank].dot(&rest);
        directions[rank] = direction;
        rank += 1;
    }
    (x, if rank == 3 { PlaneVector::zeros() } else { rest })
}

#[cfg(test)]
#[path = "optimal_tests.rs"]
mod tests;
