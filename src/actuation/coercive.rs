//! The coercive rule of Cho 2005, section 7: the one brake whose path leads out of the wall.
//!
//! Angles are counter-clockwise from the hand force: phi_d to the desired force, phi_R to an
//! available reference force. The rule as printed takes the nearest reference with
//! `phi_R >= phi_d` where `phi_d <= pi`, else the nearest with `phi_R <= phi_d`. That is
//! incomplete: without `phi_R <= pi` (else `>= pi`) it may lead *into* the wall, as a path lies
//! across its reference and follows the hand. With the condition there is sometimes no
//! reference; sticking cannot be avoided with one brake then. Both rules look at the hand
//! force alone, so they choose the wrong side for a hand that brakes a handle that slides.
//! Two freedoms. The condition is derived here.

use std::f64::consts::PI;

use super::region::{available, turn};
use super::{Allocation, Capability, Handle, WallDemand, nearest_reference, optimal};
use crate::notation::{ActuatorVector, PlaneVector};

/// Which form of the rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// As printed.
    Literal,
    /// With the condition that keeps the path out of the wall.
    Mended,
}

/// A reference force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pick {
    /// Whose.
    pub actuator: usize,
    /// The sign of its torque.
    pub sign: f64,
    /// Angle from the desired force, in [0, pi].
    pub gamma_rad: f64,
}

/// The reference force that the rule takes; `None` where it finds none, or where hand or
/// desire have no direction.
pub fn pick(
    capability: &Capability,
    hand: &PlaneVector,
    desired: &PlaneVector,
    rule: Rule,
) -> Option<Pick> {
    let phi = |ray: [f64; 2]| {
        let (x, y) = (hand.x, hand.y);
        turn((x * ray[1] - y * ray[0]).atan2(x * ray[0] + y * ray[1]))
    };
    let directed = |v: &PlaneVector| v.x.hypot(v.y) > 0.0 && v.x.is_finite() && v.y.is_finite();
    if !directed(hand) || !directed(desired) {
        return None;
    }
    let phi_d = phi([desired.x, desired.y]);
    let left = phi_d <= PI;
    let mut best: Option<Pick> = None;
    available(capability, |actuator, sign, ray| {
        let phi_R = phi(ray);
        let beyond = if left { phi_R - phi_d } else { phi_d - phi_R };
        let out = rule == Rule::Literal || if left { phi_R <= PI } else { phi_R >= PI };
        if beyond >= 0.0 && out && best.is_none_or(|known| beyond < known.gamma_rad) {
            best = Some(Pick { actuator, sign, gamma_rad: beyond });
        }
    });
    best
}

/// Torques that hold `walls` by the rule, as one desired force along their normals: the picked
/// reference gives the projection of it. Where the hand's force is unknown, where the rule finds
/// nothing, and with more than two freedoms, [`nearest_reference`] takes its place.
pub fn coercive(
    capability: &Capability,
    handle: &Handle,
    walls: &[WallDemand],
    rule: Rule,
) -> Allocation {
    let desired =
        walls.iter().fold(PlaneVector::zeros(), |sum, wall| sum + wall.normal * wall.force_N);
    if capability.freedoms > 2 {
        return optimal(capability, &desired);
    }
    let picked = handle.hand_force.and_then(|hand| pick(capability, &hand, &desired, rule));
    let Some(picked) = picked else {
        return nearest_reference(capability, &desired, &handle.velocity).allocation;
    };
    let ray = capability.reference.column(picked.actuator).xy();
    let along = picked.sign * desired.xy().dot(&ray) / ray.norm_squared();
    let mut torque_Nm = ActuatorVector::zeros();
    torque_Nm[picked.actuator] = picked.sign * along.max(0.0);
    capability.allocation(capability.bounds.clamp(&torque_Nm))
}
