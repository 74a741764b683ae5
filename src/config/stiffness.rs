//! The stiffest wall that a motor device can render, from the drag of its shafts, and the
//! refusal of a scene that asks for more.
//!
//! A sampled spring feeds energy to what bounces on it: held for a tick it pushes, on the
//! mean, half a tick late, and a motor's lag comes on top. With b the damping at the handle
//! and B that of the surface it is passive for `K (T / 2 + lag) + B <= b` (Colgate & Brown 1994
//! without lag; a first-order lag counts as the delay that it is for slow motion, derived here).
//! Brakes take energy and never feed any: a device of brakes alone has no such bound. Contacts
//! that a controller streams are not looked at here. N s/m, N/m, seconds.

use nalgebra::SMatrix;
use std::f64::consts::TAU;

use super::{DeviceDefinition, Scene};
use crate::actuation::ActuatorKind;
use crate::control::Actuators;
use crate::environment::Element;
use crate::mechanism::Mechanism;
use crate::notation::{ActuatorVector, PlaneVector};
use crate::units::FieldError;

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

impl DeviceDefinition {
    /// Refuses a scene with an object that the motors would feed, by the object's name.
    pub fn check_scene(&self, scene: &Scene) -> Result<(), FieldError> {
        let largest_N_per_m = self.largest_stiffness_N_per_m();
        if largest_N_per_m.is_infinite() {
            return Ok(());
        }
        let most_Ns_per_m = self.least_damping_N_s_per_m();
        for object in scene.list() {
            let (kind, stiffness_N_per_m, damping_Ns_per_m) = feel(&object.element());
            let refuse = |field: &str, value: f64, most: f64, unit: &str, beside: String| {
                let allowed = format!(
                    "must be at most {most:.3} {unit}{beside}: motors would feed a stiffer or \
                     more damped one at this rate"
                );
                let field = format!("objects.{}.{kind}.{field}", object.id());
                Err(FieldError::new(field, value, allowed))
            };
            if damping_Ns_per_m > most_Ns_per_m {
                let (field, unit) = ("damping_ns_per_m", "N s/m");
                return refuse(field, damping_Ns_per_m, most_Ns_per_m, unit, String::new());
            }
            let left = 1.0 - damping_Ns_per_m / most_Ns_per_m.max(f64::MIN_POSITIVE);
            // What the demo asks for comes back through floats.
            let most_N_per_m = largest_N_per_m * left;
            if stiffness_N_per_m > most_N_per_m * (1.0 + 1e-6) {
                let beside = match damping_Ns_per_m {
                    0.0 => String::new(),
                    damping => format!(" beside a damping of {damping} N s/m"),
                };
                let (field, unit) = ("stiffness_n_per_m", "N/m");
                return refuse(field, stiffness_N_per_m, most_N_per_m, unit, beside);
            }
        }
        Ok(())
    }
}

/// Where an element has them, and its largest stiffness and damping in any direction.
fn feel(element: &Element) -> (&'static str, f64, f64) {
    match element {
        Element::Surface(surface) => {
            let material = &surface.material;
            ("material", material.stiffness_N_per_m, material.damping_Ns_per_m)
        }
        Element::Corridor(corridor) => {
            let material = &corridor.material;
            ("material", material.stiffness_N_per_m, material.damping_Ns_per_m)
        }
        Element::ConstantField { .. } => ("constant", 0.0, 0.0),
        Element::ViscousField { damping_Ns_per_m } => ("viscous", 0.0, *damping_Ns_per_m),
        Element::ForceField(field) => {
            let most = |matrix: &nalgebra::Matrix3<f64>| matrix.singular_values().max();
            ("force_field", most(&field.stiffness_N_per_m), most(&field.damping_Ns_per_m))
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::config::{Id, ObjectKind, SceneObject};
    use crate::environment::Material;

    fn with_wall(stiffness_N_per_m: f64, damping_Ns_per_m: f64) -> Scene {
        let point_m = Vector3::new(0.3, 0.0, 0.0);
        let kind = ObjectKind::HalfSpace { point_m, normal: -Vector3::x() };
        let material = Material { stiffness_N_per_m, damping_Ns_per_m, ..Material::default() };
        let id = Id::parse("id", "board").unwrap();
        let wall = SceneObject::new(id, kind, Some(material), false).unwrap();
        let mut scene = Scene::default();
        scene.create(wall, None).unwrap();
        scene
    }

    #[test]
    fn motors_refuse_a_wall_that_they_would_feed_and_brakes_none() {
        let brakes = DeviceDefinition::load("cho-2005").unwrap();
        assert_eq!(brakes.check_scene(&with_wall(1e7, 1e3)), Ok(()));
        for name in ["singh", "kim-2003"] {
            let motors = DeviceDefinition::load(name).unwrap();
            let (most, drag) =
                (motors.largest_stiffness_N_per_m(), motors.least_damping_N_s_per_m());
            assert_eq!(motors.check_scene(&with_wall(most, 0.0)), Ok(()));
            assert_eq!(motors.check_scene(&with_wall(0.49 * most, 0.5 * drag)), Ok(()));
            for (stiffness, damping, field) in [
                (1.01 * most, 0.0, "objects.board.material.stiffness_n_per_m"),
                (0.51 * most, 0.5 * drag, "beside a damping of"),
                (0.0, 1.01 * drag, "objects.board.material.damping_ns_per_m"),
            ] {
                let refused = motors.check_scene(&with_wall(stiffness, damping)).unwrap_err();
                assert!(refused.to_string().contains(field), "{name}: {refused}");
            }
        }
    }
}
