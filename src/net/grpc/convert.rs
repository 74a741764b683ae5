//! What a device senses and does, as the contract shows it. Objects of a scene, which come in
//! as well, are in [`crate::config`].

use nalgebra::{UnitQuaternion, Vector3};

use crate::config::{Id, Scene};
use crate::control::{self, Report};
use crate::environment::Source;
use crate::host::DeviceHost;
use crate::proto;

use super::names;

/// A vector of W.
pub fn vector(v: &Vector3<f64>) -> Option<proto::Vector3> {
    Some(proto::Vector3 { x: v.x, y: v.y, z: v.z })
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
