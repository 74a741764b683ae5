//! One object of a resident scene, checked: the same door for gRPC, `ctl` and the scene file.
//!
//! Everything is in W, SI units. Field names in refusals are those of `scene.proto`, which
//! the scene file uses too, so one message fits both. What has a surface (shapes, corridors,
//! guides) has a material; a field has none. Only a shape can be hollow: a corridor or guide
//! is felt from every side anyhow. What is brought to length 1 (normals, directions,
//! orientations) is kept so. The ranges are in [`super::object_check`].

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use super::Id;
use super::object_check::{check_kind, check_material};
use crate::environment::{Corridor, Element, ForceField, Guide, Material, Shape, Surface};
use crate::units::FieldError;

/// A resident surface that appears or changes around the tool pushes nobody: it is felt as
/// the tool moves out, not after a time.
const BLEND_S: f64 = 0.0;

/// What an object is, and where. Lengths in metres, in W.
#[derive(Clone, Debug, PartialEq)]
pub enum ObjectKind {
    /// All points behind a plane.
    HalfSpace {
        /// Any point of the plane.
        point_m: Vector3<f64>,
        /// Out of the solid.
        normal: Vector3<f64>,
    },
    /// All points within a radius.
    Sphere {
        /// Its centre.
        centre_m: Vector3<f64>,
        /// Its radius.
        radius_m: f64,
    },
    /// A rectangular block.
    Box {
        /// Its centre.
        centre_m: Vector3<f64>,
        /// Half of its edges, along its own axes.
        half_extents_m: Vector3<f64>,
        /// Turns its axes into W.
        orientation: Quaternion<f64>,
    },
    /// All points within a radius of the line between two ends.
    Capsule {
        /// The two ends, which may be the same.
        ends_m: [Vector3<f64>; 2],
        /// Its radius.
        radius_m: f64,
    },
    /// A polyline that the tool is led along.
    Corridor {
        /// 2 to 64 points.
        points_m: Box<[Vector3<f64>]>,
        /// The tool is free within it.
        radius_m: f64,
    },
    /// A point, line or plane that the tool is led to or along.
    Guide {
        /// Which of them.
        path: GuidePath,
        /// The tool is free within it.
        radius_m: f64,
    },
    /// The same force everywhere.
    Constant {
        /// Newtons in W.
        force_N: Vector3<f64>,
    },
    /// A force against the tool's velocity.
    Viscous {
        /// Force per speed.
        damping_Ns_per_m: f64,
    },
    /// A wrench, a spring and a damper about a place.
    ForceField {
        /// Where the wrench is the stated one at rest.
        origin_m: Vector3<f64>,
        /// Force there, newtons.
        force_N: Vector3<f64>,
        /// Moment about the tool point, newton metres.
        moment_Nm: Vector3<f64>,
        /// Force per displacement from the origin.
        stiffness_N_per_m: Matrix3<f64>,
        /// Force per velocity.
        damping_Ns_per_m: Matrix3<f64>,
        /// Beyond it there is nothing; 0: everywhere.
        radius_m: f64,
    },
}

/// What a guide leads to, or along.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GuidePath {
    /// One place.
    Point {
        /// That place.
        point_m: Vector3<f64>,
    },
    /// A line without ends.
    Line {
        /// Any point of it.
        point_m: Vector3<f64>,
        /// Along it.
        direction: Vector3<f64>,
    },
    /// A plane, felt from both sides.
    Plane {
        /// Any point of it.
        point_m: Vector3<f64>,
        /// Across it.
        normal: Vector3<f64>,
    },
}

impl ObjectKind {
    /// True of what can be a sheet or shell.
    fn is_shape(&self) -> bool {
        matches!(
            self,
            Self::HalfSpace { .. } | Self::Sphere { .. } | Self::Box { .. } | Self::Capsule { .. }
        )
    }

    /// True of what needs a material.
    fn has_surface(&self) -> bool {
        self.is_shape() || matches!(self, Self::Corridor { .. } | Self::Guide { .. })
    }
}

