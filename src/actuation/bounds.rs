//! The interval of torque that each actuator can give now.
//!
//! Brakes as Cho 2005, Eq 1, and Karnopp 1985: torque only against the rate. At rest a
//! brake may act either way, up to what holds against the hand.

use super::Allocation;
use crate::notation::{ActuatorVector, MAX_ACTUATORS, ReferenceMatrix};

/// What an actuator is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
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
#[derive(Clone, Copy, Debug, PartialEq, Default)]
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
    /// True when nothing can put energy in.
    pub fn is_passive(&self) -> bool {
        self.kinds[..self.actuators].iter().all(|kind| *kind == ActuatorKind::Brake)
    }

    /// The wrench of these torques.
    pub fn allocation(&self, torque_Nm: ActuatorVector) -> Allocation {
        let mut wrench = crate::notation::PlaneVector::zeros();
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
    use super::*;

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

    #[test]
    fn a_rate_within_eps_is_rest() {
        assert_eq!(ShaftMotion::of(1e-6, 1e-6), ShaftMotion::Rest);
        assert_eq!(ShaftMotion::of(-2e-6, 1e-6), ShaftMotion::Backward);
        assert_eq!(ShaftMotion::of(f64::NAN, 1e-6), ShaftMotion::Rest);
    }
}
