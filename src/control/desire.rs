//! The scene and the controller's contacts, at the tool, become requests in the plane.
//!
//! In W everything is asked as it is, about T (`raw`). In the device's plane surfaces become
//! at most four [`WallDemand`]s and everything else one soft wrench at H, each clipped to the
//! force limit and to the device's range there: that is what the actuators are asked. What the
//! plane has no freedom for is flagged, and so is everything that was clipped or left out.
//!
//! A device with two freedoms has a handle that turns freely: forces act at H wherever the
//! tool is touched, and moments are not felt. With three, each force takes its moment about H
//! with it.

use nalgebra::Vector3;

use super::walls::Walls;
use super::{ContactResult, Estimate, Limit, Limits, Plan, Wrench};
use crate::actuation::{Capability, WallDemand};
use crate::environment::{Constraint, Desired, MAX_CONSTRAINTS, MAX_TOUCHES, Source, Tool};
use crate::notation::PlaneVector;

/// A surface less parallel to the plane than this cannot be felt in it (about 0.06 deg).
const LEAST_IN_PLANE: f64 = 1e-3;

/// Without a force sensor friction is that of this load at most: what a finger or a light
/// grip presses with. A stiff wall asks for hundreds of newtons at a tenth of a millimetre;
/// friction of such a load would hold the handle as in a trap.
const UNKNOWN_LOAD_N: f64 = 10.0;

/// Less than this is not missed: newtons and newton metres.
pub const UNFELT: f64 = 1e-6;

/// What is asked of the actuators in one tick, in B at H.
#[derive(Clone, Copy, Debug, Default)]
pub struct Request {
    /// Fields and friction.
    pub soft_BH_N: PlaneVector,
    walls: [WallDemand; MAX_CONSTRAINTS],
    count: usize,
    /// The raw request in W, about T.
    pub raw: Wrench,
    /// What of `soft_BH_N` the controller asks without a surface.
    pub controller_soft_BH_N: PlaneVector,
    /// Sum of what the controller asks after clipping; a fading command starts from it.
    pub controller_N: f64,
    /// Each surface, as far as it is known before the actuators are asked.
    pub contacts: [ContactResult; MAX_TOUCHES],
    /// How many of `contacts` count.
    pub contact_count: usize,
    /// What presses each of the touches, newtons, in their order.
    loads_N: [f64; MAX_TOUCHES],
    /// What was lost on the way.
    pub limits: Limits,
}

/// A touch in the plane.
#[derive(Clone, Copy, Debug, Default)]
struct InPlane {
    /// The wall that it became part of; `None`: it cannot be felt in the plane.
    wall: Option<usize>,
    /// Length of its normal there.
    share: f64,
    /// What it may ask along its normal, newtons.
    granted_N: f64,
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

