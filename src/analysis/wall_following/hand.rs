//! The experiment's hand on any course: approach, press, slide leg by leg.
//!
//! ```text
//! Approach ──pressing and stopped──▶ Slide ──end of the leg──▶ Turn ──▶ Slide (next leg) ... Done
//! ```
//!
//! As the hand of Cho 2005, section 8: it presses with `press_N` against the normal and pulls
//! through a spring on a target that moves along the leg, which is how a force builds up against
//! a handle that sticks; the target is never further ahead than the strongest pull needs. In an
//! inner corner it presses into both walls for a moment. Optionally the handle is not pulled by
//! the will itself but by a hand that has a mass and a soft palm ([`Flesh`]).
//!
//! Positions in B; forces are those on the handle. The hand knows the path, not the brakes.
//! `buttons` tell the watcher what it does: [`SLIDING`], [`DONE`], and from bit 8 the leg.

use nalgebra::Vector2;

use super::course::{Course, Leg, Place};
use crate::device::{Grip, HandAction, HandPull};
use crate::notation::PlaneVector;

/// The hand pulls along the leg.
pub const SLIDING: u32 = 1;
/// The hand is at the end of the course, or has given up.
pub const DONE: u32 = 2;
/// Where the number of the leg begins.
const LEG_SHIFT: u32 = 8;

/// Grip towards the wall while it is sought.
const SEEK_STIFFNESS_N_PER_M: f64 = 2_000.0;
const SEEK_DAMPING_N_S_PER_M: f64 = 60.0;

/// The handle counts as stopped by a wall after this long at full press and below this speed.
const STOPPED_S: f64 = 0.05;
const STOPPED_M_PER_S: f64 = 2e-3;

/// An approach that meets nothing for this long is given up.
const SEEK_S: f64 = 5.0;

/// A press gives way rather than chase a handle that yields.
const CHASE_M_PER_S: f64 = 0.4;

/// A leg is over this far before its end; in an inner corner the last bit is not reached.
const ENDS_M: f64 = 1e-3;

/// Time for which an inner corner is pressed.
const CORNER_S: f64 = 0.3;

/// A handle this far from its path is lost.
const LOST_M: f64 = 0.1;

/// What a hand is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flesh {
    /// Mass that moves with it.
    pub mass_kg: f64,
    /// Of palm and fingers.
    pub stiffness_N_per_m: f64,
    /// Of palm and fingers.
    pub damping_N_s_per_m: f64,
}

impl Default for Flesh {
    /// A hand and part of a forearm on a firm grip.
    fn default() -> Self {
        Self { mass_kg: 0.8, stiffness_N_per_m: 1_500.0, damping_N_s_per_m: 30.0 }
    }
}

/// What the hand does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandSettings {
    /// Force into the wall.
    pub press_N: f64,
    /// Speed towards the wall.
    pub approach_m_per_s: f64,
    /// Distance from which it comes.
    pub clearance_m: f64,
    /// Speed along it.
    pub slide_m_per_s: f64,
    /// The spring on the moving target.
    pub grip: Grip,
    /// `None`: the forces are prescribed.
    pub flesh: Option<Flesh>,
}

impl Default for HandSettings {
    fn default() -> Self {
        Self {
            press_N: 10.0,
            approach_m_per_s: 0.025,
            clearance_m: 0.015,
            slide_m_per_s: 0.1,
            // Under a perfect law this hand is stuck for 0.26 s on the paper's wall and pulls
            // with 6.5 N in the mean: a softer one lags, a stiffer one overshoots.
            grip: Grip { stiffness_N_per_m: 300.0, damping_N_s_per_m: 50.0, max_N: 60.0 },
            flesh: None,
        }
    }
}

/// The leg that buttons tell of.
pub fn leg_of(buttons: u32) -> usize {
    (buttons >> LEG_SHIFT) as usize
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    Approach { ahead_m: f64, pressed_s: f64, elapsed_s: f64 },
    Slide { leg: usize, s_m: f64, target_m: f64 },
    Turn { leg: usize, elapsed_s: f64 },
    Done,
}

/// A hand at work on a course.
#[derive(Clone, Debug)]
pub struct CourseHand {
    settings: HandSettings,
    legs: Vec<Leg>,
    phase: Phase,
    left_s: f64,
    /// Place and velocity of the flesh; `None` before it has the handle.
    flesh: Option<(Vector2<f64>, Vector2<f64>)>,
}

