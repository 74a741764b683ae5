//! One object of a resident scene as `scene.proto` has it, to and from the checked value.
//!
//! What comes in is complete and well formed here, and in range by [`SceneObject::new`]; a
//! refusal names the field relative to the object. What goes out is written as short as it
//! can be: no orientation where nothing is turned, no static friction where it is the kinetic
//! one. So what goes out comes in as it was, and goes out again unchanged. Resource names are
//! the caller's.

use nalgebra::{Quaternion, Vector3};

use super::object_check::{matrix, numbers};
use super::{GuidePath, Id, ObjectKind, SceneObject};
use crate::environment::Material;
use crate::proto::{self, guide::Path, scene_object::Kind};
use crate::units::FieldError;

/// The kinds there are, for refusals.
pub(super) const KINDS: &str = "half_space, sphere, box, capsule, corridor, guide, constant, \
                                viscous, force_field";

/// An object that somebody wrote, checked. Its name and revision are not looked at.
pub fn object_from_proto(id: Id, object: &proto::SceneObject) -> Result<SceneObject, FieldError> {
    let Some(kind) = &object.kind else {
        return Err(FieldError::new("kind", "(none)", format!("one of {KINDS} is required")));
    };
    let material = object.material.as_ref().map(material_from_proto);
    SceneObject::new(id, kind_from_proto(kind)?, material, object.hollow)
}

/// An object as the contract shows it, under this resource name.
pub fn object_to_proto(object: &SceneObject, name: String) -> proto::SceneObject {
    proto::SceneObject {
        name,
        revision: object.revision(),
        material: object.material().map(material_to_proto),
        hollow: object.hollow(),
        kind: Some(kind_to_proto(object.kind())),
    }
}

fn kind_from_proto(kind: &Kind) -> Result<ObjectKind, FieldError> {
    Ok(match kind {
        Kind::HalfSpace(wall) => ObjectKind::HalfSpace {
            point_m: vector("half_space.point_m", &wall.point_m)?,
            normal: vector("half_space.normal", &wall.normal)?,
        },
        Kind::Sphere(ball) => ObjectKind::Sphere {
            centre_m: vector("sphere.centre_m", &ball.centre_m)?,
            radius_m: ball.radius_m,
        },
        Kind::Box(block) => ObjectKind::Box {
            centre_m: vector("box.centre_m", &block.centre_m)?,
            half_extents_m: vector("box.half_extents_m", &block.half_extents_m)?,
            orientation: block
                .orientation
                .as_ref()
                .map_or(Quaternion::identity(), |q| Quaternion::new(q.w, q.x, q.y, q.z)),
        },
        Kind::Capsule(capsule) => {
            let [a, b] = capsule.ends_m.as_slice() else {
                let found = format!("{} points", capsule.ends_m.len());
                return Err(FieldError::new("capsule.ends_m", found, "must be 2"));
            };
            ObjectKind::Capsule { ends_m: [*a, *b].map(to_vector), radius_m: capsule.radius_m }
        }
        Kind::Corridor(corridor) => ObjectKind::Corridor {
            points_m: corridor.points_m.iter().copied().map(to_vector).collect(),
            radius_m: corridor.radius_m,
        },
        Kind::Guide(guide) => {
            ObjectKind::Guide { path: path_from_proto(&guide.path)?, radius_m: guide.radius_m }
        }
        Kind::Constant(field) => {
            ObjectKind::Constant { force_N: vector("constant.force_n", &field.force_n)? }
        }
        Kind::Viscous(field) => ObjectKind::Viscous { damping_Ns_per_m: field.damping_ns_per_m },
        Kind::ForceField(field) => field_from_proto(field)?,
    })
}

fn path_from_proto(path: &Option<Path>) -> Result<GuidePath, FieldError> {
    Ok(match path {
        None => {
            let allowed = "one of point, line, plane is required";
            return Err(FieldError::new("guide.path", "(none)", allowed));
        }
        Some(Path::Point(point)) => {
            GuidePath::Point { point_m: vector("guide.point.point_m", &point.point_m)? }
        }
        Some(Path::Line(line)) => GuidePath::Line {
            point_m: vector("guide.line.point_m", &line.point_m)?,
            direction: vector("guide.line.direction", &line.direction)?,
        },
        Some(Path::Plane(plane)) => GuidePath::Plane {
            point_m: vector("guide.plane.point_m", &plane.point_m)?,
            normal: vector("guide.plane.normal", &plane.normal)?,
        },
    })
}

