//! Force distribution over redundant actuators: least norm, weighted, and by the null space.
//!
//! `R T = F` has as many solutions as there are actuators to spare. The weighted one is
//! `T_w = P F` with `P = W^-1 R^T (R W^-1 R^T)^-1` (Kim 2003, Eq 23; Eq 22 where all weights
//! are one), and every other one is `T_w + N e` with the null space `N = I - P R`. Where an
//! actuator would have to give more than it can, `e` sets it to its limit and spreads the
//! rest (Eq 26-31):
//!
//! ```text
//! T = T_w + N C^+ (limits - T_w of the pinned)        C = the pinned rows of N
//! ```
//!
//! The limit carries the sign of the torque that met it, which the paper leaves out. As
//! published one actuator is pinned, among the floating ones: those with more weight than the
//! least; this often fails where a solution exists. Derived here: pin the worst of all and
//! look again, until none is over its limit or there is nothing to spare.
//!
//! None of these knows what is nearest when a wrench cannot be given: their torques go beyond
//! the limits then, and are clipped by whoever commands them. The exact answer is
//! [`optimal_weighted`](super::optimal_weighted).

use nalgebra::{Matrix3, SMatrix};

use super::Capability;
use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector, ReferenceMatrix};

/// Beyond a limit by this share counts as rounding.
const ROUNDING: f64 = 1e-9;

/// Pivots smaller than this, relative to the largest possible one, cannot be divided by.
const SINGULAR: f64 = 1e-12;

/// A square matrix of all actuators.
type Square = SMatrix<f64, MAX_ACTUATORS, MAX_ACTUATORS>;

/// All torques that give a wrench: one of them, and how they differ.
#[derive(Clone, Copy, Debug)]
pub struct Distribution {
    /// The torques of least weighted norm, N m.
    pub weighted_Nm: ActuatorVector,
    /// `N = I - P R`.
    null_space: Square,
    /// Actuators beyond the freedoms.
    spare: usize,
}

/// Torques with what was done to find them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distributed {
    /// Torques, perhaps beyond the limits.
    pub torque_Nm: ActuatorVector,
    /// Which actuators are at their limits on purpose.
    pub pinned: [bool; MAX_ACTUATORS],
}

impl Distribution {
    /// All ways to give `desired` with these weights, which are positive. `None` where the
    /// actuators do not span the freedoms.
    pub fn of(
        capability: &Capability,
        desired: &PlaneVector,
        weight: &ActuatorVector,
    ) -> Option<Self> {
        let (reference, wrench) = in_freedoms(capability, desired);
        let mut per_weight = reference.transpose();
        for (mut row, weight) in per_weight.row_iter_mut().zip(weight) {
            row /= *weight;
        }
        let mut gram = reference * per_weight;
        for freedom in capability.freedoms..3 {
            gram[(freedom, freedom)] = 1.0;
        }
        let inverse = per_weight * regular_inverse(&gram)?;
        let mut null_space = -(inverse * reference);
        (0..capability.actuators).for_each(|i| null_space[(i, i)] += 1.0);
        let spare = capability.actuators.saturating_sub(capability.freedoms);
        Some(Self { weighted_Nm: inverse * wrench, null_space, spare })
    }

    /// As published: the floating actuator that is furthest over its limit is set to it.
    pub fn null_space(&self, capability: &Capability, weight: &ActuatorVector) -> Distributed {
        let least = (0..capability.actuators).map(|i| weight[i]).fold(f64::INFINITY, f64::min);
        let alike = (0..capability.actuators).all(|i| weight[i] == least);
        let over = |i: usize| {
            let most_Nm = limit_Nm(capability, &self.weighted_Nm, i).abs();
            self.weighted_Nm[i].abs() - most_Nm
        };
        let floating = (0..capability.actuators).filter(|&i| alike || weight[i] > least);
        let worst = floating.max_by(|&a, &b| over(a).total_cmp(&over(b)));
        let mut pinned = Pinned::none();
        if let Some(worst) = worst.filter(|&worst| over(worst) > 0.0 && self.spare > 0) {
            pinned.set(worst, limit_Nm(capability, &self.weighted_Nm, worst));
        }
        Distributed { torque_Nm: self.with(&pinned), pinned: pinned.which }
    }

