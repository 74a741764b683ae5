//! Values of the contract from values of the core, and back where somebody may write.

use nalgebra::{UnitQuaternion, Vector3};

use crate::config::{Id, ObjectKind, Scene, SceneObject};
use crate::control::{self, Report};
use crate::environment::{Material, Source};
use crate::host::DeviceHost;
use crate::proto;
use crate::proto::scene_object::Kind;
use crate::units::FieldError;

use super::names;

/// A vector of W.
pub fn vector(v: &Vector3<f64>) -> Option<proto::Vector3> {
    Some(proto::Vector3 { x: v.x, y: v.y, z: v.z })
}

fn vector_of(field: &str, v: Option<&proto::Vector3>) -> Result<Vector3<f64>, FieldError> {
    let v = v.ok_or_else(|| FieldError::new(field, "(none)", "is required"))?;
    Ok(Vector3::new(v.x, v.y, v.z))
}

/// A pose of W.
pub fn pose(p_m: &Vector3<f64>, q: &UnitQuaternion<f64>) -> Option<proto::Pose> {
    let q = q.coords;
    let orientation = Some(proto::Quaternion { x: q.x, y: q.y, z: q.z, w: q.w });
    Some(proto::Pose { position_m: vector(p_m), orientation })
}

fn wrench(wrench: &control::Wrench) -> Option<proto::Wrench> {
    Some(proto::Wrench { force_n: vector(&wrench.force_N), moment_nm: vector(&wrench.moment_Nm) })
}

/// An object as the contract shows it.
pub fn object_to_proto(host: &DeviceHost, object: &SceneObject) -> proto::SceneObject {
    let kind = match object.kind() {
        ObjectKind::HalfSpace { point_m, normal } => {
            Kind::HalfSpace(proto::HalfSpace { point_m: vector(point_m), normal: vector(normal) })
        }
        ObjectKind::Sphere { centre_m, radius_m } => {
            Kind::Sphere(proto::Sphere { centre_m: vector(centre_m), radius_m: *radius_m })
        }
        ObjectKind::Constant { force_N } => {
            Kind::Constant(proto::ConstantField { force_n: vector(force_N) })
        }
        ObjectKind::Viscous { damping_Ns_per_m } => {
            Kind::Viscous(proto::ViscousField { damping_ns_per_m: *damping_Ns_per_m })
        }
    };
    proto::SceneObject {
        name: names::object(host, object.id().as_str()),
        kind: Some(kind),
        material: object.material().map(|material| proto::Material {
            stiffness_n_per_m: material.stiffness_N_per_m,
            damping_ns_per_m: material.damping_Ns_per_m,
            friction: material.static_friction,
        }),
        hollow: object.hollow(),
        revision: object.revision(),
    }
}

/// An object that somebody wrote, checked.
pub fn object_from_proto(id: Id, object: &proto::SceneObject) -> Result<SceneObject, FieldError> {
    let kind = match &object.kind {
        None => {
            let one_of = "one of half_space, sphere, constant, viscous is required";
            return Err(FieldError::new("object.kind", "(none)", one_of));
        }
        Some(Kind::HalfSpace(half_space)) => ObjectKind::HalfSpace {
            point_m: vector_of("object.half_space.point_m", half_space.point_m.as_ref())?,
            normal: vector_of("object.half_space.normal", half_space.normal.as_ref())?,
        },
        Some(Kind::Sphere(sphere)) => ObjectKind::Sphere {
            centre_m: vector_of("object.sphere.centre_m", sphere.centre_m.as_ref())?,
            radius_m: sphere.radius_m,
        },
        Some(Kind::Constant(field)) => ObjectKind::Constant {
            force_N: vector_of("object.constant.force_n", field.force_n.as_ref())?,
        },
        Some(Kind::Viscous(field)) => {
            ObjectKind::Viscous { damping_Ns_per_m: field.damping_ns_per_m }
        }
    };
    let material = object.material.as_ref().map(|material| Material {
        stiffness_N_per_m: material.stiffness_n_per_m,
        damping_Ns_per_m: material.damping_ns_per_m,
        ..Material::default().with_friction(material.friction)
    });
    SceneObject::new(id, kind, material, object.hollow).map_err(|error| error.within("object"))
}

