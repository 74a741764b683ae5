//! How a client's world lies over the device's, and the clutch that moves it.
//!
//! `p_client = scale * p_device + offset`, axes parallel. Positions and velocities are mapped
//! both ways; forces and moments are the same in both, so what a client calls a stiffness is
//! felt `scale` times as stiff, and damping likewise. While clutched the client's position
//! stands still: the offset follows the device, and on release it stays where it then is, so
//! the client's position goes on without a jump.

use nalgebra::Vector3;

use super::ExampleWall;
use crate::control::Report;
use crate::environment::{Contact, ForceField, Guide, Material, Shape};
use crate::proto;
use crate::units::{DAMPING, FieldError, POSITION, Range, STIFFNESS};
use crate::wire::{get3, number};

/// A wall that appears around the tool pushes it out within this time, as far as motors can. A
/// stiffer one is for brakes, which push nobody: it holds where the tool is.
const BLEND_MS: u32 = 200;
const STIFF_N_PER_M: f64 = 1e5;

const SCALE: Range = Range::new(1e-3, 1e3, "(scale)");

/// A uniform scale, an offset, and whether the hand moves without the client's tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Workspace {
    scale: f64,
    offset_m: Vector3<f64>,
    /// Where the client's position stands still.
    held_m: Option<Vector3<f64>>,
}

impl Workspace {
    /// Both worlds are one.
    pub const SAME: Self = Self { scale: 1.0, offset_m: Vector3::new(0.0, 0.0, 0.0), held_m: None };

    /// The workspace that a Hello asks for.
    pub fn agree(wanted: Option<&proto::Workspace>) -> Result<Self, FieldError> {
        let Some(wanted) = wanted else { return Ok(Self::SAME) };
        let scale = if wanted.scale == 0.0 { 1.0 } else { f64::from(wanted.scale) };
        SCALE.check("workspace.scale", scale)?;
        let mut offset_m = Vector3::zeros();
        if !wanted.offset_m.is_empty() {
            offset_m = get3("workspace.offset_m", &wanted.offset_m)?.into();
            for value in &offset_m {
                POSITION.check("workspace.offset_m", *value)?;
            }
        }
        Ok(Self { scale, offset_m, held_m: None })
    }

    /// What is felt of the client's stiffness and damping.
    pub fn felt_stiffness_ratio(&self) -> f64 {
        self.scale
    }

    /// True while the client's position stands still.
    pub fn is_clutched(&self) -> bool {
        self.held_m.is_some()
    }

    /// A command said whether it is clutched; the device is at `p_WT_m`.
    pub fn clutch(&mut self, clutched: bool, p_WT_m: &Vector3<f64>) {
        self.held_m = clutched.then(|| self.held_m.unwrap_or_else(|| self.client_position(p_WT_m)));
    }

    /// It commands no more, clutched or not.
    pub fn let_go(&mut self) {
        self.held_m = None;
    }

    /// The device moved.
    pub fn follow(&mut self, p_WT_m: &Vector3<f64>) {
        if let Some(held_m) = self.held_m {
            self.offset_m = held_m - self.scale * p_WT_m;
        }
    }

    /// A report as this client sees it; contacts are mapped by [`Workspace::depth_m`].
    pub fn view(&self, report: &Report) -> View {
        let position_m = self.client_position(&report.p_WT_m);
        if self.is_clutched() {
            return View { position_m, proxy_m: position_m, twist_m_per_s: Vector3::zeros() };
        }
        View {
            position_m,
            proxy_m: self.client_position(&report.proxy_W_m),
            twist_m_per_s: report.v_WT_m_per_s * self.scale,
        }
    }

    /// A depth of the device in the client's world.
    pub fn depth_m(&self, depth_m: f32) -> f32 {
        if self.scale == 1.0 { depth_m } else { number(f64::from(depth_m) * self.scale) }
    }

    /// A position of the device in the client's world.
    fn client_position(&self, p_m: &Vector3<f64>) -> Vector3<f64> {
        p_m * self.scale + self.offset_m
    }

    /// A position of the client in the device's world.
    pub fn position(&self, p_m: &Vector3<f64>) -> Vector3<f64> {
        (p_m - self.offset_m) / self.scale
    }