    /// Each constraint of `desired` with what presses it, for its friction in the next tick.
    pub fn loads<'a>(&self, desired: &'a Desired) -> impl Iterator<Item = (&'a Constraint, f64)> {
        desired.constraints().iter().zip(self.loads_N)
    }

    /// What `desired` asks, where and of whom `asking` says.
    pub fn from_desired(desired: &Desired, asking: &Asking) -> Self {
        let raw = Wrench {
            force_N: desired.soft_W_N + asking.controller.force_N,
            moment_Nm: desired.soft_moment_W_Nm + asking.controller.moment_Nm,
        };
        let (gain, Wrench { force_N, moment_Nm }) = (asking.gain(), asking.wanted());
        let mut request = Self { raw, ..Self::default() };
        let share = asking.controller_share(desired);
        let mut walls = Walls::default();
        let mut in_plane = [InPlane::default(); MAX_TOUCHES];
        for (place, constraint) in in_plane.iter_mut().zip(desired.constraints()) {
            *place = request.add_wall(constraint, share, asking, &mut walls);
        }
        let (count, clipped, crowded) =
            walls.clip(|normal| asking.most_along(normal), &mut request.walls);
        request.count = count;
        request.limits.set(Limit::Force, clipped);
        request.limits.set(Limit::Constraints, crowded || desired.left_out > 0);
        // Clipped by itself as walls are, so that the sum of what is asked is a true one.
        let (planar, clip) = asking.controller_soft();
        request.limits.set(Limit::Force, clip < 1.0);
        request.controller_soft_BH_N = planar * (clip * share);
        request.controller_N = asking.size_N(&request.controller_soft_BH_N);
        let soft_W_N = desired.soft_W_N * gain + force_N * (clip * share);
        request.add_soft(&soft_W_N, &Vector3::zeros(), asking);
        for (i, constraint) in desired.constraints().iter().enumerate() {
            let (normal_N, load_N) = pressed_N(constraint, &in_plane[i], &walls, asking);
            request.loads_N[i] = load_N;
            let friction_W_N = friction_W_N(constraint, load_N);
            request.raw.add(&friction_W_N, &constraint.arm_W_m);
            request.add_soft(&friction_W_N, &constraint.arm_W_m, asking);
            if constraint.source == Source::Controller {
                request.controller_N += normal_N;
            }
            request.account(constraint, normal_N, friction_W_N.norm());
        }
        let moment_W_Nm = desired.soft_moment_W_Nm * gain + moment_Nm * (clip * share);
        request.add_moments(&moment_W_Nm, asking);
        request.clip_total(asking);
        request
    }

    /// Adds a touch to the walls of the plane; of the controller's only this share.
    fn add_wall(
        &mut self,
        constraint: &Constraint,
        controller_share: f64,
        asking: &Asking,
        walls: &mut Walls,
    ) -> InPlane {
        let normal_W = &constraint.touch.normal_W;
        self.raw.add(&(normal_W * constraint.demand_N), &constraint.arm_W_m);
        let (normal, across) = asking.planar(normal_W, &constraint.arm_W_m);
        // Clipped before it is merged: a wall that asks for more than there is leaves those
        // that coincide with it their part.
        let clipped_N = asking.clipped_N(constraint, &normal);
        let wanted_N = constraint.held_N * asking.gain();
        self.limits.set(Limit::Force, clipped_N < wanted_N && clipped_N > 0.0);
        let of_controller = constraint.source == Source::Controller;
        let granted_N = clipped_N * if of_controller { controller_share } else { 1.0 };
        self.limits.set(Limit::Freedom, across.abs() > LEAST_IN_PLANE);
        let share = normal.xy().norm();
        let felt = share > LEAST_IN_PLANE && granted_N > 0.0;
        let wall = felt.then(|| {
            let depth_m = constraint.touch.depth_m;
            let length_m = asking.capability.moment_length_m;
            walls.add(&(normal / share), granted_N * share, depth_m, length_m)
        });
        InPlane { wall, share, granted_N }
    }

    fn add_soft(&mut self, force_W_N: &Vector3<f64>, arm_W_m: &Vector3<f64>, asking: &Asking) {
        let (soft, across_N) = asking.planar(force_W_N, arm_W_m);
        self.limits.set(Limit::Freedom, across_N.abs() > UNFELT);
        self.soft_BH_N += soft;
    }

    /// Adds the fields' moment, and tells whether any moment is lost.
    fn add_moments(&mut self, soft_moment_W_Nm: &Vector3<f64>, asking: &Asking) {
        let to_B = asking.plan.mount.q_WB.inverse();
        let mut lost_B_Nm = to_B * self.raw.moment_Nm;
        if asking.turns() {
            self.soft_BH_N.z += (to_B * soft_moment_W_Nm).z;
            lost_B_Nm.z = 0.0;
        }
        self.limits.set(Limit::Freedom, lost_B_Nm.norm() > UNFELT);
    }

    /// What one surface does: all of its touches together.
    fn account(&mut self, constraint: &Constraint, normal_N: f64, friction_N: f64) {
        let same =
            |known: &ContactResult| known.source == constraint.source && known.id == constraint.id;
        let found = self.contacts[..self.contact_count].iter().position(same);
        let place = found.unwrap_or(self.contact_count);
        if found.is_none() {
            self.contact_count += 1;
        }
        let contact = &mut self.contacts[place];
        *contact = ContactResult {
            source: constraint.source,
            id: constraint.id,
            depth_m: contact.depth_m.max(constraint.touch.depth_m),
            normal_N: contact.normal_N + normal_N,
            friction_N: contact.friction_N + friction_N,
            sticking: contact.sticking || constraint.touch.sticking,
        };
    }

    fn clip_total(&mut self, asking: &Asking) {
        let total = self.clipped_BH_N();
        let share = asking.most_along(&total);
        if share < 1.0 - 1e-12 {
            self.limits.set(Limit::Force, true);
            self.scale(share);
        }
    }

    /// Sum of the sizes of everything asked of the actuators, newtons.
    pub fn total_N(&self, asking: &Asking) -> f64 {
        let walls_N: f64 = self.walls().iter().map(|wall| wall.force_N).sum();
        walls_N + asking.size_N(&self.soft_BH_N)
    }

    /// Scales everything so that its sum is at most this.
    pub fn cap(&mut self, most_N: f64, asking: &Asking) {
        let total_N = self.total_N(asking);
        if total_N > most_N {
            self.scale(most_N / total_N);
        }
    }

    /// Gives this share of everything, because the device was enabled, or a gain or limit
    /// raised, a moment ago.
    pub fn grow(&mut self, share: f64) {
        if share < 1.0 {
            self.limits.set(Limit::Activation, true);
            self.scale(share);
        }
    }

    fn scale(&mut self, share: f64) {
        self.soft_BH_N *= share;
        self.controller_soft_BH_N *= share;
        self.walls[..self.count].iter_mut().for_each(|wall| wall.force_N *= share);
        self.controller_N *= share;
        self.loads_N.iter_mut().for_each(|load_N| *load_N *= share);
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
    /// What the controller asks besides surfaces, in W, about T.
    pub controller: Wrench,
    /// Most that the controller may ask in sum.
    pub controller_cap_N: f64,
}

