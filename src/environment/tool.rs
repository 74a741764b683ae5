//! The tool as the world meets it in one tick: where it can be touched, and how it got there.
//!
//! Everything in W. T is the tool point; a contact point is fixed to the tool at some offset
//! from T and is a ball of the tool's radius. A tool without contact points is touched at T.
//! Each point knows where it was in the last tick and how far it has travelled in all, so
//! that what lies further away than it has travelled since need not be looked at.

use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Most contact points of a tool: the corners of a box.
pub const MAX_POINTS: usize = 8;

/// A place of the tool where it can be touched.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct ToolPoint {
    /// From T, metres in W.
    pub arm_W_m: Vector3<f64>,
    /// Where it is, metres in W.
    pub p_W_m: Vector3<f64>,
    /// Its velocity in W, m/s, with what the tool's turning adds.
    pub v_W_m_per_s: Vector3<f64>,
    /// Where it was in the last tick.
    pub from_W_m: Vector3<f64>,
    /// Length of its path so far, metres.
    pub travelled_m: f64,
}

/// Pose and motion of the tool, in W.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct ToolMotion {
    /// Tool point.
    pub p_WT_m: Vector3<f64>,
    /// Turns the tool's axes into W.
    pub q_WT: UnitQuaternion<f64>,
    /// Velocity of the tool point.
    pub v_WT_m_per_s: Vector3<f64>,
    /// Angular velocity.
    pub omega_WT_rad_per_s: Vector3<f64>,
}

/// The tool in one tick.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Tool {
    /// Tool point.
    pub p_WT_m: Vector3<f64>,
    /// Its velocity.
    pub v_WT_m_per_s: Vector3<f64>,
    /// Radius of the tool at each of its points.
    pub radius_m: f64,
    /// Time since the last tick.
    pub tick_s: f64,
    points: [ToolPoint; MAX_POINTS],
    count: usize,
}

impl Tool {
    /// A tool that moves like this, touched at these offsets from T along its own axes, or at
    /// T itself where there are none; those beyond [`MAX_POINTS`] are left out. It has just
    /// appeared.
    pub fn new(
        motion: &ToolMotion,
        offsets_T_m: &[Vector3<f64>],
        radius_m: f64,
        tick_s: f64,
    ) -> Self {
        let ToolMotion { p_WT_m, q_WT, v_WT_m_per_s, omega_WT_rad_per_s } = *motion;
        let at_T = [Vector3::zeros()];
        let offsets_T_m = if offsets_T_m.is_empty() { &at_T } else { offsets_T_m };
        let mut tool = Self { p_WT_m, v_WT_m_per_s, radius_m, tick_s, ..Self::default() };
        for (point, offset_T_m) in tool.points.iter_mut().zip(offsets_T_m) {
            let arm_W_m = q_WT * offset_T_m;
            let p_W_m = p_WT_m + arm_W_m;
            *point = ToolPoint {
                arm_W_m,
                p_W_m,
                v_W_m_per_s: v_WT_m_per_s + omega_WT_rad_per_s.cross(&arm_W_m),
                from_W_m: p_W_m,
                travelled_m: 0.0,
            };
            tool.count += 1;
        }
        tool
    }

    /// The same tool, one tick after `last`.
    #[must_use]
    pub fn after(mut self, last: &Self) -> Self {
        for (point, last) in self.points.iter_mut().zip(&last.points) {
            let step_m = (point.p_W_m - last.p_W_m).norm();
            point.travelled_m = last.travelled_m;
            if step_m.is_finite() {
                point.from_W_m = last.p_W_m;
                point.travelled_m += step_m;
            }
        }
        self
    }

    /// Where it can be touched; never empty but for the default tool.
    pub fn points(&self) -> &[ToolPoint] {
        &self.points[..self.count.min(MAX_POINTS)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tool that turns about a moving centre.
    fn motion(t_s: f64) -> ToolMotion {
        ToolMotion {
            p_WT_m: Vector3::new(0.1, 0.2 * t_s, 0.0),
            q_WT: UnitQuaternion::from_euler_angles(0.0, 0.0, 3.0 * t_s),
            v_WT_m_per_s: Vector3::new(0.0, 0.2, 0.0),
            omega_WT_rad_per_s: Vector3::new(0.0, 0.0, 3.0),
        }
    }

    const CORNERS_T_M: [Vector3<f64>; 2] =
        [Vector3::new(0.05, 0.02, 0.0), Vector3::new(-0.05, 0.02, 0.01)];

    #[test]
    fn a_points_velocity_is_the_rate_of_its_place() {
        let at = |t_s| Tool::new(&motion(t_s), &CORNERS_T_M, 0.0, 1e-3);
        let (before, here, after) = (at(0.3 - 1e-6), at(0.3), at(0.3 + 1e-6));
        for i in 0..2 {
            let rate = (after.points()[i].p_W_m - before.points()[i].p_W_m) / 2e-6;
            assert!((rate - here.points()[i].v_W_m_per_s).norm() < 1e-8);
        }
    }

    #[test]
    fn a_tool_without_points_is_touched_at_its_tool_point() {
        let tool = Tool::new(&motion(0.0), &[], 0.01, 1e-3);
        assert_eq!(tool.points().len(), 1);
        assert_eq!(tool.points()[0].p_W_m, tool.p_WT_m);
        assert_eq!(tool.points()[0].v_W_m_per_s, tool.v_WT_m_per_s);
    }

    #[test]
    fn travel_adds_up_and_a_lost_place_adds_nothing() {
        let at = |y| ToolMotion { p_WT_m: Vector3::new(0.0, y, 0.0), ..ToolMotion::default() };
        let mut tool = Tool::new(&at(0.0), &[], 0.0, 1e-3);
        for y in [0.1, -0.1, 0.2] {
            tool = Tool::new(&at(y), &[], 0.0, 1e-3).after(&tool);
        }
        assert!((tool.points()[0].travelled_m - 0.6).abs() < 1e-12);
        assert_eq!(tool.points()[0].from_W_m.y, -0.1);
        let lost = Tool::new(&at(f64::NAN), &[], 0.0, 1e-3).after(&tool);
        assert!((lost.points()[0].travelled_m - 0.6).abs() < 1e-12);
    }
}
