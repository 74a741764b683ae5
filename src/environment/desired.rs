//! What the world wants of the tool in one tick: a soft wrench and a few constraints.
//!
//! A surface becomes a [`Constraint`] and never a force here: what force holds it depends
//! on the law and on the actuators. Only the [`MAX_TOUCHES`] that ask for the most force are
//! kept (the deepest could be the softest); the rest is counted, so that the loss is reported.
//! Forces and moments are in W, moments about T.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::friction::bristle_N_per_m;
use super::{Element, Material, SceneItem, Surface, SurfaceState, Tool, ToolPoint, Touch, Touches};

/// Most walls that a law considers at once.
pub const MAX_CONSTRAINTS: usize = 4;

/// Most touches that are kept in a tick; touches that push the same way are one wall.
pub const MAX_TOUCHES: usize = 8;

/// Most contacts of a controller.
pub const MAX_CONTACTS: usize = 8;

/// Who wants something.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Source {
    /// The resident scene; the slot of the object.
    #[default]
    Scene,
    /// The controller's contacts.
    Controller,
}

/// A surface that a point of the tool has entered.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Constraint {
    /// Which way is out, how deep it is, and how it rubs.
    pub touch: Touch,
    /// How fast the tool goes in.
    pub approach_m_per_s: f64,
    /// Normal force that the material asks for, newtons, never negative.
    pub demand_N: f64,
    /// What of that is to be given: less where motors would feed what is as stiff as it is.
    pub held_N: f64,
    /// Share of its bristle's stiffness that is to be given in the next tick.
    pub bristle_share: f64,
    /// Most that its friction can give per normal force.
    pub most_friction: f64,
    /// Force per depth, N/m.
    pub stiffness_N_per_m: f64,
    /// Force per speed of approach, N s/m.
    pub damping_Ns_per_m: f64,
    /// Force per way along it while its friction sticks, N/m; 0 without friction.
    pub bristle_N_per_m: f64,
    /// From T to where it is touched, metres in W.
    pub arm_W_m: Vector3<f64>,
    /// Which of the tool's points.
    pub point: usize,
    /// Whose surface it is.
    pub source: Source,
    /// Object slot or contact id.
    pub id: u32,
}

/// What is wanted in one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Desired {
    /// Sum of the fields, newtons in W.
    pub soft_W_N: Vector3<f64>,
    /// Their moment about T, newton metres in W.
    pub soft_moment_W_Nm: Vector3<f64>,
    /// Sums of the stiffness and of the damping of the scene's fields there, each in the
    /// direction in which it is felt most: N/m, N s/m.
    pub field_feel: [f64; 2],
    constraints: [Constraint; MAX_TOUCHES],
    count: usize,
    /// Touches that found no room.
    pub left_out: usize,
    /// Surfaces that had to be looked at: the others are known to be out of reach.
    pub looked_at: usize,
}

impl Desired {
    /// The surfaces entered, in the order they were found.
    pub fn constraints(&self) -> &[Constraint] {
        &self.constraints[..self.count]
    }

    /// The same, to be softened.
    pub fn constraints_mut(&mut self) -> &mut [Constraint] {
        &mut self.constraints[..self.count]
    }

    /// Adds a force at T and a moment about it.
    pub fn add_soft(&mut self, [force_W_N, moment_W_Nm]: [Vector3<f64>; 2]) {
        self.soft_W_N += force_W_N;
        self.soft_moment_W_Nm += moment_W_Nm;
    }

    /// Adds what one scene item wants at one point of the tool. `state` belongs to that item
    /// and that point. Fields act at T alone, and are added with the first point.
    pub fn add_item(
        &mut self,
        item: &SceneItem,
        state: &mut SurfaceState,
        tool: &Tool,
        point: usize,
    ) {
        let Some(at) = tool.points().get(point) else { return };
        let asked = Asked { source: Source::Scene, id: item.slot.into(), point, at };
        match &item.element {
            Element::Surface(surface) => {
                self.add_surface(surface, state, item.revision, tool, &asked);
            }
            Element::Corridor(corridor) if !state.is_clear(item.revision, at) => {
                self.looked_at += 1;
                let touches = corridor.touch(state, item.revision, at, tool.tick_s);
                self.add_touches(&touches, &corridor.material, &asked);
            }
            Element::Corridor(_) => {}
            field if point == 0 => {
                let wrench = field.field_at(&tool.p_WT_m, &tool.v_WT_m_per_s);
                self.add_soft(wrench.unwrap_or_default());
                let feel = field.field_feel(&tool.p_WT_m);
                self.field_feel.iter_mut().zip(feel).for_each(|(sum, part)| *sum += part);
            }
            _ => {}
        }
    }

    /// Adds what one of the controller's contacts wants at one point of the tool.
    pub fn add_contact(
        &mut self,
        contact: &Contact,
        state: &mut SurfaceState,
        tool: &Tool,
        point: usize,
    ) {
        let Some(at) = tool.points().get(point) else { return };
        let asked = Asked { source: Source::Controller, id: contact.id, point, at };
        self.add_surface(&contact.surface, state, contact.revision.into(), tool, &asked);
    }

    fn add_surface(
        &mut self,
        surface: &Surface,
        state: &mut SurfaceState,
        revision: u64,
        tool: &Tool,
        asked: &Asked,
    ) {
        if state.is_clear(revision, asked.at) {
            return;
        }
        self.looked_at += 1;
        let touches = surface.touch(state, revision, asked.at, tool.radius_m, tool.tick_s);
        self.add_touches(&touches, &surface.material, asked);
    }

    fn add_touches(&mut self, touches: &Touches, material: &Material, asked: &Asked) {
        for touch in touches.iter() {
            let Touch { depth_m, normal_W, .. } = touch;
            let v_W_m_per_s = &asked.at.v_W_m_per_s;
            let demand_N = material.demand_N(*depth_m, normal_W, v_W_m_per_s);
            self.keep_strongest(Constraint {
                touch: *touch,
                demand_N,
                approach_m_per_s: material.approach_m_per_s(normal_W, v_W_m_per_s),
                held_N: demand_N,
                bristle_share: 1.0,
                most_friction: material.most_friction(),
                stiffness_N_per_m: material.stiffness_N_per_m,
                damping_Ns_per_m: material.damping_Ns_per_m,
                bristle_N_per_m: bristle_N_per_m(material),
                arm_W_m: asked.at.arm_W_m,
                point: asked.point,
                source: asked.source,
                id: asked.id,
            });
        }
    }

    fn keep_strongest(&mut self, constraint: Constraint) {
        if self.count < MAX_TOUCHES {
            self.constraints[self.count] = constraint;
            self.count += 1;
            return;
        }
        self.left_out += 1;
        let weakest = self.constraints.iter_mut().min_by(|a, b| a.demand_N.total_cmp(&b.demand_N));
        if let Some(kept) = weakest.filter(|kept| kept.demand_N < constraint.demand_N) {
            *kept = constraint;
        }
    }
}

/// Whose surface is asked, and at which point of the tool.
struct Asked<'a> {
    source: Source,
    id: u32,
    point: usize,
    at: &'a ToolPoint,
}

/// A local model streamed by the controller.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// Keeps its identity from command to command.
    pub id: u32,
    /// Changes when the surface changes.
    pub revision: u32,
    /// The surface itself.
    pub surface: Surface,
}

#[cfg(test)]
mod tests;
