//! The handle as a model of brakes and mass sees it: pose, velocity, push, and real capacities.
//!
//! In B at the handle. A third-order observer predicts each tick with what the brakes were
//! told, and corrects pose, velocity and *push* (the acceleration that the model does not
//! explain) by what the encoders show. All three poles lie at one bandwidth, mapped exactly to
//! the tick. Stick and slip are the same implicit problem that a plant of brakes obeys: of all
//! torques within the capacities those that leave the least kinetic energy. So a handle that
//! rests under brakes is predicted to rest, whatever pushes it, and its push stays as it was:
//! at rest it cannot be observed.
//!
//! What a brake has reached of its command follows a first-order lag. It is never measured.

use nalgebra::{Cholesky, Const, Matrix2};
use serde::{Deserialize, Serialize};

use super::Shafts;
use crate::actuation::{Capability, Handle, nearest_in_box};
use crate::notation::{ActuatorVector, HandleInertia, PlaneVector, ReferenceMatrix};

/// Brakes that give less than this, in all, are released: the lag only ever comes near zero.
const RELEASED_NM: f64 = 1e-6;

/// An innovation beyond this is no motion of the handle: the observer begins anew there.
const LOST_M: f64 = 0.02;

/// Two freedoms of a device: reference forces and inertia, ready for use.
#[derive(Clone, Copy, Debug)]
pub struct Body {
    /// Reference matrix without the row of the freedom that is not there.
    pub reference: ReferenceMatrix,
    count: usize,
    factor: Cholesky<f64, Const<2>>,
}

impl Body {
    /// `None` where the inertia cannot be inverted.
    pub fn of(capability: &Capability, inertia: &HandleInertia) -> Option<Self> {
        let mut reference = capability.reference;
        reference.row_mut(2).fill(0.0);
        let block: Matrix2<f64> = inertia.fixed_view::<2, 2>(0, 0).into_owned();
        Some(Self { reference, count: capability.actuators, factor: block.cholesky()? })
    }

    /// Acceleration under a force.
    pub fn acceleration(&self, force: &PlaneVector) -> PlaneVector {
        let part = self.factor.solve(&force.xy());
        PlaneVector::new(part.x, part.y, 0.0)
    }

    /// Force that gives an acceleration.
    pub fn force(&self, acceleration: &PlaneVector) -> PlaneVector {
        let l = self.factor.l_dirty();
        let (a, b, c) = (l[(0, 0)], l[(1, 0)], l[(1, 1)]);
        let (u, v) = (a * acceleration.x + b * acceleration.y, c * acceleration.y);
        PlaneVector::new(a * u, b * u + c * v, 0.0)
    }

    /// Inertia felt along a unit vector.
    pub fn mass_along(&self, unit: &PlaneVector) -> f64 {
        1.0 / unit.dot(&self.acceleration(unit))
    }

    /// Velocity after `tick_s` under an acceleration and brakes that hold with `capacity_Nm`.
    fn next_velocity(
        &self,
        velocity: &PlaneVector,
        acceleration: &PlaneVector,
        capacity_Nm: &ActuatorVector,
        tick_s: f64,
    ) -> PlaneVector {
        let free = velocity + acceleration * tick_s;
        if capacity_Nm.amax() <= RELEASED_NM {
            return free;
        }
        let l = self.factor.l_dirty();
        let (a, b, c) = (l[(0, 0)], l[(1, 0)], l[(1, 1)]);
        // L^-1 R, and -L^T v per second of the tick: numbers of the size of forces.
        let mut matrix = self.reference;
        for mut column in matrix.column_iter_mut() {
            column.x /= a;
            column.y = (column.y - b * column.x) / c;
        }
        let target = PlaneVector::new(a * free.x + b * free.y, c * free.y, 0.0) * (-1.0 / tick_s);
        let torque_Nm = nearest_in_box(&matrix, &target, &-capacity_Nm, capacity_Nm, self.count);
        free + self.acceleration(&(self.reference * torque_Nm)) * tick_s
    }
}

/// What the force sensor says; nothing where there is none, or where it says nothing usable.
pub fn sensed(handle: &Handle) -> PlaneVector {
    let finite = |force: &PlaneVector| force.iter().all(|part| part.is_finite());
    handle.hand_force.filter(finite).map_or_else(PlaneVector::zeros, |force| planar(&force))
}

fn planar(v: &PlaneVector) -> PlaneVector {
    PlaneVector::new(v.x, v.y, 0.0)
}

