//! A slide while it is watched, and the figures of it.
//!
//! Everything is measured on the plant itself, behind encoders and force sensor, in B.
//!
//! | figure | how |
//! |---|---|
//! | stuck | time of the slide below 1 mm/s |
//! | stick events | how often it came to that; it ends above 4 mm/s |
//! | penetration | deepest since the hand first came near the wall, and while sliding |
//! | hand force | what the hand pulls along the wall while it slides |
//! | gamma | angle between the wall's normal and what the actuators give, while both press |
//! | rms jerk | of the velocity, second differences over 1 ms after two moving means of 20 ms |
//! | force step | largest change within 1 ms of what the actuators put on the handle |
//! | switches | changes, per second, of which brake gives the most normal force |

use super::course::Course;
use super::hand::{DONE, SLIDING, leg_of};
use crate::actuation::approximation_angle;
use crate::analysis::smoothness::{STUCK_M_PER_S, largest_step, root_mean, squared_jerks};
use crate::device::Truth;
use crate::mechanism::Mechanism;
use crate::notation::PlaneVector;

/// Above this a handle that was stuck slides again.
const FREED_M_PER_S: f64 = 4e-3;

/// A soft palm is at the end of the course while the handle is still this far before it.
const ARRIVED_M: f64 = 0.02;

/// Less force than this has no direction worth counting.
const LEAST_N: f64 = 0.5;

/// What came of a slide.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Figures {
    /// The hand came to the end of the course.
    pub arrived: bool,
    /// Length of the slide.
    pub slide_s: f64,
    /// Time stuck in it.
    pub stuck_s: f64,
    /// How often it got stuck.
    pub stick_events: u32,
    /// Deepest penetration, from first contact.
    pub penetration_mm: f64,
    /// Deepest penetration while sliding.
    pub sliding_mm: f64,
    /// Mean force of the hand along the wall.
    pub hand_mean_N: f64,
    /// Largest.
    pub hand_max_N: f64,
    /// Mean angle between the normal and the actuators' force.
    pub gamma_mean_deg: f64,
    /// Largest.
    pub gamma_max_deg: f64,
    /// Root mean square of the jerk.
    pub jerk_rms_m_per_s3: f64,
    /// Largest change of the force at the handle in one tick.
    pub step_max_N: f64,
    /// Changes of the leading brake.
    pub switches_per_s: f64,
}

impl Figures {
    /// Share of the slide in which the handle stood.
    pub fn stuck_share(&self) -> f64 {
        if self.slide_s > 0.0 { self.stuck_s / self.slide_s } else { 0.0 }
    }
}

/// One millisecond of a run, for pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Virtual time.
    pub t_s: f64,
    /// The handle.
    pub p_BH: PlaneVector,
    /// Its velocity.
    pub v_BH: PlaneVector,
    /// What the hand does.
    pub F_hand_BH_N: PlaneVector,
    /// What the actuators do.
    pub F_BH_N: PlaneVector,
    /// The wall's normal there.
    pub normal: PlaneVector,
    /// How deep it is in the wall.
    pub depth_m: f64,
    /// Angle between normal and actuators' force, where both are there.
    pub gamma_rad: Option<f64>,
    /// The hand slides.
    pub sliding: bool,
    /// The brake that gives the most normal force.
    pub leading: Option<usize>,
}

/// A stretch of sliding without a gap.
#[derive(Debug, Default)]
struct Stretch {
    leg: usize,
    velocity: Vec<PlaneVector>,
    force_N: Vec<PlaneVector>,
}

/// A slide so far.
#[derive(Debug, Default)]
pub(super) struct Watch {
    deepest_m: Option<f64>,
    sliding_m: Option<f64>,
    stretches: Vec<Stretch>,
    pull_N: Vec<f64>,
    gamma_rad: Vec<f64>,
    stuck_ticks: u32,
    stick_events: u32,
    stuck: bool,
    leading: Option<usize>,
    switches: u32,
    was_sliding: bool,
    last: Option<(usize, f64)>,
}

impl Watch {
    /// True when the hand is at the end or has given up.
    pub fn over(&self, truth: &Truth) -> bool {
        truth.hand.buttons & DONE != 0
    }