/// What the last tick sensed and decided.
pub fn state_to_proto(host: &DeviceHost, report: &Report) -> proto::DeviceState {
    let known = report.rendered_source != control::RenderedSource::Unknown;
    proto::DeviceState {
        name: names::device(host),
        mode: proto::Mode::from(report.mode).into(),
        tick: report.tick,
        device_time_ns: report.time_ns,
        measured_cp: pose(&report.p_WT_m, &report.q_WT),
        measured_cv: Some(proto::Twist {
            linear_m_per_s: vector(&report.v_WT_m_per_s),
            angular_rad_per_s: vector(&report.omega_WT_rad_per_s),
        }),
        measured_cf: report.hand.as_ref().and_then(wrench),
        requested: wrench(&report.requested),
        achievable: wrench(&report.achievable),
        rendered: wrench(&report.rendered).filter(|_| known),
        rendered_source: proto::RenderedSource::from(report.rendered_source).into(),
        region: report.region.map_or(proto::Region::Unspecified, Into::into).into(),
        approximation_angle_rad: report.approximation_angle_rad,
        stuck: report.stuck,
        limits: limits(report).map(i32::from).collect(),
        law: report.law.map_or(proto::Strategy::Unspecified, Into::into).into(),
        scene_revision: report.scene_revision,
        contacts: contacts(host, report),
        actuators: actuators(host, report),
        fault: report.fault.map_or(proto::Fault::Unspecified, Into::into).into(),
        command_seq: report.command_seq,
        buttons: report.buttons,
        homing: homing(host, report).into(),
    }
}

fn homing(host: &DeviceHost, report: &Report) -> proto::Homing {
    match (host.definition().home_m, report.homed) {
        (None, _) => proto::Homing::NotNeeded,
        (Some(_), false) => proto::Homing::Needed,
        (Some(_), true) => proto::Homing::Done,
    }
}

fn limits(report: &Report) -> impl Iterator<Item = proto::Limit> + '_ {
    let active = control::Limit::ALL.into_iter().filter(|limit| report.limits.contains(*limit));
    active.map(Into::into)
}

fn contacts(host: &DeviceHost, report: &Report) -> Vec<proto::ContactState> {
    let scene = host.scene();
    let state = |contact: &control::ContactResult| proto::ContactState {
        name: surface(host, &scene, contact.source, contact.id),
        depth_m: contact.depth_m,
        normal_n: contact.normal_N,
        friction_n: contact.friction_N,
    };
    report.contacts().iter().map(state).collect()
}

/// The name of a surface that is touched; empty for an object that is gone.
pub fn surface(host: &DeviceHost, scene: &Scene, source: Source, id: u32) -> String {
    match source {
        Source::Controller => format!("contacts/{id}"),
        Source::Scene => {
            let placed = scene.placed();
            let object = placed.iter().find(|(slot, _)| u32::from(*slot) == id);
            object.map_or_else(String::new, |(_, object)| names::object(host, object.id().as_str()))
        }
    }
}

fn actuators(host: &DeviceHost, report: &Report) -> Vec<proto::ActuatorState> {
    let names = host.definition().actuator_names.iter().enumerate();
    let state = |(i, name): (usize, &Id)| proto::ActuatorState {
        name: name.to_string(),
        angle_rad: report.shaft_rad[i],
        rate_rad_per_s: report.shaft_rad_per_s[i],
        lower_nm: report.bounds.lower_Nm[i],
        upper_nm: report.bounds.upper_Nm[i],
        commanded_nm: report.commanded_Nm[i],
    };
    names.map(state).collect()
}
