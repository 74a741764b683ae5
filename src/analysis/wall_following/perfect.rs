//! What no law of brakes can beat: the passive bound, and the same hand under a perfect law.
//!
//! A brake reacts along its reference force r, against sliding along `sigma t`; for each newton
//! that it gives the wall along the normal n it drags by `q = -(r . sigma t) / (r . n)`. Of all
//! mixtures of slipping brakes that carry the press N the one with the least drag is a single
//! brake: `D = N min { q_i > 0 }` (the closed form of a linear programme with one equality,
//! derived here); where that brake is too weak for the press, the next ones carry the rest, least
//! drag first. Where no q is positive, or all of them together are too weak, no brakes hold the
//! wall while the handle slides, and sticking cannot be avoided. A device whose brakes drag without being asked drags so much more.
//! More drag than D is always possible: where a soft force asks for more than D against the hand,
//! a perfect law gives exactly that, and where it asks for less, D.
//!
//! The perfect law lets the handle move on its path alone, dragged by exactly D; a hand that
//! has first to reach D stands until it has. In B; rigid walls; motors are not considered.

use nalgebra::Vector2;

use super::course::{Course, Leg, Place};
use super::hand::{CourseHand, DONE, HandSettings, SLIDING, leg_of};
use crate::analysis::smoothness::STUCK_M_PER_S;
use crate::config::DeviceDefinition;
use crate::device::HandPull;
use crate::mechanism::Posture;
use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector};

/// Step of plant and hand, as in the simulated device.
const STEP_S: f64 = 5e-4;

/// A brake that drags more per newton gives the wall nothing worth the name.
const STEEPEST: f64 = 30.0;

/// Most steps: the hand gives up long before.
const MAX_STEPS: usize = 200_000;

/// What a perfect law would have shown.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Perfect {
    /// Length of the slide.
    pub slide_s: f64,
    /// Time in which the handle stood.
    pub stuck_s: f64,
    /// Mean force of the hand along the wall.
    pub hand_mean_N: f64,
    /// Largest.
    pub hand_max_N: f64,
    /// Mean of the bound along the course under the full press, where there is one.
    pub bound_mean_N: f64,
    /// Its largest.
    pub bound_max_N: f64,
    /// Share of the course on which no brake holds the wall against sliding.
    pub impossible: f64,
    /// The hand came to the end.
    pub arrived: bool,
}

/// Least drag, newtons, against sliding along the tangent under a press; `None`: no brakes hold.
pub fn least_drag_N(
    posture: &Posture,
    most_Nm: &ActuatorVector,
    place: &Place,
    press_N: f64,
) -> Option<f64> {
    let mut brakes = [(f64::INFINITY, 0.0); MAX_ACTUATORS];
    for (i, brake) in brakes.iter_mut().enumerate() {
        let ray = Vector2::new(posture.reference[(0, i)], posture.reference[(1, i)]);
        let (along, out) = (ray.dot(&place.tangent), ray.dot(&place.normal));
        let drag = -along / out;
        if drag > 0.0 && drag < STEEPEST {
            *brake = (drag, most_Nm[i] * out.abs());
        }
    }
    brakes.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let (mut left_N, mut drag_N) = (press_N, 0.0);
    for (drag, most_N) in brakes.into_iter().take_while(|(drag, _)| drag.is_finite()) {
        let carried_N = most_N.min(left_N);
        (left_N, drag_N) = (left_N - carried_N, drag_N + drag * carried_N);
        if left_N <= 0.0 {
            return Some(drag_N);
        }
    }
    None
}

/// The bound at every millimetre of a course.
fn bounds(device: &DeviceDefinition, course: &Course, press_N: f64) -> Vec<Option<f64>> {
    let mut found = Vec::new();
    for leg in &course.legs {
        for k in 0..(leg.length_m() * 1e3) as usize {
            let place = leg.at(1e-3 * k as f64);
            let posture = device.mechanism.posture_at(&flat(place.p_m)).ok();
            let most_Nm = &device.actuators.max_torque_Nm;
            found.push(posture.and_then(|at| least_drag_N(&at, most_Nm, &place, press_N)));
        }
    }
    found
}

