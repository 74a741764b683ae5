//! Where things are: bodies, sheets and guides, each with a signed distance and its gradient.
//!
//! Everything in W, metres. A distance is positive where the tool is free; the normal is its
//! gradient, a unit vector that leads out. Bodies (box, sphere, capsule) are convex, and so is
//! what is free inside a hollow one, behind a plane or around a guide: a convex free region
//! needs no memory, because its nearest point is unique. The outside of a body is not convex;
//! which way out counts there is the business of [`super::god_object`].
//!
//! Every answer to finite numbers has a unit normal, at centres and on axes too. Nothing here
//! knows materials or time. Derived here.

mod capsule;
mod cuboid;
mod guide;
mod half_space;
mod sphere;

pub use guide::Guide;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Most walls that one surface can be at once: three faces meet in the corner of a box.
pub const MAX_FACES: usize = 3;

/// Shorter than this, a vector has no direction worth the name, metres.
const NO_LENGTH_M: f64 = 1e-12;

/// The geometry of a surface, in W.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Shape {
    /// All points behind a plane.
    HalfSpace {
        /// Any point of the plane.
        point_W_m: Vector3<f64>,
        /// Unit vector out of the solid.
        normal_W: Vector3<f64>,
    },
    /// All points within a radius.
    Sphere {
        /// Its centre.
        centre_W_m: Vector3<f64>,
        /// Its radius.
        radius_m: f64,
    },
    /// A rectangular block.
    Box {
        /// Its centre.
        centre_W_m: Vector3<f64>,
        /// Turns its axes into W.
        q_WS: UnitQuaternion<f64>,
        /// Half of its edges.
        half_extents_m: Vector3<f64>,
    },
    /// All points within a radius of a line between two ends.
    Capsule {
        /// The two ends, which may be the same.
        ends_W_m: [Vector3<f64>; 2],
        /// Its radius.
        radius_m: f64,
    },
    /// What is further than a radius from a point, line or plane: the tool is kept within.
    Guide {
        /// What the tool is led along.
        path: Guide,
        /// The tool is free within it; 0: only on the path itself.
        radius_m: f64,
    },
}

/// How far a point is from a surface, and which way leads out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Positive where the tool is free, metres.
    pub distance_m: f64,
    /// Unit vector, the gradient of the distance.
    pub normal_W: Vector3<f64>,
}

/// The walls that a convex free region puts around a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Faces {
    normal_W: [Vector3<f64>; MAX_FACES],
    depth_m: [f64; MAX_FACES],
    count: usize,
}

impl Faces {
    /// A single wall, entered by `depth_m`; negative: as far away.
    pub fn one(depth_m: f64, normal_W: Vector3<f64>) -> Self {
        Self { normal_W: [normal_W; MAX_FACES], depth_m: [depth_m; MAX_FACES], count: 1 }
    }

    /// Depth and normal of each.
    pub fn iter(&self) -> impl Iterator<Item = (f64, Vector3<f64>)> {
        self.depth_m.into_iter().zip(self.normal_W).take(self.count)
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Distance to the nearest of them; not positive when one is entered.
    pub fn clearance_m(&self) -> f64 {
        self.iter().fold(f64::INFINITY, |least, (depth_m, _)| least.min(-depth_m))
    }
}

impl Shape {
    /// Signed distance of a point from the solid, and the way out.
    pub fn nearest(&self, p_W_m: &Vector3<f64>) -> Nearest {
        match self {
            Self::HalfSpace { point_W_m, normal_W } => {
                half_space::nearest(p_W_m, point_W_m, normal_W)
            }
            Self::Sphere { centre_W_m, radius_m } => sphere::nearest(p_W_m, centre_W_m, *radius_m),
            Self::Box { centre_W_m, q_WS, half_extents_m } => {
                cuboid::nearest(p_W_m, centre_W_m, q_WS, half_extents_m)
            }
            Self::Capsule { ends_W_m, radius_m } => capsule::nearest(p_W_m, ends_W_m, *radius_m),
            Self::Guide { path, radius_m } => path.nearest(p_W_m, *radius_m),
        }
    }