/// The handle as the hand feels it.
#[derive(Clone, Copy, Debug)]
struct Felt {
    p_m: Vector2<f64>,
    v_m_per_s: Vector2<f64>,
    dt_s: f64,
}

impl CourseHand {
    /// A hand that comes from free air; on each leg it slides for twice as long as it needs.
    pub fn new(settings: HandSettings, course: &Course) -> Self {
        let length_m: f64 = course.legs.iter().map(Leg::length_m).sum();
        Self {
            settings,
            legs: course.legs.clone(),
            phase: Phase::Approach { ahead_m: 0.0, pressed_s: 0.0, elapsed_s: 0.0 },
            left_s: 2.0 * length_m / settings.slide_m_per_s + CORNER_S * course.legs.len() as f64,
            flesh: None,
        }
    }

    /// The same hand at the moment it begins to slide.
    pub fn sliding(settings: HandSettings, course: &Course) -> Self {
        let phase = Phase::Slide { leg: 0, s_m: 0.0, target_m: 0.0 };
        Self { phase, ..Self::new(settings, course) }
    }

    /// How far along its leg the hand believes the handle to be.
    pub fn along_m(&self) -> Option<(usize, f64)> {
        match self.phase {
            Phase::Slide { leg, s_m, .. } => Some((leg, s_m)),
            _ => None,
        }
    }

    fn will(&mut self, felt: &Felt) -> (Vector2<f64>, u32) {
        self.advance(felt);
        match self.phase {
            Phase::Approach { .. } => (self.seek(felt), 0),
            Phase::Slide { leg, s_m, target_m } => {
                let place = self.legs[leg].at(s_m);
                let rate_m_per_s = self.settings.slide_m_per_s;
                let lag_m_per_s = rate_m_per_s - felt.v_m_per_s.dot(&place.tangent);
                let pull_N = pull(&self.settings.grip, target_m - s_m, lag_m_per_s);
                let force_N = place.tangent * pull_N + self.press(&place, felt);
                (force_N, SLIDING | (leg as u32) << LEG_SHIFT)
            }
            Phase::Turn { leg, .. } => {
                let here = self.legs[leg].at(self.legs[leg].length_m());
                let next = self.legs[leg + 1].at(0.0);
                (self.press(&here, felt) + self.press(&next, felt), (leg as u32) << LEG_SHIFT)
            }
            Phase::Done => (-30.0 * felt.v_m_per_s, DONE),
        }
    }

    fn advance(&mut self, felt: &Felt) {
        let HandSettings { slide_m_per_s, press_N, grip, .. } = self.settings;
        match &mut self.phase {
            Phase::Approach { ahead_m, pressed_s, elapsed_s } => {
                let Place { p_m, normal, .. } = self.legs[0].at(0.0);
                *elapsed_s += felt.dt_s;
                let into_m = (p_m - felt.p_m).dot(&normal);
                let longest_m = press_N / SEEK_STIFFNESS_N_PER_M;
                *ahead_m += self.settings.approach_m_per_s * felt.dt_s;
                *ahead_m = ahead_m.min(into_m + self.settings.clearance_m + longest_m);
                let full = *ahead_m - self.settings.clearance_m - into_m > 0.9 * longest_m;
                let stopped = felt.v_m_per_s.dot(&normal).abs() < STOPPED_M_PER_S;
                *pressed_s = if full && stopped { *pressed_s + felt.dt_s } else { 0.0 };
                if *pressed_s >= STOPPED_S {
                    self.phase = self.begin(0, &felt.p_m);
                } else if *elapsed_s > SEEK_S || into_m > LOST_M {
                    self.phase = Phase::Done;
                }
            }
            Phase::Slide { leg, s_m, target_m } => {
                let (leg, here) = (*leg, &self.legs[*leg]);
                *s_m = here.project(&felt.p_m, *s_m);
                let longest_m = grip.max_N / grip.stiffness_N_per_m;
                *target_m += slide_m_per_s * felt.dt_s;
                *target_m = target_m.clamp(*s_m - longest_m, *s_m + longest_m);
                self.left_s -= felt.dt_s;
                let lost = (felt.p_m - here.at(*s_m).p_m).norm() > LOST_M;
                if lost || self.left_s < 0.0 {
                    self.phase = Phase::Done;
                } else if *s_m >= here.length_m() - ENDS_M {
                    self.phase = self.leave(leg, &felt.p_m);
                }
            }
            Phase::Turn { leg, elapsed_s } => {
                *elapsed_s += felt.dt_s;
                let (next, over) = (*leg + 1, *elapsed_s >= CORNER_S);
                if over {
                    self.phase = self.begin(next, &felt.p_m);
                }
            }
            Phase::Done => {}
        }
    }