/// The experiment under a perfect law.
pub fn perfect(device: &DeviceDefinition, course: &Course, settings: HandSettings) -> Perfect {
    let mut hand = CourseHand::sliding(HandSettings { flesh: None, ..settings }, course);
    let mut world = World { device, leg: 0, s_m: 0.0, v_m_per_s: 0.0 };
    let (mut pull_N, mut stuck) = (Vec::new(), 0u32);
    let mut arrived = false;
    for _ in 0..MAX_STEPS {
        let place = course.legs[world.leg].at(world.s_m);
        let velocity = flat(place.tangent * world.v_m_per_s);
        let action = hand.act(&flat(place.p_m), &velocity, STEP_S);
        if action.buttons & DONE != 0 {
            let last = course.legs.len() - 1;
            arrived = world.leg == last && world.s_m > course.legs[last].length_m() - 2e-3;
            break;
        }
        if leg_of(action.buttons) != world.leg {
            let bend = course.legs[leg_of(action.buttons)].at(0.0).tangent.dot(&place.tangent);
            world.leg = leg_of(action.buttons);
            world.s_m = 0.0;
            world.v_m_per_s *= f64::from(u8::from(bend > 0.99));
            continue;
        }
        if action.buttons & SLIDING == 0 {
            world.v_m_per_s = 0.0;
            continue;
        }
        let force_N = action.F_hand_BH_N.xy();
        pull_N.push(force_N.dot(&place.tangent).abs());
        let soft_N = course.soft_N(&place.p_m, &velocity.xy()).dot(&place.tangent);
        world.step(&course.legs[world.leg], force_N, soft_N);
        stuck += u32::from(world.v_m_per_s.abs() < STUCK_M_PER_S);
    }
    let bounds = bounds(device, course, settings.press_N);
    let known: Vec<f64> = bounds.iter().flatten().copied().collect();
    Perfect {
        slide_s: pull_N.len() as f64 * STEP_S,
        stuck_s: f64::from(stuck) * STEP_S,
        hand_mean_N: mean(&pull_N),
        hand_max_N: pull_N.iter().copied().fold(0.0, f64::max),
        bound_mean_N: mean(&known),
        bound_max_N: known.iter().copied().fold(0.0, f64::max),
        impossible: 1.0 - known.len() as f64 / bounds.len().max(1) as f64,
        arrived,
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |sum, value| sum + value) / values.len().max(1) as f64
}

fn flat(p: Vector2<f64>) -> PlaneVector {
    PlaneVector::new(p.x, p.y, 0.0)
}

/// A handle that cannot leave its path.
struct World<'a> {
    device: &'a DeviceDefinition,
    leg: usize,
    s_m: f64,
    v_m_per_s: f64,
}

impl World<'_> {
    /// One step under the hand and a soft force that is asked for along the path.
    fn step(&mut self, leg: &Leg, force_N: Vector2<f64>, soft_N: f64) {
        let DeviceDefinition { mechanism, actuators, residual_Nm, .. } = self.device;
        let place = leg.at(self.s_m);
        let Ok(posture) = mechanism.posture_at(&flat(place.p_m)) else { return };
        let tangent = flat(place.tangent);
        let mass_kg = tangent.dot(&(posture.inertia * tangent));
        let turning_N = mass_kg * self.v_m_per_s.powi(2) * leg.curvature_per_m();
        let press_N = (turning_N - force_N.dot(&place.normal)).max(0.0);
        let free_m_per_s = self.v_m_per_s + force_N.dot(&place.tangent) * STEP_S / mass_kg;
        let way = Place { tangent: place.tangent * free_m_per_s.signum(), ..place };
        // Residual drag acts against every shaft's own rate; what it gives the wall is not
        // asked of the brakes again.
        let (mut press_N, mut drag_N) = (press_N, 0.0);
        for i in 0..mechanism.actuators() {
            let ray = Vector2::new(posture.reference[(0, i)], posture.reference[(1, i)]);
            let reaction = -ray * (ray.dot(&way.tangent).signum() * residual_Nm[i]);
            press_N -= reaction.dot(&way.normal);
            drag_N -= reaction.dot(&way.tangent);
        }
        let held_N = least_drag_N(&posture, &actuators.max_torque_Nm, &way, press_N.max(0.0));
        let loss_m_per_s = match held_N {
            Some(held_N) => {
                let asked_N = -soft_N * free_m_per_s.signum();
                (held_N + drag_N).max(asked_N) * STEP_S / mass_kg
            }
            None if press_N > 0.0 => f64::INFINITY,
            None => drag_N * STEP_S / mass_kg,
        };
        self.v_m_per_s = free_m_per_s.signum() * (free_m_per_s.abs() - loss_m_per_s).max(0.0);
        self.s_m += self.v_m_per_s * STEP_S;
    }
}

