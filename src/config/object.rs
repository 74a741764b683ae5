//! One object of a resident scene, checked: the same door for gRPC, `ctl` and the scene file.
//!
//! Everything is in W, SI units. Field names in refusals are those of `scene.proto`, which
//! the scene file uses too, so one message fits both. A surface (half-space, sphere) has a
//! material; a field (constant, viscous) has none and cannot be hollow. Normals come in with
//! any sensible length and are kept with length 1.

use nalgebra::Vector3;

use super::Id;
use crate::environment::{Element, Material, Shape, Surface};
use crate::units::{self, FieldError};

/// A resident surface that appears or changes around the tool pushes nobody: it is felt as
/// the tool moves out, not after a time.
const BLEND_S: f64 = 0.0;

/// A normal this close to length 1 is kept bit by bit, so that what was saved reads back
/// the same.
const UNIT_LENGTH_TOLERANCE: f64 = 1e-12;

/// What an object is, and where.
#[derive(Clone, Copy, Debug, PartialEq)]
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
        let surface = matches!(kind, ObjectKind::HalfSpace { .. } | ObjectKind::Sphere { .. });
        let refuse = |field, value: &str, allowed| Err(FieldError::new(field, value, allowed));
        match &material {
            None if surface => return refuse("material", "(none)", "a surface needs a material"),
            Some(_) if !surface => return refuse("material", "(set)", "a field has no material"),
            Some(material) => check_material(material)?,
            None if hollow => return refuse("hollow", "true", "only a surface can be hollow"),
            None => {}
        }
        Ok(Self { id, kind, material, hollow, revision: 0 })
    }

    /// The same object as of a revision of its scene.
    #[must_use]
    pub(super) fn at_revision(self, revision: u64) -> Self {
        Self { revision, ..self }
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
        let shape = match self.kind {
            ObjectKind::HalfSpace { point_m, normal } => {
                Shape::HalfSpace { point_W_m: point_m, normal_W: normal }
            }
            ObjectKind::Sphere { centre_m, radius_m } => {
                Shape::Sphere { centre_W_m: centre_m, radius_m }
            }
            ObjectKind::Constant { force_N } => {
                return Element::ConstantField { force_W_N: force_N };
            }
            ObjectKind::Viscous { damping_Ns_per_m } => {
                return Element::ViscousField { damping_Ns_per_m };
            }
        };
        let material = self.material.unwrap_or_default();
        Element::Surface(Surface { shape, material, hollow: self.hollow, blend_s: BLEND_S })
    }
}

fn check_kind(kind: ObjectKind) -> Result<ObjectKind, FieldError> {
    match kind {
        ObjectKind::HalfSpace { point_m, normal } => {
            check_vector("half_space.point_m", &point_m, &units::POSITION)?;
            let normal = unit("half_space.normal", &normal)?;
            Ok(ObjectKind::HalfSpace { point_m, normal })
        }
        ObjectKind::Sphere { centre_m, radius_m } => {
            check_vector("sphere.centre_m", &centre_m, &units::POSITION)?;
            units::RADIUS.check("sphere.radius_m", radius_m)?;
            Ok(kind)
        }
        ObjectKind::Constant { force_N } => {
            check_vector("constant.force_n", &force_N, &units::FORCE)?;
            Ok(kind)
        }
        ObjectKind::Viscous { damping_Ns_per_m } => {
            units::DAMPING.check("viscous.damping_ns_per_m", damping_Ns_per_m)?;
            Ok(kind)
        }
    }
}

fn check_material(material: &Material) -> Result<(), FieldError> {
    let Material { stiffness_N_per_m, damping_Ns_per_m, static_friction, .. } = *material;
    units::STIFFNESS.check("material.stiffness_n_per_m", stiffness_N_per_m)?;
    units::DAMPING.check("material.damping_ns_per_m", damping_Ns_per_m)?;
    units::FRICTION.check("material.friction", static_friction)?;
    Ok(())
}

fn check_vector(
    field: &str,
    vector: &Vector3<f64>,
    range: &units::Range,
) -> Result<(), FieldError> {
    for (axis, &value) in ["x", "y", "z"].iter().zip(vector) {
        range.check(&format!("{field}.{axis}"), value)?;
    }
    Ok(())
}

