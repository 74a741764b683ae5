//! The scene and the controller's contacts, at the tool point, become requests in the plane.
//!
//! In W everything is asked as it is (`requested`, raw). In the device's plane every
//! surface becomes a [`WallDemand`] and everything else one soft force, each clipped to the
//! force limit: that is what the actuators are asked. What the plane has no freedom for is
//! flagged, and so is everything that was clipped.

use nalgebra::Vector3;

use super::{ContactResult, Estimate, Limit, Limits, Plan};
use crate::actuation::WallDemand;
use crate::environment::{Constraint, Desired, MAX_CONSTRAINTS, Source, Tool};
use crate::notation::PlaneVector;

/// A surface less parallel to the plane than this cannot be felt in it (about 0.06 deg).
const LEAST_IN_PLANE: f64 = 1e-3;

/// Friction rises to its full value over this speed, so that it has a sign at rest.
const FRICTION_SPEED_M_PER_S: f64 = 0.005;

/// What is asked of the actuators in one tick, in B.
#[derive(Clone, Copy, Debug, Default)]
pub struct Request {
    /// Fields and friction.
    pub soft_BH_N: PlaneVector,
    walls: [WallDemand; MAX_CONSTRAINTS],
    count: usize,
    /// The raw request in W.
    pub raw_W_N: Vector3<f64>,
    /// What the controller's contacts ask after clipping; a fading command starts from it.
    pub controller_N: f64,
    /// Each surface, as far as it is known before the actuators are asked.
    pub contacts: [ContactResult; MAX_CONSTRAINTS],
    /// How many of `contacts` count.
    pub contact_count: usize,
    /// What was lost on the way.
    pub limits: Limits,
}

impl Request {
    /// The surfaces, in the plane.
    pub fn walls(&self) -> &[WallDemand] {
        &self.walls[..self.count]
    }

    /// Sum of everything asked of the actuators.
    pub fn clipped_BH_N(&self) -> PlaneVector {
        self.walls().iter().fold(self.soft_BH_N, |sum, wall| sum + wall.normal * wall.force_N)
    }

    /// What `desired` asks, of which the controller's part is at most `controller_cap_N`.
    pub fn from_desired(
        desired: &Desired,
        tool: &Tool,
        estimate: &Estimate,
        plan: &Plan,
        controller_cap_N: f64,
    ) -> Self {
        let mut request = Self { raw_W_N: desired.soft_W_N, ..Self::default() };
        request.limits.set(Limit::Constraints, desired.left_out > 0);
        let mut soft_W_N = desired.soft_W_N;
        for constraint in desired.constraints() {
            soft_W_N += request.add(constraint, tool, estimate, plan, controller_cap_N);
        }
        let (soft_BH_N, across_N) = plan.W_to_plane(&soft_W_N);
        request.limits.set(Limit::Freedom, across_N.abs() > 1e-6);
        request.clip(soft_BH_N, plan.guards.force_limit_N);
        request
    }

    /// Adds one surface and returns its friction, in W.
    fn add(
        &mut self,
        constraint: &Constraint,
        tool: &Tool,
        estimate: &Estimate,
        plan: &Plan,
        controller_cap_N: f64,
    ) -> Vector3<f64> {
        let raw_N = constraint.demand_N(&tool.v_WT_m_per_s);
        self.raw_W_N += raw_N * constraint.normal_W;
        let of_controller = constraint.source == Source::Controller;
        let cap_N = if of_controller { controller_cap_N } else { f64::INFINITY };
        let limit_N = plan.guards.force_limit_N;
        self.limits.set(Limit::Force, raw_N.min(cap_N) > limit_N);
        let normal_N = raw_N.min(cap_N).min(limit_N);
        if of_controller {
            self.controller_N = self.controller_N.max(normal_N);
        }
        self.add_wall(constraint, normal_N, plan);
        let load_N = pressing_N(constraint, estimate, plan).map_or(normal_N, |n| n.min(normal_N));
        let friction_W_N = friction_W_N(constraint, &tool.v_WT_m_per_s, load_N);
        self.contacts[self.contact_count] = ContactResult {
            source: constraint.source,
            id: constraint.id,
            depth_m: constraint.depth_m,
            normal_N,
            friction_N: friction_W_N.norm(),
        };
        self.contact_count += 1;
        friction_W_N
    }

    fn add_wall(&mut self, constraint: &Constraint, normal_N: f64, plan: &Plan) {
        let (normal, across) = plan.W_to_plane(&constraint.normal_W);
        let in_plane = normal.norm();
        self.limits.set(Limit::Freedom, across.abs() > LEAST_IN_PLANE);
        if in_plane > LEAST_IN_PLANE && normal_N > 0.0 {
            self.walls[self.count] =
                WallDemand { normal: normal / in_plane, force_N: normal_N * in_plane };
            self.count += 1;
        }
    }

    fn clip(&mut self, soft_BH_N: PlaneVector, limit_N: f64) {
        let soft_N = soft_BH_N.norm();
        self.limits.set(Limit::Force, soft_N > limit_N);
        self.soft_BH_N = soft_BH_N * (limit_N / soft_N.max(limit_N));
        let total_N = self.clipped_BH_N().norm();
        if total_N > limit_N {
            self.limits.set(Limit::Force, true);
            let share = limit_N / total_N;
            self.soft_BH_N *= share;
            self.walls[..self.count].iter_mut().for_each(|wall| wall.force_N *= share);
        }
    }
}

/// How hard the hand presses into a surface, where that is known.
fn pressing_N(constraint: &Constraint, estimate: &Estimate, plan: &Plan) -> Option<f64> {
    let hand_W_N = plan.plane_to_W(&estimate.F_hand_BH_N?);
    Some((-hand_W_N.dot(&constraint.normal_W)).max(0.0))
}

/// Coulomb friction of a surface under a load, against the sliding velocity.
fn friction_W_N(constraint: &Constraint, v_W_m_per_s: &Vector3<f64>, load_N: f64) -> Vector3<f64> {
    let normal_W = constraint.normal_W;
    let sliding = v_W_m_per_s - normal_W * v_W_m_per_s.dot(&normal_W);
    let force_N = constraint.material.friction * load_N;
    -sliding * (force_N / sliding.norm().max(FRICTION_SPEED_M_PER_S))
}

/// The tool kept out of every surface it has entered: a few Gauss-Seidel passes, enough for
/// a corner and bounded for anything else.
pub fn proxy_W_m(desired: &Desired, tool: &Tool) -> Vector3<f64> {
    let mut out_W_m = Vector3::zeros();
    for _ in 0..3 {
        for constraint in desired.constraints() {
            let missing_m = constraint.depth_m - out_W_m.dot(&constraint.normal_W);
            out_W_m += missing_m.max(0.0) * constraint.normal_W;
        }
    }
    tool.p_WT_m + out_W_m
}