    /// The worst actuator of all is pinned, and again, while there is one to spare.
    pub fn null_space_iterated(&self, capability: &Capability) -> Distributed {
        let mut pinned = Pinned::none();
        let mut torque_Nm = self.weighted_Nm;
        for _ in 0..self.spare.min(MAX_ACTUATORS) {
            let ratio = |i: usize| torque_Nm[i].abs() / limit_Nm(capability, &torque_Nm, i).abs();
            let over = |&i: &usize| !pinned.which[i] && ratio(i) > 1.0 + ROUNDING;
            let worst = (0..capability.actuators).filter(over);
            let Some(worst) = worst.max_by(|&a, &b| ratio(a).total_cmp(&ratio(b))) else { break };
            pinned.set(worst, limit_Nm(capability, &torque_Nm, worst));
            torque_Nm = self.with(&pinned);
        }
        Distributed { torque_Nm, pinned: pinned.which }
    }

    /// `T_w + N C^+ (limits - T_w)` with `C^+ = C^T (C C^T)^-1`; rows of `C` that depend on
    /// each other leave the torques as they are.
    fn with(&self, pinned: &Pinned) -> ActuatorVector {
        let mut rows = self.null_space;
        let mut gram = Square::identity();
        let mut missing_Nm = ActuatorVector::zeros();
        for (i, is_pinned) in pinned.which.iter().enumerate() {
            if *is_pinned {
                missing_Nm[i] = pinned.torque_Nm[i] - self.weighted_Nm[i];
            } else {
                rows.row_mut(i).fill(0.0);
            }
        }
        let products = rows * rows.transpose();
        for i in 0..MAX_ACTUATORS {
            for j in 0..MAX_ACTUATORS {
                if pinned.which[i] && pinned.which[j] {
                    gram[(i, j)] = products[(i, j)];
                }
            }
        }
        let regular = gram.cholesky().filter(|found| found.l_dirty().diagonal().min() > SINGULAR);
        let Some(regular) = regular else { return self.weighted_Nm };
        self.weighted_Nm + self.null_space * rows.transpose() * regular.solve(&missing_Nm)
    }
}

/// Torques of least norm that give `desired` (Eq 22), whatever the limits.
pub fn least_norm(capability: &Capability, desired: &PlaneVector) -> ActuatorVector {
    weighted(capability, desired, &ActuatorVector::repeat(1.0))
}

/// Torques of least weighted norm (Eq 23), whatever the limits; none where the actuators do
/// not span the freedoms.
pub fn weighted(
    capability: &Capability,
    desired: &PlaneVector,
    weight: &ActuatorVector,
) -> ActuatorVector {
    Distribution::of(capability, desired, weight)
        .map_or_else(ActuatorVector::zeros, |found| found.weighted_Nm)
}

/// The actuators that are set to a torque.
struct Pinned {
    which: [bool; MAX_ACTUATORS],
    torque_Nm: ActuatorVector,
}

impl Pinned {
    fn none() -> Self {
        Self { which: [false; MAX_ACTUATORS], torque_Nm: ActuatorVector::zeros() }
    }

    fn set(&mut self, actuator: usize, torque_Nm: f64) {
        self.which[actuator] = true;
        self.torque_Nm[actuator] = torque_Nm;
    }
}

/// The limit on the side of a torque.
fn limit_Nm(capability: &Capability, torque_Nm: &ActuatorVector, i: usize) -> f64 {
    let bounds = &capability.bounds;
    if torque_Nm[i] < 0.0 { bounds.lower_Nm[i] } else { bounds.upper_Nm[i] }
}

/// The columns and rows that count.
fn in_freedoms(capability: &Capability, desired: &PlaneVector) -> (ReferenceMatrix, PlaneVector) {
    let (mut reference, mut wrench) = (capability.reference, *desired);
    for freedom in capability.freedoms..3 {
        reference.row_mut(freedom).fill(0.0);
        wrench[freedom] = 0.0;
    }
    for actuator in capability.actuators..MAX_ACTUATORS {
        reference.column_mut(actuator).fill(0.0);
    }
    (reference, wrench)
}

