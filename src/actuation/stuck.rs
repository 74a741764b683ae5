//! Stuck: the brakes hold the handle where the walls would leave it free.
//!
//! A handle held *against* a wall is not stuck. It is when it rests under commanded brakes
//! while the hand pushes some other way. Without a force sensor the push is unknown, and
//! resting under brakes counts.

use serde::{Deserialize, Serialize};

use super::WallDemand;
use crate::notation::PlaneVector;

/// Slower than this is at rest: below the least speed of deliberate sliding by far, and
/// above what 65,536 counts cannot tell from nothing.
const REST_M_PER_S: f64 = 0.002;

/// Rest must last this long: a reversal passes through zero in a few ticks.
const REST_S: f64 = 0.020;

/// The hand means it from here on: well above a sensor's bias and noise.
const PUSH_N: f64 = 1.0;

/// A wall law may release for a few ticks while the handle stands; it still holds.
const HELD_S: f64 = 0.010;

/// Watches tick by tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StuckDetector {
    rest_s: f64,
    since_held_s: Option<f64>,
}

impl StuckDetector {
    /// One tick on; true while stuck. `held`: some actuator is commanded.
    pub fn update(
        &mut self,
        velocity: &PlaneVector,
        hand_force: Option<&PlaneVector>,
        walls: &[WallDemand],
        held: bool,
        tick_s: f64,
    ) -> bool {
        self.since_held_s = if held {
            Some(0.0)
        } else {
            self.since_held_s.map(|s| s + tick_s).filter(|s| *s <= HELD_S)
        };
        let pushes = hand_force.is_none_or(|force| free_part(force, walls).xy().norm() > PUSH_N);
        let rests = velocity.xy().norm() < REST_M_PER_S;
        let counts = rests && pushes && self.since_held_s.is_some();
        self.rest_s = if counts { self.rest_s + tick_s } else { 0.0 };
        self.rest_s > REST_S
    }
}

/// The hand's force without what presses into the walls.
fn free_part(force: &PlaneVector, walls: &[WallDemand]) -> PlaneVector {
    walls.iter().fold(*force, |left, wall| {
        let out = PlaneVector::new(wall.normal.x, wall.normal.y, 0.0);
        left - out * left.dot(&out).min(0.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const WALL: [WallDemand; 1] =
        [WallDemand { normal: PlaneVector::new(-1.0, 0.0, 0.0), force_N: 30.0, depth_m: 1e-3 }];

    fn after(ticks: usize, hand: Option<[f64; 2]>, speed: f64, held: bool) -> bool {
        let mut detector = StuckDetector::default();
        let hand = hand.map(|f| PlaneVector::new(f[0], f[1], 0.0));
        let velocity = PlaneVector::new(0.0, speed, 0.0);
        (0..ticks).fold(false, |_, _| detector.update(&velocity, hand.as_ref(), &WALL, held, 1e-3))
    }

    #[test]
    fn pulling_along_the_wall_without_moving_is_stuck_after_a_while() {
        assert!(!after(15, Some([10.0, -5.0]), 0.0, true));
        assert!(after(25, Some([10.0, -5.0]), 0.0, true));
    }

    #[test]
    fn leaning_on_the_wall_sliding_or_resting_free_is_not() {
        assert!(!after(100, Some([10.0, 0.3]), 0.0, true), "leaning");
        assert!(!after(100, Some([10.0, -5.0]), -0.1, true), "sliding");
        assert!(!after(100, Some([10.0, -5.0]), 0.0, false), "nothing holds");
    }

    #[test]
    fn an_unknown_hand_resting_under_brakes_counts() {
        assert!(after(25, None, 0.0, true));
    }
}
