//! The deadband on a device that is moved, in virtual time: what it saves, and how wrong a
//! receiver gets that goes on with what it was sent.

use nalgebra::Vector3;

use super::*;
use crate::config::{DeviceDefinition, Scene, build_plan};
use crate::control::{ControlState, Mode, Plan, TickInput, tick};
use crate::device::{Device, HandProgram, SimulatedDevice};
use crate::environment::{Element, Material, SceneItem, Shape, Surface};
use crate::session::deadband::LEAST_FORCE_N;

const TICKS: u64 = 6_000;
const SHARE: f64 = 0.1;

/// What came of a run.
#[derive(Debug, Default)]
struct Run {
    sent: u64,
    /// Largest error of the force beside what was sent, newtons and share.
    most_N: f64,
    most_share: f64,
    most_m: f64,
    /// Ticks in which a touch began or ended, and of these those whose State was not sent.
    marks: u64,
    unsent_marks: u64,
    longest_gap: u64,
}

fn vector(floats: &[f32]) -> Vector3<f64> {
    Vector3::from_fn(|i, _| floats.get(i).copied().map_or(0.0, f64::from))
}

/// An observer with this deadband beside a simulated hand and, where one is asked for, a wall.
fn run(hand: HandProgram, wall: bool, deadband: f32) -> Run {
    let device = DeviceDefinition::load("cho-2005").unwrap();
    let demo = device.demo_wall(hand);
    let shape =
        Shape::HalfSpace { point_W_m: Vector3::new(demo.x_m, 0.0, 0.0), normal_W: -Vector3::x() };
    let material = Material { stiffness_N_per_m: demo.stiffness_N_per_m, ..Material::default() };
    let element = Element::Surface(Surface { shape, material, hollow: false, blend_s: 0.0 });
    let items: Vec<_> =
        wall.then_some(SceneItem { slot: 0, revision: 1, element }).into_iter().collect();
    let plan = Plan { scene: items.into(), ..build_plan(&device, &Scene::default()) };
    let mut simulated = SimulatedDevice::new(device.simulation(hand), 1).unwrap();
    let mut state = ControlState::new(Mode::Enabled);
    let mut sessions = sessions();
    let hello = Hello { deadband, ..hello("dead", Role::Observer) };
    meet(&mut sessions, hello, 0);
    let (mut run, mut held, mut last_touched) = (Run::default(), State::default(), 0);
    for number in 1..=TICKS {
        let now_ns = number * MS;
        let input = TickInput::uncommanded(simulated.read(now_ns), &plan, now_ns);
        let decision = tick(&mut state, &input);
        simulated.write(&decision.commands).unwrap();
        let report = decision.report;
        sessions.on_report(&report, now_ns);
        let came = states(&drain(&mut sessions)).pop().map(|(_, state)| state);
        let touched = report.contact_count;
        if touched != std::mem::replace(&mut last_touched, touched) {
            run.marks += 1;
            run.unsent_marks += u64::from(came.is_none());
        }
        if let Some(state) = came {
            run.longest_gap = run.longest_gap.max(state.seq - held.seq);
            run.sent += 1;
            held = state;
        }
        let since_s = (number - held.seq) as f64 * 1e-3;
        let shown_m = vector(&held.position_m) + vector(&held.twist[..3]) * since_s;
        run.most_m = run.most_m.max((shown_m - report.p_WT_m).norm());
        let felt_N = vector(&held.rendered);
        let error_N = (felt_N - report.rendered.force_N).norm();
        run.most_N = run.most_N.max(error_N);
        run.most_share = run.most_share.max(error_N / felt_N.norm().max(LEAST_FORCE_N));
    }
    run
}

#[test]
fn it_saves_four_of_five_and_a_receiver_stays_within_its_bounds() {
    for (name, wall) in [("press-and-slide", true), ("circle", false), ("hold", false)] {
        let hand: HandProgram = name.parse().unwrap();
        let all = run(hand, wall, 0.0);
        assert_eq!((all.sent, all.longest_gap), (TICKS, 1));
        assert!(all.most_N < 1e-4 && all.most_m < 1e-6, "{name}: {all:?}");
        let few = run(hand, wall, SHARE as f32);
        println!("{name}: {few:?}");
        let saved = 1.0 - few.sent as f64 / TICKS as f64;
        assert!((0.8..0.96).contains(&saved), "{name}: {saved} saved, {few:?}");
        // Numbers on the wire have 24 bits.
        assert!(few.most_share <= SHARE * (1.0 + 1e-5), "{name}: {few:?}");
        assert!(few.most_m <= 0.5e-3 * (1.0 + 1e-5), "{name}: {few:?}");
        assert!(few.most_share > 0.5 * SHARE || name == "hold", "nothing was left out: {few:?}");
        assert_eq!(few.unsent_marks, 0, "{name}: {few:?}");
        assert!(few.marks > 0 || !wall, "it never touched");
        assert!(few.longest_gap <= 20, "{name}: {few:?}");
    }
}

#[test]
fn a_deadband_out_of_range_is_refused() {
    for deadband in [0.001, 0.6, -0.1, f32::NAN] {
        let mut sessions = sessions();
        let bad = Hello { deadband, ..hello("x", Role::Observer) };
        let (id, outputs) = meet(&mut sessions, bad, 0);
        let (reason, detail) = bye(&outputs, id).unwrap();
        assert_eq!(reason, ByeReason::Invalid);
        assert!(detail.contains("deadband = ") && detail.contains("0.01 to 0.5"), "{detail}");
    }
}
