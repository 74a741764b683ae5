//! The wall law `sliding`: one brake slips at exactly the force with which the hand presses.
//!
//! In B, two freedoms, brakes alone. A wall is kept by a proportional law instead of an on/off
//! one. Each tick:
//!
//! 1. an [`Observer`] tells pose, velocity and what pushes the handle beyond the force sensor;
//! 2. the wall wants `f = F_press + m (w^2 (depth - layer) + 2 zeta w approach)` along its
//!    normal, never more than was asked of it; nothing, and everything is released, where the
//!    hand pulls away;
//! 3. *sliding*: the brake with the least drag ([`sides`]) gets the capacity at which it slips
//!    under f, and hands over to another one gradually ([`shares`]);
//! 4. *resting*: two brakes hold, balanced so that the one in the way is at zero just where
//!    the handle would begin to slide. Without a sensor nothing shows what a hand does to a
//!    handle that rests: the belief creeps towards sliding, which lessens one capacity after the
//!    other, and is put right by the first microns of slip. The brakes never let go for that;
//! 5. where no brake holds on one side sticking cannot be avoided, and all are locked;
//! 6. commands run ahead of the brakes' lag, within what the brakes can do.
//!
//! The handle comes to rest about [`LAYER_M`] inside the wall, so that whoever streams the
//! wall sees a contact. A handle that leaves it by less than [`LINGER_M`] is still held, until
//! it is found where the wall should be felt and is not. Every command is a capacity: a wrong
//! belief is a wrong force and never adds energy. The law does not know walls that meet, three
//! freedoms or motors. After Cho 2005, section 7, whose abrupt change of force where the
//! reference changes this avoids; derived here.

mod observer;
mod shares;
mod sides;

#[cfg(test)]
mod tests;

use observer::{Body, Observer, sensed};
use serde::{Deserialize, Serialize};
use shares::Shares;
use sides::{Sides, most_Nm, tangent_of};

use super::{Allocation, Capability, Handle, WallDemand};
use crate::notation::{ActuatorVector, PlaneVector};

/// Depth at which the wall carries the press alone.
const LAYER_M: f64 = 1e-4;

/// A handle this far outside is still at the wall.
const LINGER_M: f64 = 3e-4;

/// Normals further apart than this (cosine) are different walls.
const SAME_WALL: f64 = 0.9;

/// Slower than the first is rest along the wall, faster than the second is sliding.
const REST_M_PER_S: f64 = 1e-3;
const SLIDE_M_PER_S: f64 = 4e-3;

/// Least time from resting to sliding and back.
const REST_S: f64 = 0.02;

/// At rest, what the sensor does not explain is forgotten with this time constant.
const FORGET_S: f64 = 0.05;

/// Without a sensor: how fast the belief creeps along the wall, N/s.
const CREEP_N_PER_S: f64 = 30.0;

/// The least pace, as a time: a wrong belief in a large press is overcome in half of it, and
/// where no brake slips first the press is doubted within it, seconds.
const CREEP_S: f64 = 1.0;

/// It also creeps back by this share, where the other brake would slip.
const CREEP_BACK: f64 = 0.2;

/// The creep stops this far beyond where sliding begins.
const CREEP_BEYOND: f64 = 1.02;

/// No hand is believed to be stronger: what is slipped must not run away where the brakes are
/// at their limits.
const STRONGEST_N: f64 = 60.0;

/// A handle that slips at rest is pushed harder than believed: share of the observer's
/// bandwidth squared that turns slip into push. Beyond 1 it rings.
const SLIP_GAIN: f64 = 0.5;

/// What the law has to know of the shafts besides what they can do now.
#[derive(Clone, Copy, Debug)]
pub struct Shafts<'a> {
    /// Time constant from commanded to actual torque, seconds; 0 is at once.
    pub lag_s: &'a ActuatorVector,
    /// Encoder counts of one turn.
    pub counts_per_revolution: &'a ActuatorVector,
}

/// Numbers that depend on what is sensed; found by simulation of the wall-following experiment.
#[derive(Clone, Copy, Debug)]
struct Gains {
    /// w of the boundary layer.
    layer_per_s: f64,
    /// zeta of the boundary layer.
    damping_ratio: f64,
    /// The observer's bandwidth with fine encoders.
    observer_per_s: f64,
    /// Most that one count may add to the push in one tick: coarse encoders slow the observer.
    count_m_per_s2: f64,
    /// Time in which a brake is to reach its capacity.
    reach_s: f64,
}

const WITH_SENSOR: Gains = Gains {
    layer_per_s: 100.0,
    damping_ratio: 1.2,
    observer_per_s: 300.0,
    count_m_per_s2: 0.6,
    reach_s: 4e-3,
};

const WITHOUT_SENSOR: Gains = Gains {
    layer_per_s: 90.0,
    damping_ratio: 1.4,
    observer_per_s: 600.0,
    count_m_per_s2: 2.0,
    reach_s: 2.5e-3,
};

