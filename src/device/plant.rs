//! The simulated plant: a linkage with inertia, pulled by a hand, held by brakes, driven by motors.
//!
//! Handle space, in B. The state is the handle's position p, its velocity v, the angles of the
//! shafts (continuous over any number of turns) and the torque that each actuator has reached.
//! A step of dt seconds:
//!
//! ```text
//! lag     c <- command + (c - command) exp(-dt / lag)             exact for a first-order lag
//! kick    v <- v + dt M^-1 (F_hand + R (tau_motor + tau_held - B R^T v)),   |tau_held_i| <= c_i
//! stop    no further out, and not turned further, than the workspace's edge     inelastic
//! coast   p <- p + dt v, and v along the geodesic of M(p)         no force, no change of energy
//! ```
//!
//! Stick and slip (Cho 2005, Eq 1) are one *implicit* problem, derived here: of all torques
//! within the capacities those that leave the most passive next velocity, that is the least
//! `|L^T v|^2 / 2` with `M = L L^T`, which is kinetic energy. Explicit stick-slip chatters
//! against stiff walls. No torque is among the choices and the set is convex, so what is held
//! never adds energy: `v_next . R tau_held <= 0`, whatever is commanded. Residual drag is a
//! capacity that no command takes away, on motors too. Viscous drag B of the shafts acts on the
//! velocity *after* the step, so that it takes energy however large it is: with it the
//! problem's M is M + dt R B R^T. A motor's command is rounded to its resolution before it lags.
//! Brakes can have hysteresis and free play ([`Imperfections`]).
//!
//! Invariants: p stays in the annulus, and phi in the range, that the end stop leaves, at a
//! regular posture; nothing is ever NaN; [`Energy`] never books less than what was gained.
//! Gravity, link collisions and flexible tendons are not modelled.

use std::sync::Arc;

use crate::actuation::{ActuatorKind, nearest_in_box};
use crate::control::{ActuatorCommand, ActuatorCommands};
use crate::mechanism::{KinematicsError, Mechanism, Posture};
use crate::notation::{
    ActuatorVector, HandleInertia, MAX_ACTUATORS, MAX_FREEDOMS, PlaneVector, ReferenceMatrix,
};

mod imperfections;

#[cfg(test)]
mod plate_tests;
#[cfg(test)]
mod tests;

pub use imperfections::Imperfections;
use imperfections::Slack;

/// The end stop keeps this part of the reach, on either side, out of the workspace: linkages
/// are singular at the ends of their reach.
const STOP_MARGIN: f64 = 0.05;

/// Half the distance between the postures whose inertias give its gradient.
const GRADIENT_STEP_M: f64 = 1e-5;

/// A Newton step this short, in metres or radians, leaves nothing that an encoder could see.
const NEWTON_M: f64 = 1e-6;

/// What a plant is made of.
#[derive(Clone, Debug)]
pub struct PlantParameters {
    /// The linkage with its inertia.
    pub mechanism: Arc<dyn Mechanism>,
    /// Brake or motor.
    pub kinds: [ActuatorKind; MAX_ACTUATORS],
    /// Most that each can be commanded.
    pub max_torque_Nm: ActuatorVector,
    /// Time constant from commanded to actual torque, seconds; 0 is at once.
    pub lag_s: ActuatorVector,
    /// Drag that is there without any command.
    pub residual_Nm: ActuatorVector,
    /// Hysteresis and backlash of the brakes.
    pub imperfections: Imperfections,
    /// Viscous drag of the shafts, N m s/rad.
    pub damping_N_m_s_per_rad: ActuatorVector,
    /// Smallest step of torque that a motor can be commanded; 0: any.
    pub resolution_Nm: ActuatorVector,
}

/// Where energy came from and went, joules since the beginning. What the handle has now is
/// never more than `hand_J + motors_J - dissipated_J`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energy {
    /// Work of the hand on the handle.
    pub hand_J: f64,
    /// Work of motors on the linkage.
    pub motors_J: f64,
    /// Taken out by brakes, drag and the end stop; never falls.
    pub dissipated_J: f64,
}