    fn begin(&self, leg: usize, p_m: &Vector2<f64>) -> Phase {
        let s_m = self.legs[leg].project(p_m, 0.0);
        Phase::Slide { leg, s_m, target_m: s_m }
    }

    /// What comes after a leg: an inner corner is pressed for a while, a bend is not, and over
    /// an edge the hand goes on at once.
    fn leave(&self, leg: usize, p_m: &Vector2<f64>) -> Phase {
        let Some(next) = self.legs.get(leg + 1) else { return Phase::Done };
        let (before, after) = (self.legs[leg].at(self.legs[leg].length_m()), next.at(0.0));
        let bend = before.tangent.dot(&after.tangent) > 0.99;
        if bend {
            // The target keeps its lead, so that the pull does not begin anew.
            let Phase::Slide { s_m, target_m, .. } = self.phase else { return Phase::Done };
            let on_m = next.project(p_m, 0.0);
            return Phase::Slide { leg: leg + 1, s_m: on_m, target_m: on_m + target_m - s_m };
        }
        let inner = before.tangent.dot(&after.normal) < 0.0;
        if inner { Phase::Turn { leg, elapsed_s: 0.0 } } else { self.begin(leg + 1, p_m) }
    }

    /// Towards the wall at the approach speed, held at the beginning along it.
    fn seek(&self, felt: &Felt) -> Vector2<f64> {
        let Phase::Approach { ahead_m, .. } = self.phase else { return Vector2::zeros() };
        let Place { p_m, tangent, normal } = self.legs[0].at(0.0);
        let HandSettings { clearance_m, approach_m_per_s, press_N, .. } = self.settings;
        let grip = Grip {
            stiffness_N_per_m: SEEK_STIFFNESS_N_PER_M,
            damping_N_s_per_m: SEEK_DAMPING_N_S_PER_M,
            max_N: press_N,
        };
        let away_m = felt.p_m - p_m;
        let into_m = -away_m.dot(&normal);
        let into_m_per_s = -felt.v_m_per_s.dot(&normal);
        let press = pull(&grip, ahead_m - clearance_m - into_m, approach_m_per_s - into_m_per_s);
        let hold = pull(&Grip::EASY, -away_m.dot(&tangent), -felt.v_m_per_s.dot(&tangent));
        tangent * hold - normal * press
    }

    /// Against the normal.
    fn press(&self, place: &Place, felt: &Felt) -> Vector2<f64> {
        let HandSettings { press_N, grip, .. } = self.settings;
        let into_m_per_s = -felt.v_m_per_s.dot(&place.normal);
        let force_N = grip.damping_N_s_per_m * (CHASE_M_PER_S - into_m_per_s);
        place.normal * -force_N.clamp(-press_N, press_N)
    }
}

fn pull(grip: &Grip, lag_m: f64, lag_m_per_s: f64) -> f64 {
    let force_N = grip.stiffness_N_per_m * lag_m + grip.damping_N_s_per_m * lag_m_per_s;
    force_N.clamp(-grip.max_N, grip.max_N)
}

impl HandPull for CourseHand {
    fn act(&mut self, p_BH: &PlaneVector, v_BH: &PlaneVector, dt_s: f64) -> HandAction {
        let handle = Felt { p_m: p_BH.xy(), v_m_per_s: v_BH.xy(), dt_s };
        let (force_N, buttons) = match self.settings.flesh {
            None => self.will(&handle),
            Some(flesh) => {
                let (p_m, v_m_per_s) = self.flesh.unwrap_or((handle.p_m, handle.v_m_per_s));
                let (will_N, buttons) = self.will(&Felt { p_m, v_m_per_s, dt_s });
                let grip_N = (p_m - handle.p_m) * flesh.stiffness_N_per_m
                    + (v_m_per_s - handle.v_m_per_s) * flesh.damping_N_s_per_m;
                let next = v_m_per_s + (will_N - grip_N) * (dt_s / flesh.mass_kg);
                self.flesh = Some((p_m + next * dt_s, next));
                (grip_N, buttons)
            }
        };
        HandAction { F_hand_BH_N: PlaneVector::new(force_N.x, force_N.y, 0.0), buttons }
    }
}