impl Gains {
    fn of(handle: &Handle) -> &'static Self {
        if handle.hand_force.is_some() { &WITH_SENSOR } else { &WITHOUT_SENSOR }
    }

    /// Bandwidth for the resolution that the encoders give at the handle.
    fn bandwidth_per_s(&self, body: &Body, shafts: &Shafts, tick_s: f64) -> f64 {
        let mut per_m2 = 0.0;
        for (ray, counts) in body.reference.column_iter().zip(shafts.counts_per_revolution) {
            per_m2 += ray.norm_squared() * (counts / std::f64::consts::TAU).powi(2);
        }
        let count_m = (2.0 / per_m2).sqrt();
        self.observer_per_s.min((self.count_m_per_s2 / (tick_s * count_m)).cbrt())
    }
}

/// What the law remembers from tick to tick.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct LawState {
    observer: Observer,
    bandwidth_per_s: f64,
    touching: Option<Touching>,
}

/// The wall that is touched.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Touching {
    normal: PlaneVector,
    /// Where its surface is along the normal.
    surface_m: f64,
    /// 1 at rest along the wall, 0 sliding.
    rest: f64,
    /// Which way it slides, or is about to: the sign along the tangent.
    way: f64,
    shares: Shares,
}

/// What the hand does to the wall.
#[derive(Clone, Copy, Debug)]
struct Press {
    tangent: PlaneVector,
    /// What the wall is to give along its normal.
    force_N: f64,
    /// What the hand pulls along the tangent.
    along_N: f64,
    speed_m_per_s: f64,
}

impl LawState {
    /// Forgets everything.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// True while the law holds a wall.
    pub fn is_touching(&self) -> bool {
        self.touching.is_some()
    }

    /// Forgets the wall, not the handle.
    pub fn leave_wall(&mut self) {
        self.touching = None;
    }

    /// Takes the handle as it is sensed. To be called every tick, wall or no wall.
    pub fn observe(&mut self, capability: &Capability, handle: &Handle, shafts: &Shafts) {
        let Some(body) = Body::of(capability, &handle.inertia) else { return self.reset() };
        self.bandwidth_per_s = Gains::of(handle).bandwidth_per_s(&body, shafts, handle.tick_s);
        self.observer.follow(&body, handle, shafts.lag_s, self.bandwidth_per_s);
        if !self.observer.is_usable() {
            self.reset();
        }
    }

    /// Torques that hold the wall, as they ought to be reached; `None`: there is none.
    pub fn hold(
        &mut self,
        capability: &Capability,
        handle: &Handle,
        wall: Option<&WallDemand>,
    ) -> Option<Allocation> {
        let body = Body::of(capability, &handle.inertia).filter(|_| self.observer.is_usable())?;
        self.touching = self.touched(handle, wall);
        let touching = self.touching.as_mut()?;
        let press = Press::of(touching, &self.observer, &body, handle, wall);
        let sides = Sides::of(capability, &body, &touching.normal, press.force_N);
        touching.shares.learn(&sides, self.observer.position.dot(&press.tangent));
        if press.force_N <= 0.0 {
            touching.rest = 1.0;
            return Some(capability.allocation(ActuatorVector::zeros()));
        }
        let capacity_per_N = touching.capacity_per_N(&sides, &press, handle.tick_s);
        self.doubt(&body, handle, &sides, &press);
        let torque_Nm = ActuatorVector::from_fn(|i, _| {
            let capacity_Nm = (capacity_per_N[i] * press.force_N).min(most_Nm(capability, i));
            if sides.grip[i] < 0.0 { -capacity_Nm } else { capacity_Nm }
        });
        Some(capability.allocation(torque_Nm))
    }

    /// What to tell the brakes so that they give `torque_Nm` in spite of their lag where
    /// `ahead`; remembers it for the observer. Signs stay.
    pub fn command(
        &mut self,
        capability: &Capability,
        handle: &Handle,
        shafts: &Shafts,
        torque_Nm: &ActuatorVector,
        ahead: bool,
    ) -> ActuatorVector {
        let reach_s = Gains::of(handle).reach_s;
        let told_Nm = ActuatorVector::from_fn(|i, _| {
            let (wanted_Nm, most_Nm) = (torque_Nm[i].abs(), most_Nm(capability, i));
            if !ahead || shafts.lag_s[i] <= 0.0 {
                return wanted_Nm.min(most_Nm);
            }
            let reached_Nm = self.observer.reached_Nm[i];
            let gain = 1.0 / (1.0 - (-reach_s / shafts.lag_s[i]).exp());
            (reached_Nm + (wanted_Nm - reached_Nm) * gain).clamp(0.0, most_Nm)
        });
        self.observer.command(&told_Nm);
        ActuatorVector::from_fn(|i, _| told_Nm[i].copysign(torque_Nm[i]))
    }

