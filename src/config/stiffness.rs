//! The stiffest wall that a motor device can render, from the drag of its shafts, and the
//! refusal of a scene that asks for more.
//!
//! What a motor feeds and what the drag takes is told in [`crate::control`]; here it is asked of
//! every place in the reach, of one object at a time. The tick itself softens whatever is too
//! stiff where it is touched: several at once, or what a controller streams. Brakes take energy
//! and never feed any: a device of brakes alone has no such bound. N s/m, N/m, seconds.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::{DeviceDefinition, Scene};
use crate::control::{Actuators, Tool, least_damping_N_s_per_m as least_N_s_per_m};
use crate::environment::{Element, Material};
use crate::mechanism::Mechanism;
use crate::notation::PlaneVector;
use crate::units::FieldError;

/// The grid over the reach: distances from its inner to its outer edge, bearings, turns.
const DISTANCES: usize = 12;
const BEARINGS: usize = 48;
const TURNS: usize = 5;

/// The ends of the reach are singular, and the simulated end stop keeps this share off.
const EDGE: f64 = 0.05;

/// The smallest damping that a force on the handle feels anywhere in the reach, whichever point
/// of the tool it acts on.
pub(super) fn least_damping_N_s_per_m(
    mechanism: &dyn Mechanism,
    actuators: &Actuators,
    tool: &Tool,
) -> f64 {
    let (nearest_m, furthest_m) = mechanism.reach_m();
    let freedoms = mechanism.freedoms();
    let turns = if freedoms == 3 { TURNS } else { 1 };
    let mut least = f64::INFINITY;
    for (distance, bearing, turn) in grid(turns) {
        let share = EDGE + (1.0 - 2.0 * EDGE) * distance;
        let r_m = nearest_m + share * (furthest_m - nearest_m);
        let (sin, cos) = (TAU * bearing).sin_cos();
        let phi_rad = (1.0 - EDGE) * turn * mechanism.turn_rad();
        let p_BH = PlaneVector::new(r_m * cos, r_m * sin, phi_rad);
        // Where a working mode has no regular posture the handle does not get to.
        let Ok(posture) = mechanism.posture_at(&p_BH) else { continue };
        let felt = actuators.handle_damping(&posture.reference, freedoms);
        for arm_B_m in arms_B_m(tool, p_BH.z) {
            least = least.min(least_N_s_per_m(&felt, &arm_B_m));
        }
    }
    if least.is_finite() { least.max(0.0) } else { 0.0 }
}

/// From H to where the tool can be touched, with the handle turned by this.
fn arms_B_m(tool: &Tool, phi_rad: f64) -> impl Iterator<Item = PlaneVector> {
    static AT_T: [Vector3<f64>; 1] = [Vector3::new(0.0, 0.0, 0.0)];
    let points_T_m = if tool.point_count == 0 { &AT_T } else { tool.points_T_m() };
    let (sin, cos) = phi_rad.sin_cos();
    points_T_m.iter().map(move |point_T_m| {
        let at = tool.offset_B_m + point_T_m;
        PlaneVector::new(cos * at.x - sin * at.y, sin * at.x + cos * at.y, 0.0)
    })
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
    let delay_s = actuators.delay_s(tick_s);
    delay_s.map_or(f64::INFINITY, |delay_s| least_damping_N_s_per_m / delay_s)
}

impl DeviceDefinition {
    /// Refuses a scene with an object that the motors would feed with this tool, by the object's
    /// name. Fields act together and beside every surface; surfaces are looked at one by one.
    pub fn check_scene(&self, scene: &Scene, tool: &Tool) -> Result<(), FieldError> {
        let Some(delay_s) = self.actuators.delay_s(self.tick_ns as f64 * 1e-9) else {
            return Ok(());
        };
        let least_N_s_per_m = if *tool == self.tool {
            self.least_damping_N_s_per_m()
        } else {
            least_damping_N_s_per_m(&*self.mechanism, &self.actuators, tool)
        };
        // The newest first: it is the one that is too much.
        let mut objects: Vec<_> = scene.list().collect();
        objects.sort_by_key(|object| std::cmp::Reverse(object.revision()));
        let feels = || objects.iter().map(|object| (object, feel(&object.element())));
        let late = |feel: &Feel| feel.stiffness_N_per_m * delay_s + feel.damping_Ns_per_m;
        let is_field = |feel: &Feel| feel.kind != "material";
        let fields: f64 =
            feels().map(|(_, feel)| feel).filter(is_field).map(|feel| late(&feel)).sum();
        for (object, feel) in feels() {
            let beside = if is_field(&feel) { fields - late(&feel) } else { fields };
            let left_Ns_per_m = (least_N_s_per_m - beside).max(0.0);
            feel.check(left_Ns_per_m, delay_s)
                .map_err(|error| error.within(&format!("objects.{}", object.id())))?;
        }
        Ok(())
    }
}

/// Where an element has them, and its largest stiffness and damping in any direction.
struct Feel {
    kind: &'static str,
    stiffness_N_per_m: f64,
    damping_Ns_per_m: f64,
}

