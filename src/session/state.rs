//! A tick's Report as the State that clients get.
//!
//! Most of a State is the same for every session and is filled in once per tick, into
//! buffers that keep their room; what differs is added session by session. What is unknown
//! is absent, never zero: the hand force without a sensor, a rendered wrench of unknown
//! source, an angle that is not defined. Numbers that grow without bound are kept small
//! enough for the State's size.

use crate::control::{RenderedSource, Report, Wrench};
use crate::environment::MAX_TOUCHES;
use crate::notation::ActuatorVector;
use crate::proto::{self, SessionState, State};
use crate::wire::{ContactPart, Detail, number, put_pair, put3};

use super::Quality;
use super::mapping::surface_id;
use super::workspace::{View, Workspace};

/// Where `command_lag_ticks` saturates: two bytes on the wire, 16 s at 1 kHz.
pub(super) const MAX_LAG_TICKS: u32 = (1 << 14) - 1;

/// What State echoes of the newest command received.
#[derive(Clone, Copy, Debug)]
pub(super) struct Echo {
    /// The client's clock in that command.
    pub client_time_ns: u64,
    /// Device clock at its receipt.
    pub received_ns: u64,
}

/// Fills in what is the same for every session; contacts are added when it is encoded.
pub(super) fn fill(state: &mut State, report: &Report) {
    state.seq = report.tick;
    state.device_time_ns = report.time_ns;
    fill_motion(state, report);
    fill_wrenches(state, report);
    state.region = report.region.map_or(0, |region| proto::Region::from(region).into());
    let angle_rad = report.approximation_angle_rad;
    state.approximation_angle_rad = angle_rad.filter(|angle| angle.is_finite()).map(number);
    state.stuck = report.stuck;
    state.limits = report.limits.bits();
    state.law = report.law.map_or(0, |law| proto::Strategy::from(law).into());
    state.mode = proto::Mode::from(report.mode).into();
    state.buttons = report.buttons;
    state.command_seq = report.command_seq;
    state.command_lag_ticks = lag_ticks(report);
    state.scene_revision = report.scene_revision;
}

fn fill_motion(state: &mut State, report: &Report) {
    state.orientation.clear();
    let xyzw = report.q_WT.coords.map(number);
    if xyzw.xyz() != nalgebra::Vector3::zeros() {
        state.orientation.extend_from_slice(xyzw.as_slice());
    }
}

/// Fills in where the tool is in a session's own world.
fn fill_view(state: &mut State, view: &View, report: &Report) {
    put3(&mut state.position_m, view.position_m.into());
    put_pair(&mut state.twist, view.twist_m_per_s.into(), report.omega_WT_rad_per_s.into());
    put3(&mut state.proxy_m, view.proxy_m.into());
}

fn fill_wrenches(state: &mut State, report: &Report) {
    put_known(&mut state.measured_cf, report.hand.as_ref());
    put_known(&mut state.requested, Some(&report.requested));
    put_known(&mut state.achievable, Some(&report.achievable));
    let known = report.rendered_source != RenderedSource::Unknown;
    put_known(&mut state.rendered, known.then_some(&report.rendered));
    state.rendered_source = proto::RenderedSource::from(report.rendered_source).into();
}

fn put_known(floats: &mut Vec<f32>, wrench: Option<&Wrench>) {
    match wrench {
        Some(wrench) => put_pair(floats, wrench.force_N.into(), wrench.moment_Nm.into()),
        None => floats.clear(),
    }
}

fn lag_ticks(report: &Report) -> u32 {
    if report.command_seq == 0 {
        return 0;
    }
    u32::try_from(report.command_lag_ticks).map_or(MAX_LAG_TICKS, |lag| lag.min(MAX_LAG_TICKS))
}

/// What a State tells of the session that it goes to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Own<'a> {
    pub session: SessionState,
    pub quality: Quality,
    pub echo: Option<Echo>,
    pub workspace: &'a Workspace,
}

/// Adds what is one session's own.
pub(super) fn address(state: &mut State, report: &Report, own: &Own<'_>, now_ns: u64) {
    fill_view(state, &own.workspace.view(report), report);
    let echo = own.echo;
    state.session_state = own.session.into();
    state.session_quality = proto::Quality::from(own.quality).into();
    state.echo_client_time_ns = echo.map_or(0, |echo| echo.client_time_ns);
    state.echo_hold_ns = echo.map_or(0, |echo| {
        u32::try_from(now_ns.saturating_sub(echo.received_ns)).unwrap_or(u32::MAX)
    });
}

