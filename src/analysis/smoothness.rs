//! Measures of motion and force that experiments and recordings share.
//!
//! Velocities in m/s, forces in N, one per tick. Jerk is that of the velocity after two moving
//! means, by second differences: what is left is below about 20 Hz. Without the means it
//! would be that of single ticks.

use crate::notation::PlaneVector;

/// Below this a handle does not slide.
pub const STUCK_M_PER_S: f64 = 1e-3;

/// Length of each of the two moving means.
const SMOOTH_TICKS: usize = 20;

/// Squares of the jerks of one stretch without a gap; none where it is too short.
pub fn squared_jerks(velocity: &[PlaneVector], tick_s: f64) -> Vec<f64> {
    let mean = |all: &[PlaneVector]| -> Vec<PlaneVector> {
        let size = SMOOTH_TICKS as f64;
        all.windows(SMOOTH_TICKS).map(|some| some.iter().sum::<PlaneVector>() / size).collect()
    };
    let smooth = mean(&mean(velocity));
    let jerk = |v: &[PlaneVector]| (v[0] - 2.0 * v[1] + v[2]) / (tick_s * tick_s);
    smooth.windows(3).map(|v| jerk(v).norm_squared()).collect()
}

/// Root of the mean of squares; zero of none.
pub fn root_mean(squares: &[f64]) -> f64 {
    let sum = squares.iter().fold(0.0, |sum, square| sum + square);
    (sum / squares.len().max(1) as f64).sqrt()
}

/// Largest change from one tick to the next.
pub fn largest_step(force_N: &[PlaneVector]) -> f64 {
    force_N.windows(2).map(|pair| (pair[1] - pair[0]).norm()).fold(0.0, f64::max)
}