/// What is believed of the handle.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Observer {
    /// Pose of the handle.
    pub position: PlaneVector,
    /// Its velocity.
    pub velocity: PlaneVector,
    /// Acceleration that neither the brakes nor a sensor explain.
    pub push: PlaneVector,
    /// What each brake has reached of its command.
    pub reached_Nm: ActuatorVector,
    /// What it holds of that, behind its hysteresis.
    held_Nm: ActuatorVector,
    commanded_Nm: ActuatorVector,
    begun: bool,
}

impl Observer {
    /// One tick on, with the poles at `bandwidth_per_s`.
    pub fn follow(&mut self, body: &Body, handle: &Handle, shafts: &Shafts, bandwidth_per_s: f64) {
        let tick_s = handle.tick_s;
        let known = body.acceleration(&sensed(handle));
        let capacity_Nm = self.follow_commands(shafts, tick_s);
        let acceleration = self.push + known;
        let ahead = body.next_velocity(&self.velocity, &acceleration, &capacity_Nm, tick_s);
        let measured = planar(&handle.position);
        let innovation = measured - (self.position + ahead * tick_s);
        let plausible = innovation.norm() < LOST_M;
        if !self.begun || !plausible {
            self.position = measured;
            self.velocity = planar(&handle.velocity);
            self.push = PlaneVector::zeros();
            self.begun = true;
            return;
        }
        let pole = (-bandwidth_per_s * tick_s).exp();
        let gap = 1.0 - pole;
        self.position += ahead * tick_s + innovation * (1.0 - pole.powi(3));
        self.velocity = ahead + innovation * (1.5 * gap * gap * (1.0 + pole) / tick_s);
        self.push += innovation * (gap.powi(3) / (tick_s * tick_s));
    }

    /// True once it has seen the handle and while everything in it is a number.
    pub fn is_usable(&self) -> bool {
        let all = self.position + self.velocity + self.push;
        self.begun && all.iter().all(|part| part.is_finite())
    }

    /// Remembers what the brakes are told from now on.
    pub fn command(&mut self, capacity_Nm: &ActuatorVector) {
        self.commanded_Nm = *capacity_Nm;
    }

    /// What brake i has to reach so that it holds `wanted_Nm` on its other side of the play.
    pub fn through_play_Nm(&self, i: usize, wanted_Nm: f64, width_Nm: f64) -> f64 {
        let (half_Nm, more_Nm) = (0.5 * width_Nm, wanted_Nm - self.held_Nm[i]);
        if half_Nm <= 0.0 {
            wanted_Nm
        } else if more_Nm == 0.0 {
            self.reached_Nm[i]
        } else {
            wanted_Nm + half_Nm.copysign(more_Nm)
        }
    }