    /// The wall that is touched now.
    fn touched(&self, handle: &Handle, wall: Option<&WallDemand>) -> Option<Touching> {
        let known = self.touching;
        if let Some(wall) = wall {
            let normal = wall.normal;
            let surface_m = wall.depth_m + normal.dot(&handle.position);
            let same = known.filter(|touching| touching.normal.dot(&normal) > SAME_WALL);
            let (rest, way, shares) = (1.0, 1.0, Shares::default());
            let new = Touching { normal, surface_m, rest, way, shares };
            return Some(same.map_or(new, |same| Touching { normal, surface_m, ..same }));
        }
        known.filter(|touching| {
            let outside_m = |p: &PlaneVector| p.dot(&touching.normal) - touching.surface_m;
            let felt = outside_m(&handle.position) < -1e-6;
            !felt && outside_m(&self.observer.position) < LINGER_M
        })
    }

    /// Corrects the belief about a push that cannot be observed, because the handle rests.
    fn doubt(&mut self, body: &Body, handle: &Handle, sides: &Sides, press: &Press) {
        let Some(touching) = self.touching.as_ref() else { return };
        let elapsed_s = handle.tick_s * touching.rest;
        if handle.hand_force.is_some() {
            self.observer.push *= 1.0 - (elapsed_s / FORGET_S).min(1.0);
            return;
        }
        let slip = SLIP_GAIN * self.bandwidth_per_s.powi(2) * elapsed_s;
        self.observer.push += self.observer.velocity * slip;
        let way = touching.way;
        let creep_N = match (sides.least(way), sides.least(-way)) {
            (Some((_, ahead)), Some((_, behind))) => {
                let begins_N = CREEP_BEYOND * ahead * press.force_N;
                let left_N = (begins_N - way * press.along_N).max(0.0);
                let creep_N = CREEP_N_PER_S.max(2.0 * begins_N / CREEP_S) * elapsed_s;
                // What slips while one brake sticks moves across that brake's ray, and is put
                // right along it: creeping the same ways leaves nothing to drift.
                let (along, back) = (press.tangent * way, CREEP_BACK * creep_N);
                (along + touching.normal * ahead) * creep_N.min(left_N)
                    + (touching.normal * behind - along) * back
            }
            _ => touching.normal * (press.force_N * elapsed_s / CREEP_S),
        };
        self.observer.push += body.acceleration(&creep_N);
        let believed_N = body.force(&self.observer.push).norm();
        self.observer.push *= (STRONGEST_N / believed_N).min(1.0);
    }
}

impl Press {
    fn of(
        touching: &Touching,
        seen: &Observer,
        body: &Body,
        handle: &Handle,
        wall: Option<&WallDemand>,
    ) -> Self {
        let gains = Gains::of(handle);
        let (normal, tangent) = (touching.normal, tangent_of(&touching.normal));
        let hand = sensed(handle) + body.force(&seen.push);
        let depth_m = touching.surface_m - seen.position.dot(&normal);
        let approach_m_per_s = -seen.velocity.dot(&normal);
        let w = gains.layer_per_s;
        let layer = w * w * (depth_m - LAYER_M) + 2.0 * gains.damping_ratio * w * approach_m_per_s;
        let held_N = body.mass_along(&normal) * layer - hand.dot(&normal);
        Self {
            tangent,
            force_N: wall.map_or(held_N, |wall| held_N.min(wall.force_N)),
            along_N: hand.dot(&tangent),
            speed_m_per_s: seen.velocity.dot(&tangent),
        }
    }
}

impl Touching {
    /// Capacities per newton of press: resting, sliding, or on the way from one to the other.
    fn capacity_per_N(&mut self, sides: &Sides, press: &Press, tick_s: f64) -> ActuatorVector {
        let speed_m_per_s = press.speed_m_per_s.abs();
        let slow = (SLIDE_M_PER_S - speed_m_per_s) / (SLIDE_M_PER_S - REST_M_PER_S);
        let step = tick_s / REST_S;
        self.rest += (slow.clamp(0.0, 1.0) - self.rest).clamp(-step, step);
        let towards = if self.rest >= 1.0 { press.along_N } else { press.speed_m_per_s };
        if towards * self.way < 0.0 {
            // A reversal passes through rest, however few ticks show it.
            self.way = -self.way;
            self.rest = 1.0;
        }
        if self.rest >= 1.0 {
            self.shares.begin(sides, self.way);
        }
        let holding = sides.holding(press.along_N / press.force_N);
        let sliding = self
            .shares
            .advance(sides, self.way, speed_m_per_s, tick_s)
            .map_or_else(|| sides.locked(), |shares| sides.shared(&shares));
        holding * self.rest + sliding * (1.0 - self.rest)
    }
}
