//! Cho 2005's allocation: the exact pair of reference forces, else the nearest one alone.
//!
//! Two freedoms, as published (section 3.1). Between two available rays the pair next to the
//! desired force gives it exactly; beside them the nearest ray gives its projection, which is
//! nothing when gamma exceeds 90 degrees. A pair that is nearly collinear is never inverted:
//! such a force is given by its nearest ray.

use super::{Allocation, Bracket, Capability, Region, classify, optimal};
use crate::notation::{ActuatorVector, PlaneVector};

/// Rays closer than this to a line cannot be inverted.
const COLLINEAR: f64 = 1e-12;

/// The rule's torques before and after the torque limits.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct NearestReference {
    /// Torques the rule asks for.
    pub raw_torque_Nm: ActuatorVector,
    /// Clipped to the bounds, with their wrench.
    pub allocation: Allocation,
}

/// The rule for `desired` at a handle moving with `velocity`. With more than two freedoms
/// the nearest achievable wrench takes its place.
pub fn nearest_reference(
    capability: &Capability,
    desired: &PlaneVector,
    velocity: &PlaneVector,
) -> NearestReference {
    if capability.freedoms > 2 {
        let allocation = optimal(capability, desired);
        return NearestReference { raw_torque_Nm: allocation.torque_Nm, allocation };
    }
    let displayable = classify(capability, desired, velocity)
        .is_none_or(|found| found.region != Region::NotDisplayable);
    let bracket = Bracket::around(capability, desired)
        .filter(|_| displayable && desired.iter().all(|part| part.is_finite()));
    let raw_torque_Nm =
        bracket.map_or_else(ActuatorVector::zeros, |b| pair_or_nearest(capability, desired, &b));
    let clipped = capability.bounds.clamp(&raw_torque_Nm);
    NearestReference { raw_torque_Nm, allocation: capability.allocation(clipped) }
}

fn pair_or_nearest(
    capability: &Capability,
    desired: &PlaneVector,
    bracket: &Bracket,
) -> ActuatorVector {
    let mut torque = ActuatorVector::zeros();
    let (left, right) = (bracket.left, bracket.right);
    let ray = |i: usize| capability.reference.column(i).xy();
    let (a, b) = (ray(left.actuator), ray(right.actuator));
    let area = a.perp(&b);
    let invertible = area.abs() > COLLINEAR * a.norm() * b.norm();
    if bracket.encloses() && left.actuator != right.actuator && invertible {
        torque[left.actuator] = desired.xy().perp(&b) / area;
        torque[right.actuator] = a.perp(&desired.xy()) / area;
    } else {
        let nearest = bracket.nearest();
        let ray = ray(nearest.actuator);
        let projected = nearest.sign * desired.xy().dot(&ray) / ray.norm_squared();
        torque[nearest.actuator] = nearest.sign * projected.max(0.0);
    }
    torque
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuation::{ActuatorKind, Bounds, ShaftMotion};
    use crate::notation::{MAX_ACTUATORS, ReferenceMatrix};
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Derived here: without torque limits and for F.v <= 0 the rule equals the optimum.
    #[test]
    fn without_limits_the_rule_is_the_optimum() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        for _ in 0..2000 {
            let mut reference = ReferenceMatrix::zeros();
            for i in 0..4 {
                reference[(0, i)] = rng.random_range(-5.0..5.0);
                reference[(1, i)] = rng.random_range(-5.0..5.0);
            }
            let velocity =
                PlaneVector::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), 0.0);
            let mut desired =
                PlaneVector::new(rng.random_range(-9.0..9.0), rng.random_range(-9.0..9.0), 0.0);
            if desired.dot(&velocity) > 0.0 {
                desired = -desired;
            }
            let rates = reference.transpose() * velocity;
            let motion = std::array::from_fn(|i| ShaftMotion::of(rates[i], 0.0));
            let kinds = [ActuatorKind::Brake; MAX_ACTUATORS];
            let bounds = Bounds::given(&kinds, &ActuatorVector::repeat(1e9), &motion);
            let capability = Capability {
                reference,
                freedoms: 2,
                actuators: 4,
                kinds,
                bounds,
                moment_length_m: 1.0,
            };
            let rule = nearest_reference(&capability, &desired, &velocity).allocation.wrench;
            let best = optimal(&capability, &desired).wrench;
            assert!((rule - best).norm() < 1e-8, "{rule} for {best}");
        }
    }

    #[test]
    fn collinear_rays_are_never_inverted() {
        let mut reference = ReferenceMatrix::zeros();
        reference[(0, 0)] = 1.0;
        reference[(0, 1)] = 3.0;
        let kinds = [ActuatorKind::Brake; MAX_ACTUATORS];
        let bounds = Bounds::given(
            &kinds,
            &ActuatorVector::repeat(9.0),
            &[ShaftMotion::Rest; MAX_ACTUATORS],
        );
        let capability = Capability {
            reference,
            freedoms: 2,
            actuators: 2,
            kinds,
            bounds,
            moment_length_m: 1.0,
        };
        let desired = PlaneVector::new(2.0, 0.5, 0.0);
        let found = nearest_reference(&capability, &desired, &PlaneVector::zeros());
        assert!((found.allocation.wrench - PlaneVector::new(2.0, 0.0, 0.0)).norm() < 1e-12);
    }
}