    /// Advances the capacities; returns their mean over the tick.
    fn follow_commands(&mut self, shafts: &Shafts, tick_s: f64) -> ActuatorVector {
        let lag_s = shafts.lag_s;
        let mut mean_Nm = self.commanded_Nm;
        for i in 0..mean_Nm.len() {
            let behind_Nm = self.reached_Nm[i] - self.commanded_Nm[i];
            self.reached_Nm[i] = self.commanded_Nm[i];
            if lag_s[i] > 0.0 {
                let kept = (-tick_s / lag_s[i]).exp();
                self.reached_Nm[i] += kept * behind_Nm;
                mean_Nm[i] += behind_Nm * (1.0 - kept) * lag_s[i] / tick_s;
            }
            let half_Nm = 0.5 * shafts.hysteresis_Nm[i];
            let held_Nm = self.held_Nm[i];
            let behind = |Nm: f64| held_Nm.max(Nm - half_Nm).min(Nm + half_Nm).max(0.0);
            mean_Nm[i] = behind(mean_Nm[i]);
            self.held_Nm[i] = behind(self.reached_Nm[i]);
        }
        mean_Nm
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuation::{ActuatorKind, Bounds, ShaftMotion};
    use crate::notation::MAX_ACTUATORS;

    const TICK_S: f64 = 1e-3;

    fn device() -> (Capability, HandleInertia) {
        let mut reference = ReferenceMatrix::zeros();
        for (i, column) in [[-3.0, 2.5], [-3.5, -1.0]].iter().enumerate() {
            (reference[(0, i)], reference[(1, i)]) = (column[0], column[1]);
        }
        let kinds = [ActuatorKind::Brake; MAX_ACTUATORS];
        let bounds = Bounds::given(
            &kinds,
            &ActuatorVector::repeat(20.0),
            &[ShaftMotion::Rest; MAX_ACTUATORS],
        );
        let mut inertia = HandleInertia::zeros();
        (inertia[(0, 0)], inertia[(1, 1)]) = (0.5, 0.8);
        (inertia[(0, 1)], inertia[(1, 0)]) = (0.1, 0.1);
        let (freedoms, actuators, moment_length_m) = (2, 2, 1.0);
        let device = Capability { reference, freedoms, actuators, kinds, bounds, moment_length_m };
        (device, inertia)
    }

    fn seen(position: PlaneVector, inertia: HandleInertia) -> Handle {
        let velocity = PlaneVector::zeros();
        Handle { position, velocity, hand_force: None, inertia, tick_s: TICK_S }
    }

    #[test]
    fn an_unknown_hand_in_free_air_is_found_with_its_direction() {
        let (device, inertia) = device();
        let body = Body::of(&device, &inertia).unwrap();
        let hand = PlaneVector::new(2.0, -3.0, 0.0);
        let acceleration = body.acceleration(&hand);
        assert!((body.force(&acceleration) - hand).norm() < 1e-12);
        let mut observer = Observer::default();
        for tick in 0..100 {
            let t_s = f64::from(tick) * TICK_S;
            let handle = seen(acceleration * (0.5 * t_s * t_s), inertia);
            observer.follow(&body, &handle, &Shafts::IDEAL, 300.0);
        }
        assert!((body.force(&observer.push) - hand).norm() < 0.01 * hand.norm());
    }

    #[test]
    fn a_handle_at_rest_under_brakes_keeps_the_push_it_was_believed_to_have() {
        let (device, inertia) = device();
        let body = Body::of(&device, &inertia).unwrap();
        let mut observer = Observer::default();
        let handle = seen(PlaneVector::new(0.3, 0.1, 0.0), inertia);
        observer.follow(&body, &handle, &Shafts::IDEAL, 300.0);
        observer.push = PlaneVector::new(5.0, -2.0, 0.0);
        observer.command(&ActuatorVector::repeat(20.0));
        let before = observer.push;
        for _ in 0..100 {
            observer.follow(&body, &handle, &Shafts::IDEAL, 300.0);
        }
        assert!((observer.push - before).norm() < 1e-9);
        assert!(observer.velocity.norm() < 1e-9);
    }

    /// Any wish is held in the next tick, whatever was held before, by a brake without lag whose
    /// hysteresis is known.
    #[test]
    fn a_command_through_the_play_gives_what_is_wanted() {
        let (mut observer, width_Nm) = (Observer::default(), ActuatorVector::repeat(0.6));
        let shafts = Shafts { hysteresis_Nm: &width_Nm, ..Shafts::IDEAL };
        for wanted_Nm in [2.0, 2.1, 2.05, 2.05, 0.4, 5.0, 4.9] {
            let goal_Nm = observer.through_play_Nm(0, wanted_Nm, 0.6);
            observer.command(&ActuatorVector::repeat(goal_Nm));
            observer.follow_commands(&shafts, TICK_S);
            assert!((observer.held_Nm[0] - wanted_Nm).abs() < 1e-12, "{wanted_Nm}");
        }
    }

    #[test]
    fn capacities_follow_their_commands_as_a_first_order_lag_does() {
        let mut observer = Observer::default();
        observer.command(&ActuatorVector::repeat(10.0));
        let lag_s = ActuatorVector::repeat(0.01);
        let (mut mean_Nm, mut sum_Nm) = (0.0, 0.0);
        for tick in 0..10 {
            let shafts = Shafts { lag_s: &lag_s, ..Shafts::IDEAL };
            mean_Nm += 0.1 * observer.follow_commands(&shafts, TICK_S)[0];
            for part in 0..100 {
                let t_s = TICK_S * (f64::from(tick) + (f64::from(part) + 0.5) / 100.0);
                sum_Nm += 1e-3 * 10.0 * (1.0 - (-t_s / 0.01).exp());
            }
        }
        assert!((observer.reached_Nm[0] - 10.0 * (1.0 - (-1.0f64).exp())).abs() < 1e-9);
        assert!((mean_Nm - sum_Nm).abs() < 1e-4, "{mean_Nm} {sum_Nm}");
    }
}