/// A linkage in motion.
#[derive(Clone, Debug)]
pub struct Plant {
    parameters: PlantParameters,
    stops_m: (f64, f64),
    /// Largest |phi|, where phi is a freedom.
    turn_stop_rad: f64,
    posture: Posture,
    /// Authoritative; `posture.p_BH` has the told third coordinate of two-freedom devices.
    p_BH: PlaneVector,
    v_BH: PlaneVector,
    shaft_rad: ActuatorVector,
    commanded_Nm: ActuatorVector,
    reached_Nm: ActuatorVector,
    slack: Slack,
    torque_Nm: ActuatorVector,
    energy: Energy,
}

impl Plant {
    /// A plant at rest at `p_BH`, everything released. Refuses a place beyond the end stop,
    /// which leaves 5 % of the linkage's reach on either side.
    pub fn new(parameters: PlantParameters, p_BH: &PlaneVector) -> Result<Self, KinematicsError> {
        let mechanism = parameters.mechanism.as_ref();
        let (nearest_m, furthest_m) = mechanism.reach_m();
        let margin_m = STOP_MARGIN * (furthest_m - nearest_m);
        // A reach from zero at a regular posture has no inner edge to stop at.
        let has_hole = nearest_m > 0.0 || mechanism.posture_at(&PlaneVector::zeros()).is_err();
        let inner_m = if has_hole { nearest_m + margin_m } else { 0.0 };
        let stops_m = (inner_m, furthest_m - margin_m);
        let turn_stop_rad = (1.0 - STOP_MARGIN) * mechanism.turn_rad();
        let p_BH = first(mechanism.freedoms(), p_BH);
        let posture = mechanism.posture_at(&p_BH)?;
        let r_m = p_BH.xy().norm();
        if !(stops_m.0..=stops_m.1).contains(&r_m) || p_BH.z.abs() > turn_stop_rad {
            return Err(KinematicsError::Unreachable {
                needed_m: r_m,
                min_m: stops_m.0,
                max_m: stops_m.1,
            });
        }
        Ok(Self {
            stops_m,
            turn_stop_rad,
            posture,
            p_BH,
            v_BH: PlaneVector::zeros(),
            shaft_rad: posture.shaft_rad,
            commanded_Nm: ActuatorVector::zeros(),
            reached_Nm: ActuatorVector::zeros(),
            slack: Slack::default(),
            torque_Nm: ActuatorVector::zeros(),
            energy: Energy::default(),
            parameters,
        })
    }

    /// Commands the actuators from now on. A torque beyond the actuator's is clipped; a command
    /// of the wrong kind, or one that is not a number, releases.
    pub fn command(&mut self, commands: &ActuatorCommands) {
        let actuators = self.parameters.mechanism.actuators();
        for (i, command) in commands.iter().enumerate().take(actuators) {
            let most_Nm = self.parameters.max_torque_Nm[i].max(0.0);
            let wanted_Nm = match (self.parameters.kinds[i], command) {
                (ActuatorKind::Brake, ActuatorCommand::Brake { capacity_Nm }) => {
                    capacity_Nm.max(0.0)
                }
                (ActuatorKind::Motor, ActuatorCommand::Motor { torque_Nm }) => *torque_Nm,
                _ => 0.0,
            };
            let wanted_Nm =
                if wanted_Nm.is_nan() { 0.0 } else { wanted_Nm.clamp(-most_Nm, most_Nm) };
            self.commanded_Nm[i] = match self.parameters.kinds[i] {
                ActuatorKind::Motor => self.on_grid(i, wanted_Nm, most_Nm),
                ActuatorKind::Brake => wanted_Nm,
            };
        }
    }

    /// The nearest torque that a motor can be commanded: a whole number of its steps.
    fn on_grid(&self, motor: usize, torque_Nm: f64, most_Nm: f64) -> f64 {
        let step_Nm = self.parameters.resolution_Nm[motor];
        if step_Nm <= 0.0 {
            return torque_Nm;
        }
        let most_steps = (most_Nm / step_Nm).floor();
        (torque_Nm / step_Nm).round().clamp(-most_steps, most_steps) * step_Nm
    }

