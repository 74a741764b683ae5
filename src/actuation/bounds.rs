//! The interval of torque that each actuator can give now.
//!
//! Brakes as Cho 2005, Eq 1, and Karnopp 1985: torque only against the rate. At rest a
//! brake may act either way, up to what holds against the hand.

use serde::{Deserialize, Serialize};

use super::Allocation;
use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector, ReferenceMatrix};

/// What an actuator is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum ActuatorKind {
    /// Passive: only dissipates.
    #[default]
    Brake,
    /// Active.
    Motor,
}

/// Which way a shaft turns, as far as its encoder can tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum ShaftMotion {
    /// Too slow for a sign.
    #[default]
    Rest,
    /// Positive rate.
    Forward,
    /// Negative rate.
    Backward,
}

impl ShaftMotion {
    /// The motion of a shaft whose rate is known to `eps`.
    pub fn of(rate_rad_per_s: f64, eps_rad_per_s: f64) -> Self {
        match rate_rad_per_s {
            rate if rate > eps_rad_per_s => Self::Forward,
            rate if rate < -eps_rad_per_s => Self::Backward,
            _ => Self::Rest,
        }
    }
}

/// Smallest and largest torque of each actuator, N m.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Bounds {
    /// Never positive for what `given` makes.
    pub lower_Nm: ActuatorVector,
    /// Never negative for what `given` makes.
    pub upper_Nm: ActuatorVector,
}

impl Bounds {
    /// The bounds of these actuators moving like this.
    pub fn given(
        kinds: &[ActuatorKind; MAX_ACTUATORS],
        max_torque_Nm: &ActuatorVector,
        motion: &[ShaftMotion; MAX_ACTUATORS],
    ) -> Self {
        let may = |i: usize, against: ShaftMotion| {
            let allowed = kinds[i] == ActuatorKind::Motor
                || motion[i] == ShaftMotion::Rest
                || motion[i] == against;
            if allowed { max_torque_Nm[i].max(0.0) } else { 0.0 }
        };
        Self {
            lower_Nm: ActuatorVector::from_fn(|i, _| -may(i, ShaftMotion::Forward)),
            upper_Nm: ActuatorVector::from_fn(|i, _| may(i, ShaftMotion::Backward)),
        }
    }

    /// `torque_Nm` moved into the bounds; what is not a number becomes the value nearest zero.
    pub fn clamp(&self, torque_Nm: &ActuatorVector) -> ActuatorVector {
        ActuatorVector::from_fn(|i, _| {
            let wanted_Nm = if torque_Nm[i].is_nan() { 0.0 } else { torque_Nm[i] };
            wanted_Nm.min(self.upper_Nm[i]).max(self.lower_Nm[i])
        })
    }
}

/// What the actuators can do here and now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capability {
    /// Handle wrench per unit torque.
    pub reference: ReferenceMatrix,
    /// Actuated freedoms, 2 or 3; further rows of `reference` are not read.
    pub freedoms: usize,
    /// Actuators; further columns are not read.
    pub actuators: usize,
    /// Brake or motor.
    pub kinds: [ActuatorKind; MAX_ACTUATORS],
    /// Torques possible now.
    pub bounds: Bounds,
    /// Length that makes moments comparable with forces: `|F|^2 = fx^2 + fy^2 + (m/L)^2`.
    pub moment_length_m: f64,
}

impl Capability {
    /// True when something can only take energy out.
    pub fn has_brakes(&self) -> bool {
        self.kinds[..self.actuators].contains(&ActuatorKind::Brake)
    }

    /// True when nothing can put energy in.
    pub fn is_passive(&self) -> bool {
        self.kinds[..self.actuators].iter().all(|kind| *kind == ActuatorKind::Brake)
    }

    /// Largest force in `direction`, newtons, that the actuators could give if every one of
    /// them could act both ways: the device's range here, whatever moves. `direction` need
    /// not have length 1; without a direction there is no range.
    ///
    /// The wrenches of all torques form a zonotope, and along a direction its surface is where
    /// the first of its facets is met: `min h(n) / |d . n|` over the facets' normals n, with
    /// the support function `h(n) = sum |r_i . n| tau_i`. Where `d` lies in a flat zonotope, no
    /// facet bounds it, and the rays themselves do.
    pub fn range_N(&self, direction: &PlaneVector) -> f64 {
        let in_force = |v: &PlaneVector| match self.freedoms {
            2 => PlaneVector::new(v.x, v.y, 0.0),
            _ => PlaneVector::new(v.x, v.y, v.z / self.moment_length_m),
        };
        let Some(along) = in_force(direction).try_normalize(1e-12) else { return 0.0 };
        // Each ray as long as its actuator can make it.
        let mut rays = [PlaneVector::zeros(); MAX_ACTUATORS];
        let rays = &mut rays[..self.actuators.min(MAX_ACTUATORS)];
        for (i, ray) in rays.iter_mut().enumerate() {
            let most_Nm = self.bounds.upper_Nm[i].max(-self.bounds.lower_Nm[i]);
            *ray = in_force(&self.reference.column(i).into_owned()) * most_Nm;
        }
        let rays = &*rays;
        let facet_N = |normal: PlaneVector| {
            let slope = along.dot(&normal).abs();
            if slope <= 1e-9 * normal.norm() {
                return f64::INFINITY;
            }
            rays.iter().map(|ray| ray.dot(&normal).abs()).sum::<f64>() / slope
        };
        let mut range_N = f64::INFINITY;
        for (i, ray) in rays.iter().enumerate() {
            if self.freedoms == 2 {
                range_N = range_N.min(facet_N(PlaneVector::new(-ray.y, ray.x, 0.0)));
            } else {
                let normals = rays[..i].iter().map(|other| ray.cross(other));
                range_N = normals.map(facet_N).fold(range_N, f64::min);
            }
        }
        if range_N.is_infinite() {
            range_N = rays.iter().copied().map(facet_N).fold(range_N, f64::min);
        }
        if range_N.is_finite() { range_N } else { 0.0 }
    }

