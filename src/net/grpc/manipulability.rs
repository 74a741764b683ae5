//! GetManipulability: what the actuators can do where the handle is, or would be.

use std::sync::Arc;

use tonic::Status;

use super::desk::Desk;
use super::devices::report;
use super::{convert, field_status, names};
use crate::analysis::manipulability::{manipulability, shaft_motion};
use crate::control::Report;
use crate::host::DeviceHost;
use crate::mechanism::{Posture, Rays};
use crate::notation::PlaneVector;
use crate::proto;
use crate::units::{FieldError, POSITION, Range};

/// Directions of force when none are asked for, and at most.
const USUAL_DIRECTIONS: u32 = 36;
const MOST_DIRECTIONS: u32 = 360;

/// A handle slower than this rests: an ordinary encoder's count in a window of 15 ms.
const REST_M_PER_S: f64 = 1e-3;

/// A direction; some turns more do no harm.
const ANGLE: Range = Range::new(-100.0, 100.0, "rad");

/// The account of a posture.
pub async fn get(
    desk: &Desk,
    request: &proto::GetManipulabilityRequest,
) -> Result<proto::Manipulability, Status> {
    let refused = |error: FieldError| field_status(&error);
    let host = &desk.host;
    let report = report(host).await;
    let directions = directions(request.directions).map_err(refused)?;
    let posture = posture(host, request, &report).map_err(refused)?;
    let motion_rad = match (request.motion_rad, &request.handle_m) {
        (Some(angle_rad), _) => Some(ANGLE.check("motion_rad", angle_rad).map_err(refused)?),
        (None, None) => motion_rad(host, &report),
        (None, Some(_)) => None,
    };
    let host = Arc::clone(host);
    desk.looks.run(move || Ok(to_proto(&host, &posture, motion_rad, directions))).await
}

fn directions(asked: u32) -> Result<usize, FieldError> {
    match asked {
        0 => Ok(USUAL_DIRECTIONS as usize),
        1..=MOST_DIRECTIONS => Ok(asked as usize),
        _ => {
            let allowed = format!("must be 1 to {MOST_DIRECTIONS}, or 0 for {USUAL_DIRECTIONS}");
            Err(FieldError::new("directions", asked, allowed))
        }
    }
}

fn posture(
    host: &DeviceHost,
    request: &proto::GetManipulabilityRequest,
    report: &Report,
) -> Result<Posture, FieldError> {
    let p_BH = match &request.handle_m {
        None if !report.homed => {
            let allowed = "is required: where the handle is, is not known before Home";
            return Err(FieldError::new("handle_m", "(none)", allowed));
        }
        None => report.p_BH,
        Some(at) => PlaneVector::new(
            POSITION.check("handle_m.x", at.x)?,
            POSITION.check("handle_m.y", at.y)?,
            0.0,
        ),
    };
    host.definition().mechanism.posture_at(&p_BH).map_err(|error| {
        let place = format!("({}, {}) m", p_BH.x, p_BH.y);
        FieldError::new("handle_m", place, format!("must be within reach: {error}"))
    })
}

/// Which way the handle moves in the device's plane, if it does.
fn motion_rad(host: &DeviceHost, report: &Report) -> Option<f64> {
    let v_B = host.settings().settings.mount.q_WB.inverse() * report.v_WT_m_per_s;
    (v_B.x.hypot(v_B.y) > REST_M_PER_S).then(|| v_B.y.atan2(v_B.x))
}

fn to_proto(
    host: &DeviceHost,
    posture: &Posture,
    motion_rad: Option<f64>,
    directions: usize,
) -> proto::Manipulability {
    let device = host.definition();
    let capability = device.capability(posture, &shaft_motion(&posture.reference, motion_rad));
    let max_torque_Nm = &device.actuators.max_torque_Nm;
    let found = manipulability(&capability, max_torque_Nm, motion_rad, directions);
    let rays = Rays::of(&posture.reference, capability.actuators);
    let columns = device.actuator_names.iter().zip(posture.reference.column_iter());
    proto::Manipulability {
        name: names::device(host),
        handle_m: convert::vector(&nalgebra::Vector3::new(posture.p_BH.x, posture.p_BH.y, 0.0)),
        motion_rad,
        reference_forces: columns
            .map(|(name, column)| proto::ReferenceForce {
                actuator: name.to_string(),
                per_nm: convert::vector(&column.into_owned()),
            })
            .collect(),
        singular_values: found.singular_values,
        weighted_singular_values_n: found.weighted_singular_values_N,
        condition: found.condition,
        sectors: found
            .sectors
            .iter()
            .map(|sector| proto::RegionSector {
                from_rad: sector.from_rad,
                to_rad: sector.to_rad,
                region: proto::Region::from(sector.region).into(),
            })
            .collect(),
        largest: found
            .largest
            .iter()
            .map(|force| proto::LargestForce {
                angle_rad: force.angle_rad,
                now_n: force.now_N,
                range_n: force.range_N,
            })
            .collect(),
        p_a: rays.as_ref().map(Rays::P_a),
        p_f: rays.as_ref().map(Rays::P_f),
    }
}
