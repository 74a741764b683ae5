//! Which brake carries the press while the handle slides, and how one takes over from another.
//!
//! The brake with the least drag carries it alone. As the handle moves along the wall the
//! drags change. When another brake begins to hold with less, or the one that carries is about
//! to stop holding, shares move over within a given time: the least drag jumps there, the
//! shares do not. How fast a drag changes is learnt from the motion itself.

use serde::{Deserialize, Serialize};

use super::sides::Sides;
use crate::notation::ActuatorVector;

/// Time in which one brake takes over from another. Longer costs the hand, shorter is felt.
const BLEND_S: f64 = 0.08;

/// The least way along the wall that it is given, for slow motion.
const BLEND_M: f64 = 5e-4;

/// Drags are compared over at least this much of the way, and at most [`LONGEST_M`].
const SHORTEST_M: f64 = 2e-4;
const LONGEST_M: f64 = 5e-3;

/// Shares of the press, summing to one, or none at all.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Shares {
    shares: ActuatorVector,
    /// Change of the drags along the wall, per metre.
    drag_per_m: ActuatorVector,
    anchor: Option<(f64, ActuatorVector)>,
}

impl Shares {
    /// Learns from the drags at `place_m` along the wall, round its bends.
    pub fn learn(&mut self, sides: &Sides, place_m: f64) {
        if let Some((from_m, drag)) = self.anchor {
            let moved_m = place_m - from_m;
            if moved_m.abs() < SHORTEST_M {
                return;
            }
            self.drag_per_m = if moved_m.abs() < LONGEST_M {
                (sides.drag - drag) / moved_m
            } else {
                ActuatorVector::zeros()
            };
        }
        self.anchor = Some((place_m, sides.drag));
    }

    /// Forgets how the drags change: the normal does not follow from the place alone.
    pub fn forget(&mut self) {
        (self.drag_per_m, self.anchor) = (ActuatorVector::zeros(), None);
    }

    /// Everything to the brake that is best against sliding in `way`, at once: at rest.
    pub fn begin(&mut self, sides: &Sides, way: f64) {
        self.shares.fill(0.0);
        if let Some((best, _)) = sides.least(way) {
            self.shares[best] = 1.0;
        }
    }

    /// Moves shares to the brake that is best while sliding in `way` at `speed_m_per_s`.
    /// `None`: no brake holds the wall there.
    pub fn advance(
        &mut self,
        sides: &Sides,
        way: f64,
        speed_m_per_s: f64,
        tick_s: f64,
    ) -> Option<ActuatorVector> {
        let blend_m = (BLEND_S * speed_m_per_s).max(BLEND_M);
        let best = self.best(sides, way, blend_m)?;
        let step = tick_s / BLEND_S;
        for i in 0..sides.count {
            let goal = f64::from(u8::from(i == best));
            let share = self.shares[i] + (goal - self.shares[i]).clamp(-step, step);
            self.shares[i] = share.min(self.room(sides, i, way, blend_m));
        }
        let sum = self.shares.sum();
        if sum > 1e-6 {
            self.shares /= sum;
        } else {
            self.shares = ActuatorVector::ith(best, 1.0);
        }
        Some(self.shares)
    }

    /// Most that brake i may carry: everything where it will hold for `blend_m` to come, then
    /// less and less, and nothing where it does not hold.
    fn room(&self, sides: &Sides, i: usize, way: f64, blend_m: f64) -> f64 {
        let Some(drag) = sides.against(i, way) else { return 0.0 };
        // Along the motion q = -way drag changes by -drag_per_m, whatever the way.
        let falls_per_m = self.drag_per_m[i];
        if falls_per_m > 0.0 { (drag / (falls_per_m * blend_m)).min(1.0) } else { 1.0 }
    }

    /// Of those with the most room the one with the least drag.
    fn best(&self, sides: &Sides, way: f64, blend_m: f64) -> Option<usize> {
        let mut best = (0.0, f64::INFINITY, None);
        for i in 0..sides.count {
            let Some(drag) = sides.against(i, way) else { continue };
            let room = self.room(sides, i, way, blend_m);
            if room > best.0 || (room == best.0 && drag < best.1) {
                best = (room, drag, Some(i));
            }
        }
        best.2
    }
}