    /// A contact of the client in the device's world.
    pub fn contact(&self, contact: &mut Contact) -> Result<(), FieldError> {
        self.shape(&mut contact.surface.shape);
        self.material(&mut contact.surface.material)
    }

    /// A wall of the device as a contact that this client may send.
    pub fn example(&self, wall: &ExampleWall) -> proto::Contact {
        let numbers = |v: Vector3<f64>| v.iter().map(|x| number(*x)).collect();
        let shape = proto::HalfSpaceContact {
            point_m: numbers(self.client_position(&wall.point_W_m)),
            normal: numbers(wall.normal_W),
        };
        proto::Contact {
            id: 1,
            revision: 1,
            stiffness_n_per_m: number(wall.stiffness_N_per_m / self.scale),
            blend_ms: if wall.stiffness_N_per_m < STIFF_N_PER_M { BLEND_MS } else { 0 },
            shape: Some(proto::contact::Shape::HalfSpace(shape)),
            ..proto::Contact::default()
        }
    }

    fn shape(&self, shape: &mut Shape) {
        match shape {
            Shape::HalfSpace { point_W_m, .. } => *point_W_m = self.position(point_W_m),
            Shape::Sphere { centre_W_m, radius_m } => {
                *centre_W_m = self.position(centre_W_m);
                *radius_m /= self.scale;
            }
            Shape::Box { centre_W_m, half_extents_m, .. } => {
                *centre_W_m = self.position(centre_W_m);
                *half_extents_m /= self.scale;
            }
            Shape::Capsule { ends_W_m, radius_m } => {
                *ends_W_m = ends_W_m.map(|end| self.position(&end));
                *radius_m /= self.scale;
            }
            Shape::Guide { path, radius_m } => {
                self.guide(path);
                *radius_m /= self.scale;
            }
        }
    }

    fn guide(&self, path: &mut Guide) {
        match path {
            Guide::Point { point_W_m }
            | Guide::Line { point_W_m, .. }
            | Guide::Plane { point_W_m, .. } => *point_W_m = self.position(point_W_m),
            Guide::Segment { ends_W_m } => *ends_W_m = ends_W_m.map(|end| self.position(&end)),
        }
    }

    fn material(&self, material: &mut Material) -> Result<(), FieldError> {
        material.surface_velocity_W_m_per_s /= self.scale;
        self.felt("stiffness_n_per_m", &mut material.stiffness_N_per_m, &STIFFNESS)?;
        self.felt("damping_ns_per_m", &mut material.damping_Ns_per_m, &DAMPING)
    }

    fn felt(&self, field: &str, value: &mut f64, range: &Range) -> Result<(), FieldError> {
        let felt = *value * self.scale;
        if felt > range.max && self.scale > 1.0 {
            let allowed = format!("is felt as {felt} by the workspace's scale, must be {range}");
            return Err(FieldError::new(field, *value, allowed));
        }
        *value = felt;
        Ok(())
    }

    /// A force field of the client in the device's world.
    pub fn field(&self, field: &mut ForceField) {
        field.origin_W_m = self.position(&field.origin_W_m);
        field.stiffness_N_per_m *= self.scale;
        field.damping_Ns_per_m *= self.scale;
        field.radius_m /= self.scale;
    }
}

