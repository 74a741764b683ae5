//! What a surface is made of.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// The feel of a surface; all zero is a surface that cannot be felt.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Material {
    /// Force per depth, N/m.
    pub stiffness_N_per_m: f64,
    /// Force per speed of approach, N s/m.
    pub damping_Ns_per_m: f64,
    /// Coulomb coefficient that has to be overcome before the tool slips, at least the
    /// kinetic one.
    pub static_friction: f64,
    /// Coulomb coefficient while it slips. Both 0: no friction.
    pub kinetic_friction: f64,
    /// Velocity of the surface itself, in W: a conveyor that stays where it is. What counts
    /// in damping and friction is the tool's velocity relative to it.
    pub surface_velocity_W_m_per_s: Vector3<f64>,
}

impl Material {
    /// The same with one coefficient of friction, at rest and while it slips.
    #[must_use]
    pub fn with_friction(self, coefficient: f64) -> Self {
        Self { static_friction: coefficient, kinetic_friction: coefficient, ..self }
    }

    /// The coefficient that its friction can reach.
    pub fn most_friction(&self) -> f64 {
        self.static_friction.max(self.kinetic_friction)
    }

    /// Normal force asked for at a depth and velocity of the tool, newtons, never negative
    /// and always a number.
    pub fn demand_N(
        &self,
        depth_m: f64,
        normal_W: &Vector3<f64>,
        v_W_m_per_s: &Vector3<f64>,
    ) -> f64 {
        let approach_m_per_s = self.approach_m_per_s(normal_W, v_W_m_per_s);
        let spring_N = self.stiffness_N_per_m * depth_m;
        let damper_N = self.damping_Ns_per_m * approach_m_per_s;
        (spring_N + damper_N).max(0.0) // a NaN becomes 0
    }

    /// How fast the tool goes in.
    pub fn approach_m_per_s(&self, normal_W: &Vector3<f64>, v_W_m_per_s: &Vector3<f64>) -> f64 {
        (self.surface_velocity_W_m_per_s - v_W_m_per_s).dot(normal_W)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NORMAL_W: Vector3<f64> = Vector3::new(-1.0, 0.0, 0.0);

    fn soft() -> Material {
        Material { stiffness_N_per_m: 100.0, damping_Ns_per_m: 10.0, ..Material::default() }
    }

    #[test]
    fn damping_resists_the_approach_and_never_pulls() {
        let demand_N = |x| soft().demand_N(0.001, &NORMAL_W, &Vector3::new(x, 0.0, 0.0));
        assert!((demand_N(0.1) - 1.1).abs() < 1e-12);
        assert_eq!(demand_N(-5.0), 0.0);
        assert_eq!(demand_N(f64::NAN), 0.0);
    }

    #[test]
    fn what_counts_is_the_velocity_relative_to_the_surface() {
        let towards = Material { surface_velocity_W_m_per_s: 0.2 * NORMAL_W, ..soft() };
        let at_rest = towards.demand_N(0.001, &NORMAL_W, &Vector3::zeros());
        assert!((at_rest - 2.1).abs() < 1e-12, "a surface that comes nearer: {at_rest}");
        assert!((towards.demand_N(0.001, &NORMAL_W, &(0.2 * NORMAL_W)) - 0.1).abs() < 1e-12);
    }
}