    /// Lets `dt_s` seconds pass under a constant hand force; one that is not finite is none.
    /// Does not allocate; costs one small box problem and two postures, six where the inertia
    /// varies.
    pub fn step(&mut self, F_hand_BH_N: &PlaneVector, dt_s: f64) {
        self.follow_commands(dt_s);
        let moved = self
            .kick(F_hand_BH_N, dt_s)
            .and_then(|()| self.stop(dt_s))
            .and_then(|()| self.coast(dt_s));
        if moved.is_none() {
            self.energy.dissipated_J += self.kinetic_J();
            self.v_BH = PlaneVector::zeros();
        }
    }

    /// Position of the handle in B; the third is zero on devices of two freedoms.
    pub fn p_BH(&self) -> &PlaneVector {
        &self.p_BH
    }

    /// Its rate.
    pub fn v_BH(&self) -> &PlaneVector {
        &self.v_BH
    }

    /// Angles of the shafts, continuous since the beginning.
    pub fn shaft_rad(&self) -> &ActuatorVector {
        &self.shaft_rad
    }

    /// What the actuators put into their shafts in the last step: motor, brake and drag.
    pub fn torque_Nm(&self) -> &ActuatorVector {
        &self.torque_Nm
    }

    /// What each actuator has reached of its command: a brake's capacity, a motor's torque.
    pub fn reached_Nm(&self) -> &ActuatorVector {
        &self.reached_Nm
    }

    /// The books.
    pub fn energy(&self) -> &Energy {
        &self.energy
    }

    /// Kinetic energy now, joules.
    pub fn kinetic_J(&self) -> f64 {
        0.5 * self.v_BH.dot(&(self.posture.inertia * self.v_BH))
    }

    fn follow_commands(&mut self, dt_s: f64) {
        for i in 0..MAX_ACTUATORS {
            let lag_s = self.parameters.lag_s[i];
            let kept = if lag_s > 0.0 { (-dt_s / lag_s).exp() } else { 0.0 };
            let behind_Nm = self.reached_Nm[i] - self.commanded_Nm[i];
            self.reached_Nm[i] = self.commanded_Nm[i] + kept * behind_Nm;
        }
        let PlantParameters { imperfections, max_torque_Nm, .. } = &self.parameters;
        self.slack.follow(imperfections, &self.reached_Nm, max_torque_Nm);
    }

    /// Torques of the motors.
    fn drive(&self) -> ActuatorVector {
        ActuatorVector::from_fn(|i, _| match self.parameters.kinds[i] {
            ActuatorKind::Brake => 0.0,
            ActuatorKind::Motor => self.reached_Nm[i],
        })
    }

    /// Torques, from least to most, that hold shafts which are about to turn by `turn_rad`.
    fn hold(&self, turn_rad: &ActuatorVector) -> (ActuatorVector, ActuatorVector) {
        let mut upper_Nm = self.parameters.residual_Nm;
        let mut lower_Nm = -upper_Nm;
        for (i, kind) in self.parameters.kinds.iter().enumerate() {
            if *kind == ActuatorKind::Brake {
                let [on, back] = self.slack.engages(&self.parameters.imperfections, i, turn_rad[i]);
                let held_Nm = self.slack.held_Nm(i);
                lower_Nm[i] -= if on { held_Nm } else { 0.0 };
                upper_Nm[i] += if back { held_Nm } else { 0.0 };
            }
        }
        (lower_Nm, upper_Nm)
    }

