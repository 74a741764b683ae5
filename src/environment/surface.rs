//! Shapes with a surface: where the tool touches them, and how deep.
//!
//! A solid is felt from outside. A hollow one is a sheet or shell: it is felt from the side
//! on which the tool was when the surface appeared, and for an unbounded or closed shape
//! that side can never change without passing through.
//!
//! A surface that appears or changes never makes the force jump: what the tool is already
//! inside of is given away as an `offset_m`, which shrinks as the tool moves out (a ratchet:
//! nobody is pushed) or, where the owner asked for it, over a blend time.

use nalgebra::Vector3;

/// What a surface is made of.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Material {
    /// Force per depth, N/m.
    pub stiffness_N_per_m: f64,
    /// Force per speed of approach, N s/m.
    pub damping_Ns_per_m: f64,
    /// Coulomb coefficient, friction force per normal force.
    pub friction: f64,
}

/// The geometry of a surface, in W.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// All points behind a plane.
    HalfSpace {
        /// Any point of the plane.
        point_W_m: Vector3<f64>,
        /// Unit vector out of the solid.
        normal_W: Vector3<f64>,
    },
    /// All points within a radius.
    Sphere {
        /// Its centre.
        centre_W_m: Vector3<f64>,
        /// Its radius.
        radius_m: f64,
    },
}

impl Shape {
    /// Signed distance of a point (positive outside) and the outward unit normal there.
    fn distance(&self, p_W_m: &Vector3<f64>) -> (f64, Vector3<f64>) {
        match self {
            Self::HalfSpace { point_W_m, normal_W } => {
                ((p_W_m - point_W_m).dot(normal_W), *normal_W)
            }
            Self::Sphere { centre_W_m, radius_m } => {
                let away = p_W_m - centre_W_m;
                let range = away.norm();
                // At the very centre every direction leads out; pick one.
                let normal_W = if range > 1e-12 { away / range } else { Vector3::x() };
                (range - radius_m, normal_W)
            }
        }
    }
}

/// A shape of some material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Where it is.
    pub shape: Shape,
    /// What it feels like.
    pub material: Material,
    /// A sheet or shell, felt from both sides.
    pub hollow: bool,
    /// Time over which a change takes effect; zero: only as the tool moves out.
    pub blend_s: f64,
}

/// Where and how deep the tool touches a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Unit vector that leads out, in W.
    pub normal_W: Vector3<f64>,
    /// How far the tool would have to move along the normal, metres, positive.
    pub depth_m: f64,
}

/// What a surface remembers between ticks.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct SurfaceState {
    /// The surface that the rest belongs to, with its revision; `None` before the first tick.
    known: Option<(u64, Shape)>,
    /// +1 outside, -1 inside a hollow shape.
    side: f64,
    /// Depth that is given away.
    offset_m: f64,
    /// Time left until the offset has to be gone, where the owner set one.
    blend_left_s: f64,
}

impl Surface {
    /// The touch of a tool of `radius_m` at `p_WT_m`, if any; advances `state` by `tick_s`.
    pub fn touch(
        &self,
        state: &mut SurfaceState,
        revision: u64,
        p_WT_m: &Vector3<f64>,
        radius_m: f64,
        tick_s: f64,
    ) -> Option<Touch> {
        let (distance_m, outward_W) = self.shape.distance(p_WT_m);
        let changed = state.known.is_none_or(|(known, _)| known != revision);
        // What the surface as it was would make felt here and now: only what the *change*
        // adds is given away, not what the tool moved meanwhile.
        let before_m = match state.known {
            Some((_, shape)) if changed => {
                radius_m - state.side * shape.distance(p_WT_m).0 - state.offset_m
            }
            _ => 0.0,
        };
        if changed {
            state.choose_side(self.hollow, before_m, distance_m);
        }
        state.known = Some((revision, self.shape));
        let depth_m = radius_m - state.side * distance_m;
        if changed {
            state.offset_m = (depth_m - before_m.max(0.0)).max(0.0);
            state.blend_left_s = self.blend_s;
        }
        state.relax(depth_m, tick_s);
        let felt_m = depth_m - state.offset_m;
        let normal_W = state.side * outward_W;
        (felt_m > 0.0).then_some(Touch { normal_W, depth_m: felt_m })
    }
}

impl SurfaceState {
    /// Turning a sheet around is a new sheet; a moved one keeps the side it is felt from.
    fn choose_side(&mut self, hollow: bool, before_m: f64, distance_m: f64) {
        let touched = self.known.is_some() && before_m > 0.0;
        if !hollow {
            self.side = 1.0;
        } else if !touched {
            self.side = if distance_m < 0.0 { -1.0 } else { 1.0 };
        }
    }

