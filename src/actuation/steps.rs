//! Torques in steps: coarse actuators are rounded first, finer ones carry what that leaves.
//!
//! Strong motors at the base and weak fine ones on the links give a force of both high range
//! and high resolution (Kim 2003, section 2.3). From the coarsest step to the finest the
//! actuators of one step are rounded to it, within their bounds, and the rest is distributed
//! anew over those that are finer; an actuator without a step is rounded last of all, that is,
//! not. Derived here.
//!
//! Which of them are rounded up and which down is not for each to decide alone: in many
//! postures the finer ones can hardly push along one direction, and what is left along it would
//! throw them from limit to limit. Of all the ways the one is taken that leaves the finer ones
//! least to do, and none of them takes up more than a few coarse steps.

use nalgebra::Matrix3;

use super::optimal::scaled;
use super::{Allocation, Bounds, Capability, optimal_weighted};
use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector, ReferenceMatrix};

/// A finer actuator moves by this many coarse steps for the sake of the coarse.
const TAKES_UP: f64 = 4.0;

/// To leave this share of what a coarse step gives at the handle costs as much as to move a
/// finer actuator by a coarse step.
const LEAVES: f64 = 0.05;

/// The torques that actuators with these steps can give for `torque_Nm`, which was to give
/// `wanted`; a step of zero is none.
pub fn in_steps(
    capability: &Capability,
    wanted: &PlaneVector,
    torque_Nm: &ActuatorVector,
    step_Nm: &ActuatorVector,
    weight: &ActuatorVector,
) -> Allocation {
    let (matrix, _) = scaled(capability, wanted);
    let mut left = *capability;
    let mut torque_Nm = *torque_Nm;
    let mut rounded = [false; MAX_ACTUATORS];
    for _ in 0..capability.actuators {
        let coarse = (0..capability.actuators).filter(|&i| !rounded[i] && step_Nm[i] > 0.0);
        let coarsest_Nm = coarse.map(|i| step_Nm[i]).fold(0.0, f64::max);
        if coarsest_Nm == 0.0 {
            break;
        }
        let mut ways = Ways::default();
        for i in (0..capability.actuators).filter(|&i| step_Nm[i] == coarsest_Nm) {
            rounded[i] = true;
            ways.add(i, around_Nm(capability, i, torque_Nm[i], coarsest_Nm));
        }
        let Bounds { lower_Nm: least_Nm, upper_Nm: most_Nm } = &capability.bounds;
        let finer = |i: usize| i < capability.actuators && !rounded[i] && least_Nm[i] < most_Nm[i];
        ways.choose(&matrix, &cost(&matrix, finer, coarsest_Nm), &mut torque_Nm);
        let takes_Nm = ActuatorVector::repeat(TAKES_UP * coarsest_Nm);
        let Bounds { lower_Nm, upper_Nm } = &mut left.bounds;
        (*lower_Nm, *upper_Nm) = (
            capability.bounds.clamp(&(torque_Nm - takes_Nm)),
            capability.bounds.clamp(&(torque_Nm + takes_Nm)),
        );
        for i in (0..capability.actuators).filter(|&i| rounded[i]) {
            (lower_Nm[i], upper_Nm[i]) = (torque_Nm[i], torque_Nm[i]);
        }
        if !(0..capability.actuators).any(finer) {
            break;
        }
        torque_Nm = optimal_weighted(&left, wanted, weight).torque_Nm;
    }
    capability.allocation(torque_Nm)
}

/// What it costs to leave a force: the least squares of what then still misses at the handle
/// and of what the finer ones move, as a form `r . C r` of the force r that the coarse miss by.
fn cost(matrix: &ReferenceMatrix, finer: impl Fn(usize) -> bool, step_Nm: f64) -> Matrix3<f64> {
    let leaves_N = LEAVES * step_Nm * matrix.norm();
    let mut reach = Matrix3::from_diagonal_element(leaves_N * leaves_N);
    for i in (0..MAX_ACTUATORS).filter(|&i| finer(i)) {
        let moved_N = matrix.column(i) * step_Nm;
        reach += moved_N * moved_N.transpose();
    }
    reach.try_inverse().unwrap_or_else(Matrix3::identity)
}

/// Actuators of one step, each with the torques below and above what it was to give.
#[derive(Default)]
struct Ways {
    actuators: [(usize, [f64; 2]); MAX_ACTUATORS],
    count: usize,
}

impl Ways {
    fn add(&mut self, i: usize, around_Nm: [f64; 2]) {
        self.actuators[self.count] = (i, around_Nm);
        self.count += 1;
    }

    /// Rounds `torque_Nm` in the way of least cost; at most 64 are tried.
    fn choose(
        &self,
        matrix: &ReferenceMatrix,
        cost: &Matrix3<f64>,
        torque_Nm: &mut ActuatorVector,
    ) {
        let to = |way: usize| {
            let actuators = self.actuators[..self.count].iter().enumerate();
            actuators.map(move |(bit, (i, around_Nm))| (*i, around_Nm[(way >> bit) & 1]))
        };
        let cost = |way: usize| {
            let missed = to(way)
                .map(|(i, to_Nm)| matrix.column(i) * (to_Nm - torque_Nm[i]))
                .sum::<PlaneVector>();
            missed.dot(&(cost * missed))
        };
        let best = (0..1_usize << self.count).min_by(|a, b| cost(*a).total_cmp(&cost(*b)));
        for (i, to_Nm) in to(best.unwrap_or(0)) {
            torque_Nm[i] = to_Nm;
        }
    }
}

