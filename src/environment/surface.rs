//! A shape of some material: where the tool touches it, how deep, and what it remembers.
//!
//! A solid is felt from outside, with a memory of the way in ([`Proxy`]). A hollow one is a
//! sheet or shell: it is felt from the side on which the tool was when it appeared, and that
//! side never changes. A guide is felt from everywhere beyond its radius.
//!
//! A surface that appears or changes never makes its spring force jump up: what it would add
//! is given away as an offset of depth. The offset shrinks as the tool moves out (a ratchet:
//! nobody is pushed) or, where the owner asked for it, over a blend time. The force before
//! the change is that of the surface as it *was*, here and now, so that a surface renewed on
//! every tick is as hard as one that stays. A change that would give less gives less at once.
//! What was not felt is not remembered over a change: the surface is then as new.
//!
//! In W, metres and newtons. A surface does not know who else is there, nor the actuators.
//! Source of the proxy: [`super::god_object`]; the offset is derived here.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::friction::Bristle;
use super::god_object::Proxy;
use super::shape::{Faces, MAX_FACES, Shape};
use super::{Material, ToolPoint};

/// A shape of some material.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Surface {
    /// Where it is.
    pub shape: Shape,
    /// What it feels like.
    pub material: Material,
    /// A sheet or shell, felt from the side on which the tool was.
    pub hollow: bool,
    /// Time over which a change takes effect; zero: only as the tool moves out.
    pub blend_s: f64,
}

/// Where and how the tool touches a surface.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Touch {
    /// Unit vector that leads out, in W.
    pub normal_W: Vector3<f64>,
    /// How far the tool would have to move along the normal, metres, positive.
    pub depth_m: f64,
    /// Friction under the load of the last tick, newtons in W.
    pub friction_W_N: Vector3<f64>,
    /// Friction holds the tool where it is.
    pub sticking: bool,
}

/// The touches of one tool point on one surface: more than one only within a hollow box,
/// whose friction is then in the first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touches {
    touches: [Touch; MAX_FACES],
    count: usize,
}

impl Touches {
    const NONE: Self = Self {
        touches: [Touch {
            normal_W: Vector3::new(0.0, 0.0, 0.0),
            depth_m: 0.0,
            friction_W_N: Vector3::new(0.0, 0.0, 0.0),
            sticking: false,
        }; MAX_FACES],
        count: 0,
    };

    /// One by one.
    pub fn iter(&self) -> impl Iterator<Item = &Touch> {
        self.touches[..self.count].iter()
    }
}

/// What a surface remembers between ticks of one tool point.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct SurfaceState {
    /// Free until the tool point has travelled so far in all, metres.
    clear_until_m: f64,
    /// The surface that the rest belongs to; `None` before the first tick.
    known: Option<Known>,
    /// +1 outside, -1 inside a hollow shape.
    side: f64,
    /// The way in, outside a body that is touched.
    proxy: Option<Proxy>,
    /// Depth that is given away at each face.
    offset_m: [f64; MAX_FACES],
    /// Time left until the offset has to be gone, where the owner set one.
    blend_left_s: f64,
    bristle: Bristle,
    /// Segment of a corridor that the tool is in.
    pub(super) segment: u8,
}

/// A surface as it was in the last tick.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Known {
    revision: u64,
    shape: Shape,
    stiffness_N_per_m: f64,
}

impl Surface {
    /// The touch of a tool point that is a ball of `radius_m`; advances `state` by `tick_s`.
    /// `revision` changes when the surface does.
    pub fn touch(
        &self,
        state: &mut SurfaceState,
        revision: u64,
        point: &ToolPoint,
        radius_m: f64,
        tick_s: f64,
    ) -> Touches {
        let faces = if state.knows(revision) {
            state.faces(&self.shape, &point.from_W_m, &point.p_W_m, radius_m)
        } else {
            self.change(state, point, radius_m)
        };
        let stiffness_N_per_m = self.material.stiffness_N_per_m;
        state.known = Some(Known { revision, shape: self.shape, stiffness_N_per_m });
        state.relax(&faces, tick_s);
        let clear_until_m = point.travelled_m + faces.clearance_m();
        state.clear_until_m = if clear_until_m.is_finite() { clear_until_m } else { 0.0 };
        self.felt(state, &faces, &point.p_W_m, tick_s)
    }

    /// Faces of a surface that is new or not what it was, with the offsets that keep its force.
    fn change(&self, state: &mut SurfaceState, point: &ToolPoint, radius_m: f64) -> Faces {
        let (before_N, before_faces) = state.held_N(point, radius_m);
        let felt = before_N.iter().any(|force_N| *force_N > 0.0);
        let known = state.known.filter(|_| felt);
        match known.and_then(|known| known.shape.carry(&self.shape)) {
            Some(moved) => {
                state.proxy = state.proxy.map(|at| at.carry(&moved, &self.shape, radius_m));
                state.bristle.carry(&moved);
            }
            None => (state.proxy, state.bristle) = (None, Bristle::default()),
        }
        if !self.hollow {
            state.side = 1.0;
        } else if !felt {
            let inside = self.shape.nearest(&point.p_W_m).distance_m < 0.0;
            state.side = if inside { -1.0 } else { 1.0 };
        }
        let faces = state.faces(&self.shape, &point.p_W_m, &point.p_W_m, radius_m);
        let kept_N = match (before_faces, faces.len()) {
            (_, 1) => [Vector3::from(before_N).norm(), 0.0, 0.0],
            (before, now) if before == now => before_N,
            _ => [0.0; MAX_FACES],
        };
        state.offset_m = [0.0; MAX_FACES];
        let stiffness_N_per_m = self.material.stiffness_N_per_m;
        for (i, (depth_m, _)) in faces.iter().enumerate().filter(|_| stiffness_N_per_m > 0.0) {
            state.offset_m[i] = (depth_m - kept_N[i] / stiffness_N_per_m).max(0.0);
        }
        state.blend_left_s = self.blend_s;
        faces
    }

