//! Explain: the account of the last tick, with what its report does not say.

use std::sync::Arc;

use tonic::Status;

use super::desk::Desk;
use super::devices::report;
use super::{convert, field_status, names};
use crate::actuation::ShaftMotion;
use crate::clock::now_ns;
use crate::control::{Mount, Report};
use crate::explain::{Circumstances, Explanation, Reason, explain, surroundings};
use crate::host::DeviceHost;
use crate::net::SessionDesk;
use crate::notation::{MAX_ACTUATORS, PlaneVector};
use crate::proto;
use crate::session::{Role, SessionId, Switchboard};
use crate::units::FieldError;

/// What is known of the sessions of a device.
#[derive(Clone, Debug, Default)]
pub struct Who {
    /// Name of the client that commands.
    pub controller: Option<String>,
    /// Role of the session that asks.
    pub asked_by: Option<Role>,
}

/// Who commands a device, and the session that asks ("": none).
pub async fn who(desk: &SessionDesk, device: String, session: &str) -> Result<Who, Status> {
    let refuse = |allowed: String| {
        field_status(&FieldError::new("session", format!("{session:?}"), allowed))
    };
    let asks = match SessionId::parse(session) {
        None if !session.is_empty() => return Err(refuse("must be sessions/ID or empty".into())),
        asks => asks,
    };
    let called = device.clone();
    let find = move |board: &mut Switchboard, now_ns: u64| {
        let sessions = board.devices().find(|sessions| sessions.device_name() == called)?;
        let of = |id| sessions.info(id, now_ns);
        let controller = sessions.lease().holder.and_then(of);
        let controller = controller.map(|session| session.client_name.to_owned());
        let asked_by = asks.map(|id| of(id).map(|session| session.role));
        Some((controller, asked_by))
    };
    let found = desk.ask(find).await.flatten();
    let (controller, asked_by) =
        found.ok_or_else(|| Status::unavailable("the stream has ended"))?;
    match asked_by {
        Some(None) => {
            Err(refuse(format!("must be a session of {device}, as ListSessions has them")))
        }
        asked_by => Ok(Who { controller, asked_by: asked_by.flatten() }),
    }
}

/// Explains the last tick to whom it may concern.
pub async fn of_last_tick(
    desk: &Desk,
    request: &proto::ExplainRequest,
    mut who: Who,
) -> Result<proto::Explanation, Status> {
    who.asked_by = who.asked_by.or(role(request.role)?);
    let report = report(&desk.host).await;
    let host = Arc::clone(&desk.host);
    let told = move || {
        Ok(to_proto(&host, &report, &explain(&report, &circumstances(&host, &report, &who))))
    };
    desk.looks.run(told).await
}

fn circumstances<'a>(host: &DeviceHost, report: &Report, who: &'a Who) -> Circumstances<'a> {
    let (device, settings) = (host.definition(), host.settings().settings);
    let ago_s = |then_ns: u64| now_ns().saturating_sub(then_ns) as f64 * 1e-9;
    Circumstances {
        controller: who.controller.as_deref(),
        asked_by: who.asked_by,
        around: surroundings(device, &settings, &host.scene(), &report.p_WT_m),
        force_gain: settings.guards.force_gain,
        force_limit_N: settings.guards.force_limit_N,
        range_N: range_N(host, report, &settings.mount),
        ran_out_s: host.events().ran_out_ns().map(ago_s),
    }
}

/// What the device could give at most in the direction asked.
fn range_N(host: &DeviceHost, report: &Report, mount: &Mount) -> Option<f64> {
    let device = host.definition();
    let posture = device.mechanism.posture_at(&report.p_BH).ok()?;
    let asked_B_N = mount.q_WB.inverse() * report.requested.force_N;
    let direction = PlaneVector::new(asked_B_N.x, asked_B_N.y, 0.0);
    let capability = device.capability(&posture, &[ShaftMotion::Rest; MAX_ACTUATORS]);
    (direction.norm() > 0.0).then(|| capability.range_N(&direction))
}

fn role(number: i32) -> Result<Option<Role>, Status> {
    match proto::Role::try_from(number) {
        Ok(proto::Role::Unspecified) => Ok(None),
        Ok(proto::Role::Observer) => Ok(Some(Role::Observer)),
        Ok(proto::Role::Controller) => Ok(Some(Role::Controller)),
        Ok(proto::Role::Hand) => Ok(Some(Role::Hand)),
        Err(_) => {
            let allowed = "must be ROLE_OBSERVER, ROLE_CONTROLLER, ROLE_HAND or left out";
            Err(field_status(&FieldError::new("role", number, allowed)))
        }
    }
}

fn to_proto(host: &DeviceHost, report: &Report, told: &Explanation) -> proto::Explanation {
    let reason = |(reason, text): &(Reason, String)| proto::ReasonText {
        reason: proto::Reason::from(*reason).into(),
        text: text.clone(),
    };
    let link = |link: &crate::explain::Link| proto::ChainLink {
        name: link.name.to_owned(),
        text: link.text.clone(),
        force_n: link.force_W_N.as_ref().and_then(convert::vector),
    };
    proto::Explanation {
        name: names::device(host),
        tick: report.tick,
        device_time_ns: report.time_ns,
        summary: told.summary.clone(),
        reasons: told.reasons.iter().map(reason).collect(),
        chain: told.chain.iter().map(link).collect(),
    }
}

impl From<Reason> for proto::Reason {
    fn from(reason: Reason) -> Self {
        match reason {
            Reason::Fault => Self::Fault,
            Reason::Stopped => Self::Stopped,
            Reason::NotHomed => Self::NotHomed,
            Reason::Disabled => Self::Disabled,
            Reason::Clutched => Self::Clutched,
            Reason::Stale => Self::Stale,
            Reason::NoGain => Self::NoGain,
            Reason::Observer => Self::Observer,
            Reason::NoScene => Self::NoScene,
            Reason::GivenAway => Self::GivenAway,
            Reason::OutOfReach => Self::OutOfReach,
            Reason::NothingTouched => Self::NothingTouched,
            Reason::OutsideFreedoms => Self::OutsideFreedoms,
            Reason::NotDisplayable => Self::NotDisplayable,
            Reason::ForceLimit => Self::ForceLimit,
            Reason::DeviceRange => Self::DeviceRange,
            Reason::TorqueLimit => Self::TorqueLimit,
            Reason::Softened => Self::Softened,
            Reason::HeldBack => Self::HeldBack,
            Reason::Activation => Self::Activation,
            Reason::Slew => Self::Slew,
            Reason::TooManyContacts => Self::TooManyContacts,
            Reason::Gain => Self::Gain,
            Reason::Approximate => Self::Approximate,
            Reason::Stuck => Self::Stuck,
            Reason::Unmeasured => Self::Unmeasured,
        }
    }
}
