//! What brakes with lag hold though they need not any more, and what they cannot reach yet.
//!
//! A brake lets go no faster than its lag, and comes no faster than that under all it has. Where
//! one still holds more than it should, the others make up for what that does to the wall:
//! more where it pushes in, less where it carries. Where those that should stop an impact
//! cannot come in time, every other brake that slows it lends what it can.
//!
//! Capacities, N m, and forces at the handle along the wall's normal.

use super::observer::Body;
use super::sides::{Sides, most_Nm};
use crate::actuation::Capability;
use crate::notation::{ActuatorVector, PlaneVector};

/// From this speed along the wall on what lingers acts against the way.
const MOVING_M_PER_S: f64 = 3e-3;

/// What lingers may at most multiply what the others carry.
const MOST_TIMES: f64 = 3.0;

/// Faster into the wall is an impact, and a force missing beyond this is worth a jolt.
const IMPACT_M_PER_S: f64 = 0.03;
const MISSING_N: f64 = 2.0;

/// What each brake will hold at least and at most once it has had its time.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    least_Nm: ActuatorVector,
    most_Nm: ActuatorVector,
}

impl Reach {
    /// From what is reached now, within `reach_s`.
    pub fn of(
        capability: &Capability,
        reached_Nm: &ActuatorVector,
        lag_s: &ActuatorVector,
        reach_s: f64,
    ) -> Self {
        let kept = lag_s.map(|lag_s| if lag_s > 0.0 { (-reach_s / lag_s).exp() } else { 0.0 });
        let most_Nm = ActuatorVector::from_fn(|i, _| {
            let most_Nm = most_Nm(capability, i);
            most_Nm + (reached_Nm[i] - most_Nm) * kept[i]
        });
        Self { least_Nm: reached_Nm.component_mul(&kept), most_Nm }
    }

    /// The brakes that carry make up for those that linger, while the handle slides in `way` at
    /// `speed_m_per_s`.
    pub fn make_up(
        &self,
        capacity_Nm: &mut ActuatorVector,
        sides: &Sides,
        way: f64,
        speed_m_per_s: f64,
    ) {
        let moving = (way * speed_m_per_s / MOVING_M_PER_S).clamp(0.0, 1.0);
        let (mut extra_N, mut carried_N) = (0.0, 0.0);
        for i in 0..sides.count {
            let (grip_N, holds) = (sides.grip[i].abs(), way * sides.drag[i] < 0.0);
            let lingers_Nm = self.least_Nm[i] - capacity_Nm[i];
            if lingers_Nm > 0.0 {
                let out = if holds { 1.0 } else { -1.0 };
                extra_N += moving * out * lingers_Nm * grip_N;
            } else if holds {
                carried_N += capacity_Nm[i] * grip_N;
            }
        }
        if carried_N <= 0.0 {
            return;
        }
        let times = (1.0 - extra_N / carried_N).clamp(0.0, MOST_TIMES);
        for i in 0..sides.count {
            if way * sides.drag[i] < 0.0 && self.least_Nm[i] <= capacity_Nm[i] {
                capacity_Nm[i] *= times;
            }
        }
    }

    /// Every brake that slows an impact lends what those that should cannot reach.
    pub fn lend(
        &self,
        capacity_Nm: &mut ActuatorVector,
        sides: &Sides,
        body: &Body,
        normal: &PlaneVector,
        velocity: &PlaneVector,
    ) {
        let short_Nm = (*capacity_Nm - self.most_Nm).map(|Nm| Nm.max(0.0));
        let mut missing_N: f64 = (0..sides.count).map(|i| short_Nm[i] * sides.grip[i].abs()).sum();
        if missing_N < MISSING_N || -velocity.dot(normal) < IMPACT_M_PER_S {
            return;
        }
        for i in 0..sides.count {
            let slows = body.reference.column(i).dot(velocity) * sides.grip[i] < 0.0;
            let spare_N = (self.most_Nm[i] - capacity_Nm[i]) * sides.grip[i].abs();
            if slows && spare_N > 0.0 && missing_N > 0.0 {
                let lent_N = spare_N.min(missing_N);
                capacity_Nm[i] += lent_N / sides.grip[i].abs();
                missing_N -= lent_N;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuation::{ActuatorKind, Bounds, ShaftMotion};
    use crate::notation::{HandleInertia, MAX_ACTUATORS, ReferenceMatrix};

    /// A wall whose normal is -x, slid along -y: the first brake carries, the second, on the
    /// other side, pushes in.
    fn device() -> (Capability, Body, Sides) {
        let mut reference = ReferenceMatrix::zeros();
        for (i, column) in [[-3.0, 1.0], [-2.0, -2.0]].iter().enumerate() {
            (reference[(0, i)], reference[(1, i)]) = (column[0], column[1]);
        }
        let kinds = [ActuatorKind::Brake; MAX_ACTUATORS];
        let motion = [ShaftMotion::Rest; MAX_ACTUATORS];
        let bounds = Bounds::given(&kinds, &ActuatorVector::repeat(20.0), &motion);
        let (freedoms, actuators, moment_length_m) = (2, 2, 1.0);
        let device = Capability { reference, freedoms, actuators, kinds, bounds, moment_length_m };
        let body = Body::of(&device, &HandleInertia::identity()).expect("regular");
        let sides = Sides::of(&device, &body, &-PlaneVector::x(), 10.0);
        (device, body, sides)
    }

    fn both(Nm: f64, other_Nm: f64) -> ActuatorVector {
        ActuatorVector::from_column_slice(&[Nm, other_Nm, 0.0, 0.0, 0.0, 0.0])
    }

    #[test]
    fn a_brake_that_lingers_and_pushes_in_is_made_up_for_by_the_one_that_carries() {
        let (device, _, sides) = device();
        let way = if sides.against(0, 1.0).is_some() { 1.0 } else { -1.0 };
        let reach = Reach::of(&device, &both(3.0, 2.0), &both(0.03, 0.03), 4e-3);
        let wanted_Nm = both(10.0 / 3.0, 0.0);
        let mut capacity_Nm = wanted_Nm;
        reach.make_up(&mut capacity_Nm, &sides, way, way * 0.1);
        let lingers_Nm = 2.0 * (-4e-3f64 / 0.03).exp();
        assert!((3.0 * capacity_Nm[0] - 2.0 * lingers_Nm - 10.0).abs() < 1e-9, "{capacity_Nm}");
        let mut at_rest_Nm = wanted_Nm;
        reach.make_up(&mut at_rest_Nm, &sides, way, 0.0);
        assert_eq!(at_rest_Nm, wanted_Nm);
    }

    #[test]
    fn an_impact_gets_what_other_brakes_can_lend_and_a_slow_touch_does_not() {
        let (device, body, sides) = device();
        let reach = Reach::of(&device, &both(0.0, 0.0), &both(0.03, 0.03), 4e-3);
        let most_Nm = 20.0 * (1.0 - (-4e-3f64 / 0.03).exp());
        for (speed, lent_Nm) in [(0.2, most_Nm), (0.01, 0.0)] {
            let mut capacity_Nm = both(20.0, 0.0);
            let (normal, velocity) = (-PlaneVector::x(), PlaneVector::x() * speed);
            reach.lend(&mut capacity_Nm, &sides, &body, &normal, &velocity);
            assert!((capacity_Nm[1] - lent_Nm).abs() < 1e-9, "{speed}: {capacity_Nm}");
        }
    }
}
