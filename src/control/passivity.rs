//! What a controller's force may feed to the handle: an account of its energy, and what is held
//! back when it runs out.
//!
//! A simulator far away commands a force for a place that the handle has left, and a spring that
//! is late feeds what it touches: on motors it swings ever wider. Surfaces and the scene's fields
//! are rendered here at full rate and do not; a direct wrench, and a field whose origin comes from
//! afar, can. Their energy is observed at the handle, tick by tick, as force times way (time-domain
//! passivity: Hannaford & Ryu 2002, Ryu, Kim & Hannaford 2004): a command is held for a tick, and
//! what motors reach of it follows from their lag. What they may feed is an account of at most a
//! *reserve*: what the handle is fed is taken out of it, what the hand puts into them is paid in,
//! and a small *power* is paid in always, so that a guiding force guides for ever, slowly.
//!
//! ```text
//! spent <- max(0, spent + force . way - power tick)              left = reserve - spent
//! force . velocity <= power + max(0, left) / WITHIN_S            what is along the motion is held back
//! force <- force min(1, 1 + left / reserve)                      overdrawn, as velocity is an estimate
//! ```
//!
//! So over any stretch of time the controller feeds at most two reserves, and the power times the
//! time, more than the hand puts into it, but for what one tick, or the lag of the motors, feeds
//! beyond; one reserve where the velocity is known. A reserve is to be what a healthy force gives
//! back: a spring's `F^2 / 2 K`, a weight's `F` times the way. At rest nothing is fed, and unless
//! the account is overdrawn nothing is held back, nor of what resists. (The published controller
//! is a damper of `excess / v^2`: large where a slow motion is fed, beyond what is stable at 1 kHz
//! with an estimated velocity, and it pulls at a handle that the force itself would have let be.
//! Taking away from the force can at most make it 0.)
//!
//! Brakes take energy and give none: where there is no motor nothing is looked at. Beside brakes,
//! and under a law that gives another wrench than was asked, what the *motors* did counts where it
//! is more. In B at H; joules, watts.

use nalgebra::SVector;
use serde::{Deserialize, Serialize};

use super::desire::Request;
use super::{Estimate, Guards, Plan, Report};
use crate::actuation::ActuatorKind;
use crate::notation::{ActuatorVector, PlaneVector};

/// What is left may be fed within this time, no sooner: twenty ticks at 1 kHz, longer than a
/// velocity is late (15 ms at most), so that the force fades before the account is empty.
const WITHIN_S: f64 = 0.02;

/// A law that misses what was asked by less gives what was asked: steps of a motor's torque do it.
const EXACT_N: f64 = 0.05;

/// A lag that is shorter is none.
const LEAST_LAG_TICKS: f64 = 1e-3;

/// The account of one device's controller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Account {
    /// What the handle was fed beyond what was paid in: the reserve without what is left.
    spent_J: f64,
    /// Of the last tick.
    gave: Gave,
    /// What the motors had reached of it when it began: they lag.
    reached: Reached,
    /// Nothing was sensed since: the way is not known by parts.
    unseen: bool,
}

/// What one tick gave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Gave {
    /// For the controller.
    controller_BH_N: PlaneVector,
    /// For surfaces and scene.
    beside_BH_N: PlaneVector,
    /// The law gave another wrench than the sum of them.
    otherwise: bool,
}

/// How far lagging motors had got.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Reached {
    controller_BH_N: PlaneVector,
    torque_Nm: ActuatorVector,
}

/// Where the force of a controller acts.
#[derive(Clone, Copy, Debug)]
pub struct Port<'a> {
    /// The configuration.
    pub plan: &'a Plan,
    /// The handle now.
    pub estimate: &'a Estimate,
    /// A moment counts as the force on an arm of this length.
    pub length_m: f64,
}

impl Account {
    /// Books what was fed since the last tick, whose report is `last`.
    pub fn settle(&mut self, port: &Port, last: &Report) {
        let Plan { guards, .. } = port.plan;
        if !watched(port.plan) {
            *self = Self::default();
            return;
        }
        let fed_J = self.follow(port, last);
        // A place that makes no sense is no news of energy.
        let fed_J = if fed_J.is_finite() { fed_J } else { 0.0 };
        self.spent_J =
            (self.spent_J + fed_J - guards.passivity_power_W * port.plan.tick_s()).max(0.0);
        self.unseen = false;
    }

    /// Nothing is sensed in this tick. Motors let go until something is: a way that is fed counts
    /// as a whole, one that pays in does not count.
    pub fn unseen(&mut self) {
        self.unseen = true;
    }

    /// Nothing is given from now on.
    pub fn rest(&mut self) {
        (self.gave, self.reached) = Default::default();
    }

    /// What of the slewed soft force is the controller's and must be held back.
    pub fn held_back(
        &self,
        port: &Port,
        slewed_BH_N: &PlaneVector,
        request: &Request,
    ) -> PlaneVector {
        if !watched(port.plan) {
            return PlaneVector::zeros();
        }
        let controller = self.of_controller(slewed_BH_N, request, port.length_m);
        controller
            - self.granted(&port.plan.guards, &controller, &port.estimate.v_BH, port.length_m)
    }