    /// Forces and torques change the velocity; books their work.
    fn kick(&mut self, F_hand_BH_N: &PlaneVector, dt_s: f64) -> Option<()> {
        let F_hand_BH_N = if F_hand_BH_N.iter().all(|F| F.is_finite()) {
            first(self.parameters.mechanism.freedoms(), F_hand_BH_N)
        } else {
            PlaneVector::zeros()
        };
        let R = &self.posture.reference;
        let damping = &self.parameters.damping_N_m_s_per_rad;
        let drag = R * nalgebra::SMatrix::from_diagonal(damping) * R.transpose();
        let M = invertible(&self.posture);
        let momentum = M * self.v_BH;
        let M = (M + dt_s * drag).cholesky()?;
        let drive_Nm = self.drive();
        let v_free = M.solve(&(momentum + dt_s * (F_hand_BH_N + R * drive_Nm)));
        let hold_Nm = self.hold(&(dt_s * R.tr_mul(&v_free)));
        let held_Nm = most_passive(&M.l(), R, &(v_free / dt_s), &hold_Nm)?;
        self.v_BH = v_free + dt_s * M.solve(&(R * held_Nm));
        let w = R.tr_mul(&self.v_BH);
        self.slack.turn(&self.parameters.imperfections, &(dt_s * w));
        let dragged_Nm = -damping.component_mul(&w);
        self.torque_Nm = drive_Nm + held_Nm + dragged_Nm;
        self.energy.hand_J += dt_s * F_hand_BH_N.dot(&self.v_BH);
        self.energy.motors_J += dt_s * drive_Nm.dot(&w);
        self.energy.dissipated_J += (-dt_s * (held_Nm + dragged_Nm).dot(&w)).max(0.0);
        Some(())
    }

    /// Takes away the parts of the velocity that would cross the end stop in this step: by an
    /// impulse along the radius, and one that turns.
    fn stop(&mut self, dt_s: f64) -> Option<()> {
        let r_m = self.p_BH.xy().norm();
        if r_m > 0.0 {
            let out = PlaneVector::new(self.p_BH.x / r_m, self.p_BH.y / r_m, 0.0);
            let (nearest_m, furthest_m) = self.stops_m;
            // A handle may pass through the origin where there is no hole around it.
            let way_in_m = if nearest_m > 0.0 { nearest_m - r_m } else { f64::NEG_INFINITY };
            self.stop_along(&out, (way_in_m / dt_s, (furthest_m - r_m) / dt_s))?;
        }
        if self.parameters.mechanism.freedoms() == MAX_FREEDOMS {
            let (phi_rad, most_rad) = (self.p_BH.z, self.turn_stop_rad);
            let rates = ((-most_rad - phi_rad) / dt_s, (most_rad - phi_rad) / dt_s);
            self.stop_along(&PlaneVector::z(), rates)?;
        }
        Some(())
    }

    /// Brings the rate along one way into its range, which always has zero, by an impulse.
    fn stop_along(&mut self, out: &PlaneVector, (slowest, fastest): (f64, f64)) -> Option<()> {
        let speed = out.dot(&self.v_BH);
        let excess = speed - speed.clamp(slowest.min(0.0), fastest.max(0.0));
        if excess != 0.0 {
            let impulse = invertible(&self.posture).cholesky()?.solve(out);
            let before_J = self.kinetic_J();
            self.v_BH -= impulse * (excess / out.dot(&impulse));
            self.energy.dissipated_J += (before_J - self.kinetic_J()).max(0.0);
        }
        Some(())
    }

    /// Moves on without forces. `None` where no regular posture follows: then nothing moves.
    fn coast(&mut self, dt_s: f64) -> Option<()> {
        let mechanism = self.parameters.mechanism.as_ref();
        let p_BH = self.inside_stops(self.p_BH + dt_s * self.v_BH);
        let posture = mechanism.posture_at(&p_BH).ok()?;
        let near_rad = self.shaft_rad + dt_s * self.posture.reference.tr_mul(&self.v_BH);
        self.shaft_rad = on_shafts(mechanism, near_rad, &p_BH);
        if mechanism.inertia_varies() {
            let middle = 0.5 * (self.p_BH + p_BH);
            let push = dt_s * energy_gradient(mechanism, &middle, &self.v_BH);
            self.v_BH = along_geodesic(&self.posture, &posture, &self.v_BH, &push)?;
        }
        self.p_BH = p_BH;
        self.posture = posture;
        Some(())
    }

