//! The walls that the handle is at: one, or the two of an inner corner, and what they want.
//!
//! In B. Each wall is remembered as the plane that touches it where the handle is, so that a
//! handle which leaves it by less than [`LINGER_M`] is still held there; the plane rolls on along
//! a wall that was bent so far, or a handle that has left a ball by a hair would follow the
//! tangent until it falls back. Each wants its own
//! layer to be kept: a force h along its normal. Two walls want it at once, and neither can
//! pull: the reaction is `a_1 n_1 + a_2 n_2` with `a >= 0`, `n_k . reaction >= h_k`, and no
//! more than that where `a_k > 0`: a complementarity problem of two, solved by its cases. So in
//! a corner the reaction turns with the hand, becomes that of one wall alone exactly where the
//! hand begins to pull away from the other, and for the rest of the law a corner is a wall
//! whose normal is the reaction's direction. Derived here.

use serde::{Deserialize, Serialize};

use super::observer::Observer;
use super::sides::tangent_of;
use crate::actuation::{Handle, WallDemand};
use crate::notation::PlaneVector;

/// A handle this far outside is still at the wall.
const LINGER_M: f64 = 3e-4;

/// The bend of a wall is learnt over this much of the way along it.
const LEARNT_OVER_M: f64 = 2e-3;

/// Normals further apart than this (cosine) are different walls from tick to tick.
const SAME_WALL: f64 = 0.9;

/// A surface further off is that of another wall with the same normal.
const SAME_PLACE_M: f64 = 2e-3;

/// Normals closer than this (cosine) are one wall within a tick.
const COINCIDENT: f64 = 1.0 - 1e-6;

/// Walls that face each other (1 + cosine) do not make a corner.
const OPPOSED: f64 = 1e-3;

/// One wall as the plane that touches it.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Contact {
    /// Out of the wall.
    pub normal: PlaneVector,
    /// Where its surface is along the normal.
    pub surface_m: f64,
    /// Most that was asked of it; without a limit where the handle lingers outside.
    pub most_N: f64,
    /// How fast the normal turns along the tangent, counter-clockwise.
    pub bend_rad_per_m: f64,
}

impl Contact {
    /// How deep a place is in it.
    pub fn depth_m(&self, position: &PlaneVector) -> f64 {
        self.surface_m - position.dot(&self.normal)
    }

    fn is_same(&self, normal: &PlaneVector) -> bool {
        self.normal.dot(normal) > SAME_WALL
    }

    /// True for a wall that pushes the same way from about the same place; `None` for one that
    /// pushes another way.
    pub fn is_there(
        &self,
        position: &PlaneVector,
        normal: &PlaneVector,
        depth_m: f64,
    ) -> Option<bool> {
        let apart_m = (self.depth_m(position) - depth_m).abs();
        self.is_same(normal).then_some(apart_m < SAME_PLACE_M)
    }

    /// The same wall as it is asked for now, `moved_m` further along.
    fn learn(&mut self, before: &Self, moved_m: &PlaneVector) {
        let along_m = moved_m.dot(&tangent_of(&before.normal));
        let turned_rad = tangent_of(&before.normal).dot(&self.normal);
        let change = (turned_rad - before.bend_rad_per_m * along_m) / LEARNT_OVER_M;
        self.bend_rad_per_m = before.bend_rad_per_m + change * along_m.signum();
    }

    /// The plane where the wall would be by its bend, under a handle that came `moved_m` to
    /// `position`.
    fn rolled(&self, position: &PlaneVector, moved_m: &PlaneVector) -> Self {
        let along_m = moved_m.dot(&tangent_of(&self.normal));
        let turn_rad = self.bend_rad_per_m * along_m;
        let turned = |rad: f64| {
            let (sin, cos) = rad.sin_cos();
            self.normal * cos + tangent_of(&self.normal) * sin
        };
        let from = position - moved_m;
        let foot = from + self.normal * self.depth_m(&from);
        let foot = foot + tangent_of(&turned(0.5 * turn_rad)) * along_m;
        let normal = turned(turn_rad);
        Self { normal, surface_m: normal.dot(&foot), most_N: f64::INFINITY, ..*self }
    }
}

/// At most two walls; the first is there wherever the second is.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Contacts([Option<Contact>; 2]);