    /// The walls around a ball of `radius_m` whose free region is convex: before a half-space,
    /// within a guide (where the ball counts as a point), and inside a hollow body
    /// (`side` = -1). `None` outside a body, where the way out depends on the way in.
    ///
    /// A ball too large for the inside of a body is led to its middle.
    pub fn faces(&self, side: f64, p_W_m: &Vector3<f64>, radius_m: f64) -> Option<Faces> {
        let Nearest { distance_m, normal_W } = match self {
            Self::Box { .. } => return self.inner_faces(side, p_W_m, radius_m),
            _ => self.nearest(p_W_m),
        };
        match self {
            Self::HalfSpace { .. } => {
                Some(Faces::one(radius_m - side * distance_m, side * normal_W))
            }
            Self::Guide { .. } => Some(Faces::one(-distance_m, normal_W)),
            Self::Sphere { radius_m: most_m, .. } | Self::Capsule { radius_m: most_m, .. } => {
                (side < 0.0).then(|| Faces::one(distance_m + radius_m.min(*most_m), -normal_W))
            }
            Self::Box { .. } => None,
        }
    }

    fn inner_faces(&self, side: f64, p_W_m: &Vector3<f64>, radius_m: f64) -> Option<Faces> {
        match self {
            Self::Box { centre_W_m, q_WS, half_extents_m } if side < 0.0 => {
                let room_m = half_extents_m.map(|half_m| (half_m - radius_m).max(0.0));
                Some(cuboid::inner_faces(p_W_m, centre_W_m, q_WS, &room_m))
            }
            _ => None,
        }
    }

    /// Moves what is fixed to `self` to where it is on `next`; `None` where they are not the
    /// same kind of thing. About an axis of symmetry the turn is the smallest one from z of W.
    pub fn carry(&self, next: &Self) -> Option<Isometry3<f64>> {
        let same = std::mem::discriminant(self) == std::mem::discriminant(next);
        same.then(|| next.pose() * self.pose().inverse())
    }

    fn pose(&self) -> Isometry3<f64> {
        let at = |p_W_m: &Vector3<f64>, q| Isometry3::from_parts(Translation3::from(*p_W_m), q);
        match self {
            Self::HalfSpace { point_W_m, normal_W } => at(point_W_m, turn_to(normal_W)),
            Self::Sphere { centre_W_m, .. } => at(centre_W_m, UnitQuaternion::identity()),
            Self::Box { centre_W_m, q_WS, .. } => at(centre_W_m, *q_WS),
            Self::Capsule { ends_W_m: [a, b], .. } => at(a, turn_to(&(b - a))),
            Self::Guide { path, .. } => {
                let (origin_W_m, axis_W) = path.origin_and_axis();
                at(&origin_W_m, turn_to(&axis_W))
            }
        }
    }
}

/// The smallest turn from z to a direction.
fn turn_to(axis: &Vector3<f64>) -> UnitQuaternion<f64> {
    let half_turn = || UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    UnitQuaternion::rotation_between(&Vector3::z(), axis).unwrap_or_else(half_turn)
}

/// Distance along `away` less `radius_m`, with a direction even where there is none.
fn radial(away: &Vector3<f64>, radius_m: f64, anywhere: impl Fn() -> Vector3<f64>) -> Nearest {
    let range_m = away.norm();
    let normal_W = if range_m > NO_LENGTH_M { away / range_m } else { anywhere() };
    Nearest { distance_m: range_m - radius_m, normal_W }
}

/// Some unit vector across `axis`, which need not have length 1.
fn across(axis: &Vector3<f64>) -> Vector3<f64> {
    let other = if axis.x.abs() <= axis.y.abs() { Vector3::x() } else { Vector3::y() };
    axis.cross(&other).try_normalize(NO_LENGTH_M).unwrap_or_else(Vector3::x)
}

/// The point between two ends that is nearest to `p`.
fn nearest_between([a, b]: &[Vector3<f64>; 2], p: &Vector3<f64>) -> Vector3<f64> {
    let along = b - a;
    let share = (p - a).dot(&along) / along.norm_squared();
    // Ends that are the same give no number, and any share will do.
    a + along * if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) }
}

#[cfg(test)]
pub(super) mod tests;