/// The inverse of a symmetric matrix whose rows may differ in unit; `None` where rounding
/// would be most of it.
fn regular_inverse(gram: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let scale = gram.diagonal().map(|entry| 1.0 / entry.sqrt());
    let scaled = Matrix3::from_fn(|i, j| gram[(i, j)] * scale[i] * scale[j]);
    let regular = scaled.iter().all(|entry| entry.is_finite()) && scaled.determinant() > SINGULAR;
    let inverse = regular.then(|| scaled.try_inverse())??;
    Some(Matrix3::from_fn(|i, j| inverse[(i, j)] * scale[i] * scale[j]))
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::actuation::{ActuatorKind, Bounds, ShaftMotion, optimal_weighted};

    fn device(rng: &mut ChaCha8Rng, freedoms: usize, actuators: usize) -> Capability {
        let mut reference = ReferenceMatrix::zeros();
        for i in 0..actuators {
            (0..freedoms).for_each(|row| reference[(row, i)] = rng.random_range(-9.0..9.0));
        }
        let kinds = [ActuatorKind::Motor; MAX_ACTUATORS];
        let max_Nm = ActuatorVector::from_fn(|_, _| rng.random_range(0.3..2.0));
        let bounds = Bounds::given(&kinds, &max_Nm, &[ShaftMotion::Rest; MAX_ACTUATORS]);
        Capability { reference, freedoms, actuators, kinds, bounds, moment_length_m: 0.1 }
    }

    fn wanted(rng: &mut ChaCha8Rng, freedoms: usize) -> PlaneVector {
        PlaneVector::from_fn(|i, _| if i < freedoms { rng.random_range(-6.0..6.0) } else { 0.0 })
    }

    fn within(capability: &Capability, torque_Nm: &ActuatorVector) -> bool {
        (capability.bounds.clamp(torque_Nm) - torque_Nm).amax() < 1e-7
    }

    /// Against the exact bounded solution, whose norm is never larger, and which exists where
    /// any of them stays within the limits.
    #[test]
    fn every_scheme_gives_the_wrench_and_none_beats_the_exact_one() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let (mut once, mut iterated, mut feasible) = (0, 0, 0);
        for case in 0..2000 {
            let freedoms = 2 + case % 2;
            let actuators = rng.random_range(freedoms + 1..=MAX_ACTUATORS);
            let device = device(&mut rng, freedoms, actuators);
            let weight = ActuatorVector::from_fn(|i, _| if i % 2 == 0 { 1.0 } else { 4.0 });
            let wanted = wanted(&mut rng, freedoms);
            let all = Distribution::of(&device, &wanted, &weight).expect("regular");
            let exact = optimal_weighted(&device, &wanted, &weight);
            let can = (exact.wrench - wanted).norm() < 1e-9;
            feasible += usize::from(can);
            let norm = |torque: &ActuatorVector| torque.component_mul(torque).dot(&weight);
            for (scheme, solved) in [
                (all.null_space(&device, &weight), &mut once),
                (all.null_space_iterated(&device), &mut iterated),
            ] {
                let error = device.reference * scheme.torque_Nm - wanted;
                assert!(error.norm() < 1e-8, "case {case}: {error}");
                for i in (0..actuators).filter(|&i| scheme.pinned[i]) {
                    let limit_Nm = device.bounds.upper_Nm[i];
                    let miss = scheme.torque_Nm[i].abs() - limit_Nm;
                    assert!(miss.abs() < 1e-7, "case {case}: pinned {i} misses by {miss}");
                }
                if within(&device, &scheme.torque_Nm) {
                    *solved += 1;
                    assert!(can && norm(&scheme.torque_Nm) > norm(&exact.torque_Nm) - 1e-7);
                }
            }
        }
        assert!(once < iterated && iterated <= feasible && feasible < 2000);
        assert!(10 * iterated > 9 * feasible, "{once} {iterated} {feasible}");
    }

    #[test]
    fn equal_weights_are_the_least_norm() {
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        for _ in 0..200 {
            let device = device(&mut rng, 3, 6);
            let wanted = wanted(&mut rng, 3);
            let least = least_norm(&device, &wanted);
            assert!((device.reference * least - wanted).norm() < 1e-9);
            let twice = weighted(&device, &wanted, &ActuatorVector::repeat(2.0));
            assert!((least - twice).norm() < 1e-9);
            let other = Distribution::of(&device, &wanted, &ActuatorVector::repeat(1.0));
            let null_space = other.expect("regular").null_space;
            for column in null_space.column_iter() {
                assert!(least.dot(&column).abs() < 1e-9, "orthogonal to what gives nothing");
            }
        }
    }

    #[test]
    fn actuators_that_do_not_span_the_freedoms_and_nonsense_give_nothing() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut flat = device(&mut rng, 2, 3);
        flat.reference.row_mut(1).fill(0.0);
        assert_eq!(least_norm(&flat, &PlaneVector::x()), ActuatorVector::zeros());
        let mut broken = device(&mut rng, 3, 6);
        broken.reference[(0, 0)] = f64::NAN;
        assert_eq!(least_norm(&broken, &PlaneVector::x()), ActuatorVector::zeros());
    }
}