impl Contacts {
    /// The walls of this tick: the two deepest that ask, and those known that are only just
    /// left.
    pub fn follow(&self, handle: &Handle, seen: &Observer, walls: &[WallDemand]) -> Self {
        let mut now = Self::default();
        let moved_m = seen.velocity * handle.tick_s;
        for _ in 0..2 {
            let apart = |wall: &&WallDemand| {
                wall.force_N > 0.0
                    && now.iter().all(|known| known.normal.dot(&wall.normal) < COINCIDENT)
            };
            let deepest = walls.iter().filter(apart).max_by(|a, b| a.depth_m.total_cmp(&b.depth_m));
            let Some(WallDemand { normal, force_N, depth_m }) = deepest.copied() else { break };
            let surface_m = depth_m + normal.dot(&handle.position);
            let mut found = Contact { normal, surface_m, most_N: force_N, bend_rad_per_m: 0.0 };
            if let Some(before) = self.iter().find(|known| known.is_same(&normal)) {
                found.learn(before, &moved_m);
            }
            now.add(found);
        }
        for known in self.iter() {
            let again = now.iter().any(|contact| contact.is_same(&known.normal));
            let rolled = known.rolled(&seen.position, &moved_m);
            let felt = rolled.depth_m(&handle.position) > 1e-6;
            let near = rolled.depth_m(&seen.position) > -LINGER_M;
            if !again && !felt && near {
                now.add(rolled);
            }
        }
        now
    }

    /// One by one.
    pub fn iter(&self) -> impl Iterator<Item = &Contact> {
        self.0.iter().flatten()
    }

    /// True where one of these walls was there before.
    pub fn continues(&self, before: &Self) -> bool {
        self.iter().any(|now| before.iter().any(|known| known.is_same(&now.normal)))
    }

    fn add(&mut self, contact: Contact) {
        if let Some(free) = self.0.iter_mut().find(|place| place.is_none()) {
            *free = Some(contact);
        }
    }