    /// Sliding along a round stop leaves it by a little of second order: put back.
    fn inside_stops(&self, p_BH: PlaneVector) -> PlaneVector {
        let r_m = p_BH.xy().norm();
        let held_m = r_m.clamp(self.stops_m.0, self.stops_m.1);
        let scale = if r_m > 0.0 { held_m / r_m } else { 1.0 };
        let phi_rad = p_BH.z.clamp(-self.turn_stop_rad, self.turn_stop_rad);
        PlaneVector::new(scale * p_BH.x, scale * p_BH.y, phi_rad)
    }
}

/// Torques between those of `hold_Nm` that leave the least kinetic energy. Per second of the step, so
/// that the numbers are of the size of forces: the least `|L^T v_free / dt + L^-1 R tau|`.
fn most_passive(
    L: &HandleInertia,
    R: &ReferenceMatrix,
    v_free_per_s: &PlaneVector,
    (lower_Nm, upper_Nm): &(ActuatorVector, ActuatorVector),
) -> Option<ActuatorVector> {
    let per_torque = L.solve_lower_triangular(R)?;
    let target = -L.tr_mul(v_free_per_s);
    Some(nearest_in_box(&per_torque, &target, lower_Nm, upper_Nm, MAX_ACTUATORS))
}

/// The freedoms that a device has; the others are zero.
fn first(freedoms: usize, v: &PlaneVector) -> PlaneVector {
    PlaneVector::from_fn(|i, _| if i < freedoms { v[i] } else { 0.0 })
}

/// The inertia, with a one for each freedom that the device does not have.
fn invertible(posture: &Posture) -> HandleInertia {
    let mut M = posture.inertia;
    for i in 0..MAX_FREEDOMS {
        if M[(i, i)] == 0.0 {
            M[(i, i)] = 1.0;
        }
    }
    M
}

/// Shaft angles of the handle's position, on the turns that the `near` ones are on: Newton
/// steps from the posture with those angles, a second one where the first went far.
fn on_shafts(
    mechanism: &dyn Mechanism,
    near_rad: ActuatorVector,
    p_BH: &PlaneVector,
) -> ActuatorVector {
    let mut shaft_rad = near_rad;
    for _ in 0..2 {
        let Ok(near) = mechanism.posture_from_shafts(&shaft_rad) else { break };
        let left = first(mechanism.freedoms(), &(p_BH - near.p_BH));
        shaft_rad = near.shaft_rad + near.reference.tr_mul(&left);
        if left.amax() < NEWTON_M {
            break;
        }
    }
    shaft_rad
}

/// Gradient of `v^T M(p) v / 2` by central differences, N; zero where a posture is missing.
fn energy_gradient(
    mechanism: &dyn Mechanism,
    p_BH: &PlaneVector,
    v_BH: &PlaneVector,
) -> PlaneVector {
    let energy_J = |p_BH: &PlaneVector| {
        let posture = mechanism.posture_at(p_BH).ok()?;
        Some(0.5 * v_BH.dot(&(posture.inertia * v_BH)))
    };
    PlaneVector::from_fn(|axis, _| {
        let mut step = PlaneVector::zeros();
        if axis < mechanism.freedoms() {
            step[axis] = GRADIENT_STEP_M;
        }
        match (energy_J(&(p_BH + step)), energy_J(&(p_BH - step))) {
            (Some(ahead_J), Some(behind_J)) => (ahead_J - behind_J) / (2.0 * GRADIENT_STEP_M),
            _ => 0.0,
        }
    })
}

/// The velocity after coasting from one posture to another. Lagrange's equation in momentum
/// form, `M' v' = M v + dt grad(v^T M v / 2)`, has Coriolis and centrifugal forces in it; it
/// gives the direction, and the kinetic energy, which coasting does not change, the speed.
fn along_geodesic(
    from: &Posture,
    to: &Posture,
    v_BH: &PlaneVector,
    push: &PlaneVector,
) -> Option<PlaneVector> {
    let momentum = from.inertia * v_BH;
    let ahead = invertible(to).cholesky()?.solve(&(momentum + push));
    let (before_J, after_J) = (v_BH.dot(&momentum), ahead.dot(&(to.inertia * ahead)));
    if after_J > 0.0 { Some(ahead * (before_J / after_J).sqrt()) } else { Some(*v_BH) }
}
