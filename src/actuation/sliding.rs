//! The wall law `sliding`: one brake slips at exactly the force with which the hand presses.
//!
//! In B, two freedoms, brakes alone. A wall is kept by a proportional law instead of an on/off
//! one. Each tick:
//!
//! 1. an [`Observer`] tells pose, velocity and what pushes the handle beyond the force sensor;
//! 2. the wall wants `f = F_press + m (w^2 (depth - layer) + 2 zeta w approach)` along its
//!    normal, or what stops an impact in time, never more than was asked of it; nothing, and
//!    everything is released, where the hand pulls away;
//! 3. *sliding*: the brake with the least drag ([`sides`]) gets the capacity at which it slips
//!    under f, and hands over to another one gradually ([`shares`]);
//! 4. *resting*: two brakes hold, balanced so that the one in the way is at zero just where
//!    the handle would begin to slide. Without a sensor nothing shows what a hand does to a
//!    handle that rests: the belief creeps towards sliding, which lessens one capacity after the
//!    other, and is put right by the first microns of slip. The brakes never let go for that;
//! 5. where no brake holds on one side sticking cannot be avoided, and all are locked;
//! 6. brakes that still hold what they should not are made up for, and others lend what is
//!    missing in an impact ([`reach`]); commands run ahead of the brakes' lag and through their
//!    hysteresis, within what the brakes can do.
//!
//! A soft force against the way along the wall is given by the same brakes: they drag by it, or
//! by the least that holds the wall where that is more. What is soft across the wall is not given
//! while the wall is pressed: the press is carried anyway, and brakes push nobody off.
//!
//! The handle comes to rest about [`LAYER_M`] inside the wall, so that whoever streams the
//! wall sees a contact. A handle that leaves it by a little is still held, until it is found
//! where the wall should be felt and is not. Every command is a capacity: a wrong belief is a
//! wrong force and never adds energy. Two walls at once are one whose normal is the direction of
//! what they give together ([`contacts`]). The law does not know three freedoms or motors. After
//! Cho 2005, section 7, whose abrupt change of force where the reference changes this avoids;
//! derived here.

mod contacts;
mod observer;
mod reach;
mod shares;
mod sides;

#[cfg(test)]
mod tests;

use contacts::{Contact, Contacts};
use observer::{Body, Observer, sensed};
use reach::Reach;
use serde::{Deserialize, Serialize};
use shares::Shares;
use sides::{Sides, most_Nm, tangent_of};

use super::{Allocation, Capability, Handle, WallDemand, Wanted};
use crate::notation::{ActuatorVector, PlaneVector};

/// Depth at which the wall carries the press alone.
const LAYER_M: f64 = 1e-4;

/// The layer's bandwidth is at most this share of the observer's: coarse encoders slow both.
const LAYER_SHARE: f64 = 0.36;

/// An impact is stopped within this depth, as far as the brakes can: the deceleration is
/// constant then, where the layer alone would let a fast handle through to its own depth.
const STOP_M: f64 = 3e-4;

/// At rest two brakes hold more than the hand needs by this part of the smaller one's share:
/// less, and a hand that begins to pull makes the handle slip before the law knows.
const TENSION: f64 = 0.5;

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

/// Without a sensor: a brake that holds at least this and turns with less than this share of the
/// handle's speed sticks; what is believed along its ray is forgotten with this time constant.
const STUCK_N: f64 = 2.0;
const STUCK_SHARE: f64 = 0.2;
const STUCK_S: f64 = 0.03;

/// What a law has to know of the shafts besides what they can do now.
#[derive(Clone, Copy, Debug)]
pub struct Shafts<'a> {
    /// Time constant from commanded to actual torque, seconds; 0 is at once.
    pub lag_s: &'a ActuatorVector,
    /// Encoder counts of one turn.
    pub counts_per_revolution: &'a ActuatorVector,
    /// Width by which a brake's torque stays behind its command.
    pub hysteresis_Nm: &'a ActuatorVector,
    /// Smallest step of a motor's torque; 0: none.
    pub resolution_Nm: &'a ActuatorVector,
    /// What a torque counts among torques that give the same wrench.
    pub weight: &'a ActuatorVector,
}

impl Shafts<'static> {
    /// Shafts without lag, hysteresis and steps, alike, sensed finely.
    pub const IDEAL: Self = {
        const NONE: &ActuatorVector = &ActuatorVector::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        const ONE: &ActuatorVector = &ActuatorVector::new(1.0, 1.0, 1.0, 1.0, 1.0, 1.0);
        const FINE: &ActuatorVector = &ActuatorVector::new(1e6, 1e6, 1e6, 1e6, 1e6, 1e6);
        Self {
            lag_s: NONE,
            counts_per_revolution: FINE,
            hysteresis_Nm: NONE,
            resolution_Nm: NONE,
            weight: ONE,
        }
    };
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
    damping_ratio: 1.0,
    observer_per_s: 300.0,
    count_m_per_s2: 0.3,
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