impl Asking<'_> {
    /// The share of everything asked that is wanted at all.
    pub(super) fn gain(&self) -> f64 {
        self.plan.guards.force_gain
    }

    /// What the controller asks besides surfaces, as far as it is wanted.
    fn wanted(&self) -> Wrench {
        let Wrench { force_N, moment_Nm } = self.controller;
        Wrench { force_N: force_N * self.gain(), moment_Nm: moment_Nm * self.gain() }
    }

    /// Largest multiple of a wrench that makes sense to ask: its force within the configured
    /// limit, and all of it within what the device could give at all. Infinite for none.
    fn most_along(&self, wrench: &PlaneVector) -> f64 {
        let (force_N, size_N) = (wrench.xy().norm(), self.size_N(wrench));
        if size_N == 0.0 {
            return f64::INFINITY;
        }
        let limit =
            if force_N > 0.0 { self.plan.guards.force_limit_N / force_N } else { f64::INFINITY };
        limit.min(self.capability.range_N(wrench) / size_N)
    }

    /// Size of a wrench, its moment taken on the device's length.
    fn size_N(&self, wrench: &PlaneVector) -> f64 {
        let moment_N = if self.turns() { wrench.z / self.capability.moment_length_m } else { 0.0 };
        wrench.xy().norm().hypot(moment_N)
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
        let (planar, clip) = self.controller_soft();
        let sum_N = walls_N + self.size_N(&planar) * clip;
        if sum_N > self.controller_cap_N { self.controller_cap_N / sum_N } else { 1.0 }
    }

    /// What the controller asks besides surfaces, in the plane, and the share of it that is left
    /// after clipping.
    fn controller_soft(&self) -> (PlaneVector, f64) {
        let Wrench { force_N, moment_Nm } = self.wanted();
        let (mut planar, _) = self.planar(&force_N, &Vector3::zeros());
        if self.turns() {
            planar.z += (self.plan.mount.q_WB.inverse() * moment_Nm).z;
        }
        (planar, self.most_along(&planar).min(1.0))
    }

    /// Normal force of a surface after clipping.
    fn normal_N(&self, constraint: &Constraint) -> f64 {
        let (normal, _) = self.planar(&constraint.touch.normal_W, &constraint.arm_W_m);
        self.clipped_N(constraint, &normal)
    }

    /// The same, its normal in the plane known.
    fn clipped_N(&self, constraint: &Constraint, normal: &PlaneVector) -> f64 {
        let share = normal.xy().norm();
        if share <= LEAST_IN_PLANE || constraint.held_N <= 0.0 {
            return 0.0;
        }
        (constraint.held_N * self.gain()).min(self.most_along(&(normal / share)) / share)
    }

    fn turns(&self) -> bool {
        self.capability.freedoms == 3
    }

    /// The planar wrench at H of a force at an arm from T, and its part across the plane that
    /// the device has no freedom for.
    pub(super) fn planar(
        &self,
        force_W_N: &Vector3<f64>,
        arm_W_m: &Vector3<f64>,
    ) -> (PlaneVector, f64) {
        let (mut planar, across_N) = self.plan.W_to_plane(force_W_N);
        if self.turns() {
            let Plan { mount, .. } = self.plan;
            let at_B_m = mount.q_WB.inverse() * (self.tool.p_WT_m + arm_W_m - mount.p_WB_m);
            let arm_m = at_B_m.xy() - self.estimate.p_BH.xy();
            planar.z = arm_m.perp(&planar.xy());
        }
        (planar, across_N)
    }

    /// How hard the hand presses into a surface, where that is known.
    fn pressing_N(&self, constraint: &Constraint) -> Option<f64> {
        let hand_W_N = self.plan.plane_to_W(&self.estimate.F_hand_BH_N?);
        Some((-hand_W_N.dot(&constraint.touch.normal_W)).max(0.0))
    }
}

