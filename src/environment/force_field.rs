//! A local model of a force: a wrench, a spring and a damper about a point.
//!
//! `F = w + K (x0 - x) - B v` within a radius, fading over the last tenth of it so that its
//! edge is not felt as a step. What a controller computes slowly (a field around a molecule,
//! a magnet, a tool guide) is rendered here at the rate of the loop.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Part of the radius over which the field fades.
const EDGE: f64 = 0.1;

/// A wrench that varies with place and velocity, in W.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ForceField {
    /// Where the wrench is the stated one at rest.
    pub origin_W_m: Vector3<f64>,
    /// Force there, newtons.
    pub force_W_N: Vector3<f64>,
    /// Moment about the tool point, newton metres; the same everywhere.
    pub moment_W_Nm: Vector3<f64>,
    /// Force per displacement from the origin, N/m.
    pub stiffness_N_per_m: Matrix3<f64>,
    /// Force per velocity, N s/m.
    pub damping_Ns_per_m: Matrix3<f64>,
    /// Beyond it there is nothing, metres; infinite: everywhere.
    pub radius_m: f64,
}

impl ForceField {
    /// Stiffness and damping at a place, no less than they are in any direction.
    pub fn feel(&self, p_W_m: &Vector3<f64>) -> [f64; 2] {
        let inside = (p_W_m - self.origin_W_m).norm() < self.radius_m;
        if inside { [&self.stiffness_N_per_m, &self.damping_Ns_per_m].map(most) } else { [0.0; 2] }
    }

    /// The same where it is felt most.
    pub fn most_feel(&self) -> [f64; 2] {
        [&self.stiffness_N_per_m, &self.damping_Ns_per_m].map(most)
    }

    /// Force and moment at a place and velocity.
    pub fn at(&self, p_W_m: &Vector3<f64>, v_W_m_per_s: &Vector3<f64>) -> [Vector3<f64>; 2] {
        let away = p_W_m - self.origin_W_m;
        let inside_m = self.radius_m - away.norm();
        // An infinite radius has no edge; and inside a finite one the share is never NaN.
        let share = if inside_m >= EDGE * self.radius_m || inside_m.is_infinite() {
            1.0
        } else {
            (inside_m / (EDGE * self.radius_m)).max(0.0)
        };
        let force =
            self.force_W_N - self.stiffness_N_per_m * away - self.damping_Ns_per_m * v_W_m_per_s;
        [force * share, self.moment_W_Nm * share]
    }
}

/// No less than the largest singular value, and equal to it where the matrix is a number: the
/// root of the largest sums along columns and along rows.
fn most(matrix: &Matrix3<f64>) -> f64 {
    let sums = |matrix: Matrix3<f64>| matrix.abs().row_sum().max();
    (sums(*matrix) * sums(matrix.transpose())).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spring(radius_m: f64) -> ForceField {
        ForceField {
            origin_W_m: Vector3::new(0.1, 0.0, 0.0),
            force_W_N: Vector3::new(0.0, 1.0, 0.0),
            moment_W_Nm: Vector3::new(0.0, 0.0, 0.2),
            stiffness_N_per_m: Matrix3::from_diagonal(&Vector3::new(100.0, 50.0, 0.0)),
            damping_Ns_per_m: Matrix3::identity() * 2.0,
            radius_m,
        }
    }

    #[test]
    fn it_is_wrench_spring_and_damper() {
        let place = Vector3::new(0.12, 0.01, 0.0);
        let [force, moment] = spring(f64::INFINITY).at(&place, &Vector3::new(0.5, 0.0, 0.0));
        assert!((force - Vector3::new(-3.0, 0.5, 0.0)).norm() < 1e-12, "{force}");
        assert_eq!(moment, Vector3::new(0.0, 0.0, 0.2));
    }

    #[test]
    fn its_edge_is_no_step_and_beyond_there_is_nothing() {
        let field = spring(0.05);
        let norm_at =
            |x_m: f64| field.at(&Vector3::new(0.1 + x_m, 0.0, 0.0), &Vector3::zeros())[0].norm();
        let mut last = norm_at(0.0);
        for step in 1..=60 {
            let now = norm_at(f64::from(step) * 1e-3);
            assert!((now - last).abs() < 1.3, "{last} to {now} at {step} mm");
            last = now;
        }
        assert_eq!(last, 0.0);
    }

    #[test]
    fn an_edge_without_width_is_never_nan() {
        let [force, moment] = spring(0.0).at(&Vector3::new(0.1, 0.0, 0.0), &Vector3::zeros());
        assert!(force.iter().chain(moment.iter()).all(|part| part.is_finite()));
    }
}