/// What of a report lies elsewhere for a client.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct View {
    /// Tool point.
    pub position_m: Vector3<f64>,
    /// Tool point kept on the surfaces.
    pub proxy_m: Vector3<f64>,
    /// Velocity of the tool point.
    pub twist_m_per_s: Vector3<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::Surface;
    use nalgebra::{Matrix3, UnitQuaternion};

    fn agreed(scale: f32, offset_m: Vec<f32>) -> Workspace {
        Workspace::agree(Some(&proto::Workspace { scale, offset_m })).unwrap()
    }

    fn report(x_m: f64) -> Report {
        Report {
            p_WT_m: Vector3::new(x_m, 0.25, 0.0),
            proxy_W_m: Vector3::new(x_m - 0.01, 0.25, 0.0),
            v_WT_m_per_s: Vector3::new(0.5, 0.0, 0.0),
            ..Report::default()
        }
    }

    #[test]
    fn there_and_back_is_the_same_place() {
        let workspace = agreed(4.0, vec![1.0, -2.0, 0.5]);
        let view = workspace.view(&report(0.25));
        assert_eq!(view.position_m, Vector3::new(2.0, -1.0, 0.5));
        assert_eq!(view.twist_m_per_s, Vector3::new(2.0, 0.0, 0.0));
        assert!((view.position_m - view.proxy_m).norm() - 0.04 < 1e-12);
        assert_eq!(workspace.position(&view.position_m), report(0.25).p_WT_m);
        assert_eq!(workspace.depth_m(0.125), 0.5);
    }

    #[test]
    fn a_force_is_the_same_in_both_worlds() {
        let workspace = agreed(4.0, vec![1.0, 0.0, 0.0]);
        let field = ForceField {
            origin_W_m: Vector3::new(1.5, 1.0, 0.0),
            force_W_N: Vector3::new(0.0, 1.0, 0.0),
            moment_W_Nm: Vector3::zeros(),
            stiffness_N_per_m: Matrix3::identity() * 30.0,
            damping_Ns_per_m: Matrix3::identity() * 2.0,
            radius_m: 2.0,
        };
        let mut mapped = field;
        workspace.field(&mut mapped);
        for x_m in [0.1, 0.2, 0.3, 0.5, 0.62] {
            let (report, view) = (report(x_m), workspace.view(&report(x_m)));
            let wanted = field.at(&view.position_m, &view.twist_m_per_s)[0];
            let felt = mapped.at(&report.p_WT_m, &report.v_WT_m_per_s)[0];
            assert!((wanted - felt).norm() < 1e-9, "{wanted} {felt}");
        }
    }

    /// Scale 4 and an offset, everything by hand: lengths and velocities are a quarter,
    /// directions and coefficients what they were, stiffness and damping four times as much.
    #[test]
    fn every_contact_lies_where_the_client_says() {
        let workspace = agreed(4.0, vec![1.0, 2.0, -1.0]);
        let (here, there) = (Vector3::new(2.0, 2.0, 1.0), Vector3::new(0.25, 0.0, 0.5));
        let (far, far_there) = (Vector3::new(5.0, 1.0, -1.0), Vector3::new(1.0, -0.25, 0.0));
        let turn = UnitQuaternion::from_euler_angles(0.3, -0.2, 0.1);
        let along = Vector3::new(0.6, 0.0, -0.8);
        let half = Vector3::new(0.4, 0.8, 1.2);
        let guide = |path, radius_m| Shape::Guide { path, radius_m };
        for (client, device) in [
            (
                Shape::Box { centre_W_m: here, q_WS: turn, half_extents_m: half },
                Shape::Box { centre_W_m: there, q_WS: turn, half_extents_m: half / 4.0 },
            ),
            (
                Shape::Capsule { ends_W_m: [here, far], radius_m: 0.5 },
                Shape::Capsule { ends_W_m: [there, far_there], radius_m: 0.125 },
            ),
            (
                Shape::Sphere { centre_W_m: here, radius_m: 0.5 },
                Shape::Sphere { centre_W_m: there, radius_m: 0.125 },
            ),
            (
                Shape::HalfSpace { point_W_m: here, normal_W: along },
                Shape::HalfSpace { point_W_m: there, normal_W: along },
            ),
            (
                guide(Guide::Point { point_W_m: far }, 1.0),
                guide(Guide::Point { point_W_m: far_there }, 0.25),
            ),
            (
                guide(Guide::Line { point_W_m: here, direction_W: along }, 1.0),
                guide(Guide::Line { point_W_m: there, direction_W: along }, 0.25),
            ),
            (
                guide(Guide::Plane { point_W_m: here, normal_W: along }, 0.0),
                guide(Guide::Plane { point_W_m: there, normal_W: along }, 0.0),
            ),
        ] {
            let material = Material {
                stiffness_N_per_m: 500.0,
                damping_Ns_per_m: 2.0,
                static_friction: 0.6,
                kinetic_friction: 0.4,
                surface_velocity_W_m_per_s: Vector3::new(0.2, 0.0, -0.4),
            };
            let surface = Surface { shape: client, material, hollow: false, blend_s: 0.1 };
            let mut contact = Contact { id: 1, revision: 1, surface };
            workspace.contact(&mut contact).unwrap();
            assert_eq!(contact.surface.shape, device);
            let felt = Material {
                stiffness_N_per_m: 2000.0,
                damping_Ns_per_m: 8.0,
                surface_velocity_W_m_per_s: Vector3::new(0.05, 0.0, -0.1),
                ..material
            };
            assert_eq!((contact.surface.material, contact.surface.blend_s), (felt, 0.1));
        }
    }

    #[test]
    fn the_example_comes_back_as_the_wall_that_the_device_takes() {
        let wall = ExampleWall {
            point_W_m: Vector3::new(0.25, 0.5, -0.125),
            normal_W: Vector3::new(0.0, -1.0, 0.0),
            stiffness_N_per_m: 1024.0,
        };
        for (scale, offset_m) in [(1.0, vec![]), (4.0, vec![1.0, -2.0, 0.5])] {
            let workspace = agreed(scale, offset_m);
            let sent = workspace.example(&wall);
            assert_eq!((sent.id, sent.stiffness_n_per_m), (1, 1024.0 / scale));
            let mut contact = crate::session::contact::contacts(&[sent]).unwrap()[0];
            workspace.contact(&mut contact).unwrap();
            let Surface { shape, material, blend_s, .. } = contact.surface;
            let (point_W_m, normal_W) = (wall.point_W_m, wall.normal_W);
            assert_eq!(shape, Shape::HalfSpace { point_W_m, normal_W });
            assert_eq!((material.stiffness_N_per_m, blend_s), (1024.0, 0.2));
        }
        let stiff = ExampleWall { stiffness_N_per_m: 1e7, ..wall };
        assert_eq!(Workspace::SAME.example(&stiff).blend_ms, 0, "brakes push nobody");
    }

    #[test]
    fn while_clutched_the_client_stands_still_and_goes_on_from_there() {
        let mut workspace = agreed(2.0, vec![0.5, 0.0, 0.0]);
        let before = workspace.view(&report(0.1)).position_m;
        workspace.clutch(true, &report(0.1).p_WT_m);
        for step in 0..100 {
            let report = report(0.1 + 0.002 * f64::from(step));
            workspace.follow(&report.p_WT_m);
            workspace.clutch(true, &report.p_WT_m);
            let view = workspace.view(&report);
            assert!((view.position_m - before).norm() < 1e-12);
            assert_eq!((view.proxy_m, view.twist_m_per_s), (view.position_m, Vector3::zeros()));
        }
        workspace.clutch(false, &report(0.298).p_WT_m);
        assert!((workspace.view(&report(0.298)).position_m - before).norm() < 1e-12);
        let after = workspace.view(&report(0.308)).position_m;
        assert!(
            (after - before - Vector3::new(0.02, 0.0, 0.0)).norm() < 1e-12,
            "and on from there"
        );
    }

    #[test]
    fn what_cannot_be_is_refused_by_name() {
        for (scale, offset_m, expected) in [
            (1001.0, vec![], "workspace.scale = 1001: must be a number in 0.001 to 1000 (scale)"),
            (-1.0, vec![], "workspace.scale = -1"),
            (f32::NAN, vec![], "workspace.scale = NaN"),
            (1.0, vec![0.0; 2], "workspace.offset_m = 2 numbers: must have 3"),
            (1.0, vec![0.0, 101.0, 0.0], "workspace.offset_m = 101: must be a number"),
        ] {
            let wanted = proto::Workspace { scale, offset_m };
            let error = Workspace::agree(Some(&wanted)).unwrap_err().to_string();
            assert!(error.starts_with(expected), "{error}");
        }
        assert_eq!(Workspace::agree(None), Ok(Workspace::SAME));
        assert_eq!(agreed(0.0, vec![]), Workspace::SAME);
        let mut stiff = Material { stiffness_N_per_m: 1e9, ..Material::default() };
        let error = agreed(2.0, vec![]).material(&mut stiff).unwrap_err().to_string();
        assert!(error.contains("is felt as 2000000000 by the workspace's scale"), "{error}");
    }
}