    /// The wrench of these torques.
    pub fn allocation(&self, torque_Nm: ActuatorVector) -> Allocation {
        let mut wrench = PlaneVector::zeros();
        for i in 0..self.actuators {
            wrench += self.reference.column(i) * torque_Nm[i];
        }
        if self.freedoms == 2 {
            wrench.z = 0.0;
        }
        Allocation { torque_Nm, wrench }
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::actuation::optimal;

    #[test]
    fn a_brake_acts_only_against_its_rate_and_a_motor_both_ways() {
        let mut kinds = [ActuatorKind::Brake; MAX_ACTUATORS];
        kinds[3] = ActuatorKind::Motor;
        let mut motion = [ShaftMotion::Rest; MAX_ACTUATORS];
        motion[0] = ShaftMotion::Forward;
        motion[1] = ShaftMotion::Backward;
        motion[3] = ShaftMotion::Forward;
        let bounds = Bounds::given(&kinds, &ActuatorVector::repeat(5.0), &motion);
        assert_eq!(bounds.lower_Nm.as_slice()[..4], [-5.0, 0.0, -5.0, -5.0]);
        assert_eq!(bounds.upper_Nm.as_slice()[..4], [0.0, 5.0, 5.0, 5.0]);
    }

    /// Against the allocator: just inside the range a wrench can be given, just outside not.
    #[test]
    fn the_range_is_where_the_allocator_gives_up() {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        for case in 0..2000 {
            let freedoms = rng.random_range(2..=3);
            let actuators = rng.random_range(freedoms..=MAX_ACTUATORS);
            let mut reference = ReferenceMatrix::zeros();
            for entry in reference.columns_mut(0, actuators).iter_mut() {
                *entry = rng.random_range(-5.0..5.0);
            }
            let kinds = [ActuatorKind::Motor; MAX_ACTUATORS];
            let max = ActuatorVector::from_fn(|_, _| rng.random_range(0.5..20.0));
            let bounds = Bounds::given(&kinds, &max, &[ShaftMotion::Rest; MAX_ACTUATORS]);
            let device =
                Capability { reference, freedoms, actuators, kinds, bounds, moment_length_m: 1.0 };
            let mut direction = PlaneVector::from_fn(|_, _| rng.random_range(-1.0..1.0));
            direction.z *= f64::from(u8::from(freedoms == 3));
            let range_N = device.range_N(&direction);
            let error_N = |share: f64| {
                let wanted = direction.normalize() * range_N * share;
                (optimal(&device, &wanted).wrench - wanted).norm()
            };
            assert!(error_N(0.999) < 1e-9 * range_N.max(1.0), "case {case}");
            assert!(error_N(1.01) > 1e-6 * range_N, "case {case}");
        }
    }

    #[test]
    fn without_a_direction_or_a_ray_there_is_no_range() {
        let mut reference = ReferenceMatrix::zeros();
        let kinds = [ActuatorKind::Brake; MAX_ACTUATORS];
        let bounds = Bounds::given(&kinds, &ActuatorVector::repeat(2.0), &Default::default());
        let flat = |reference| Capability {
            reference,
            freedoms: 2,
            actuators: 2,
            kinds,
            bounds,
            moment_length_m: 1.0,
        };
        assert_eq!(flat(reference).range_N(&PlaneVector::x()), 0.0);
        reference[(0, 0)] = 3.0;
        assert_eq!(flat(reference).range_N(&PlaneVector::zeros()), 0.0);
        assert!((flat(reference).range_N(&PlaneVector::x()) - 6.0).abs() < 1e-12);
        assert_eq!(flat(reference).range_N(&PlaneVector::y()), 0.0);
    }

    #[test]
    fn a_rate_within_eps_is_rest() {
        assert_eq!(ShaftMotion::of(1e-6, 1e-6), ShaftMotion::Rest);
        assert_eq!(ShaftMotion::of(-2e-6, 1e-6), ShaftMotion::Backward);
        assert_eq!(ShaftMotion::of(f64::NAN, 1e-6), ShaftMotion::Rest);
    }
}