    fn felt(
        &self,
        state: &mut SurfaceState,
        faces: &Faces,
        p_W_m: &Vector3<f64>,
        tick_s: f64,
    ) -> Touches {
        let mut found = Touches::NONE;
        let mut pressed_W_m = Vector3::zeros();
        for ((depth_m, normal_W), offset_m) in faces.iter().zip(state.offset_m) {
            let depth_m = depth_m - offset_m;
            let usable = depth_m.is_finite() && normal_W.iter().all(|part| part.is_finite());
            if depth_m > 0.0 && usable {
                found.touches[found.count] = Touch { normal_W, depth_m, ..Touch::default() };
                found.count += 1;
                pressed_W_m += depth_m * normal_W;
            }
        }
        match pressed_W_m.try_normalize(0.0) {
            Some(normal_W) => {
                let pull = state.bristle.pull(p_W_m, &normal_W, &self.material, tick_s);
                found.touches[0].friction_W_N = pull.force_W_N;
                found.touches[0].sticking = pull.sticking;
            }
            None => state.bristle = Bristle::default(),
        }
        found
    }
}

impl SurfaceState {
    /// Forgets everything: the surface is new to the tool, and what the tool is inside of is
    /// given away. For whoever begins to render after a pause.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// The load that the surface's friction will have in the next tick, and the share of its
    /// stiffness.
    pub fn bear(&mut self, load_N: f64, share: f64) {
        self.bristle.bear(load_N, share);
    }

    /// True while the tool point cannot have reached the surface: it was further away than
    /// the point has travelled since, and is what it was.
    pub fn is_clear(&self, revision: u64, point: &ToolPoint) -> bool {
        point.travelled_m < self.clear_until_m && self.knows(revision)
    }

    /// True where the surface is what it was.
    pub(super) fn knows(&self, revision: u64) -> bool {
        self.known.is_some_and(|known| known.revision == revision)
    }

    /// The walls around a point after a step, with the memory of the way in.
    fn faces(
        &mut self,
        shape: &Shape,
        from_W_m: &Vector3<f64>,
        p_W_m: &Vector3<f64>,
        radius_m: f64,
    ) -> Faces {
        if let Some(faces) = shape.faces(self.side, p_W_m, radius_m) {
            self.proxy = None;
            return faces;
        }
        let nearest = shape.nearest(p_W_m);
        let free_m = nearest.distance_m - radius_m;
        let outside = Faces::one(-free_m, nearest.normal_W);
        // A step shorter than the distance left cannot have crossed anything.
        if self.proxy.is_none() && free_m > (p_W_m - from_W_m).norm() {
            return outside;
        }
        let entered = || Proxy::entered(shape, radius_m, from_W_m, p_W_m);
        self.proxy = self.proxy.or_else(entered);
        let depth_m = self.proxy.as_mut().map_or(0.0, |at| at.follow(shape, radius_m, p_W_m));
        match self.proxy {
            Some(proxy) if depth_m > 0.0 => Faces::one(depth_m, proxy.normal_W()),
            _ => {
                self.proxy = None;
                outside
            }
        }
    }

    /// Spring force at each face of the surface as it was, at the point's new place, and how
    /// many faces that were.
    fn held_N(&mut self, point: &ToolPoint, radius_m: f64) -> ([f64; MAX_FACES], usize) {
        let mut held_N = [0.0; MAX_FACES];
        let Some(known) = self.known else { return (held_N, 0) };
        let faces = self.faces(&known.shape, &point.from_W_m, &point.p_W_m, radius_m);
        for (i, (depth_m, _)) in faces.iter().enumerate() {
            held_N[i] = known.stiffness_N_per_m * (depth_m - self.offset_m[i]).max(0.0);
        }
        (held_N, faces.len())
    }

    /// Shrinks the offsets: never more than the depth, and to nothing within the blend time.
    fn relax(&mut self, faces: &Faces, tick_s: f64) {
        let blending = self.blend_left_s > 0.0;
        let share = if blending { (tick_s / self.blend_left_s).clamp(0.0, 1.0) } else { 0.0 };
        for ((depth_m, _), offset_m) in faces.iter().zip(&mut self.offset_m) {
            *offset_m = offset_m.min(depth_m.max(0.0)) * (1.0 - share);
        }
        if blending {
            self.blend_left_s -= tick_s;
        }
    }
}

#[cfg(test)]
mod tests;
