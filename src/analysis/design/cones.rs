//! Passive sets, pseudo friction cones and one-brake paths: what brakes can do, by angle.
//!
//! Angles in B, counter-clockwise from x, radians. The 2n rays of n brakes cut the directions
//! of force into 2n *regions*. A motion turns every brake one way, so it makes n neighbouring
//! rays available, the *passive set* (passive FME) of that motion: n - 1 neighbouring regions;
//! there are 2n of them. The *pseudo friction cone* of a desired force is the region opposite
//! to the one that it lies in: a hand that pushes from there goes into the wall along every
//! one-brake path, so that it sticks whatever brake is chosen. With two brakes that region is
//! the whole passive set on the other side; with more it is only what the cones of all pairs
//! of brakes around the desired force have in common.
//!
//! Signs and directions only: torque limits play no part, nor does a third freedom.
//! Source: Cho 2005, sections 2, 3.2, 4 and 5.2; Figures 1-4 and 8.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::mechanism::{Ray, Rays};
use crate::notation::{MAX_ACTUATORS, PlaneVector, ReferenceMatrix};

/// Directions between two rays, counter-clockwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Where it begins.
    pub from: Ray,
    /// Where it ends.
    pub to: Ray,
    /// Direction of `from`, in (-pi, pi].
    pub from_rad: f64,
    /// How far it is to `to`.
    pub width_rad: f64,
}

/// Forces that a group of motions leaves to brakes.
#[derive(Clone, Debug, PartialEq)]
pub struct PassiveSet {
    /// The available rays, counter-clockwise.
    pub rays: Vec<Ray>,
    /// From the first to the last of them.
    pub cone: Cone,
}

/// The motion that one locked brake leaves to the handle, both ways.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OneBrakePath {
    /// The locked brake, counted from zero.
    pub brake: usize,
    /// The way Q+ that turns the first other shaft in positive sense; Q- is its opposite.
    pub plus_rad: f64,
}

impl Cone {
    /// True where it holds a direction, its edges with it.
    pub fn holds(&self, angle_rad: f64) -> bool {
        turn(angle_rad - self.from_rad) <= self.width_rad
    }

    /// The same cone through the origin.
    pub fn opposite(&self) -> Self {
        let flip = |ray: Ray| Ray { positive: !ray.positive, ..ray };
        let from_rad = wrapped(self.from_rad + PI);
        Self { from: flip(self.from), to: flip(self.to), from_rad, ..*self }
    }
}

/// The regions around the circle, counter-clockwise from ray 1+.
pub fn regions(reference: &ReferenceMatrix, actuators: usize) -> Vec<Cone> {
    let Some(rays) = Rays::of(reference, actuators) else { return Vec::new() };
    let (order, betas_rad) = (rays.order(), rays.betas_rad());
    let cone = |i: usize| Cone {
        from: order[i],
        to: order[(i + 1) % order.len()],
        from_rad: direction_of(reference, order[i]),
        width_rad: betas_rad[i],
    };
    (0..order.len()).map(cone).collect()
}

/// The 2n passive sets, in the order of their first rays.
pub fn passive_sets(reference: &ReferenceMatrix, actuators: usize) -> Vec<PassiveSet> {
    let regions = regions(reference, actuators);
    let set = |first: usize| {
        let around = |k: usize| &regions[(first + k) % regions.len()];
        let rays: Vec<Ray> = (0..actuators).map(|k| around(k).from).collect();
        let width_rad = (0..actuators - 1).map(|k| around(k).width_rad).sum();
        let cone = Cone { to: around(actuators - 1).from, width_rad, ..*around(0) };
        PassiveSet { rays, cone }
    };
    (0..regions.len()).map(set).collect()
}

/// The passive set of a motion: the rays against which every brake turns. `None` where a
/// brake does not turn, so that it can be used both ways.
pub fn passive_set_of(
    reference: &ReferenceMatrix,
    actuators: usize,
    motion_rad: f64,
) -> Option<PassiveSet> {
    let rates = reference.tr_mul(&along(motion_rad));
    let sets = passive_sets(reference, actuators);
    let resists = |ray: &Ray| rates[ray.actuator] * if ray.positive { 1.0 } else { -1.0 } < 0.0;
    sets.into_iter().find(|set| set.rays.iter().all(resists))
}

/// The part of the half-plane of resisting forces that a passive set leaves to approximation
/// (Cho 2005, Eq 5): clockwise of the set, and counter-clockwise of it.
pub fn approximation_rad(set: &PassiveSet, motion_rad: f64) -> [f64; 2] {
    let begin_rad = motion_rad + FRAC_PI_2;
    let before = turn(set.cone.from_rad - begin_rad);
    [before, PI - before - set.cone.width_rad]
}

/// The pseudo friction cone of a desired force on a device that uses only `brakes`; `None`
/// where they have no two directions.
pub fn friction_cone(
    reference: &ReferenceMatrix,
    brakes: &[usize],
    desired_rad: f64,
) -> Option<Cone> {
    let mut used = ReferenceMatrix::zeros();
    for (column, &brake) in brakes.iter().enumerate().take(MAX_ACTUATORS) {
        used.set_column(column, &reference.column(brake));
    }
    let regions = regions(&used, brakes.len());
    let around =
        regions.iter().find(|region| region.width_rad > 0.0 && region.holds(desired_rad))?;
    let named = |ray: Ray| Ray { actuator: brakes[ray.actuator], ..ray };
    let opposite = around.opposite();
    Some(Cone { from: named(opposite.from), to: named(opposite.to), ..opposite })
}

/// The paths that locking one brake leaves, for every brake that has a direction.
pub fn one_brake_paths(reference: &ReferenceMatrix, actuators: usize) -> Vec<OneBrakePath> {
    let path = |brake: usize| {
        let ray = reference.column(brake);
        let across = PlaneVector::new(-ray.y, ray.x, 0.0).try_normalize(0.0)?;
        let rates = reference.tr_mul(&across);
        let others = (0..actuators).filter(|&other| other != brake);
        let scale = rates.amax();
        let first = others.map(|other| rates[other]).find(|rate| rate.abs() > 1e-12 * scale)?;
        let plus = across * first.signum();
        Some(OneBrakePath { brake, plus_rad: plus.y.atan2(plus.x) })
    };
    (0..actuators.min(MAX_ACTUATORS)).filter_map(path).collect()
}

/// Direction of a ray, in (-pi, pi].
pub fn direction_of(reference: &ReferenceMatrix, ray: Ray) -> f64 {
    let sign = if ray.positive { 1.0 } else { -1.0 };
    let column = reference.column(ray.actuator) * sign;
    column.y.atan2(column.x)
}

fn along(angle_rad: f64) -> PlaneVector {
    PlaneVector::new(angle_rad.cos(), angle_rad.sin(), 0.0)
}

/// In [0, 2 pi).
fn turn(angle_rad: f64) -> f64 {
    let turned = angle_rad.rem_euclid(TAU);
    // An edge that rounding puts just behind itself is the edge.
    if TAU - turned < 1e-12 { 0.0 } else { turned }
}

/// In (-pi, pi].
fn wrapped(angle_rad: f64) -> f64 {
    PI - (PI - angle_rad).rem_euclid(TAU)
}

#[cfg(test)]
mod tests;
