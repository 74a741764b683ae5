//! What surfaces may ask of motors: the share of their stiffness that feeds nothing to the handle.
//!
//! A sampled spring pushes late: by half a tick, because it is held for one, and by the lag of
//! the torque. With C the damping that the shafts give the handle in this posture, K the
//! stiffness of everything that is touched and B its damping, nothing is fed while
//! `K (T / 2 + lag) + B <= C` as quadratic forms of the handle's velocity (Colgate & Brown 1994
//! for one freedom without lag; a first-order lag counts as the delay that it is for slow motion;
//! several touches, arms and freedoms derived here). Brakes take energy and feed none.
//! In B at H, on the freedoms of the device; N s/m, N/m, seconds. The scene's fields take their
//! part of the damping first; what a controller asks without a surface is not looked at here.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::Plan;
use super::desire::Asking;
use super::plan::Actuators;
use crate::actuation::ActuatorKind;
use crate::environment::{Constraint, Desired};
use crate::notation::{PlaneVector, ReferenceMatrix};

impl Actuators {
    /// How late the torque of the slowest motor is, seconds: its lag and half of a tick. `None`
    /// where there are only brakes.
    pub fn delay_s(&self, tick_s: f64) -> Option<f64> {
        let motors = self.kinds.iter().zip(&self.lag_s).zip(&self.max_torque_Nm);
        let lag_s = motors
            .filter(|((kind, _), most_Nm)| **kind == ActuatorKind::Motor && **most_Nm > 0.0)
            .map(|((_, lag_s), _)| *lag_s)
            .reduce(f64::max);
        lag_s.map(|lag_s| lag_s + 0.5 * tick_s)
    }

    /// Damping that the drag of the shafts gives the handle, about H. A freedom that the device
    /// has not is damped by 1 and coupled to nothing.
    pub fn handle_damping(&self, reference: &ReferenceMatrix, freedoms: usize) -> Matrix3<f64> {
        let drag = SMatrix::from_diagonal(&self.damping_N_m_s_per_rad);
        let felt = reference * drag * reference.transpose();
        if freedoms == 3 {
            return felt;
        }
        let mut planar = Matrix3::identity();
        planar.fixed_view_mut::<2, 2>(0, 0).copy_from(&felt.fixed_view::<2, 2>(0, 0));
        planar
    }
}

/// A bristle takes at most this share of what its direction has: a wall is worth more than the
/// stick of its friction.
const BRISTLE: f64 = 0.25;

impl Asking<'_> {
    /// Softens what is touched until the motors feed nothing to the handle; true where a normal
    /// force is less for it. First each touch by itself, its stiffness before its damping, so
    /// that one that is too stiff takes nothing from the others; then, where they help one
    /// another, all of them.
    pub fn soften(&self, desired: &mut Desired) -> bool {
        let Plan { actuators, mechanism, .. } = self.plan;
        let Some(delay_s) = actuators.delay_s(self.plan.tick_s()) else { return false };
        if desired.constraints().is_empty() {
            return false;
        }
        let drag = actuators.handle_damping(&self.estimate.posture.reference, mechanism.freedoms());
        let felt = drag - self.late_of_fields(desired.field_feel, delay_s);
        // Where some motion is not damped at all a wall cannot be stiff.
        let give = felt.cholesky().map(|root| root.inverse());
        let (mut late, mut softened) = (Matrix3::zeros(), false);
        for constraint in desired.constraints_mut() {
            let most = |along: &PlaneVector| {
                give.map_or(0.0, |give| 1.0 / along.dot(&(give * along)).max(f64::MIN_POSITIVE))
            };
            let along = self.planar(&constraint.touch.normal_W, &constraint.arm_W_m).0;
            let kept_N_s_per_m = soften(constraint, most(&along), delay_s, self.gain());
            late += along * along.transpose() * kept_N_s_per_m;
            let across = self.across(constraint);
            let wanted_N_s_per_m = constraint.bristle_N_per_m * delay_s * self.gain();
            let kept_N_s_per_m = wanted_N_s_per_m.min(BRISTLE * most(&across));
            constraint.bristle_share = share(kept_N_s_per_m, wanted_N_s_per_m);
            late += across * across.transpose() * kept_N_s_per_m;
        }
        let all = match most_fed(&late, &felt) {
            Some(fed) if fed <= ROUNDING => 1.0,
            Some(fed) => 1.0 / fed,
            None => 0.0,
        };
        for constraint in desired.constraints_mut() {
            constraint.held_N *= all;
            constraint.bristle_share *= all;
            softened |= constraint.held_N != constraint.demand_N;
        }
        softened
    }

    /// `K (T / 2 + lag) + B` of the scene's fields, which act at T.
    fn late_of_fields(
        &self,
        [stiffness_N_per_m, damping_Ns_per_m]: [f64; 2],
        delay_s: f64,
    ) -> Matrix3<f64> {
        let late_N_s_per_m = (stiffness_N_per_m * delay_s + damping_Ns_per_m) * self.gain();
        let q_WB = &self.plan.mount.q_WB;
        [Vector3::x(), Vector3::y()].iter().fold(Matrix3::zeros(), |sum, axis_B| {
            let (along, _) = self.planar(&(q_WB * axis_B), &Vector3::zeros());
            sum + along * along.transpose() * late_N_s_per_m
        })
    }

    /// Along the surface, in the plane.
    fn across(&self, constraint: &Constraint) -> PlaneVector {
        let across_W = self.plan.mount.q_WB * Vector3::z();
        let along_W = across_W.cross(&constraint.touch.normal_W);
        self.planar(&along_W.try_normalize(1e-9).unwrap_or_default(), &constraint.arm_W_m).0
    }
}

