//! Torques in steps: coarse actuators are rounded first, finer ones carry what that leaves.
//!
//! Strong motors at the base and weak fine ones on the links give a force of both high range
//! and high resolution (Kim 2003, section 2.3). From the coarsest step to the finest the
//! actuators of one step are rounded to it, within their bounds, and the rest is distributed
//! anew over those that are finer; an actuator without a step is rounded last of all, that is,
//! not. Derived here.

use super::{Allocation, Capability, optimal_weighted};
use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector};

/// The torques that actuators with these steps can give for `torque_Nm`, which was to give
/// `wanted`; a step of zero is none.
pub fn in_steps(
    capability: &Capability,
    wanted: &PlaneVector,
    torque_Nm: &ActuatorVector,
    step_Nm: &ActuatorVector,
    weight: &ActuatorVector,
) -> Allocation {
    let mut left = *capability;
    let mut torque_Nm = *torque_Nm;
    let mut rounded = [false; MAX_ACTUATORS];
    for _ in 0..capability.actuators {
        let coarse = (0..capability.actuators).filter(|&i| !rounded[i] && step_Nm[i] > 0.0);
        let coarsest_Nm = coarse.map(|i| step_Nm[i]).fold(0.0, f64::max);
        if coarsest_Nm == 0.0 {
            break;
        }
        for i in (0..capability.actuators).filter(|&i| step_Nm[i] == coarsest_Nm) {
            rounded[i] = true;
            let to_Nm = nearest_step_Nm(capability, i, torque_Nm[i], coarsest_Nm);
            (left.bounds.lower_Nm[i], left.bounds.upper_Nm[i]) = (to_Nm, to_Nm);
            torque_Nm[i] = to_Nm;
        }
        if (0..capability.actuators).all(|i| rounded[i]) {
            break;
        }
        torque_Nm = optimal_weighted(&left, wanted, weight).torque_Nm;
    }
    capability.allocation(torque_Nm)
}

/// The nearest multiple of the step that lies within the bounds; zero always does.
fn nearest_step_Nm(capability: &Capability, i: usize, torque_Nm: f64, step_Nm: f64) -> f64 {
    let bounds = &capability.bounds;
    let steps = (torque_Nm / step_Nm).round();
    let most = (bounds.upper_Nm[i] / step_Nm).floor();
    let least = (bounds.lower_Nm[i] / step_Nm).ceil();
    if least > most { 0.0 } else { steps.min(most).max(least) * step_Nm }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::actuation::{ActuatorKind, Bounds, ShaftMotion, optimal};
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
