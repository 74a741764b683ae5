//! A place for a course within the reach of a device.
//!
//! As it is written wherever it fits there. Else smaller than the largest that fits anywhere,
//! turned by eighths and moved over a grid, at the largest size at which brakes hold along all
//! of it easily, or where they do along most: with few brakes the way that a wall faces decides
//! whether any law can follow it. The same device gives the same place. In B.

use std::f64::consts::FRAC_PI_4;

use nalgebra::Vector2;

use super::course::{Course, CourseKind, Place, Placement};
use super::perfect::least_drag_N;
use crate::mechanism::Mechanism;
use crate::notation::{ActuatorVector, PlaneVector};

/// Samples along the path, metres of the full size.
const EVERY_M: f64 = 0.01;

/// The handle gets this far into the wall and, before it begins, out of it.
const INTO_M: f64 = 0.004;
const OUT_M: f64 = 0.016;

/// Least margin of a posture on the way, and part of the reach that stays free on both sides:
/// the simulated device stops at 0.05.
const LEAST_MARGIN: f64 = 0.15;
const EDGE: f64 = 0.06;

/// Sizes that are tried, and the parts of the largest of them that are looked at.
const SMALLEST: f64 = 0.15;
const SIZE_STEP: f64 = 0.05;
const PARTS: [f64; 4] = [0.9, 0.75, 0.6, 0.45];

/// Drag per newton of press that a hand can do with: a brake that drags more holds in theory.
const EASY: f64 = 3.0;

/// Places across the reach in each direction, and turns.
const ACROSS: usize = 17;
const TURNS: usize = 8;

/// The device has no room for the course.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "the course `{course}` does not fit {mechanism}: nowhere in its reach of {nearest_m:.3} to \
     {furthest_m:.3} m is there room for it at {SMALLEST} of its size or more"
)]
pub struct NoRoom {
    course: CourseKind,
    mechanism: &'static str,
    nearest_m: f64,
    furthest_m: f64,
}

/// Where the course stands for this device.
pub fn placement(kind: CourseKind, mechanism: &dyn Mechanism) -> Result<Placement, NoRoom> {
    if held_share(kind, mechanism, &Placement::USUAL).is_some() {
        return Ok(Placement::USUAL);
    }
    let sizes = (0..).map(|k| 1.0 - SIZE_STEP * f64::from(k)).take_while(|s| *s > SMALLEST - 1e-9);
    for largest in sizes {
        let Some(mut best) = best_at(kind, mechanism, largest) else { continue };
        let mut most = 0.0;
        for part in PARTS.into_iter().filter(|part| part * largest >= SMALLEST) {
            let Some((share, placement)) = best_at(kind, mechanism, part * largest) else {
                continue;
            };
            if share > most + 0.01 {
                (most, best) = (share, (share, placement));
            }
        }
        return Ok(best.1);
    }
    Err(no_room(kind, mechanism))
}

fn no_room(course: CourseKind, mechanism: &dyn Mechanism) -> NoRoom {
    let (nearest_m, furthest_m) = mechanism.reach_m();
    NoRoom { course, mechanism: mechanism.name(), nearest_m, furthest_m }
}

/// The place at this size at which brakes hold the most of the course.
fn best_at(kind: CourseKind, mechanism: &dyn Mechanism, scale: f64) -> Option<(f64, Placement)> {
    let centre_m = middle(&Course::new(kind, 1.0, &Placement::USUAL)) * scale;
    let furthest_m = mechanism.reach_m().1;
    let mut best: Option<(f64, Placement)> = None;
    for turn in 0..TURNS {
        let turn_rad = FRAC_PI_4 * turn as f64;
        let turned_m = nalgebra::Rotation2::new(turn_rad) * centre_m;
        for cell in 0..ACROSS * ACROSS {
            let share = |i: usize| 2.0 * i as f64 / (ACROSS - 1) as f64 - 1.0;
            let at_m = Vector2::new(share(cell % ACROSS), share(cell / ACROSS)) * furthest_m;
            let placement = Placement { scale, turn_rad, move_m: at_m - turned_m };
            let Some(share) = held_share(kind, mechanism, &placement) else { continue };
            if best.is_none_or(|(most, _)| share > most + 1e-9) {
                best = Some((share, placement));
            }
        }
    }
    best
}

/// Halfway between the extremes of a path.
fn middle(course: &Course) -> Vector2<f64> {
    let (mut least, mut most) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(-f64::INFINITY));
    for place in places(course, EVERY_M) {
        (least, most) = (least.inf(&place.p_m), most.sup(&place.p_m));
    }
    (least + most) * 0.5
}

/// Places along the course, both ends of each leg among them.
fn places(course: &Course, every_m: f64) -> impl Iterator<Item = Place> + '_ {
    course.legs.iter().flat_map(move |leg| {
        let parts = (leg.length_m() / every_m).ceil().max(1.0) as usize;
        (0..=parts).map(move |k| leg.at(leg.length_m() * k as f64 / parts as f64))
    })
}

/// Share of the course along which some brake holds it easily; `None` where the handle cannot go.
fn held_share(kind: CourseKind, mechanism: &dyn Mechanism, placement: &Placement) -> Option<f64> {
    let course = Course::new(kind, 1.0, placement);
    let (nearest_m, furthest_m) = mechanism.reach_m();
    let edge_m = EDGE * (furthest_m - nearest_m);
    let goes = |p_m: &Vector2<f64>| {
        let within = (nearest_m + edge_m..=furthest_m - edge_m).contains(&p_m.norm());
        let posture = mechanism.posture_at(&PlaneVector::new(p_m.x, p_m.y, 0.0)).ok();
        posture.filter(|posture| within && posture.margin >= LEAST_MARGIN)
    };
    let (mut held, mut all) = (0usize, 0usize);
    for place in places(&course, EVERY_M * placement.scale) {
        goes(&(place.p_m + place.normal * OUT_M))?;
        goes(&(place.p_m - place.normal * INTO_M))?;
        let posture = goes(&place.p_m)?;
        let strong_Nm = ActuatorVector::repeat(f64::INFINITY);
        let drag = least_drag_N(&posture, &strong_Nm, &place, 1.0);
        held += usize::from(drag.is_some_and(|drag| drag < EASY));
        all += 1;
    }
    Some(held as f64 / all as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::DeviceDefinition;

    #[test]
    fn courses_stand_as_they_are_written_where_they_fit() {
        for device in ["cho-2005", "cho-2005-unoptimised", "cho-2005-crossed"] {
            let device = DeviceDefinition::load(device).unwrap();
            for kind in CourseKind::ALL {
                let found = placement(kind, device.mechanism.as_ref());
                assert_eq!(found, Ok(Placement::USUAL), "{kind}");
            }
        }
    }

    /// Everywhere on the way, and a little beside it, the handle has a regular posture.
    #[test]
    fn every_course_finds_room_in_a_small_five_bar() {
        let device = DeviceDefinition::load("singh-brakes").unwrap();
        let mechanism = device.mechanism.as_ref();
        for kind in CourseKind::ALL {
            let found = placement(kind, mechanism).unwrap();
            assert!((0.15..=1.0).contains(&found.scale), "{kind}: {found:?}");
            let course = Course::new(kind, 1.0, &found);
            for place in places(&course, 1e-3) {
                for out_m in [-0.002, 0.0, 0.01] {
                    let p_m = place.p_m + place.normal * out_m;
                    let posture = mechanism.posture_at(&PlaneVector::new(p_m.x, p_m.y, 0.0));
                    assert!(posture.is_ok_and(|posture| posture.margin > 0.1), "{kind}");
                }
            }
        }
    }
}