fn unit(field: &str, vector: &Vector3<f64>) -> Result<Vector3<f64>, FieldError> {
    let length = units::NORMAL_LENGTH.check(field, vector.norm())?;
    let is_unit = (length - 1.0).abs() <= UNIT_LENGTH_TOLERANCE;
    Ok(if is_unit { *vector } else { vector / length })
}

#[cfg(test)]
mod tests {
    use super::*;

    const STIFF: Material = Material {
        stiffness_N_per_m: 1e7,
        damping_Ns_per_m: 10.0,
        static_friction: 0.2,
        kinetic_friction: 0.2,
        surface_velocity_W_m_per_s: Vector3::new(0.0, 0.0, 0.0),
    };

    fn object(kind: ObjectKind, material: Option<Material>) -> Result<SceneObject, FieldError> {
        SceneObject::new(Id::parse("id", "thing").unwrap(), kind, material, false)
    }

    fn wall(normal: Vector3<f64>) -> ObjectKind {
        ObjectKind::HalfSpace { point_m: Vector3::new(0.3, 0.0, 0.0), normal }
    }

    #[test]
    fn a_normal_comes_out_with_length_one_and_stays_as_it_is() {
        let normal = Vector3::new(-3.0, 4.0, 0.1);
        let once = object(wall(normal), Some(STIFF)).unwrap();
        let ObjectKind::HalfSpace { normal: unit, .. } = *once.kind() else { panic!() };
        assert!((unit.norm() - 1.0).abs() < 1e-15 && unit.cross(&normal).norm() < 1e-15);
        assert_eq!(object(*once.kind(), Some(STIFF)).unwrap(), once);
    }

    #[test]
    fn each_field_is_refused_by_its_name() {
        let x = |x| Vector3::new(x, 0.0, 0.0);
        let sphere = |x_m, radius_m| ObjectKind::Sphere { centre_m: x(x_m), radius_m };
        let material = |stiffness, damping, friction| {
            let surface = Material {
                stiffness_N_per_m: stiffness,
                damping_Ns_per_m: damping,
                ..STIFF.with_friction(friction)
            };
            object(wall(-Vector3::x()), Some(surface))
        };
        let refusals = [
            (object(wall(x(0.0)), Some(STIFF)), "half_space.normal"),
            (object(wall(x(f64::NAN)), Some(STIFF)), "half_space.normal"),
            (object(wall(x(1e200)), Some(STIFF)), "half_space.normal"),
            (object(sphere(101.0, 0.1), Some(STIFF)), "sphere.centre_m.x"),
            (object(sphere(0.0, 0.0), Some(STIFF)), "sphere.radius_m"),
            (object(sphere(0.0, f64::INFINITY), Some(STIFF)), "sphere.radius_m"),
            (object(ObjectKind::Constant { force_N: x(f64::NAN) }, None), "constant.force_n.x"),
            (
                object(ObjectKind::Viscous { damping_Ns_per_m: -1.0 }, None),
                "viscous.damping_ns_per_m",
            ),
            (material(-1.0, 0.0, 0.0), "material.stiffness_n_per_m"),
            (material(f64::NAN, 0.0, 0.0), "material.stiffness_n_per_m"),
            (material(0.0, -1.0, 0.0), "material.damping_ns_per_m"),
            (material(0.0, 0.0, 11.0), "material.friction"),
            (object(sphere(0.0, 0.1), None), "material"),
            (object(ObjectKind::Viscous { damping_Ns_per_m: 1.0 }, Some(STIFF)), "material"),
        ];
        for (refused, field) in refusals {
            assert_eq!(refused.unwrap_err().field, field);
        }
        let id = Id::parse("id", "air").unwrap();
        let hollow =
            SceneObject::new(id, ObjectKind::Viscous { damping_Ns_per_m: 1.0 }, None, true);
        assert_eq!(hollow.unwrap_err().field, "hollow");
    }

    #[test]
    fn the_loop_sees_the_same_thing() {
        let sphere = ObjectKind::Sphere { centre_m: Vector3::y(), radius_m: 0.1 };
        let Element::Surface(surface) = object(sphere, Some(STIFF)).unwrap().element() else {
            panic!("a sphere is a surface")
        };
        let shape = Shape::Sphere { centre_W_m: Vector3::y(), radius_m: 0.1 };
        assert_eq!((surface.shape, surface.material), (shape, STIFF));
        let field = object(ObjectKind::Constant { force_N: Vector3::z() }, None).unwrap();
        assert_eq!(field.element(), Element::ConstantField { force_W_N: Vector3::z() });
    }
}
