//! A client with its own workspace over the whole way: bytes, session, tick, State. A clutch
//! never jumps, in position or in force.

use nalgebra::Vector3;

use super::*;
use crate::config::{DeviceDefinition, Scene, build_plan};
use crate::control::{ControlState, Limit, Mode, Plan, Sample, TickInput, tick};
use crate::notation::PlaneVector;
use crate::proto::Workspace;

const SCALE: f64 = 4.0;
/// Where the client has its wall, and how stiff: 0.35 m of the device, and felt as 2000 N/m.
const WALL_M: f64 = 1.5;
const STIFFNESS_N_PER_M: f64 = 500.0;

/// A client, its session, and a device whose handle is put where the test wants it.
struct Rig {
    sessions: Sessions,
    id: SessionId,
    plan: Plan,
    state: ControlState,
    setpoint: Setpoint,
    tick: u64,
    x_m: f64,
    seen: State,
}

impl Rig {
    fn new() -> Self {
        let device = DeviceDefinition::load("cho-2005").expect("built in");
        let mut sessions = sessions();
        let workspace = Workspace { scale: SCALE as f32, offset_m: vec![0.1, 0.0, 0.0] };
        let hello = Hello { workspace: Some(workspace), ..hello("scaled", Role::Controller) };
        let (id, outputs) = meet(&mut sessions, hello, 0);
        assert_eq!(welcome(&outputs).unwrap().felt_stiffness_ratio, SCALE as f32);
        Self {
            sessions,
            id,
            plan: build_plan(&device, &Scene::default()),
            state: ControlState::new(Mode::Enabled),
            setpoint: Setpoint::NONE,
            tick: 0,
            x_m: 0.34,
            seen: State::default(),
        }
    }

    /// One tick, and the client's answer to its State.
    fn step(&mut self, clutched: bool) -> Report {
        self.tick += 1;
        let now_ns = self.tick * MS;
        let at = PlaneVector::new(self.x_m, 0.0, 0.0);
        let input = TickInput {
            sample: Ok(Sample::at(&self.plan, &at)),
            setpoint: &self.setpoint,
            plan: &self.plan,
            now_ns,
            overruns_in_row: 0,
        };
        let report = tick(&mut self.state, &input).report;
        self.sessions.on_report(&report, now_ns);
        let outputs = drain(&mut self.sessions);
        self.seen = states(&outputs).remove(0).1;
        let mut command = wall_command(self.tick, now_ns, self.tick);
        let Some(command::Body::Contacts(contacts)) = &mut command.body else { unreachable!() };
        contacts.contacts[0].stiffness_n_per_m = STIFFNESS_N_PER_M as f32;
        contacts.contacts[0].shape = Some(contact::Shape::HalfSpace(HalfSpaceContact {
            point_m: vec![WALL_M as f32, 0.0, 0.0],
            normal: vec![-1.0, 0.0, 0.0],
        }));
        let command = Command { clutched, ..command };
        self.sessions.on_datagram(self.id, &datagram(command), now_ns + MS / 10);
        self.setpoint = setpoints(&drain(&mut self.sessions))[0];
        report
    }

    fn client_m(&self) -> f64 {
        f64::from(self.seen.position_m[0])
    }
}

fn force_N(report: &Report) -> f64 {
    report.contacts().iter().map(|contact| contact.normal_N).sum()
}

#[test]
fn a_wall_of_the_client_is_where_it_says_and_is_felt_scale_times_as_stiff() {
    let mut rig = Rig::new();
    for step in 0..100 {
        rig.x_m = 0.34 + 0.0002 * f64::from(step);
        let report = rig.step(false);
        let expected_m = SCALE * report.p_WT_m.x + 0.1;
        assert!((rig.client_m() - expected_m).abs() < 1e-6);
        let into_m = report.p_WT_m.x - 0.35;
        let felt_N = if into_m > 0.0 { SCALE * STIFFNESS_N_PER_M * into_m } else { 0.0 };
        assert!((force_N(&report) - felt_N).abs() < 1e-3 + 1e-3 * felt_N, "{felt_N}");
        if let Some(depth_m) = rig.seen.contact_depth_m.first() {
            assert!((f64::from(*depth_m) - (expected_m - WALL_M)).abs() < 1e-5);
            assert!((f64::from(rig.seen.proxy_m[0]) - WALL_M).abs() < 1e-5, "kept on the wall");
        }
    }
    assert!(rig.seen.contact_id.len() == 1);
}

#[test]
fn a_clutch_never_jumps_in_position_or_force() {
    let mut rig = Rig::new();
    let (mut last_m, mut last_N) = (SCALE * rig.x_m + 0.1, 0.0);
    let mut clutched_ms = 0;
    for step in 0..1_200u32 {
        // In, clutch behind the wall, away from it while clutched, release, and in again.
        let clutched = (300..600).contains(&step);
        rig.x_m = match step {
            0..200 => 0.34 + 0.00007 * f64::from(step),
            200..400 => 0.354,
            400..550 => 0.354 - 0.0002 * f64::from(step - 400),
            550..700 => 0.324,
            _ => 0.324 + 0.00004 * f64::from(step - 700),
        };
        let report = rig.step(clutched);
        let moved_m = (rig.client_m() - last_m).abs();
        assert!(moved_m < SCALE * 0.0002, "step {step}: {moved_m} m");
        let stepped_N = force_N(&report) - last_N;
        assert!(stepped_N.abs() < 0.6, "step {step}: {stepped_N} N");
        if report.limits.contains(Limit::Clutch) {
            clutched_ms += 1;
            assert!(moved_m < 1e-6, "the client stands still");
            assert!(clutched_ms <= 51 || force_N(&report) == 0.0);
        }
        (last_m, last_N) = (rig.client_m(), force_N(&report));
    }
    assert!((295..=305).contains(&clutched_ms), "{clutched_ms}");
    // It went on from where it stood, deep in the wall, and only what came after is felt.
    let into_N = SCALE * STIFFNESS_N_PER_M * 0.00004 * 500.0;
    assert!((last_N - into_N).abs() < 0.1 * into_N, "{last_N} of {into_N}");
    assert!(rig.sessions.list(0).all(|info| !info.clutched));
}

#[test]
fn losing_the_lease_while_clutched_ends_the_clutch_where_it_is() {
    let mut rig = Rig::new();
    rig.step(true);
    rig.x_m += 0.01;
    rig.step(true);
    let before_m = rig.client_m();
    let taker = Hello { takeover: true, ..hello("taker", Role::Controller) };
    meet(&mut rig.sessions, taker, 3 * MS);
    let at = |x_m: f64| Report { p_WT_m: Vector3::new(x_m, 0.0, 0.0), ..report(3) };
    rig.sessions.on_report(&at(0.35), 3 * MS);
    let outputs = drain(&mut rig.sessions);
    let (_, seen) = states(&outputs).into_iter().find(|(to, _)| *to == rig.id).unwrap();
    assert!((f64::from(seen.position_m[0]) - before_m).abs() < 1e-3, "no jump");
    rig.sessions.on_report(&Report { tick: 4, ..at(0.36) }, 4 * MS);
    let outputs = drain(&mut rig.sessions);
    let (_, seen) = states(&outputs).into_iter().find(|(to, _)| *to == rig.id).unwrap();
    assert!((f64::from(seen.position_m[0]) - before_m - 0.04).abs() < 1e-3, "and on it goes");
}