/// The wall, or the corner, that is touched.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Touching {
    contacts: Contacts,
    /// Way along the wall so far.
    travelled_m: f64,
    /// 1 at rest along the wall, 0 sliding.
    rest: f64,
    /// Which way it slides, or is about to: the sign along the tangent.
    way: f64,
    shares: Shares,
}

/// What the hand does to the wall.
#[derive(Clone, Copy, Debug)]
struct Press {
    /// Of the wall; of two, the direction of what they give together.
    normal: PlaneVector,
    tangent: PlaneVector,
    /// Two walls share it.
    corner: bool,
    /// What the wall is to give along its normal.
    force_N: f64,
    /// What the hand pulls along the tangent.
    along_N: f64,
    /// The soft force along the tangent: brakes give it where it is against the way.
    soft_N: f64,
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

    /// True where the law holds a wall with this normal there, false where that is another one,
    /// further off; `None`: it holds none with this normal.
    pub fn holds(&self, handle: &Handle, wall: &WallDemand) -> Option<bool> {
        let mut known = self.touching.iter().flat_map(|touching| touching.contacts.iter());
        known.find_map(|contact| contact.is_there(&handle.position, &wall.normal, wall.depth_m))
    }

    /// Forgets the wall, not the handle.
    pub fn leave_wall(&mut self) {
        self.touching = None;
    }

    /// Takes the handle as it is sensed. To be called every tick, wall or no wall.
    pub fn observe(&mut self, capability: &Capability, handle: &Handle, shafts: &Shafts) {
        let Some(body) = Body::of(capability, &handle.inertia) else { return self.reset() };
        self.bandwidth_per_s = Gains::of(handle).bandwidth_per_s(&body, shafts, handle.tick_s);
        self.observer.follow(&body, handle, shafts, self.bandwidth_per_s);
        if !self.observer.is_usable() {
            self.reset();
        }
    }

    /// Torques that hold the walls and drag as the soft force asks, as they ought to be reached;
    /// nothing where no wall is pressed. `None`: there is none.
    pub fn hold(
        &mut self,
        capability: &Capability,
        handle: &Handle,
        shafts: &Shafts,
        wanted: &Wanted,
    ) -> Option<Allocation> {
        let body = Body::of(capability, &handle.inertia).filter(|_| self.observer.is_usable())?;
        let mut touching = self.touched(handle, wanted.walls);
        self.touching = None;
        let press = Press::of(&touching.contacts, self, &body, handle, &wanted.soft)?;
        let sides = Sides::of(capability, &body, &press.normal, press.force_N);
        touching.travelled_m += press.speed_m_per_s * handle.tick_s;
        if press.corner {
            touching.shares.forget();
        } else {
            touching.shares.learn(&sides, touching.travelled_m);
        }
        let touching = self.touching.insert(touching);
        if press.force_N <= 0.0 {
            touching.rest = 1.0;
            return Some(capability.allocation(ActuatorVector::zeros()));
        }
        let tension = if handle.hand_force.is_some() { TENSION } else { 0.0 };
        let mut capacity_Nm =
            touching.capacity_per_N(&sides, &press, tension, handle.tick_s) * press.force_N;
        let way = touching.way;
        let Observer { velocity, reached_Nm, .. } = self.observer;
        let reach = Reach::of(capability, &reached_Nm, shafts.lag_s, Gains::of(handle).reach_s);
        reach.make_up(&mut capacity_Nm, &sides, way, press.speed_m_per_s);
        if handle.hand_force.is_some() {
            // Without a sensor what sticks for it leaves a wrong belief behind.
            reach.lend(&mut capacity_Nm, &sides, &body, &press.normal, &velocity);
        }
        self.doubt(&body, handle, &sides, &press);
        let torque_Nm = ActuatorVector::from_fn(|i, _| {
            let capacity_Nm = capacity_Nm[i].min(most_Nm(capability, i));
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
            if !ahead {
                return wanted_Nm.min(most_Nm);
            }
            let goal_Nm = self.observer.through_play_Nm(i, wanted_Nm, shafts.hysteresis_Nm[i]);
            if shafts.lag_s[i] <= 0.0 {
                return goal_Nm.clamp(0.0, most_Nm);
            }
            let reached_Nm = self.observer.reached_Nm[i];
            let gain = 1.0 / (1.0 - (-reach_s / shafts.lag_s[i]).exp());
            (reached_Nm + (goal_Nm - reached_Nm) * gain).clamp(0.0, most_Nm)
        });
        self.observer.command(&told_Nm);
        ActuatorVector::from_fn(|i, _| told_Nm[i].copysign(torque_Nm[i]))
    }

    /// What is touched now, and what is remembered of it.
    fn touched(&self, handle: &Handle, walls: &[WallDemand]) -> Touching {
        let known = self.touching.as_ref();
        let before = known.map(|touching| touching.contacts).unwrap_or_default();
        let contacts = before.follow(handle, &self.observer, walls);
        match known.filter(|_| contacts.continues(&before)) {
            Some(known) => Touching { contacts, ..*known },
            None => {
                let (rest, way, travelled_m, shares) = (1.0, 1.0, 0.0, Shares::default());
                Touching { contacts, travelled_m, rest, way, shares }
            }
        }
    }