    /// Takes one tick.
    pub fn see(
        &mut self,
        truth: &Truth,
        mechanism: &dyn Mechanism,
        course: &Course,
        t_s: f64,
    ) -> Moment {
        let depth_m = course.depth_m(&truth.p_BH);
        let leg_number = leg_of(truth.hand.buttons).min(course.legs.len() - 1);
        let leg = &course.legs[leg_number];
        let near_m = self.last.filter(|(last, _)| *last == leg_number).map_or(0.0, |(_, s)| s);
        let s_m = leg.project(&truth.p_BH.xy(), near_m);
        let place = leg.at(s_m);
        let normal = PlaneVector::new(place.normal.x, place.normal.y, 0.0);
        let tangent = PlaneVector::new(place.tangent.x, place.tangent.y, 0.0);
        let posture = mechanism.posture_at(&truth.p_BH).ok();
        let reference = posture.map(|posture| posture.reference).unwrap_or_default();
        let mut force_N = reference * truth.torque_Nm;
        force_N.z = 0.0;
        let strong = force_N.norm() > LEAST_N;
        let gamma_rad = approximation_angle(&normal, &force_N).filter(|_| strong);
        let normal_N = reference.tr_mul(&normal).component_mul(&truth.torque_Nm).abs();
        let leading = (normal_N.max() > 0.1).then(|| normal_N.imax());
        let sliding = truth.hand.buttons & SLIDING != 0;
        self.deepest_m = Some(self.deepest_m.map_or(depth_m, |deepest_m| deepest_m.max(depth_m)));
        if sliding {
            self.last = Some((leg_number, s_m));
            self.sliding_m = Some(self.sliding_m.map_or(depth_m, |most_m| most_m.max(depth_m)));
            self.pull_N.push(truth.hand.F_hand_BH_N.dot(&tangent).abs());
            self.gamma_rad.extend(gamma_rad);
            self.count_sticking(truth.v_BH.dot(&tangent).abs());
            self.switches += u32::from(leading != self.leading);
            self.leading = leading;
            self.stretch(leg_number, truth.v_BH, force_N);
        }
        self.was_sliding = sliding;
        Moment {
            t_s,
            p_BH: truth.p_BH,
            v_BH: truth.v_BH,
            F_hand_BH_N: truth.hand.F_hand_BH_N,
            F_BH_N: force_N,
            normal,
            depth_m,
            gamma_rad,
            sliding,
            leading,
        }
    }

    fn count_sticking(&mut self, speed_m_per_s: f64) {
        let slow = speed_m_per_s < STUCK_M_PER_S;
        self.stuck_ticks += u32::from(slow);
        self.stick_events += u32::from(slow && !self.stuck);
        self.stuck = slow || (self.stuck && speed_m_per_s < FREED_M_PER_S);
    }

    fn stretch(&mut self, leg: usize, velocity: PlaneVector, force_N: PlaneVector) {
        if !self.was_sliding || self.stretches.last().is_none_or(|stretch| stretch.leg != leg) {
            self.stretches.push(Stretch { leg, ..Stretch::default() });
        }
        if let Some(stretch) = self.stretches.last_mut() {
            stretch.velocity.push(velocity);
            stretch.force_N.push(force_N);
        }
    }

    /// The figures of what was seen.
    pub fn figures(&self, course: &Course, tick_s: f64) -> Figures {
        let slide_s = self.pull_N.len() as f64 * tick_s;
        let jerks: Vec<f64> = self
            .stretches
            .iter()
            .flat_map(|stretch| squared_jerks(&stretch.velocity, tick_s))
            .collect();
        let steps_N = self.stretches.iter().map(|stretch| largest_step(&stretch.force_N));
        let last = course.legs.len() - 1;
        let end_m = course.legs[last].length_m() - ARRIVED_M;
        Figures {
            arrived: self.last.is_some_and(|(leg, s_m)| leg == last && s_m > end_m),
            slide_s,
            stuck_s: f64::from(self.stuck_ticks) * tick_s,
            stick_events: self.stick_events,
            penetration_mm: 1e3 * self.deepest_m.unwrap_or(0.0),
            sliding_mm: 1e3 * self.sliding_m.unwrap_or(0.0),
            hand_mean_N: mean(&self.pull_N),
            hand_max_N: self.pull_N.iter().copied().fold(0.0, f64::max),
            gamma_mean_deg: mean(&self.gamma_rad).to_degrees(),
            gamma_max_deg: self.gamma_rad.iter().copied().fold(0.0, f64::max).to_degrees(),
            jerk_rms_m_per_s3: root_mean(&jerks),
            step_max_N: steps_N.fold(0.0, f64::max),
            switches_per_s: f64::from(self.switches) / slide_s.max(tick_s),
        }
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |sum, value| sum + value) / values.len().max(1) as f64
}