/// Normal force of a touch after clipping, and the load of its friction: the hand's press
/// where that is known, shared by the touches of one wall, and never more than was asked.
fn pressed_N(
    constraint: &Constraint,
    in_plane: &InPlane,
    walls: &Walls,
    asking: &Asking,
) -> (f64, f64) {
    let Some(wall) = in_plane.wall.map(|place| walls.get(place)) else { return (0.0, 0.0) };
    let of_wall = in_plane.granted_N * in_plane.share / wall.asked_N;
    let normal_N = of_wall * wall.force_N / in_plane.share;
    let press_N = asking.pressing_N(constraint).unwrap_or(UNKNOWN_LOAD_N);
    (normal_N, normal_N.min(press_N * of_wall))
}

/// The friction of the last tick's load, no more than this one's allows: letting go is never
/// delayed.
fn friction_W_N(constraint: &Constraint, load_N: f64) -> Vector3<f64> {
    let friction_W_N = constraint.touch.friction_W_N;
    let (force_N, most_N) = (friction_W_N.norm(), constraint.most_friction * load_N);
    if force_N > most_N { friction_W_N * (most_N / force_N) } else { friction_W_N }
}

/// The tool kept out of every surface it has entered: a few Gauss-Seidel passes, enough for
/// a corner and bounded for anything else. Where contact points are touched T moves with them.
pub fn proxy_W_m(desired: &Desired, tool: &Tool) -> Vector3<f64> {
    let mut out_W_m = Vector3::zeros();
    for _ in 0..3 {
        for constraint in desired.constraints() {
            let touch = &constraint.touch;
            let missing_m = touch.depth_m - out_W_m.dot(&touch.normal_W);
            out_W_m += missing_m.max(0.0) * touch.normal_W;
        }
    }
    tool.p_WT_m + out_W_m
}