/// A checked object.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneObject {
    id: Id,
    kind: ObjectKind,
    material: Option<Material>,
    hollow: bool,
    revision: u64,
}

impl SceneObject {
    /// Checks what somebody wrote. A refusal names the field relative to the object.
    pub fn new(
        id: Id,
        kind: ObjectKind,
        material: Option<Material>,
        hollow: bool,
    ) -> Result<Self, FieldError> {
        let kind = check_kind(kind)?;
        let refuse = |field, value: &str, allowed| Err(FieldError::new(field, value, allowed));
        match &material {
            None if kind.has_surface() => {
                return refuse("material", "(none)", "a surface needs a material");
            }
            Some(_) if !kind.has_surface() => {
                return refuse("material", "(set)", "a field has no material");
            }
            Some(material) => check_material(material)?,
            None => {}
        }
        if hollow && !kind.is_shape() {
            let allowed = "only a half-space, sphere, box or capsule can be hollow";
            return refuse("hollow", "true", allowed);
        }
        Ok(Self { id, kind, material, hollow, revision: 0 })
    }

    /// The same object as of a revision of its scene.
    #[must_use]
    pub(super) fn at_revision(self, revision: u64) -> Self {
        Self { revision, ..self }
    }

    /// True where only the revisions may differ.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        let Self { id, kind, material, hollow, revision: _ } = self;
        (id, kind, material, hollow) == (&other.id, &other.kind, &other.material, &other.hollow)
    }

    /// Its identifier, unique in the scene.
    pub fn id(&self) -> &Id {
        &self.id
    }

    /// What it is.
    pub fn kind(&self) -> &ObjectKind {
        &self.kind
    }

    /// What its surface feels like; `None` for a field.
    pub fn material(&self) -> Option<&Material> {
        self.material.as_ref()
    }

    /// A sheet or shell.
    pub fn hollow(&self) -> bool {
        self.hollow
    }

    /// Scene revision in which it last changed; 0 outside a scene.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The object as the loop knows it.
    pub(super) fn element(&self) -> Element {
        let material = self.material.unwrap_or_default();
        let shape = match &self.kind {
            ObjectKind::HalfSpace { point_m, normal } => {
                Shape::HalfSpace { point_W_m: *point_m, normal_W: *normal }
            }
            ObjectKind::Sphere { centre_m, radius_m } => {
                Shape::Sphere { centre_W_m: *centre_m, radius_m: *radius_m }
            }
            ObjectKind::Box { centre_m, half_extents_m, orientation } => Shape::Box {
                centre_W_m: *centre_m,
                q_WS: UnitQuaternion::new_unchecked(*orientation),
                half_extents_m: *half_extents_m,
            },
            ObjectKind::Capsule { ends_m, radius_m } => {
                Shape::Capsule { ends_W_m: *ends_m, radius_m: *radius_m }
            }
            ObjectKind::Guide { path, radius_m } => {
                Shape::Guide { path: path.in_W(), radius_m: *radius_m }
            }
            ObjectKind::Corridor { points_m, radius_m } => {
                let corridor = Corridor::new(points_m.clone(), *radius_m, material, BLEND_S);
                // Checked to have points enough; a corridor of none leads nowhere.
                let nowhere = Element::ViscousField { damping_Ns_per_m: 0.0 };
                return corridor.map_or(nowhere, Element::Corridor);
            }
            ObjectKind::Constant { force_N } => {
                return Element::ConstantField { force_W_N: *force_N };
            }
            ObjectKind::Viscous { damping_Ns_per_m } => {
                return Element::ViscousField { damping_Ns_per_m: *damping_Ns_per_m };
            }
            ObjectKind::ForceField {
                origin_m,
                force_N,
                moment_Nm,
                stiffness_N_per_m,
                damping_Ns_per_m,
                radius_m,
            } => {
                return Element::ForceField(ForceField {
                    origin_W_m: *origin_m,
                    force_W_N: *force_N,
                    moment_W_Nm: *moment_Nm,
                    stiffness_N_per_m: *stiffness_N_per_m,
                    damping_Ns_per_m: *damping_Ns_per_m,
                    radius_m: if *radius_m == 0.0 { f64::INFINITY } else { *radius_m },
                });
            }
        };
        Element::Surface(Surface { shape, material, hollow: self.hollow, blend_s: BLEND_S })
    }
}

