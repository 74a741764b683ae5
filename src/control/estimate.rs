//! Counts become angles, rates, signs, and the handle's pose and velocity.
//!
//! Rates come from *first-order adaptive windowing* (Janabi-Sharifi, Hayward & Chen 2000):
//! the longest window in which a straight line stays within one count of every sample. It
//! follows fast motion with a short window and slow motion with a long one, needs no model
//! and adds no overshoot. A sign counts as known only when the window moved
//! [`SIGN_COUNTS`] one way; below that the shaft is "at rest" and a brake may act both ways.
//!
//! Every shaft has an encoder, so a loop linkage measures its pose more than once. The first
//! shafts give the posture; the redundant ones correct it by one least-squares step,
//! `(R R^T)^-1 R e`, and their disagreement `e` is watched as a fault source.

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use super::homing::Homing;
use super::{Fault, Plan, Sample};
use crate::actuation::ShaftMotion;
use crate::mechanism::{KinematicsError, Posture};
use crate::notation::{ActuatorVector, MAX_ACTUATORS, PlaneVector, ReferenceMatrix};

/// Samples of the longest velocity window, which spans 15 ticks. 15 ms at 1 kHz: half of the
/// shortest time constant of a hand's voluntary motion (about 5 Hz), and two counts in it are
/// 13 mrad/s at 65,536 counts.
const WINDOW: usize = 16;

/// Counts that a window must move one way before its sign is trusted: one is quantisation.
const SIGN_COUNTS: i64 = 2;

/// Ticks in a row for which the encoders must disagree before it is a fault.
const CLOSURE_TICKS: u32 = 10;

/// What is known of the device in one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Posture at the measured angles.
    pub posture: Posture,
    /// Handle in B, corrected by the redundant encoders.
    pub p_BH: PlaneVector,
    /// Velocity of the handle in B.
    pub v_BH: PlaneVector,
    /// Shaft angles.
    pub shaft_rad: ActuatorVector,
    /// Shaft rates.
    pub shaft_rad_per_s: ActuatorVector,
    /// Which way each shaft turns.
    pub motion: [ShaftMotion; MAX_ACTUATORS],
    /// What the hand puts on the handle, in B; `None` without a sensor.
    pub F_hand_BH_N: Option<PlaneVector>,
}

impl Estimate {
    /// True while no shaft is known to turn.
    pub fn is_at_rest(&self) -> bool {
        self.motion.iter().all(|motion| *motion == ShaftMotion::Rest)
    }
}

/// Remembers what the estimate needs of earlier ticks.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Estimator {
    /// Newest first.
    counts: [[i64; MAX_ACTUATORS]; WINDOW],
    times_ns: [u64; WINDOW],
    filled: usize,
    closure_ticks: u32,
    homing: Homing,
}

impl Estimator {
    /// The estimate from one more sample, or the fault that it reveals.
    pub fn update(&mut self, sample: &Sample, plan: &Plan, now_ns: u64) -> Result<Estimate, Fault> {
        if sample.F_hand_BH_N.is_some_and(|force| !force.iter().all(|part| part.is_finite())) {
            return Err(Fault::NotFinite);
        }
        let actuators = plan.mechanism.actuators();
        let rad_per_count = plan.actuators.counts_per_revolution.map(|n| std::f64::consts::TAU / n);
        let shaft_rad = ActuatorVector::from_fn(|i, _| match i < actuators {
            true => self.homing.shaft_rad(plan, i, sample.counts[i], rad_per_count[i]),
            false => 0.0,
        });
        // What fits no posture is not remembered either: it would spoil the rates for a while.
        let posture = plan.mechanism.posture_from_shafts(&shaft_rad).map_err(fault_of)?;
        self.remember(sample, now_ns);
        let mut shaft_rad_per_s = ActuatorVector::zeros();
        let mut motion = [ShaftMotion::Rest; MAX_ACTUATORS];
        for i in 0..actuators {
            let (counts_per_s, direction) = self.rate(i);
            shaft_rad_per_s[i] = counts_per_s * rad_per_count[i];
            motion[i] = direction;
        }
        self.watch_closure(&posture, plan)?;
        let correction = handle_from_shafts(&posture.reference, plan, &posture.closure_rad);
        Ok(Estimate {
            p_BH: posture.p_BH + correction,
            v_BH: handle_from_shafts(&posture.reference, plan, &shaft_rad_per_s),
            posture,
            shaft_rad,
            shaft_rad_per_s,
            motion,
            F_hand_BH_N: sample.F_hand_BH_N,
        })
    }

    /// What is known of where the encoders count from.
    pub(super) fn homing_mut(&mut self) -> &mut Homing {
        &mut self.homing
    }

    /// True when counts tell where the handle is.
    pub fn is_homed(&self, plan: &Plan) -> bool {
        self.homing.is_done(plan)
    }

    /// False for what no update leaves behind.
    pub fn is_sound(&self) -> bool {
        self.filled <= WINDOW
    }

    /// Forgets the past: after a fault the device may be somewhere else.
    pub fn reset(&mut self) {
        self.filled = 0;
        self.closure_ticks = 0;
    }