/// What every actuator does, for those who asked.
pub(super) fn fill_detail(detail: &mut Detail, report: &Report, actuators: usize) {
    let put = |row: &mut Vec<f32>, values: &ActuatorVector| {
        row.clear();
        row.extend(values.iter().take(actuators).map(|value| number(*value)));
    };
    put(&mut detail.rad, &report.shaft_rad);
    put(&mut detail.rad_per_s, &report.shaft_rad_per_s);
    put(&mut detail.lower_Nm, &report.bounds.lower_Nm);
    put(&mut detail.upper_Nm, &report.bounds.upper_Nm);
    put(&mut detail.commanded_Nm, &report.commanded_Nm);
}

/// The surfaces entered, the deepest first.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DeepestFirst {
    parts: [ContactPart; MAX_TOUCHES],
    count: usize,
}

impl DeepestFirst {
    /// Those of one tick.
    pub fn of(report: &Report) -> Self {
        let mut sorted = Self::default();
        for contact in report.contacts() {
            sorted.parts[sorted.count] = ContactPart {
                id: surface_id(contact.source, contact.id),
                depth_m: number(contact.depth_m),
                normal_N: number(contact.normal_N),
                friction_N: number(contact.friction_N),
                sticking: contact.sticking,
            };
            sorted.count += 1;
        }
        sorted.parts[..sorted.count].sort_unstable_by(|a, b| b.depth_m.total_cmp(&a.depth_m));
        sorted
    }

    /// The same in a session's own world.
    pub fn seen_in(mut self, workspace: &Workspace) -> Self {
        for part in &mut self.parts[..self.count] {
            part.depth_m = workspace.depth_m(part.depth_m);
        }
        self
    }

    /// As a slice.
    pub fn as_slice(&self) -> &[ContactPart] {
        &self.parts[..self.count]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuation::{Region, Strategy};
    use crate::control::{ContactResult, Limit, Limits, Mode};
    use crate::environment::Source;
    use crate::wire::{EventPart, StateParts};
    use nalgebra::{UnitQuaternion, Vector3};

    fn own(echo: Option<Echo>) -> Own<'static> {
        let (session, quality) = (SessionState::Commanding, Quality::Excellent);
        Own { session, quality, echo, workspace: &Workspace::SAME }
    }

    fn wrench(x: f64) -> Wrench {
        Wrench { force_N: Vector3::new(x, 0.0, 0.0), moment_Nm: Vector3::zeros() }
    }

    fn busy_report() -> Report {
        let mut limits = Limits::default();
        limits.set(Limit::Torque, true);
        limits.set(Limit::Stale, true);
        let contact = |id, depth_m| ContactResult {
            source: Source::Controller,
            id,
            depth_m,
            normal_N: 1.0,
            friction_N: 2.0,
            sticking: false,
        };
        let mut report = Report {
            tick: 12,
            time_ns: 34,
            mode: Mode::Enabled,
            q_WT: UnitQuaternion::from_euler_angles(0.0, 0.0, 1.0),
            p_WT_m: Vector3::new(0.25, 0.0, 0.0),
            omega_WT_rad_per_s: Vector3::new(0.0, 0.0, 2.0),
            hand: Some(wrench(1.0)),
            requested: wrench(2.0),
            achievable: wrench(3.0),
            rendered: wrench(4.0),
            rendered_source: RenderedSource::Measured,
            region: Some(Region::Approximate),
            approximation_angle_rad: Some(0.5),
            law: Some(Strategy::PredictedVelocity),
            limits,
            contact_count: 3,
            command_seq: 5,
            command_lag_ticks: 1,
            scene_revision: 6,
            buttons: 7,
            stuck: true,
            ..Report::default()
        };
        report.contacts[..3].copy_from_slice(&[contact(1, 0.1), contact(2, 0.3), contact(3, 0.2)]);
        report
    }