/// What is at the bound is not beyond it.
const ROUNDING: f64 = 1.0 + 1e-9;

fn share(kept: f64, wanted: f64) -> f64 {
    if kept < wanted { kept / wanted } else { 1.0 }
}

/// Keeps of the stiffness of a touch, and then of its damping, what feeds nothing under this
/// damping along its normal; returns what `K (T / 2 + lag) + B` is then.
fn soften(touched: &mut Constraint, most_N_s_per_m: f64, delay_s: f64, gain: f64) -> f64 {
    let stiff_N_s_per_m = touched.stiffness_N_per_m * delay_s * gain;
    let damped_N_s_per_m = touched.damping_Ns_per_m * gain;
    let kept_stiff = stiff_N_s_per_m.min(most_N_s_per_m);
    let kept_damped = damped_N_s_per_m.min(most_N_s_per_m - kept_stiff);
    let spring_N = touched.stiffness_N_per_m * touched.touch.depth_m;
    let damper_N = touched.damping_Ns_per_m * touched.approach_m_per_s;
    let (stiff, damped) =
        (share(kept_stiff, stiff_N_s_per_m), share(kept_damped, damped_N_s_per_m));
    if stiff < 1.0 || damped < 1.0 {
        touched.held_N = (spring_N * stiff + damper_N * damped).max(0.0); // a NaN becomes 0
    }
    kept_stiff + kept_damped
}

/// Largest ratio of `late` to `felt` over all motions; `None` where some motion is not damped at
/// all.
pub fn most_fed(late: &Matrix3<f64>, felt: &Matrix3<f64>) -> Option<f64> {
    let root = felt.cholesky()?.unpack();
    let half = root.solve_lower_triangular(late)?;
    let whole = root.solve_lower_triangular(&half.transpose())?;
    Some(largest_eigenvalue(&whole)).filter(|fed| fed.is_finite())
}

/// Of a symmetric matrix, in closed form: roots of a cubic by the cosine of a third of an angle
/// (O. K. Smith, "Eigenvalues of a symmetric 3 x 3 matrix", 1961).
fn largest_eigenvalue(matrix: &Matrix3<f64>) -> f64 {
    let mean = matrix.trace() / 3.0;
    let rest = matrix - Matrix3::from_diagonal_element(mean);
    let spread = (rest.norm_squared() / 6.0).sqrt();
    if spread == 0.0 {
        return mean;
    }
    let cosine = (0.5 * (rest / spread).determinant()).clamp(-1.0, 1.0);
    mean + 2.0 * spread * (cosine.acos() / 3.0).cos()
}

/// Smallest damping that a unit force on this arm from H feels in any direction, N s/m.
pub fn least_damping_N_s_per_m(felt: &Matrix3<f64>, arm_B_m: &PlaneVector) -> f64 {
    let mut late = Matrix3::zeros();
    for (x, y) in [(1.0, 0.0), (0.0, 1.0)] {
        let along = PlaneVector::new(x, y, arm_B_m.x * y - arm_B_m.y * x);
        late += along * along.transpose();
    }
    most_fed(&late, felt).map_or(0.0, |fed| 1.0 / fed)
}

#[cfg(test)]
mod tests;
