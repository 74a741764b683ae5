//! `circle`: follows a point that runs around a circle, and leans on whatever is in the way.
//!
//! Positions in B. By default the circle reaches 50 mm behind a wall at x = 0.3 m, so that a
//! turn has a part in free air, a contact made, a curved press with sliding, and a release.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector2;

use super::{Grip, Handle};

/// A circle and how firmly it is followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CircleProgram {
    /// Centre, metres.
    pub centre_m: [f64; 2],
    /// Radius, metres.
    pub radius_m: f64,
    /// Time for one turn, counter-clockwise, seconds.
    pub period_s: f64,
    /// Impedance towards the moving point.
    pub grip: Grip,
}

impl Default for CircleProgram {
    fn default() -> Self {
        Self {
            centre_m: [0.27, 0.1],
            radius_m: 0.08,
            period_s: 4.0,
            grip: Grip { stiffness_N_per_m: 200.0, damping_N_s_per_m: 20.0, max_N: 20.0 },
        }
    }
}

impl CircleProgram {
    /// Where a turn begins: the point with the smallest x.
    pub(super) fn start_m(&self) -> [f64; 2] {
        [self.centre_m[0] - self.radius_m, self.centre_m[1]]
    }

    pub(super) fn outermost_m(&self) -> f64 {
        Vector2::from(self.centre_m).norm() + self.radius_m
    }

    pub(super) fn scaled(self, scale: f64) -> Self {
        Self { centre_m: self.centre_m.map(|m| scale * m), radius_m: scale * self.radius_m, ..self }
    }
}

/// A hand that draws the circle.
#[derive(Clone, Debug)]
pub(super) struct Circle {
    program: CircleProgram,
    /// Part of a turn done, 0 to 1.
    turn: f64,
}

impl Circle {
    pub(super) fn new(program: CircleProgram) -> Self {
        Self { program, turn: 0.0 }
    }

    pub(super) fn act(&mut self, handle: &Handle) -> Vector2<f64> {
        let CircleProgram { centre_m, radius_m, period_s, grip } = self.program;
        let (sin, cos) = (PI + TAU * self.turn).sin_cos();
        let target_m = Vector2::from(centre_m) + radius_m * Vector2::new(cos, sin);
        let target_m_per_s = TAU / period_s * radius_m * Vector2::new(-sin, cos);
        self.turn = (self.turn + handle.dt_s / period_s).fract();
        grip.pull(target_m - handle.p_m, target_m_per_s - handle.v_m_per_s)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{DT_S, PointMass};
    use super::super::{Hand, HandProgram};
    use super::*;
    use crate::notation::PlaneVector;

    #[test]
    fn a_free_handle_goes_round_once_per_period_near_the_circle() {
        let program = CircleProgram::default();
        let [x, y] = program.start_m();
        let mut hand = Hand::new(HandProgram::Circle(program), &PlaneVector::new(x, y, 0.0), 0);
        let mut handle = PointMass::at([x, y]);
        for _ in 0..(program.period_s / DT_S) as usize {
            handle.step(&mut hand, |_, _| ());
            let r_m = (handle.p_m - Vector2::from(program.centre_m)).norm();
            assert!((r_m - program.radius_m).abs() < 5e-3, "{r_m}");
        }
        assert!((handle.p_m - Vector2::new(x, y)).norm() < 5e-3);
    }

    #[test]
    fn it_leans_on_a_wall_for_part_of_a_turn_with_a_moderate_force() {
        let program = CircleProgram::default();
        let [x, y] = program.start_m();
        let mut hand = Hand::new(HandProgram::Circle(program), &PlaneVector::new(x, y, 0.0), 0);
        let mut handle = PointMass::at([x, y]);
        let (mut touching_s, mut press_N) = (0.0, 0.0_f64);
        for _ in 0..(program.period_s / DT_S) as usize {
            let action = handle.step(&mut hand, |handle, _| {
                if handle.p_m.x >= 0.3 {
                    handle.v_m_per_s.x = handle.v_m_per_s.x.min(0.0);
                }
            });
            if handle.p_m.x >= 0.3 && handle.v_m_per_s.x == 0.0 {
                touching_s += DT_S;
                press_N = press_N.max(action.F_hand_BH_N.x);
            }
        }
        assert!((0.8..2.0).contains(&touching_s), "{touching_s}");
        assert!((8.0..13.0).contains(&press_N), "{press_N}");
    }
}
