//! `pointer`: a person pulls the handle with mouse, touch or controller, through a spring.
//!
//! The target comes from outside the loop, in W and for the tool point, through a slot that
//! keeps the newest; whoever holds the other end may be gone at any time. A target that has
//! not been renewed for [`PATIENCE_S`], or that says so, lets go: the hand is never left
//! pulling. Targets in the device's plane only; what lies across it is not felt.

use std::fmt;

use nalgebra::{UnitQuaternion, Vector2, Vector3};
use triple_buffer::{Input, Output, TripleBuffer};

use super::{Grip, Handle};

/// A target older than this is nobody's any more; clients renew it many times in between.
const PATIENCE_S: f64 = 0.3;

/// A firm hand: it can press the 10 N of an examination and pull as hard as an arm at ease.
const GRIP: Grip = Grip { stiffness_N_per_m: 400.0, damping_N_s_per_m: 30.0, max_N: 30.0 };

/// Where somebody wants the tool to be.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointerTarget {
    /// Tool point in W, metres.
    pub p_WT_m: Vector3<f64>,
    /// False: the hand has let go.
    pub holds: bool,
    /// Buttons held, bit 0 first.
    pub buttons: u32,
}

/// The end on which targets are written.
pub type PointerInput = Input<PointerTarget>;

/// The end that the simulated hand reads.
pub struct Pointer {
    targets: Output<PointerTarget>,
    p_WB_m: Vector3<f64>,
    q_WB: UnitQuaternion<f64>,
    offset_B_m: Vector3<f64>,
    age_s: f64,
}

impl fmt::Debug for Pointer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pointer").field("age_s", &self.age_s).finish_non_exhaustive()
    }
}

impl Pointer {
    /// A hand for a device whose plane lies at `p_WB_m`, turned by `q_WB`, and whose tool point
    /// is `offset_B_m` from the handle; and the end on which it is told where to pull.
    pub fn new(
        p_WB_m: Vector3<f64>,
        q_WB: UnitQuaternion<f64>,
        offset_B_m: Vector3<f64>,
    ) -> (Self, PointerInput) {
        let (input, targets) = TripleBuffer::default().split();
        (Self { targets, p_WB_m, q_WB, offset_B_m, age_s: f64::INFINITY }, input)
    }

    /// Force on the handle and buttons held.
    pub(super) fn act(&mut self, handle: &Handle) -> (Vector2<f64>, u32) {
        self.age_s = if self.targets.update() { 0.0 } else { self.age_s + handle.dt_s };
        let target = *self.targets.output_buffer();
        let p_BH_m = self.q_WB.inverse() * (target.p_WT_m - self.p_WB_m) - self.offset_B_m;
        let held = target.holds && self.age_s < PATIENCE_S;
        if !held || !p_BH_m.iter().all(|part| part.is_finite()) {
            return (Vector2::zeros(), 0);
        }
        (GRIP.pull(p_BH_m.xy() - handle.p_m, -handle.v_m_per_s), target.buttons)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;
    use crate::device::hand::tests::{DT_S, PointMass};
    use crate::device::hand::{Hand, HandProgram};
    use crate::notation::PlaneVector;

    fn pulled(pointer: Pointer) -> Hand {
        let mut hand = Hand::new(HandProgram::Pointer, &PlaneVector::zeros(), 0);
        hand.follow(pointer);
        hand
    }

    #[test]
    fn the_handle_comes_to_the_target_and_is_let_go_when_it_is_not_renewed() {
        let (pointer, mut input) =
            Pointer::new(Vector3::zeros(), UnitQuaternion::identity(), Vector3::zeros());
        let mut hand = pulled(pointer);
        let mut mass = PointMass::at([0.3, 0.0]);
        assert_eq!(mass.step(&mut hand, |_, _| ()).F_hand_BH_N.norm(), 0.0, "nobody yet");
        let p_WT_m = Vector3::new(0.35, 0.1, 0.0);
        for step in 0..4_000 {
            if step % 40 == 0 {
                input.write(PointerTarget { p_WT_m, holds: true, buttons: 2 });
            }
            let action = mass.step(&mut hand, |_, _| ());
            assert!(action.F_hand_BH_N.norm() <= GRIP.max_N + 1e-9 && action.buttons == 2);
        }
        assert!((mass.p_m - Vector2::new(0.35, 0.1)).norm() < 1e-4, "{}", mass.p_m);
        mass.p_m.x += 0.05;
        let silent = (1.1 * PATIENCE_S / DT_S) as usize;
        let last = (0..silent).map(|_| mass.step(&mut hand, |_, _| ())).last().unwrap();
        assert_eq!((last.F_hand_BH_N.norm(), last.buttons), (0.0, 0));
    }

    #[test]
    fn a_hand_that_says_so_lets_go_at_once_and_what_is_no_number_pulls_nothing() {
        let (pointer, mut input) =
            Pointer::new(Vector3::zeros(), UnitQuaternion::identity(), Vector3::zeros());
        let mut hand = pulled(pointer);
        let mut mass = PointMass::at([0.3, 0.0]);
        let nowhere = Vector3::new(f64::NAN, 0.0, 0.0);
        for (p_WT_m, holds) in [(Vector3::zeros(), false), (nowhere, true)] {
            input.write(PointerTarget { p_WT_m, holds, buttons: 1 });
            assert_eq!(mass.step(&mut hand, |_, _| ()).F_hand_BH_N.norm(), 0.0);
        }
    }

    #[test]
    fn the_mount_and_the_tool_are_taken_off() {
        let q_WB = UnitQuaternion::from_euler_angles(0.0, 0.0, FRAC_PI_2);
        let (p_WB_m, offset_B_m) = (Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.02, 0.0, 0.1));
        let (pointer, mut input) = Pointer::new(p_WB_m, q_WB, offset_B_m);
        let mut hand = pulled(pointer);
        // H at (0.3, 0.1) of B: T is 0.02 further along x of B, which is y of W.
        let p_WT_m = p_WB_m + Vector3::new(-0.1, 0.32, 0.1);
        input.write(PointerTarget { p_WT_m, holds: true, buttons: 0 });
        let mut mass = PointMass::at([0.3, 0.1]);
        assert!(mass.step(&mut hand, |_, _| ()).F_hand_BH_N.norm() < 1e-9);
    }
}
