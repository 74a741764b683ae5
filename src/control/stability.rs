//! What surfaces may ask of motors: the share of their stiffness that feeds nothing to the handle.
//!
//! A sampled spring pushes late: by half a tick, because it is held for one, and by the lag of
//! the torque. With C the damping that the shafts give the handle in this posture, K the
//! stiffness of everything that is touched and B its damping, nothing is fed while
//! `K (T / 2 + lag) + B <= C` as quadratic forms of the handle's velocity (Colgate & Brown 1994
//! for one freedom without lag; a first-order lag counts as the delay that it is for slow motion;
//! several touches, arms and freedoms derived here). Brakes take energy and feed none.
//! In B at H, on the freedoms of the device; N s/m, N/m, seconds. Fields are not looked at here.

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

impl Asking<'_> {
    /// The share of the stiffness of all surfaces touched that the motors can give without
    /// feeding the handle; 1 where there is no motor, 0 where nothing is damped.
    pub fn held_share(&self, desired: &Desired) -> f64 {
        let Plan { actuators, mechanism, .. } = self.plan;
        let Some(delay_s) = actuators.delay_s(self.plan.tick_s()) else { return 1.0 };
        if desired.constraints().is_empty() {
            return 1.0;
        }
        let mut late = Matrix3::zeros();
        for constraint in desired.constraints() {
            self.add_touch(constraint, delay_s, &mut late);
        }
        let felt = actuators.handle_damping(&self.estimate.posture.reference, mechanism.freedoms());
        match most_fed(&late, &felt) {
            Some(fed) if fed <= 1.0 => 1.0,
            Some(fed) => 1.0 / fed,
            None => 0.0,
        }
    }

    /// Adds `K (T / 2 + lag) + B` of a touch, and the stiffness of the bristle of its friction.
    fn add_touch(&self, constraint: &Constraint, delay_s: f64, late: &mut Matrix3<f64>) {
        let Constraint { arm_W_m, stiffness_N_per_m, damping_Ns_per_m, .. } = constraint;
        let normal_W = &constraint.touch.normal_W;
        let mut add = |along_W: &Vector3<f64>, late_N_s_per_m: f64| {
            let (along, _) = self.planar(along_W, arm_W_m);
            *late += along * along.transpose() * (late_N_s_per_m * self.gain());
        };
        add(normal_W, stiffness_N_per_m * delay_s + damping_Ns_per_m);
        if constraint.bristle_N_per_m > 0.0 {
            let across_W = self.plan.mount.q_WB * Vector3::z();
            let along_W = across_W.cross(normal_W).try_normalize(1e-9).unwrap_or_default();
            add(&along_W, constraint.bristle_N_per_m * delay_s);
        }
    }
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
