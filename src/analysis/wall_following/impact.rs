//! How deep a handle gets into a wall that nobody knew of, whatever the law: the brakes' lag.
//!
//! The handle meets the wall with a speed along the normal, under the hand's press. From the first
//! tick that can show it on every brake is commanded as much as it has; torques follow with
//! their lag, and act as implicit brakes do. What such a handle goes in until it stops, no law of
//! these brakes can better that does not brake in free air. In B; metres, seconds.

use crate::actuation::nearest_in_box;
use crate::mechanism::Mechanism;
use crate::notation::{ActuatorVector, PlaneVector};

/// Step of the simulation; the brakes are told at the end of a tick.
const STEP_S: f64 = 1e-4;
const TICK_S: f64 = 1e-3;

/// Longer than any impact.
const MAX_STEPS: usize = 10_000;

/// What meets the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impact {
    /// Where.
    pub p_BH: PlaneVector,
    /// Out of the wall.
    pub normal: PlaneVector,
    /// Into it.
    pub speed_m_per_s: f64,
    /// Of the hand, into it.
    pub press_N: f64,
}

/// The least depth; `None` where there is no posture or the brakes never stop the handle.
pub fn least_depth_m(
    mechanism: &dyn Mechanism,
    max_torque_Nm: &ActuatorVector,
    lag_s: f64,
    impact: &Impact,
) -> Option<f64> {
    let posture = mechanism.posture_at(&impact.p_BH).ok()?;
    let inertia = posture.inertia.fixed_view::<2, 2>(0, 0).into_owned();
    let factor = inertia.cholesky()?;
    let l = factor.l();
    let mut matrix = posture.reference;
    matrix.row_mut(2).fill(0.0);
    for mut column in matrix.column_iter_mut() {
        let part = l.solve_lower_triangular(&column.xy()).unwrap_or_default();
        (column.x, column.y) = (part.x, part.y);
    }
    let normal = impact.normal.xy();
    let mut velocity = normal * -impact.speed_m_per_s;
    let (mut depth_m, mut told_s) = (0.0, -TICK_S);
    for _ in 0..MAX_STEPS {
        let share = match told_s {
            s if s < 0.0 => 0.0,
            _ if lag_s <= 0.0 => 1.0,
            s => 1.0 - (-s / lag_s).exp(),
        };
        let capacity_Nm = max_torque_Nm * share;
        let free = velocity + factor.solve(&(normal * -impact.press_N)) * STEP_S;
        let target = l.transpose() * free * (-1.0 / STEP_S);
        let target = PlaneVector::new(target.x, target.y, 0.0);
        let count = mechanism.actuators();
        let torque_Nm = nearest_in_box(&matrix, &target, &-capacity_Nm, &capacity_Nm, count);
        let reaction_N = (posture.reference * torque_Nm).xy();
        velocity = free + factor.solve(&reaction_N) * STEP_S;
        let into_m_per_s = -velocity.dot(&normal);
        if into_m_per_s <= 1e-6 {
            return Some(depth_m);
        }
        depth_m += into_m_per_s * STEP_S;
        told_s += STEP_S;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::DeviceDefinition;

    fn depth_mm(lag_s: f64, speed_m_per_s: f64, press_N: f64) -> f64 {
        let device = DeviceDefinition::load("cho-2005").unwrap();
        let impact = Impact {
            p_BH: PlaneVector::new(0.35, 0.1, 0.0),
            normal: PlaneVector::new(0.0, 1.0, 0.0),
            speed_m_per_s,
            press_N,
        };
        let max_Nm = device.actuators.max_torque_Nm;
        1e3 * least_depth_m(device.mechanism.as_ref(), &max_Nm, lag_s, &impact).unwrap()
    }

    /// Without lag the handle flies for a tick and stops; with lag the brakes' force grows as
    /// t / lag at first, so that without a press the depth goes with the square root of lag
    /// times speed cubed.
    #[test]
    fn depth_is_a_tick_of_flight_and_then_the_lag() {
        assert!((depth_mm(0.0, 0.1, 0.0) - 0.1).abs() < 0.06);
        let beyond = |lag_s, speed| depth_mm(lag_s, speed, 0.0) - 1e3 * speed * TICK_S;
        let (short, long) = (beyond(0.01, 0.1), beyond(0.04, 0.1));
        assert!((1.8..2.3).contains(&(long / short)), "{short} {long}");
        let faster = beyond(0.04, 0.4) / long;
        assert!((7.0..9.5).contains(&faster), "{faster}");
        assert!(depth_mm(0.03, 0.1, 10.0) > depth_mm(0.03, 0.1, 0.0));
    }
}