    /// What is given from now on: this soft force and the walls, of which the law made this
    /// wrench.
    pub fn give(
        &mut self,
        port: &Port,
        soft_BH_N: &PlaneVector,
        request: &Request,
        wrench_BH_N: &PlaneVector,
    ) {
        let controller_BH_N = self.of_controller(soft_BH_N, request, port.length_m);
        let asked = request.clipped_BH_N() - request.soft_BH_N + soft_BH_N;
        let apart_N = as_forces(&(wrench_BH_N - asked), port.length_m).norm();
        self.gave = Gave {
            controller_BH_N,
            beside_BH_N: asked - controller_BH_N,
            otherwise: apart_N > EXACT_N,
        };
    }

    /// The part of this soft force that is the controller's: what is not the scene's. A force that
    /// slews is between the last and the wanted one, so what is more than both is the scene's.
    fn of_controller(
        &self,
        soft_BH_N: &PlaneVector,
        request: &Request,
        length_m: f64,
    ) -> PlaneVector {
        let wanted = request.controller_soft_BH_N;
        let size_N = |wrench: &PlaneVector| as_forces(wrench, length_m).norm();
        if size_N(&wanted) == 0.0 {
            return PlaneVector::zeros();
        }
        let part = soft_BH_N - (request.soft_BH_N - wanted);
        let most_N = size_N(&wanted).max(size_N(&self.gave.controller_BH_N));
        let part_N = size_N(&part);
        if part_N > most_N { part * (most_N / part_N) } else { part }
    }

    /// What of a force may be given to a handle that moves like this.
    fn granted(
        &self,
        guards: &Guards,
        force_BH_N: &PlaneVector,
        v_BH: &PlaneVector,
        length_m: f64,
    ) -> PlaneVector {
        let reserve_J = guards.passivity_reserve_J;
        let left_J = reserve_J - self.spent_J;
        let most_W = guards.passivity_power_W + left_J.max(0.0) / WITHIN_S;
        let motion = PlaneVector::new(v_BH.x, v_BH.y, v_BH.z * length_m);
        let (power_W, speed2) = (force_BH_N.dot(v_BH), motion.norm_squared());
        let mut granted = as_forces(force_BH_N, length_m);
        if power_W > most_W && speed2 > 0.0 {
            granted -= motion * ((power_W - most_W) / speed2);
        }
        granted *= (1.0 + left_J / reserve_J).clamp(0.0, 1.0);
        PlaneVector::new(granted.x, granted.y, granted.z * length_m)
    }

    /// Lets the motors follow what the last tick commanded; what the controller fed meanwhile.
    fn follow(&mut self, port: &Port, last: &Report) -> f64 {
        let lag = Lag::of(port.plan);
        let torque_Nm = lag.follow(&mut self.reached.torque_Nm, &last.commanded_Nm);
        let gave = self.gave;
        let force = lag.follow(&mut self.reached.controller_BH_N, &gave.controller_BH_N);
        if force == PlaneVector::zeros() {
            return 0.0;
        }
        let way_BH = port.estimate.p_BH - last.p_BH;
        let mut fed_J = force.dot(&way_BH);
        if gave.otherwise {
            let by_others_J = gave.beside_BH_N.dot(&way_BH).max(0.0);
            fed_J = fed_J.max(by_motors_J(port, last, &torque_Nm) - by_others_J);
        }
        if self.unseen { fed_J.max(0.0) } else { fed_J }
    }
}

/// How the slowest motor follows a command within a tick.
struct Lag {
    /// Share of what was missing that is still missing in the mean of a tick, and at its end.
    missing: [f64; 2],
}

impl Lag {
    fn of(plan: &Plan) -> Self {
        let tick_s = plan.tick_s();
        let delay_s = plan.actuators.delay_s(tick_s).unwrap_or_default();
        let lag_ticks = (delay_s / tick_s - 0.5).max(0.0);
        if lag_ticks < LEAST_LAG_TICKS {
            return Self { missing: [0.0; 2] };
        }
        let end = (-1.0 / lag_ticks).exp();
        Self { missing: [lag_ticks * (1.0 - end), end] }
    }

    /// The mean over a tick that commands this; `reached` is its begin, and becomes its end.
    fn follow<const N: usize>(
        &self,
        reached: &mut SVector<f64, N>,
        commanded: &SVector<f64, N>,
    ) -> SVector<f64, N> {
        let behind = *reached - commanded;
        *reached = commanded + behind * self.missing[1];
        commanded + behind * self.missing[0]
    }
}

/// Work of the motors since the last tick, with these torques.
fn by_motors_J(port: &Port, last: &Report, torque_Nm: &ActuatorVector) -> f64 {
    let Plan { mechanism, actuators, .. } = port.plan;
    let turned_rad = port.estimate.shaft_rad - last.shaft_rad;
    (0..mechanism.actuators())
        .filter(|i| actuators.kinds[*i] == ActuatorKind::Motor)
        .map(|i| torque_Nm[i] * turned_rad[i])
        .sum()
}

/// True where a motor can feed anything, and an end of it is set.
fn watched(plan: &Plan) -> bool {
    let motors = plan.actuators.kinds[..plan.mechanism.actuators()].contains(&ActuatorKind::Motor);
    motors && plan.guards.passivity_reserve_J.is_finite()
}

/// A wrench with its moment as the force on an arm of this length.
fn as_forces(wrench: &PlaneVector, length_m: f64) -> PlaneVector {
    PlaneVector::new(wrench.x, wrench.y, wrench.z / length_m)
}

#[cfg(test)]
mod late_tests;
#[cfg(test)]
mod tests;