    /// Shrinks the offset: never more than the depth, and to nothing within the blend time.
    fn relax(&mut self, depth_m: f64, tick_s: f64) {
        self.offset_m = self.offset_m.min(depth_m.max(0.0));
        if self.blend_left_s > 0.0 {
            let share = (tick_s / self.blend_left_s).clamp(0.0, 1.0);
            self.offset_m -= share * self.offset_m;
            self.blend_left_s -= tick_s;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK_S: f64 = 1e-3;

    fn wall(x_m: f64) -> Surface {
        Surface {
            shape: Shape::HalfSpace {
                point_W_m: Vector3::new(x_m, 0.0, 0.0),
                normal_W: -Vector3::x(),
            },
            material: Material { stiffness_N_per_m: 1e7, ..Material::default() },
            hollow: false,
            blend_s: 0.0,
        }
    }

    fn shell(hollow: bool) -> Surface {
        let shape = Shape::Sphere { centre_W_m: Vector3::zeros(), radius_m: 0.1 };
        Surface { shape, hollow, ..wall(0.0) }
    }

    fn at(surface: &Surface, state: &mut SurfaceState, revision: u64, x_m: f64) -> f64 {
        let touch = surface.touch(state, revision, &Vector3::new(x_m, 0.0, 0.0), 0.0, TICK_S);
        touch.map_or(0.0, |touch| touch.depth_m)
    }

    #[test]
    fn a_wall_is_felt_behind_its_plane_and_only_there() {
        let mut state = SurfaceState::default();
        assert_eq!(at(&wall(0.3), &mut state, 1, 0.2), 0.0);
        assert!((at(&wall(0.3), &mut state, 1, 0.301) - 0.001).abs() < 1e-12);
    }

    #[test]
    fn the_tool_radius_counts() {
        let mut state = SurfaceState::default();
        wall(0.3).touch(&mut state, 1, &Vector3::new(0.1, 0.0, 0.0), 0.01, TICK_S);
        let touch = wall(0.3).touch(&mut state, 1, &Vector3::new(0.295, 0.0, 0.0), 0.01, TICK_S);
        assert!((touch.unwrap().depth_m - 0.005).abs() < 1e-12);
    }

    #[test]
    fn a_new_wall_around_the_tool_lets_it_out_but_not_deeper() {
        let mut state = SurfaceState::default();
        assert_eq!(at(&wall(0.3), &mut state, 1, 0.35), 0.0, "no step of force");
        assert!((at(&wall(0.3), &mut state, 1, 0.36) - 0.01).abs() < 1e-12, "not deeper");
        assert_eq!(at(&wall(0.3), &mut state, 1, 0.31), 0.0);
        assert!((at(&wall(0.3), &mut state, 1, 0.35) - 0.04).abs() < 1e-12, "it followed out");
    }

    #[test]
    fn a_moved_wall_keeps_the_force_it_had() {
        let mut state = SurfaceState::default();
        at(&wall(0.3), &mut state, 1, 0.2);
        let before_m = at(&wall(0.3), &mut state, 1, 0.302);
        let after_m = at(&wall(0.25), &mut state, 2, 0.302);
        assert!((before_m - after_m).abs() < 1e-12);
    }

    #[test]
    fn a_wall_renewed_every_tick_is_as_hard_as_one_that_stays() {
        let mut state = SurfaceState::default();
        at(&wall(0.3), &mut state, 0, 0.2);
        for tick in 1..=200 {
            let (wall_m, tool_m) = (0.3 - 1e-6 * tick as f64, 0.3 + 5e-6 * tick as f64);
            let depth_m = at(&wall(wall_m), &mut state, tick, tool_m);
            assert!((depth_m - (tool_m - 0.3)).abs() < 3e-6, "{depth_m} at tick {tick}");
        }
    }

    #[test]
    fn a_blend_time_brings_the_true_surface_back() {
        let mut state = SurfaceState::default();
        let blended = |x_m| Surface { blend_s: 0.010, ..wall(x_m) };
        assert_eq!(at(&blended(0.3), &mut state, 0, 0.2), 0.0);
        let mut last_m = 0.0;
        for _ in 0..12 {
            let depth_m = at(&blended(0.25), &mut state, 1, 0.26);
            assert!(depth_m >= last_m - 1e-15 && depth_m - last_m < 2.5e-3, "{last_m} {depth_m}");
            last_m = depth_m;
        }
        assert!((last_m - 0.01).abs() < 1e-9);
    }

    #[test]
    fn a_solid_sphere_pushes_out_and_a_shell_keeps_the_tool_in() {
        let mut outside = SurfaceState::default();
        at(&shell(false), &mut outside, 1, 0.2);
        let touch = shell(false).touch(&mut outside, 1, &Vector3::new(0.09, 0.0, 0.0), 0.0, TICK_S);
        assert_eq!(touch.unwrap().normal_W, Vector3::x());
        let mut inside = SurfaceState::default();
        assert_eq!(at(&shell(true), &mut inside, 1, 0.05), 0.0);
        let touch = shell(true).touch(&mut inside, 1, &Vector3::new(0.11, 0.0, 0.0), 0.0, TICK_S);
        assert_eq!(touch.unwrap().normal_W, -Vector3::x());
    }

    #[test]
    fn the_centre_of_a_sphere_has_a_normal() {
        let mut state = SurfaceState::default();
        at(&shell(false), &mut state, 1, 0.2);
        let touch = shell(false).touch(&mut state, 1, &Vector3::zeros(), 0.0, TICK_S).unwrap();
        assert!((touch.normal_W.norm() - 1.0).abs() < 1e-12);
    }
}
