//! The scene and the controller's contacts, at the tool point, become requests in the plane.
//!
//! In W everything is asked as it is (`requested`, raw). In the device's plane every
//! surface becomes a [`WallDemand`] and everything else one soft force, each clipped to the
//! force limit and to the device's range there: that is what the actuators are asked. What the plane has no freedom for is
//! flagged, and so is everything that was clipped.

use nalgebra::Vector3;

use super::{ContactResult, Estimate, Limit, Limits, Plan, Wrench};
use crate::actuation::{Capability, WallDemand};
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
    /// Sum of what the controller asks after clipping; a fading command starts from it.
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

    /// What `desired` asks, where and of whom `asking` says.
    pub fn from_desired(desired: &Desired, asking: &Asking) -> Self {
        let share = asking.controller_share(desired);
        let raw_W_N = desired.soft_W_N + asking.controller.force_N;
        let mut request = Self { raw_W_N, ..Self::default() };
        // Clipped by itself as walls are, so that the sum of what is asked is a true one.
        let (in_plane_N, clipped_N) = asking.soft_N(&asking.controller.force_N);
        let granted = if in_plane_N > clipped_N { share * clipped_N / in_plane_N } else { share };
        let mut soft_W_N = desired.soft_W_N + asking.controller.force_N * granted;
        request.controller_N = clipped_N * share;
        request.limits.set(Limit::Force, in_plane_N > clipped_N);
        request.limits.set(Limit::Constraints, desired.left_out > 0);
        for constraint in desired.constraints() {
            let share = if constraint.source == Source::Controller { share } else { 1.0 };
            let friction_W_N = request.add(constraint, share, asking);
            request.raw_W_N += friction_W_N;
            soft_W_N += friction_W_N;
        }
        let (soft_BH_N, across_N) = asking.plan.W_to_plane(&soft_W_N);
        let turned = asking.controller.moment_Nm != Vector3::zeros();
        request.limits.set(Limit::Freedom, across_N.abs() > 1e-6 || turned);
        request.soft_BH_N = soft_BH_N;
        request.clip_total(asking);
        request
    }

    /// Adds a share of one surface and returns its friction, in W.
    fn add(&mut self, constraint: &Constraint, share: f64, asking: &Asking) -> Vector3<f64> {
        let v_W_m_per_s = &asking.tool.v_WT_m_per_s;
        let raw_N = constraint.demand_N(v_W_m_per_s);
        self.raw_W_N += raw_N * constraint.normal_W;
        let normal_N = self.add_wall(constraint, raw_N, share, asking);
        if constraint.source == Source::Controller {
            self.controller_N += normal_N;
        }
        let load_N = asking.pressing_N(constraint).map_or(normal_N, |n| n.min(normal_N));
        let friction_W_N = friction_W_N(constraint, v_W_m_per_s, load_N);
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

    /// Adds a share of a surface's part in the plane; returns its normal force after clipping.
    fn add_wall(
        &mut self,
        constraint: &Constraint,
        raw_N: f64,
        share: f64,
        asking: &Asking,
    ) -> f64 {
        let (normal, across) = asking.plan.W_to_plane(&constraint.normal_W);
        let in_plane = normal.norm();
        self.limits.set(Limit::Freedom, across.abs() > LEAST_IN_PLANE);
        if in_plane <= LEAST_IN_PLANE || raw_N * share <= 0.0 {
            return 0.0;
        }
        let most_N = asking.most_N(&normal);
        self.limits.set(Limit::Force, raw_N * in_plane > most_N);
        let force_N = (raw_N * in_plane).min(most_N) * share;
        self.walls[self.count] = WallDemand { normal: normal / in_plane, force_N };
        self.count += 1;
        force_N / in_plane
    }

    fn clip_total(&mut self, asking: &Asking) {
        let total = self.clipped_BH_N();
        let most_N = asking.most_N(&total);
        if total.norm() > most_N * (1.0 + 1e-12) {
            self.limits.set(Limit::Force, true);
            self.scale(most_N / total.norm());
        }
    }

    /// Sum of the lengths of everything asked of the actuators, newtons.
    pub fn total_N(&self) -> f64 {
        self.walls().iter().map(|wall| wall.force_N).sum::<f64>() + self.soft_BH_N.norm()
    }

    /// Scales everything so that its sum is at most this.
    pub fn cap(&mut self, most_N: f64) {
        let total_N = self.total_N();
        if total_N > most_N {
            self.scale(most_N / total_N);
        }
    }

    fn scale(&mut self, share: f64) {
        self.soft_BH_N *= share;
        self.walls[..self.count].iter_mut().for_each(|wall| wall.force_N *= share);
        self.controller_N *= share;
        for contact in &mut self.contacts[..self.contact_count] {
            contact.normal_N *= share;
            contact.friction_N *= share;
        }
    }
}

/// Where a request is made, of whom, and within which bounds.
#[derive(Clone, Copy, Debug)]
pub struct Asking<'a> {
    /// The tool in W.
    pub tool: &'a Tool,
    /// The device as sensed.
    pub estimate: &'a Estimate,
    /// Its configuration.
    pub plan: &'a Plan,
    /// What its actuators can do.
    pub capability: &'a Capability,
    /// The soft part of what the controller asks, in W.
    pub controller: Wrench,
    /// Most that the controller may ask in sum.
    pub controller_cap_N: f64,
}

impl Asking<'_> {
    /// Most that makes sense to ask along a direction of the plane: the configured limit, or
    /// what the device could give at all.
    fn most_N(&self, direction: &PlaneVector) -> f64 {
        self.plan.guards.force_limit_N.min(self.capability.range_N(direction))
    }

    /// What is left of everything that the controller asks so that its sum, after clipping,
    /// is within the cap: a fade keeps its directions, whatever its parts are.
    fn controller_share(&self, desired: &Desired) -> f64 {
        if self.controller_cap_N.is_infinite() {
            return 1.0;
        }
        let constraints = desired.constraints().iter();
        let of_controller =
            constraints.filter(|constraint| constraint.source == Source::Controller);
        let walls_N: f64 = of_controller.map(|constraint| self.normal_N(constraint)).sum();
        let sum_N = walls_N + self.soft_N(&self.controller.force_N).1;
        if sum_N > self.controller_cap_N { self.controller_cap_N / sum_N } else { 1.0 }
    }

    /// Normal force of a surface after clipping.
    fn normal_N(&self, constraint: &Constraint) -> f64 {
        let (normal, _) = self.plan.W_to_plane(&constraint.normal_W);
        let (in_plane, raw_N) = (normal.norm(), constraint.demand_N(&self.tool.v_WT_m_per_s));
        if in_plane <= LEAST_IN_PLANE {
            return 0.0;
        }
        (raw_N * in_plane).min(self.most_N(&normal)) / in_plane
    }

    /// Length of a soft force in the plane, and after clipping.
    fn soft_N(&self, force_W_N: &Vector3<f64>) -> (f64, f64) {
        let (in_plane_N, _) = self.plan.W_to_plane(force_W_N);
        let raw_N = in_plane_N.norm();
        (raw_N, raw_N.min(self.most_N(&in_plane_N)))
    }

    /// How hard the hand presses into a surface, where that is known.
    fn pressing_N(&self, constraint: &Constraint) -> Option<f64> {
        let hand_W_N = self.plan.plane_to_W(&self.estimate.F_hand_BH_N?);
        Some((-hand_W_N.dot(&constraint.normal_W)).max(0.0))
    }
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