    /// The reaction that gives every wall what `wants` says of it; zero, along the first
    /// normal, where none wants anything. `None` without a wall. The last tells whether two
    /// walls share it.
    pub fn reaction(&self, wants: impl Fn(&Contact) -> f64) -> Option<(PlaneVector, f64, bool)> {
        let first = self.0[0].as_ref()?;
        let h_1 = wants(first);
        let alone = |contact: &Contact, h: f64| (contact.normal, h.max(0.0), false);
        let Some(second) = self.0[1].as_ref() else { return Some(alone(first, h_1)) };
        let h_2 = wants(second);
        let cosine = first.normal.dot(&second.normal);
        if h_1.max(h_2) <= 0.0 || 1.0 + cosine < OPPOSED || 1.0 - cosine < OPPOSED {
            let more = if h_2 > h_1 { alone(second, h_2) } else { alone(first, h_1) };
            return Some(more);
        }
        if h_1 > 0.0 && cosine * h_1 >= h_2 {
            return Some(alone(first, h_1));
        }
        if h_2 > 0.0 && cosine * h_2 >= h_1 {
            return Some(alone(second, h_2));
        }
        let scale = 1.0 / (1.0 - cosine * cosine);
        let (a_1, a_2) = ((h_1 - cosine * h_2) * scale, (h_2 - cosine * h_1) * scale);
        let force = first.normal * a_1.max(0.0) + second.normal * a_2.max(0.0);
        let force_N = force.norm();
        Some(if force_N > 0.0 { (force / force_N, force_N, true) } else { alone(first, h_1) })
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn at(bearing_rad: f64) -> Contact {
        let normal = PlaneVector::new(bearing_rad.cos(), bearing_rad.sin(), 0.0);
        Contact { normal, surface_m: 0.0, most_N: f64::INFINITY, bend_rad_per_m: 0.0 }
    }

    /// Of all reactions that only push and give each wall what it wants, the least.
    fn least_by_search(walls: &[Contact; 2], wants: [f64; 2]) -> f64 {
        let mut least_N = f64::INFINITY;
        for i in 0..=400 {
            for k in 0..=400 {
                let (a, b) = (0.1 * f64::from(i), 0.1 * f64::from(k));
                let force = walls[0].normal * a + walls[1].normal * b;
                let gives = [force.dot(&walls[0].normal), force.dot(&walls[1].normal)];
                if gives[0] >= wants[0] - 1e-9 && gives[1] >= wants[1] - 1e-9 {
                    least_N = least_N.min(force.norm());
                }
            }
        }
        least_N
    }

    #[test]
    fn a_corner_gives_each_wall_what_it_wants_with_the_least_force() {
        let mut rng = ChaCha8Rng::seed_from_u64(12);
        for _ in 0..40 {
            let bearing_rad = rng.random_range(-3.0..3.0);
            let walls = [at(bearing_rad), at(bearing_rad + rng.random_range(0.6..2.2))];
            let wants = [rng.random_range(-5.0..10.0), rng.random_range(-5.0..10.0)];
            let contacts = Contacts([Some(walls[0]), Some(walls[1])]);
            let want = |contact: &Contact| {
                if contact.normal == walls[0].normal { wants[0] } else { wants[1] }
            };
            let (normal, force_N, both) = contacts.reaction(want).unwrap();
            let force = normal * force_N;
            for (wall, want_N) in walls.iter().zip(wants) {
                assert!(force.dot(&wall.normal) >= want_N - 1e-9, "{wants:?}");
            }
            let least_N = least_by_search(&walls, wants);
            assert!(force_N <= least_N + 1e-9 && force_N > least_N - 0.5, "{force_N} {least_N}");
            assert!(!both || (wants[0] > -5.0 && wants[1] > -5.0));
        }
    }

    /// Where the hand begins to pull away from one wall, the reaction is that of the other: the
    /// change from a corner to a wall is no step.
    #[test]
    fn the_reaction_turns_without_a_step() {
        let (a, b) = (at(0.3), at(2.0));
        let contacts = Contacts([Some(a), Some(b)]);
        let mut last: Option<PlaneVector> = None;
        for k in 0..=2000 {
            let hand_rad = 0.3 + std::f64::consts::PI + 1.7e-3 * f64::from(k) - 0.85;
            let hand = PlaneVector::new(hand_rad.cos(), hand_rad.sin(), 0.0) * 10.0;
            let (normal, force_N, _) =
                contacts.reaction(|contact| -hand.dot(&contact.normal)).unwrap();
            let force = normal * force_N;
            assert!(last.is_none_or(|last| (force - last).norm() < 0.05), "{hand_rad}");
            last = Some(force);
        }
    }

    /// Round the outside of a ball with its walls told, then on a hair outside without them: the
    /// plane rolls on where a tangent would be 0.06 mm off.
    #[test]
    fn a_wall_that_is_left_by_a_hair_goes_on_bending() {
        let (radius_m, inertia) = (0.08, crate::notation::HandleInertia::identity());
        let (mut contacts, mut seen) = (Contacts::default(), Observer::default());
        for tick in 0..180 {
            let at_rad = f64::from(tick) * 1e-4 / radius_m;
            let normal = PlaneVector::new(at_rad.cos(), at_rad.sin(), 0.0);
            let told = tick < 150;
            let depth_m = if told { 1e-4 } else { -1e-5 };
            (seen.position, seen.velocity) =
                (normal * (radius_m - depth_m), tangent_of(&normal) * 0.1);
            let (position, velocity) = (seen.position, seen.velocity);
            let handle = Handle { position, velocity, hand_force: None, inertia, tick_s: 1e-3 };
            let wall = [WallDemand { normal, force_N: 10.0, depth_m }];
            contacts = contacts.follow(&handle, &seen, if told { &wall } else { &[] });
            let contact = contacts.iter().next().expect("held on");
            let off_m = contact.depth_m(&seen.position) - depth_m;
            assert!(off_m.abs() < 5e-6, "{tick}: {off_m}");
            assert!((contact.normal - normal).norm() < 5e-3, "{tick}");
        }
    }

    #[test]
    fn walls_that_face_each_other_and_a_pull_away_from_both_are_no_corner() {
        let opposed = Contacts([Some(at(0.0)), Some(at(std::f64::consts::PI))]);
        let (normal, force_N, both) = opposed.reaction(|_| 3.0).unwrap();
        assert!(normal.x.abs() > 0.99 && force_N == 3.0 && !both);
        let corner = Contacts([Some(at(0.0)), Some(at(1.5))]);
        assert_eq!(corner.reaction(|_| -1.0).unwrap().1, 0.0);
        assert!(Contacts::default().reaction(|_| 1.0).is_none());
    }
}
