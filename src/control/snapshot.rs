//! The state of a control as a value that can be copied at a tick's edge, stored and resumed.
//!
//! A copy goes into a state that was made elsewhere, and touches only the surfaces that the
//! plan and the tool use: all others are as new on both sides. What is stored keeps every
//! bit of every number, and surfaces that are as new take no room.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::{ControlState, MAX_EVENTS, Plan};
use crate::environment::{MAX_OBJECTS, MAX_POINTS, MAX_TOUCHES, SurfaceState};

/// No device counts further, and sums of it stay within a u64.
const LARGEST_COUNT: u64 = 1 << 62;

impl ControlState {
    /// Becomes what `other` is; this one must be as new. Neither allocates nor frees; costs the
    /// copy of what is in use.
    pub(super) fn copy_from(&mut self, other: &Self, plan: &Plan) {
        // Every field by name: one that is added has to be thought of here.
        let Self {
            tick,
            mode,
            fault,
            estimator,
            authority,
            activation,
            begins,
            stuck,
            law,
            was_stuck,
            scene,
            used,
            contacts,
            tool,
            command,
            before,
            soft_BH_N,
            account,
            commands,
            last,
            touched,
            blind_ticks,
            events,
            times_ns,
        } = other;
        (self.tick, self.mode, self.fault) = (*tick, *mode, *fault);
        (self.authority, self.stuck, self.law) = (*authority, *stuck, *law);
        (self.activation, self.begins, self.used) = (*activation, *begins, *used);
        (self.was_stuck, self.tool, self.command) = (*was_stuck, *tool, *command);
        (self.before, self.soft_BH_N, self.account) = (*before, *soft_BH_N, *account);
        (self.last, self.touched, self.commands) = (*last, *touched, *commands);
        (self.events, self.times_ns, self.blind_ticks) = (*events, *times_ns, *blind_ticks);
        self.estimator.clone_from(estimator);
        self.contacts.clone_from(contacts);
        let points = tool.as_ref().map_or(0, |(tool, ..)| tool.points().len());
        for (to, from) in self.scene.iter_mut().zip(scene).take(points) {
            for slot in plan.scene.iter().map(|item| usize::from(item.slot)) {
                if let (Some(to), Some(from)) = (to.get_mut(slot), from.get(slot)) {
                    *to = *from;
                }
            }
        }
    }

    /// False for what no tick ever leaves behind: a state that was read from outside is asked
    /// before it is resumed.
    pub fn is_sound(&self) -> bool {
        self.estimator.is_sound()
            && self.touched.1 <= MAX_TOUCHES
            && self.events.count <= MAX_EVENTS
            && self.tick < LARGEST_COUNT
            && self.events.last < LARGEST_COUNT
    }

    /// Ticks so far.
    pub fn ticks(&self) -> u64 {
        self.tick
    }
}

/// Surfaces by point of the tool and slot.
type Surfaces = Box<[[SurfaceState; MAX_OBJECTS]]>;

/// Surfaces that are not as new, each with its place.
pub(super) mod surfaces {
    use super::*;

    #[expect(clippy::disallowed_methods, reason = "stored after a copy, never in a tick")]
    pub fn serialize<S: Serializer>(all: &Surfaces, to: S) -> Result<S::Ok, S::Error> {
        let new = SurfaceState::default();
        let layers = all.iter().enumerate();
        let places = layers.flat_map(|(point, layer)| {
            layer.iter().enumerate().map(move |(slot, state)| (point as u8, slot as u16, state))
        });
        let used: Box<[_]> = places.filter(|(_, _, state)| **state != new).collect();
        used.serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Surfaces, D::Error> {
        let used = Box::<[(u8, u16, SurfaceState)]>::deserialize(from)?;
        let mut all = ControlState::new_surfaces();
        for (point, slot, state) in used {
            let layer = all.get_mut(usize::from(point));
            let place = layer.and_then(|layer| layer.get_mut(usize::from(slot)));
            let beyond = || {
                D::Error::custom(format_args!(
                    "surface at point {point}, slot {slot}: a tool has {MAX_POINTS} points, a scene {MAX_OBJECTS} slots"
                ))
            };
            *place.ok_or_else(beyond)? = state;
        }
        Ok(all)
    }
}

/// Times of the newest ticks: more of them than serde has arrays for.
pub(super) mod times {
    use super::*;

    pub fn serialize<S: Serializer, const N: usize>(
        times_ns: &[u64; N],
        to: S,
    ) -> Result<S::Ok, S::Error> {
        times_ns.as_slice().serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>, const N: usize>(
        from: D,
    ) -> Result<[u64; N], D::Error> {
        let times_ns = Box::<[u64]>::deserialize(from)?;
        let count = times_ns.len();
        <[u64; N]>::try_from(&*times_ns).map_err(|_| D::Error::invalid_length(count, &"all times"))
    }
}

#[cfg(test)]
#[path = "snapshot_tests.rs"]
mod tests;