impl Feel {
    /// Refuses what is beyond the damping that is left for it.
    fn check(&self, left_Ns_per_m: f64, delay_s: f64) -> Result<(), FieldError> {
        let Self { kind, stiffness_N_per_m, damping_Ns_per_m } = self;
        let refuse = |field: &str, value: f64, most: f64, unit: &str| {
            let allowed = format!(
                "must be at most {most:.3} {unit} beside the rest of it and the scene's fields: \
                 motors would feed more at this rate, with this lag_s and damping_N_m_s_per_rad"
            );
            Err(FieldError::new(format!("{kind}.{field}"), value, allowed))
        };
        // What the demo asks for comes back through floats.
        let slack = 1.0 + 1e-6;
        if *damping_Ns_per_m > left_Ns_per_m * slack {
            return refuse("damping_ns_per_m", *damping_Ns_per_m, left_Ns_per_m, "N s/m");
        }
        let most_N_per_m = (left_Ns_per_m - damping_Ns_per_m).max(0.0) / delay_s;
        if *stiffness_N_per_m > most_N_per_m * slack {
            return refuse("stiffness_n_per_m", *stiffness_N_per_m, most_N_per_m, "N/m");
        }
        Ok(())
    }
}

fn feel(element: &Element) -> Feel {
    let feel = |kind, stiffness_N_per_m, damping_Ns_per_m| Feel {
        kind,
        stiffness_N_per_m,
        damping_Ns_per_m,
    };
    let of = |material: &Material| {
        feel("material", material.stiffness_N_per_m, material.damping_Ns_per_m)
    };
    match element {
        Element::Surface(surface) => of(&surface.material),
        Element::Corridor(corridor) => of(&corridor.material),
        Element::ConstantField { .. } => feel("constant", 0.0, 0.0),
        Element::ViscousField { damping_Ns_per_m } => feel("viscous", 0.0, *damping_Ns_per_m),
        Element::ForceField(field) => {
            let [stiffness_N_per_m, damping_Ns_per_m] = field.most_feel();
            feel("force_field", stiffness_N_per_m, damping_Ns_per_m)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Id, ObjectKind, SceneObject};

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
        assert_eq!(brakes.check_scene(&with_wall(1e7, 1e3), &brakes.tool), Ok(()));
        for name in ["singh", "kim-2003"] {
            let motors = DeviceDefinition::load(name).unwrap();
            let (most, drag) =
                (motors.largest_stiffness_N_per_m(), motors.least_damping_N_s_per_m());
            assert_eq!(motors.check_scene(&with_wall(most, 0.0), &motors.tool), Ok(()));
            assert_eq!(
                motors.check_scene(&with_wall(0.49 * most, 0.5 * drag), &motors.tool),
                Ok(())
            );
            for (stiffness, damping, field) in [
                (1.01 * most, 0.0, "objects.board.material.stiffness_n_per_m"),
                (0.51 * most, 0.5 * drag, "objects.board.material.stiffness_n_per_m"),
                (0.0, 1.01 * drag, "objects.board.material.damping_ns_per_m"),
            ] {
                let refused =
                    motors.check_scene(&with_wall(stiffness, damping), &motors.tool).unwrap_err();
                assert!(refused.to_string().contains(field), "{name}: {refused}");
            }
            // Two fields of which each alone would do, and a wall beside one of them.
            let viscous = |id: &str| {
                let kind = ObjectKind::Viscous { damping_Ns_per_m: 0.6 * drag };
                SceneObject::new(Id::parse("id", id).unwrap(), kind, None, false).unwrap()
            };
            let mut scene = with_wall(0.39 * most, 0.0);
            scene.create(viscous("oil"), None).unwrap();
            assert_eq!(motors.check_scene(&scene, &motors.tool), Ok(()));
            let before = scene.clone();
            scene.create(viscous("glue"), None).unwrap();
            let refused = motors.check_scene(&scene, &motors.tool).unwrap_err().to_string();
            assert!(refused.starts_with("objects.glue."), "the newest: {refused}");
            assert_eq!(motors.check_scene(&before, &motors.tool), Ok(()));
            let mut scene = with_wall(0.41 * most, 0.0);
            scene.create(viscous("oil"), None).unwrap();
            let refused = motors.check_scene(&scene, &motors.tool);
            assert!(refused.unwrap_err().to_string().contains("objects.board.material"));
        }
    }

    /// A longer tool has a longer arm, on which the same wall pushes harder.
    #[test]
    fn the_tool_in_force_decides() {
        let plate = DeviceDefinition::load("kim-2003").unwrap();
        let wall = with_wall(0.99 * plate.largest_stiffness_N_per_m(), 0.0);
        assert_eq!(plate.check_scene(&wall, &plate.tool), Ok(()));
        let mut long = plate.tool;
        long.points_T_m[0] = Vector3::new(0.5, 0.5, 0.0);
        let refused = plate.check_scene(&wall, &long).unwrap_err().to_string();
        assert!(refused.starts_with("objects.board.material.stiffness_n_per_m"), "{refused}");
    }
}