    /// Corrects the belief about a push that cannot be observed, because the handle rests.
    fn doubt(&mut self, body: &Body, handle: &Handle, sides: &Sides, press: &Press) {
        let Some(touching) = self.touching.as_ref() else { return };
        let (elapsed_s, way) = (handle.tick_s * touching.rest, touching.way);
        if handle.hand_force.is_some() {
            self.observer.push *= 1.0 - (elapsed_s / FORGET_S).min(1.0);
            return;
        }
        self.doubt_stuck(body, handle.tick_s, press);
        let slip = SLIP_GAIN * self.bandwidth_per_s.powi(2) * elapsed_s;
        self.observer.push += self.observer.velocity * slip;
        let creep_N = match (sides.least(way), sides.least(-way)) {
            (Some((_, ahead)), Some((_, behind))) => {
                let begins_N = (ahead * press.force_N).max(-way * press.soft_N) * CREEP_BEYOND;
                let left_N = (begins_N - way * press.along_N).max(0.0);
                let creep_N = CREEP_N_PER_S.max(2.0 * begins_N / CREEP_S) * elapsed_s;
                // What slips while one brake sticks moves across that brake's ray, and is put
                // right along it: creeping the same ways leaves nothing to drift.
                let (along, back) = (press.tangent * way, CREEP_BACK * creep_N);
                (along + press.normal * ahead) * creep_N.min(left_N)
                    + (press.normal * behind - along) * back
            }
            _ => press.normal * (press.force_N * elapsed_s / CREEP_S),
        };
        self.observer.push += body.acceleration(&creep_N);
        let believed_N = body.force(&self.observer.push).norm();
        self.observer.push *= (STRONGEST_N / believed_N).min(1.0);
    }
}

impl LawState {
    /// A handle that moves out of the wall round a brake that does not turn is pushed in less
    /// than believed: along that brake's ray nothing is observed.
    fn doubt_stuck(&mut self, body: &Body, tick_s: f64, press: &Press) {
        let velocity = self.observer.velocity;
        let speed_m_per_s = velocity.norm();
        if speed_m_per_s < SLIDE_M_PER_S {
            return;
        }
        let out = velocity.dot(&press.normal) / speed_m_per_s;
        let leaves = (out / STUCK_SHARE).clamp(0.0, 1.0);
        for (ray, reached_Nm) in body.reference.column_iter().zip(&self.observer.reached_Nm) {
            let length = ray.norm();
            if reached_Nm * length < STUCK_N {
                continue;
            }
            let along = ray / length;
            let turns = along.dot(&velocity).abs() / speed_m_per_s;
            let stuck = leaves * (1.0 - turns / STUCK_SHARE).max(0.0);
            let believed_N = body.force(&self.observer.push).dot(&along);
            let less_N = along * (believed_N * stuck * (tick_s / STUCK_S).min(1.0));
            self.observer.push -= body.acceleration(&less_N);
        }
    }
}

impl Press {
    /// `None` without a wall.
    fn of(
        contacts: &Contacts,
        law: &LawState,
        body: &Body,
        handle: &Handle,
        soft: &PlaneVector,
    ) -> Option<Self> {
        let (gains, seen) = (Gains::of(handle), &law.observer);
        let hand = sensed(handle) + body.force(&seen.push);
        let w = gains.layer_per_s.min(LAYER_SHARE * law.bandwidth_per_s);
        let wants = |contact: &Contact| {
            let Contact { normal, most_N, .. } = contact;
            let into_m = contact.depth_m(&seen.position) - LAYER_M;
            let approach_m_per_s = -seen.velocity.dot(normal);
            let mut layer = w * w * into_m + 2.0 * gains.damping_ratio * w * approach_m_per_s;
            if approach_m_per_s > 0.0 {
                let left_m = (STOP_M - into_m).max(0.3 * STOP_M);
                layer = layer.max(approach_m_per_s.powi(2) / (2.0 * left_m));
            }
            (body.mass_along(normal) * layer - hand.dot(normal)).min(*most_N)
        };
        let (normal, force_N, corner) = contacts.reaction(wants)?;
        let tangent = tangent_of(&normal);
        let (along_N, speed_m_per_s) = (hand.dot(&tangent), seen.velocity.dot(&tangent));
        let soft_N = soft.dot(&tangent);
        Some(Self { normal, tangent, corner, force_N, along_N, soft_N, speed_m_per_s })
    }
}

impl Touching {
    /// Capacities per newton of press: resting, sliding, or on the way from one to the other.
    fn capacity_per_N(
        &mut self,
        sides: &Sides,
        press: &Press,
        tension: f64,
        tick_s: f64,
    ) -> ActuatorVector {
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
        let (along, soft) = (press.along_N / press.force_N, press.soft_N / press.force_N);
        let holding = sides.holding(along, tension).sup(&sides.braced(soft));
        let sliding = self.shares.advance(sides, self.way, speed_m_per_s, tick_s).map_or_else(
            || sides.locked(along),
            |shares| sides.dragging(&shares, self.way, -self.way * soft),
        );
        holding * self.rest + sliding * (1.0 - self.rest)
    }
}