#[cfg(test)]
mod tests {
    use super::super::course::{CourseKind, Placement};
    use super::*;

    fn of(device: &str, kind: CourseKind) -> Perfect {
        let device = DeviceDefinition::load(device).unwrap();
        let mechanism = device.mechanism.as_ref();
        let course = Course::on(kind, 1e7, mechanism).unwrap();
        perfect(&device, &course, HandSettings::default())
    }

    /// Another simulation of the experiment has 0.26 s, 6.57 N and 15.5 N, under a bound of
    /// 5.31 N in the mean and 15.47 N at most.
    #[test]
    fn on_the_papers_wall_the_bound_and_its_hand_are_those_of_another_simulation() {
        let found = of("cho-2005", CourseKind::Straight);
        assert!(found.arrived && found.impossible == 0.0, "{found:?}");
        assert!((found.stuck_s - 0.26).abs() < 0.02, "{found:?}");
        assert!((found.hand_mean_N - 6.57).abs() < 0.1, "{found:?}");
        assert!((found.hand_max_N - 15.52).abs() < 0.1, "{found:?}");
        assert!((found.bound_mean_N - 5.31).abs() < 0.02, "{found:?}");
        assert!((found.bound_max_N - 15.47).abs() < 0.05, "{found:?}");
    }

    #[test]
    fn the_bound_on_the_papers_wall_is_a_sawtooth_whose_jumps_are_drops() {
        let device = DeviceDefinition::load("cho-2005").unwrap();
        let course = Course::new(CourseKind::Straight, 1e7, &Placement::USUAL);
        let drag_N: Vec<f64> = bounds(&device, &course, 10.0).into_iter().flatten().collect();
        let jumps = drag_N.windows(2).filter(|pair| pair[1] < pair[0] - 5.0).count();
        assert_eq!(jumps, 2);
        assert!(drag_N.windows(2).all(|pair| pair[1] < pair[0] + 0.5), "all jumps are drops");
    }

    #[test]
    fn a_perfect_law_with_four_brakes_passes_every_course_and_with_two_not() {
        for kind in CourseKind::ALL {
            let found = of("cho-2005", kind);
            assert!(found.arrived && found.impossible == 0.0, "{kind}: {found:?}");
            assert!(found.hand_mean_N > 0.5 && found.hand_max_N < 60.0, "{kind}: {found:?}");
        }
        let stuck = of("two-link", CourseKind::Straight);
        assert!(!stuck.arrived && stuck.impossible > 0.0, "{stuck:?}");
    }

    #[test]
    fn weak_brakes_share_the_press_and_then_none_hold() {
        let mut device = DeviceDefinition::load("cho-2005").unwrap();
        let course = Course::new(CourseKind::Straight, 1e7, &Placement::USUAL);
        let bound_N = |device: &DeviceDefinition| bounds(device, &course, 10.0);
        let strong = bound_N(&device);
        device.actuators.max_torque_Nm.fill(2.5);
        let weak = bound_N(&device);
        let pairs = || strong.iter().zip(&weak);
        assert!(pairs().all(|(strong, weak)| weak.is_none_or(|weak| Some(weak + 1e-9) >= *strong)));
        assert!(pairs().any(|(strong, weak)| weak.is_some_and(|weak| Some(weak - 0.5) > *strong)));
        device.actuators.max_torque_Nm.fill(0.1);
        let found = perfect(&device, &course, HandSettings::default());
        assert!(!found.arrived && found.impossible > 0.5, "{found:?}");
    }
}