/// The multiples of the step around a torque that lie within the bounds; zero always does.
fn around_Nm(capability: &Capability, i: usize, torque_Nm: f64, step_Nm: f64) -> [f64; 2] {
    let bounds = &capability.bounds;
    let most = (bounds.upper_Nm[i] / step_Nm).floor();
    let least = (bounds.lower_Nm[i] / step_Nm).ceil();
    let within = |steps: f64| if least > most { 0.0 } else { steps.min(most).max(least) };
    let steps = torque_Nm / step_Nm;
    [steps.floor(), steps.ceil()].map(|steps| within(steps) * step_Nm)
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::actuation::{ActuatorKind, ShaftMotion, optimal};
    use crate::notation::ReferenceMatrix;

    const COARSE_NM: f64 = 0.05;
    const FINE_NM: f64 = 0.001;

    fn device(rng: &mut ChaCha8Rng) -> Capability {
        let mut reference = ReferenceMatrix::zeros();
        for entry in reference.iter_mut() {
            *entry = rng.random_range(-10.0..10.0);
        }
        reference.row_mut(2).scale_mut(0.1);
        let kinds = [ActuatorKind::Motor; MAX_ACTUATORS];
        let max_Nm = ActuatorVector::from_column_slice(&[2.0, 0.4, 2.0, 0.4, 2.0, 0.4]);
        let bounds = Bounds::given(&kinds, &max_Nm, &[ShaftMotion::Rest; MAX_ACTUATORS]);
        let moment_length_m = 0.1;
        Capability { reference, freedoms: 3, actuators: 6, kinds, bounds, moment_length_m }
    }

    /// Median error of the force for actuators with these steps, newtons: now and then fine
    /// actuators meet their limits.
    fn error_N(step_Nm: [f64; MAX_ACTUATORS]) -> f64 {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        let step_Nm = ActuatorVector::from(step_Nm);
        let weight = ActuatorVector::from_column_slice(&[1.0, 3.0, 1.0, 3.0, 1.0, 3.0]);
        let mut errors_N = [0.0; 501];
        for error_N in &mut errors_N {
            let device = device(&mut rng);
            let wanted =
                PlaneVector::from_fn(|i, _| if i < 2 { rng.random_range(-3.0..3.0) } else { 0.0 });
            let exact = optimal(&device, &wanted).torque_Nm;
            let given = in_steps(&device, &wanted, &exact, &step_Nm, &weight);
            for i in 0..6 {
                let steps = given.torque_Nm[i] / step_Nm[i];
                assert!(step_Nm[i] == 0.0 || (steps - steps.round()).abs() < 1e-6, "{steps}");
            }
            assert!((device.bounds.clamp(&given.torque_Nm) - given.torque_Nm).amax() < 1e-12);
            *error_N = (given.wrench - wanted).xy().norm();
        }
        errors_N.sort_by(f64::total_cmp);
        errors_N[250]
    }

    /// The finer three can hardly push along one line, which the coarse miss by their steps.
    #[test]
    fn fine_actuators_do_not_swing_where_they_can_hardly_push() {
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let weight = ActuatorVector::repeat(1.0);
        let step_Nm = ActuatorVector::from_fn(|i, _| if i % 2 == 0 { COARSE_NM } else { FINE_NM });
        for _ in 0..300 {
            let mut device = device(&mut rng);
            let line =
                PlaneVector::from_fn(|i, _| [1.0, 1.0, 0.1][i] * rng.random_range(-1.0..1.0));
            let unit = line.normalize();
            for i in [1, 3, 5] {
                let column: PlaneVector = device.reference.column(i).into_owned();
                let weakened = column - unit * (0.999 * column.dot(&unit));
                device.reference.set_column(i, &weakened);
            }
            let wanted =
                PlaneVector::from_fn(|i, _| if i < 2 { rng.random_range(-3.0..3.0) } else { 0.0 });
            let exact = optimal(&device, &wanted).torque_Nm;
            let given = in_steps(&device, &wanted, &exact, &step_Nm, &weight).torque_Nm;
            for i in [1, 3, 5] {
                let moved_Nm = (given[i] - exact[i]).abs();
                assert!(moved_Nm <= TAKES_UP * COARSE_NM + FINE_NM, "{moved_Nm} N m");
            }
        }
    }

    /// One coarse step is a large part of a newton at the handle.
    #[test]
    fn fine_actuators_carry_what_coarse_ones_leave() {
        let (coarse, fine) = (COARSE_NM, FINE_NM);
        let alone = error_N([coarse; 6]);
        let both = error_N([coarse, fine, coarse, fine, coarse, fine]);
        let all_fine = error_N([fine; 6]);
        assert!((0.1..1.0).contains(&alone), "{alone}");
        assert!((0.5..2.0).contains(&(both / all_fine)), "{both} {all_fine}");
        assert!(error_N([coarse, 0.0, coarse, 0.0, coarse, 0.0]) < 1e-6);
        assert!(error_N([0.0; 6]) < 1e-9);
    }
}