    fn remember(&mut self, sample: &Sample, now_ns: u64) {
        self.counts.copy_within(0..WINDOW - 1, 1);
        self.times_ns.copy_within(0..WINDOW - 1, 1);
        self.counts[0] = sample.counts;
        self.times_ns[0] = now_ns;
        self.filled = (self.filled + 1).min(WINDOW);
    }

    /// Counts per second of one shaft, and its direction.
    fn rate(&self, shaft: usize) -> (f64, ShaftMotion) {
        let newest = self.counts[0][shaft];
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        let (mut counts_per_s, mut moved) = (0.0, 0);
        let (mut rising, mut falling) = (true, true);
        for back in 1..self.filled {
            let seconds = self.times_ns[0].saturating_sub(self.times_ns[back]) as f64 * 1e-9;
            if seconds <= 0.0 {
                break;
            }
            let step = newest.saturating_sub(self.counts[back][shaft]);
            let slope = step as f64 / seconds;
            if slope < low || slope > high {
                break;
            }
            let later = self.counts[back - 1][shaft];
            rising &= later >= self.counts[back][shaft];
            falling &= later <= self.counts[back][shaft];
            (counts_per_s, moved) = (slope, step);
            low = low.max((step as f64 - 1.0) / seconds);
            high = high.min((step as f64 + 1.0) / seconds);
        }
        let direction = match moved {
            m if m >= SIGN_COUNTS && rising => ShaftMotion::Forward,
            m if m <= -SIGN_COUNTS && falling => ShaftMotion::Backward,
            _ => ShaftMotion::Rest,
        };
        (counts_per_s, direction)
    }

    fn watch_closure(&mut self, posture: &Posture, plan: &Plan) -> Result<(), Fault> {
        let apart = posture.closure_rad.amax() > plan.guards.closure_limit_rad;
        self.closure_ticks = if apart { self.closure_ticks.saturating_add(1) } else { 0 };
        if self.closure_ticks >= CLOSURE_TICKS { Err(Fault::Closure) } else { Ok(()) }
    }
}

fn fault_of(error: KinematicsError) -> Fault {
    match error {
        KinematicsError::Unreachable { .. } => Fault::Unreachable,
        KinematicsError::Singular { .. } => Fault::Singular,
        KinematicsError::NotFinite => Fault::NotFinite,
    }
}

/// Least-squares handle motion of small shaft motions, `(R R^T)^-1 R w`; zero where the
/// posture does not determine it.
fn handle_from_shafts(
    reference: &ReferenceMatrix,
    plan: &Plan,
    shafts: &ActuatorVector,
) -> PlaneVector {
    let sum = reference * shafts;
    let gram = reference * reference.transpose();
    if plan.mechanism.freedoms() == 2 {
        let block: Matrix2<f64> = gram.fixed_view::<2, 2>(0, 0).into_owned();
        let handle = block.try_inverse().unwrap_or_default() * Vector2::new(sum.x, sum.y);
        PlaneVector::new(handle.x, handle.y, 0.0)
    } else {
        gram.try_inverse().unwrap_or_default() * sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn feed(estimator: &mut Estimator, counts_at: impl Fn(f64) -> i64, ticks: u64) {
        for tick in 0..ticks {
            let mut sample = Sample::default();
            sample.counts[0] = counts_at(tick as f64 * 1e-3);
            estimator.remember(&sample, tick * 1_000_000);
        }
    }

    #[test]
    fn a_steady_rate_is_found_within_a_count_per_window() {
        for counts_per_s in [-5000.0, -700.0, 130.0, 333.0, 20_000.0] {
            let mut estimator = Estimator::default();
            feed(&mut estimator, |t| (counts_per_s * t).floor() as i64, 40);
            let (rate, motion) = estimator.rate(0);
            assert!((rate - counts_per_s).abs() <= 1.0 / 0.015 + 1e-9, "{rate} for {counts_per_s}");
            let expected =
                if counts_per_s > 0.0 { ShaftMotion::Forward } else { ShaftMotion::Backward };
            if counts_per_s.abs() > 3.0 / 0.015 {
                assert_eq!(motion, expected);
            }
        }
    }

    #[test]
    fn a_count_that_flickers_is_rest() {
        let mut estimator = Estimator::default();
        feed(&mut estimator, |t| ((t * 1e3) as i64) % 2, 40);
        assert_eq!(estimator.rate(0).1, ShaftMotion::Rest);
    }

    #[test]
    fn a_reversal_is_followed_within_a_few_ticks() {
        let mut estimator = Estimator::default();
        feed(
            &mut estimator,
            |t| {
                if t < 0.030 { (4000.0 * t) as i64 } else { (240.0 - 4000.0 * t) as i64 }
            },
            34,
        );
        let (rate, motion) = estimator.rate(0);
        assert!(rate < -2000.0, "{rate}");
        assert_eq!(motion, ShaftMotion::Backward);
    }

    #[test]
    fn one_sample_has_no_rate() {
        let mut estimator = Estimator::default();
        feed(&mut estimator, |_| 7, 1);
        assert_eq!(estimator.rate(0), (0.0, ShaftMotion::Rest));
    }
}