    #[test]
    fn a_report_becomes_the_state_of_the_contract() {
        let mut state = State::default();
        fill(&mut state, &busy_report());
        address(&mut state, &busy_report(), &own(None), 0);
        assert_eq!((state.seq, state.device_time_ns), (12, 34));
        assert_eq!(state.position_m, [0.25, 0.0, 0.0]);
        let half = [0.0, 0.0, 0.5f32.sin(), 0.5f32.cos()];
        for (sent, expected) in state.orientation.iter().zip(half) {
            assert!((sent - expected).abs() < 1e-6, "x y z w: {:?}", state.orientation);
        }
        assert_eq!(state.twist, [0.0, 0.0, 0.0, 0.0, 0.0, 2.0]);
        assert_eq!(state.measured_cf, [1.0, 0.0, 0.0]);
        assert_eq!(state.requested, [2.0, 0.0, 0.0]);
        assert_eq!(state.achievable, [3.0, 0.0, 0.0]);
        assert_eq!(state.rendered, [4.0, 0.0, 0.0]);
        assert_eq!(state.rendered_source(), proto::RenderedSource::Measured);
        assert_eq!(state.region(), proto::Region::Approximate);
        assert_eq!(state.law(), proto::Strategy::PredictedVelocity);
        assert_eq!(state.mode(), proto::Mode::Enabled);
        assert_eq!(state.limits, 0b1001);
        assert_eq!((state.command_seq, state.command_lag_ticks), (5, 1));
        assert_eq!((state.scene_revision, state.buttons), (6, 7));
    }

    #[test]
    fn what_is_unknown_is_absent_and_nothing_of_the_last_tick_stays() {
        let mut state = State::default();
        fill(&mut state, &busy_report());
        fill(&mut state, &Report::default());
        address(&mut state, &Report::default(), &own(None), 0);
        assert!(state.orientation.is_empty(), "the tool is not turned");
        assert!(state.measured_cf.is_empty(), "no sensor");
        assert!(state.rendered.is_empty(), "unknown source");
        assert_eq!(state.approximation_angle_rad, None);
        assert_eq!((state.region, state.law), (0, 0));
        assert_eq!(state.requested, [0.0; 3], "nothing asked is known to be zero");
        let mut fresh = State::default();
        fill(&mut fresh, &Report::default());
        address(&mut fresh, &Report::default(), &own(None), 0);
        assert_eq!(state, fresh);
    }

    #[test]
    fn contacts_come_deepest_first() {
        let sorted = DeepestFirst::of(&busy_report());
        let ids: Vec<u32> = sorted.as_slice().iter().map(|part| part.id).collect();
        assert_eq!(ids, [2, 3, 1]);
    }

    #[test]
    fn lag_and_hold_saturate() {
        let mut state = State::default();
        let report = Report { command_lag_ticks: u64::MAX, ..busy_report() };
        fill(&mut state, &report);
        assert_eq!(state.command_lag_ticks, MAX_LAG_TICKS);
        let echo = Echo { client_time_ns: 9, received_ns: 1 };
        address(&mut state, &report, &own(Some(echo)), 11);
        assert_eq!((state.echo_client_time_ns, state.echo_hold_ns), (9, 10));
        address(&mut state, &report, &own(Some(echo)), u64::MAX);
        assert_eq!(state.echo_hold_ns, u32::MAX);
        address(&mut state, &report, &own(None), 11);
        assert_eq!((state.echo_client_time_ns, state.echo_hold_ns), (0, 0));
    }

    #[test]
    fn the_worst_report_fits_the_state() {
        let far = Vector3::repeat(f64::MIN);
        let all = Wrench { force_N: far, moment_Nm: far };
        let mut limits = Limits::default();
        Limit::ALL.into_iter().for_each(|limit| limits.set(limit, true));
        let report = Report {
            tick: (1 << 42) - 1,
            time_ns: u64::MAX,
            mode: Mode::Fault,
            p_WT_m: far,
            v_WT_m_per_s: far,
            omega_WT_rad_per_s: far,
            proxy_W_m: far,
            hand: Some(all),
            requested: all,
            achievable: all,
            rendered: all,
            approximation_angle_rad: Some(f64::MIN),
            limits,
            contact_count: 8,
            contacts: [ContactResult {
                id: u32::MAX,
                depth_m: f64::MAX,
                ..ContactResult::default()
            }; 8],
            command_seq: crate::session::command::MAX_SEQ,
            command_lag_ticks: u64::MAX,
            scene_revision: (1 << 35) - 1,
            buttons: u32::MAX,
            ..busy_report()
        };
        let mut state = State::default();
        fill(&mut state, &report);
        let echo = Echo { client_time_ns: u64::MAX, received_ns: 0 };
        address(&mut state, &report, &own(Some(echo)), u64::MAX);
        let contacts = DeepestFirst::of(&report);
        assert_eq!(contacts.as_slice().len(), 8);
        let event = EventPart { id: u64::MAX, kind: 9, value: u32::MAX };
        let parts =
            StateParts { deepest_first: contacts.as_slice(), oldest_first: &[event], detail: None };
        let bytes = crate::wire::encode_state(&mut state, &parts);
        assert!(bytes.len() <= crate::wire::MAX_STATE_BYTES, "{}", bytes.len());
    }
}
