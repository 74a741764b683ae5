//! What the world wants at the tool point in one tick: a soft force and a few constraints.
//!
//! A surface becomes a [`Constraint`] and never a force here: what force holds it depends
//! on the law and on the actuators. Only the deepest [`MAX_CONSTRAINTS`] are kept; the rest
//! is counted, so that the loss is reported.

use nalgebra::Vector3;

use super::{Element, Material, SceneItem, Surface, SurfaceState};

/// Most constraints that a law considers at once.
pub const MAX_CONSTRAINTS: usize = 4;

/// Most contacts of a controller.
pub const MAX_CONTACTS: usize = 8;

/// Who wants something.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Source {
    /// The resident scene; the slot of the object.
    #[default]
    Scene,
    /// The controller's contacts.
    Controller,
}

/// A surface that the tool has entered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Constraint {
    /// Unit vector out of the surface, in W.
    pub normal_W: Vector3<f64>,
    /// Depth, metres, positive.
    pub depth_m: f64,
    /// What the surface feels like.
    pub material: Material,
    /// Whose surface it is.
    pub source: Source,
    /// Object slot or contact id.
    pub id: u32,
}

impl Default for Constraint {
    fn default() -> Self {
        Self {
            normal_W: Vector3::zeros(),
            depth_m: 0.0,
            material: Material::default(),
            source: Source::Scene,
            id: 0,
        }
    }
}

impl Constraint {
    /// Normal force that the material asks for at this velocity, newtons, never negative.
    pub fn demand_N(&self, v_WT_m_per_s: &Vector3<f64>) -> f64 {
        let approach_m_per_s = -v_WT_m_per_s.dot(&self.normal_W);
        let spring_N = self.material.stiffness_N_per_m * self.depth_m;
        (spring_N + self.material.damping_Ns_per_m * approach_m_per_s).max(0.0)
    }
}

/// What is wanted in one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Desired {
    /// Sum of the fields, newtons in W.
    pub soft_W_N: Vector3<f64>,
    constraints: [Constraint; MAX_CONSTRAINTS],
    count: usize,
    /// Constraints that found no room.
    pub left_out: usize,
}

impl Desired {
    /// The surfaces entered, in the order they were found.
    pub fn constraints(&self) -> &[Constraint] {
        &self.constraints[..self.count]
    }

    /// Adds what one scene item wants.
    pub fn add_item(&mut self, item: &SceneItem, state: &mut SurfaceState, tool: &Tool) {
        match &item.element {
            Element::Surface(surface) => {
                self.add_surface(
                    surface,
                    state,
                    item.revision,
                    Source::Scene,
                    item.slot.into(),
                    tool,
                );
            }
            field => {
                if let Some(force_W_N) = field.field_force_W_N(&tool.v_WT_m_per_s) {
                    self.soft_W_N += force_W_N;
                }
            }
        }
    }

    /// Adds what one of the controller's contacts wants.
    pub fn add_contact(&mut self, contact: &Contact, state: &mut SurfaceState, tool: &Tool) {
        let revision = contact.revision.into();
        self.add_surface(&contact.surface, state, revision, Source::Controller, contact.id, tool);
    }

    fn add_surface(
        &mut self,
        surface: &Surface,
        state: &mut SurfaceState,
        revision: u64,
        source: Source,
        id: u32,
        tool: &Tool,
    ) {
        let touch = surface.touch(state, revision, &tool.p_WT_m, tool.radius_m, tool.tick_s);
        if let Some(touch) = touch {
            self.keep_deepest(Constraint {
                normal_W: touch.normal_W,
                depth_m: touch.depth_m,
                material: surface.material,
                source,
                id,
            });
        }
    }

    fn keep_deepest(&mut self, constraint: Constraint) {
        if self.count < MAX_CONSTRAINTS {
            self.constraints[self.count] = constraint;
            self.count += 1;
            return;
        }
        self.left_out += 1;
        let shallowest = self.constraints.iter_mut().min_by(|a, b| a.depth_m.total_cmp(&b.depth_m));
        if let Some(kept) = shallowest.filter(|kept| kept.depth_m < constraint.depth_m) {
            *kept = constraint;
        }
    }
}

/// The tool as the world meets it in one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tool {
    /// Tool point in W.
    pub p_WT_m: Vector3<f64>,
    /// Its velocity.
    pub v_WT_m_per_s: Vector3<f64>,
    /// Radius of the tool.
    pub radius_m: f64,
    /// Time since the last tick.
    pub tick_s: f64,
}

/// A local model streamed by the controller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Keeps its identity from command to command.
    pub id: u32,
    /// Changes when the surface changes.
    pub revision: u32,
    /// The surface itself.
    pub surface: Surface,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::Shape;

    fn tool(x_m: f64) -> Tool {
        Tool {
            p_WT_m: Vector3::new(x_m, 0.0, 0.0),
            v_WT_m_per_s: Vector3::new(0.1, 0.2, 0.0),
            radius_m: 0.0,
            tick_s: 1e-3,
        }
    }

    fn wall(x_m: f64) -> Element {
        Element::Surface(Surface {
            shape: Shape::HalfSpace {
                point_W_m: Vector3::new(x_m, 0.0, 0.0),
                normal_W: -Vector3::x(),
            },
            material: Material { stiffness_N_per_m: 100.0, damping_Ns_per_m: 10.0, friction: 0.0 },
            hollow: false,
            blend_s: 0.0,
        })
    }

    #[test]
    fn fields_add_up() {
        let mut desired = Desired::default();
        let mut state = SurfaceState::default();
        for element in [
            Element::ConstantField { force_W_N: Vector3::new(1.0, 0.0, 0.0) },
            Element::ViscousField { damping_Ns_per_m: 10.0 },
        ] {
            desired.add_item(&SceneItem { slot: 0, revision: 1, element }, &mut state, &tool(0.0));
        }
        assert!((desired.soft_W_N - Vector3::new(0.0, -2.0, 0.0)).norm() < 1e-12);
        assert!(desired.constraints().is_empty());
    }

    #[test]
    fn damping_resists_the_approach_and_never_pulls() {
        let constraint = Constraint {
            normal_W: -Vector3::x(),
            depth_m: 0.001,
            material: Material { stiffness_N_per_m: 100.0, damping_Ns_per_m: 10.0, friction: 0.0 },
            ..Constraint::default()
        };
        assert!((constraint.demand_N(&Vector3::new(0.1, 0.0, 0.0)) - 1.1).abs() < 1e-12);
        assert_eq!(constraint.demand_N(&Vector3::new(-5.0, 0.0, 0.0)), 0.0);
    }

    #[test]
    fn the_deepest_constraints_are_kept_and_the_rest_is_counted() {
        let mut states = [SurfaceState::default(); 6];
        let mut desired = Desired::default();
        for x_m in [0.0, 0.35] {
            desired = Desired::default();
            for (slot, state) in states.iter_mut().enumerate() {
                let element = wall(0.1 + 0.01 * slot as f64);
                let item = SceneItem { slot: slot as u16, revision: 1, element };
                desired.add_item(&item, state, &tool(x_m));
            }
        }
        assert_eq!((desired.constraints().len(), desired.left_out), (MAX_CONSTRAINTS, 2));
        assert!(desired.constraints().iter().all(|kept| kept.id < 4));
    }
}
