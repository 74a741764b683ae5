//! The stiffest wall that a motor device can render, from the drag of its shafts.
//!
//! A sampled spring feeds energy to what bounces on it: held for a tick it pushes, on the
//! mean, half a tick late, and a motor's lag comes on top. With b the damping at the handle it
//! is passive for `K <= b / (T / 2 + lag)` (Colgate & Brown 1994 without lag; a first-order
//! lag counts as the delay that it is for slow motion, derived here). Brakes take energy and
//! never feed any: a device of brakes alone has no such bound. N s/m, N/m, seconds.

use nalgebra::SMatrix;
use std::f64::consts::TAU;

use crate::actuation::ActuatorKind;
use crate::control::Actuators;
use crate::mechanism::Mechanism;
use crate::notation::{ActuatorVector, PlaneVector};

/// The grid over the reach: distances from its inner to its outer edge, bearings, turns.
const DISTANCES: usize = 12;
const BEARINGS: usize = 48;
const TURNS: usize = 5;

/// The ends of the reach are singular, and the simulated end stop keeps this share off.
const EDGE: f64 = 0.05;

/// The smallest damping that a translation of the handle feels anywhere in the reach.
pub(super) fn least_damping_N_s_per_m(
    mechanism: &dyn Mechanism,
    damping_N_m_s_per_rad: &ActuatorVector,
) -> f64 {
    let (nearest_m, furthest_m) = mechanism.reach_m();
    let turns = if mechanism.freedoms() == 3 { TURNS } else { 1 };
    let mut least = f64::INFINITY;
    for (distance, bearing, turn) in grid(turns) {
        let share = EDGE + (1.0 - 2.0 * EDGE) * distance;
        let r_m = nearest_m + share * (furthest_m - nearest_m);
        let (sin, cos) = (TAU * bearing).sin_cos();
        let phi_rad = (1.0 - EDGE) * turn * mechanism.turn_rad();
        let p_BH = PlaneVector::new(r_m * cos, r_m * sin, phi_rad);
        // Where a working mode has no regular posture the handle does not get to.
        let Ok(posture) = mechanism.posture_at(&p_BH) else { continue };
        let R = posture.reference.fixed_rows::<2>(0);
        let felt = R * SMatrix::from_diagonal(damping_N_m_s_per_rad) * R.transpose();
        least = least.min(felt.symmetric_eigenvalues().min());
    }
    if least.is_finite() { least.max(0.0) } else { 0.0 }
}

/// Shares of distance and of a turn around, and turns from -1 to 1.
fn grid(turns: usize) -> impl Iterator<Item = (f64, f64, f64)> {
    let share = |i: usize, of: usize| i as f64 / (of - 1).max(1) as f64;
    (0..DISTANCES * BEARINGS * turns).map(move |i| {
        let (place, turn) = (i / turns, i % turns);
        let turn = if turns > 1 { 2.0 * share(turn, turns) - 1.0 } else { 0.0 };
        (share(place / BEARINGS, DISTANCES), (place % BEARINGS) as f64 / BEARINGS as f64, turn)
    })
}

/// The stiffness up to which a wall is passive at this damping.
pub(super) fn largest_N_per_m(
    actuators: &Actuators,
    tick_s: f64,
    least_damping_N_s_per_m: f64,
) -> f64 {
    let motors = actuators.kinds.iter().zip(&actuators.lag_s).zip(&actuators.max_torque_Nm);
    let lag_s = motors
        .filter(|((kind, _), most_Nm)| **kind == ActuatorKind::Motor && **most_Nm > 0.0)
        .map(|((_, lag_s), _)| *lag_s)
        .reduce(f64::max);
    lag_s.map_or(f64::INFINITY, |lag_s| least_damping_N_s_per_m / (0.5 * tick_s + lag_s))
}