impl GuidePath {
    fn in_W(self) -> Guide {
        match self {
            Self::Point { point_m } => Guide::Point { point_W_m: point_m },
            Self::Line { point_m, direction } => {
                Guide::Line { point_W_m: point_m, direction_W: direction }
            }
            Self::Plane { point_m, normal } => {
                Guide::Plane { point_W_m: point_m, normal_W: normal }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STIFF: Material = Material {
        stiffness_N_per_m: 1e7,
        damping_Ns_per_m: 10.0,
        static_friction: 0.3,
        kinetic_friction: 0.2,
        surface_velocity_W_m_per_s: Vector3::new(0.0, 0.1, 0.0),
    };

    fn object(kind: ObjectKind, material: Option<Material>) -> Result<SceneObject, FieldError> {
        SceneObject::new(Id::parse("id", "thing").unwrap(), kind, material, false)
    }

    #[test]
    fn a_material_belongs_to_surfaces_and_a_hollow_to_shapes() {
        let point_m = Vector3::new(0.3, 0.0, 0.0);
        let path = GuidePath::Point { point_m };
        let guide = ObjectKind::Guide { path, radius_m: 0.0 };
        let corridor = ObjectKind::Corridor { points_m: [point_m; 2].into(), radius_m: 0.0 };
        let air = ObjectKind::Viscous { damping_Ns_per_m: 1.0 };
        let wall = ObjectKind::HalfSpace { point_m, normal: Vector3::x() };
        for (kind, surface, shape) in
            [(wall, true, true), (guide, true, false), (corridor, true, false), (air, false, false)]
        {
            for material in [None, Some(STIFF)] {
                let made = object(kind.clone(), material);
                assert_eq!(made.is_ok(), surface == material.is_some(), "{kind:?}");
                assert!(made.is_ok() || made.unwrap_err().field == "material");
            }
            let id = Id::parse("id", "thing").unwrap();
            let hollow = SceneObject::new(id, kind.clone(), surface.then_some(STIFF), true);
            assert_eq!(hollow.is_ok(), shape, "{kind:?}");
            assert!(shape || hollow.unwrap_err().field == "hollow");
        }
    }

    #[test]
    fn the_loop_sees_the_same_thing() {
        let turn = UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3);
        let (centre_m, half_extents_m) = (Vector3::y(), Vector3::new(0.1, 0.2, 0.001));
        let kind = ObjectKind::Box { centre_m, half_extents_m, orientation: *turn.quaternion() };
        let Element::Surface(surface) = object(kind, Some(STIFF)).unwrap().element() else {
            panic!("a box is a surface")
        };
        let shape = Shape::Box { centre_W_m: centre_m, q_WS: turn, half_extents_m };
        assert_eq!((surface.shape, surface.material), (shape, STIFF));
        let field = object(ObjectKind::Constant { force_N: Vector3::z() }, None).unwrap();
        assert_eq!(field.element(), Element::ConstantField { force_W_N: Vector3::z() });
    }

    #[test]
    fn a_field_of_radius_zero_is_everywhere() {
        for (radius_m, felt_m) in [(0.0, f64::INFINITY), (0.25, 0.25)] {
            let field = ObjectKind::ForceField {
                origin_m: Vector3::x(),
                force_N: Vector3::y(),
                moment_Nm: Vector3::z(),
                stiffness_N_per_m: Matrix3::identity(),
                damping_Ns_per_m: Matrix3::zeros(),
                radius_m,
            };
            let Element::ForceField(field) = object(field, None).unwrap().element() else {
                panic!("it is a field")
            };
            assert_eq!((field.radius_m, field.origin_W_m), (felt_m, Vector3::x()));
        }
    }
}