fn field_from_proto(field: &proto::ForceField) -> Result<ObjectKind, FieldError> {
    let wrench = field.wrench.unwrap_or_default();
    let or_zero = |part: Option<proto::Vector3>| part.map_or(Vector3::zeros(), to_vector);
    let stiffness = "force_field.stiffness_n_per_m";
    Ok(ObjectKind::ForceField {
        origin_m: vector("force_field.origin_m", &field.origin_m)?,
        force_N: or_zero(wrench.force_n),
        moment_Nm: or_zero(wrench.moment_nm),
        stiffness_N_per_m: matrix(stiffness, &field.stiffness_n_per_m)?,
        damping_Ns_per_m: matrix("force_field.damping_ns_per_m", &field.damping_ns_per_m)?,
        radius_m: field.radius_m,
    })
}

fn kind_to_proto(kind: &ObjectKind) -> Kind {
    match kind {
        ObjectKind::HalfSpace { point_m, normal } => {
            Kind::HalfSpace(proto::HalfSpace { point_m: some(point_m), normal: some(normal) })
        }
        ObjectKind::Sphere { centre_m, radius_m } => {
            Kind::Sphere(proto::Sphere { centre_m: some(centre_m), radius_m: *radius_m })
        }
        ObjectKind::Box { centre_m, half_extents_m, orientation: q } => {
            let turned = *q != Quaternion::identity();
            let orientation =
                turned.then_some(proto::Quaternion { x: q.i, y: q.j, z: q.k, w: q.w });
            let (centre_m, half_extents_m) = (some(centre_m), some(half_extents_m));
            Kind::Box(proto::Box { centre_m, half_extents_m, orientation })
        }
        ObjectKind::Capsule { ends_m, radius_m } => Kind::Capsule(proto::Capsule {
            ends_m: ends_m.iter().filter_map(some).collect(),
            radius_m: *radius_m,
        }),
        ObjectKind::Corridor { points_m, radius_m } => Kind::Corridor(proto::Corridor {
            points_m: points_m.iter().filter_map(some).collect(),
            radius_m: *radius_m,
        }),
        ObjectKind::Guide { path, radius_m } => {
            Kind::Guide(proto::Guide { radius_m: *radius_m, path: Some(path_to_proto(path)) })
        }
        ObjectKind::Constant { force_N } => {
            Kind::Constant(proto::ConstantField { force_n: some(force_N) })
        }
        ObjectKind::Viscous { damping_Ns_per_m } => {
            Kind::Viscous(proto::ViscousField { damping_ns_per_m: *damping_Ns_per_m })
        }
        ObjectKind::ForceField {
            origin_m,
            force_N,
            moment_Nm,
            stiffness_N_per_m,
            damping_Ns_per_m,
            radius_m,
        } => Kind::ForceField(proto::ForceField {
            origin_m: some(origin_m),
            wrench: Some(proto::Wrench { force_n: some(force_N), moment_nm: some(moment_Nm) }),
            stiffness_n_per_m: numbers(stiffness_N_per_m),
            damping_ns_per_m: numbers(damping_Ns_per_m),
            radius_m: *radius_m,
        }),
    }
}

fn path_to_proto(path: &GuidePath) -> Path {
    match path {
        GuidePath::Point { point_m } => Path::Point(proto::GuidePoint { point_m: some(point_m) }),
        GuidePath::Line { point_m, direction } => {
            Path::Line(proto::GuideLine { point_m: some(point_m), direction: some(direction) })
        }
        GuidePath::Plane { point_m, normal } => {
            Path::Plane(proto::GuidePlane { point_m: some(point_m), normal: some(normal) })
        }
    }
}

fn material_from_proto(material: &proto::Material) -> Material {
    let kinetic_friction = material.kinetic_friction;
    Material {
        stiffness_N_per_m: material.stiffness_n_per_m,
        damping_Ns_per_m: material.damping_ns_per_m,
        kinetic_friction,
        static_friction: material.static_friction.unwrap_or(kinetic_friction),
        surface_velocity_W_m_per_s: material
            .surface_velocity_m_per_s
            .map_or(Vector3::zeros(), to_vector),
    }
}

fn material_to_proto(material: &Material) -> proto::Material {
    let Material { static_friction, kinetic_friction, .. } = *material;
    let velocity = &material.surface_velocity_W_m_per_s;
    proto::Material {
        stiffness_n_per_m: material.stiffness_N_per_m,
        damping_ns_per_m: material.damping_Ns_per_m,
        kinetic_friction,
        static_friction: (static_friction != kinetic_friction).then_some(static_friction),
        surface_velocity_m_per_s: some(velocity).filter(|_| *velocity != Vector3::zeros()),
    }
}

fn some(v: &Vector3<f64>) -> Option<proto::Vector3> {
    Some(proto::Vector3 { x: v.x, y: v.y, z: v.z })
}

fn to_vector(v: proto::Vector3) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

fn vector(field: &str, v: &Option<proto::Vector3>) -> Result<Vector3<f64>, FieldError> {
    v.map(to_vector).ok_or_else(|| FieldError::new(field, "(none)", "is required"))
}

#[cfg(test)]
mod tests;
