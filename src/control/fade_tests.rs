//! How what a controller asks comes and goes: no part of it ever steps up, and none steps
//! down but where somebody lets go at once.
//!
//! The handle is prescribed and still, so that whatever changes is the fade's doing. Forces
//! are looked at where they leave `desire`, before the actuators add what they can and
//! cannot do.

use nalgebra::{Matrix3, Vector3};

use super::*;
use crate::config::{DeviceDefinition, Scene, build_plan};
use crate::environment::{Contact, Element, ForceField, Material, SceneItem, Shape, Surface};
use crate::notation::PlaneVector;

const MS: u64 = 1_000_000;
const RAMP_MS: u64 = 50;

/// A device whose handle is where it is put.
struct Rig {
    plan: Plan,
    state: ControlState,
    setpoint: Setpoint,
    now_ns: u64,
    x_m: f64,
}

fn wall(x_m: f64, stiffness_N_per_m: f64) -> Surface {
    Surface {
        shape: Shape::HalfSpace { point_W_m: Vector3::new(x_m, 0.0, 0.0), normal_W: -Vector3::x() },
        material: Material { stiffness_N_per_m, ..Material::default() },
        hollow: false,
        blend_s: 0.0,
    }
}

fn contacts() -> Vec<Contact> {
    [1000.0, 3000.0, 1e7]
        .into_iter()
        .zip(1..)
        .map(|(stiffness, id)| Contact { id, revision: 1, surface: wall(0.35, stiffness) })
        .collect()
}

fn field() -> ForceField {
    ForceField {
        origin_W_m: Vector3::new(0.35, 0.01, 0.0),
        force_W_N: Vector3::new(0.0, 3.0, 0.0),
        moment_W_Nm: Vector3::zeros(),
        stiffness_N_per_m: Matrix3::identity() * 200.0,
        damping_Ns_per_m: Matrix3::identity(),
        radius_m: f64::INFINITY,
    }
}

impl Rig {
    /// Outside of everything, with a scene of one wall where `scene` says so.
    fn new(scene: bool) -> Self {
        let device = DeviceDefinition::load("cho-2005").expect("built in");
        let mut plan = build_plan(&device, &Scene::default());
        plan.guards.stale_ramp_ns = RAMP_MS * MS;
        if scene {
            // Slanted: one that coincides with the controller's would share one clipping.
            let mut slanted = wall(0.35, 2000.0);
            if let Shape::HalfSpace { normal_W, .. } = &mut slanted.shape {
                *normal_W = Vector3::new(-0.8, -0.6, 0.0);
            }
            let element = Element::Surface(slanted);
            plan.scene = [SceneItem { slot: 0, revision: 1, element }].into();
        }
        let state = ControlState::new(Mode::Enabled);
        Self { plan, state, setpoint: Setpoint::NONE, now_ns: 1000 * MS, x_m: 0.345 }
    }

    /// A command that came just now.
    fn command(&mut self, body: Setpoint) {
        let seq = self.setpoint.seq + 1;
        self.setpoint = body;
        (self.setpoint.epoch, self.setpoint.seq) = (1, seq);
        (self.setpoint.received_ns, self.setpoint.ttl_ns) = (self.now_ns, 100 * MS);
    }

    fn tick(&mut self) -> Report {
        let at = PlaneVector::new(self.x_m, 0.0, 0.0);
        let input = TickInput {
            sample: Ok(Sample::at(&self.plan, &at)),
            setpoint: &self.setpoint,
            plan: &self.plan,
            now_ns: self.now_ns,
            overruns_in_row: 0,
        };
        self.now_ns += MS;
        tick(&mut self.state, &input).report
    }

    /// Moves 2 mm behind the walls and stays, commanded all the time; returns what is asked.
    fn press(&mut self, body: Setpoint) -> Report {
        for step in 0..200 {
            self.x_m = 0.345 + 0.007 * (f64::from(step) / 100.0).min(1.0);
            self.command(body);
            self.tick();
        }
        self.tick()
    }

    fn total_N(&self) -> f64 {
        self.state.before.total_N
    }
}

fn clutched(mut body: Setpoint) -> Setpoint {
    body.clutched = true;
    body
}

/// Contacts, a field, a wrench, and one beyond what the device can do.
fn bodies() -> [Setpoint; 4] {
    let wrench = |x_N, y_N| {
        let force_N = Vector3::new(x_N, y_N, 0.0);
        Setpoint::NONE.with_wrench(Wrench { force_N, moment_Nm: Vector3::zeros() })
    };
    let none = Setpoint::NONE;
    let (contacts, field) = (none.with_contacts(&contacts()), none.with_field(field()));
    [contacts, field, wrench(-4.0, 7.0), wrench(-900.0, 300.0)]
}

#[test]
fn while_a_command_fades_every_part_of_it_goes_down_together_and_nothing_else_does() {
    for body in bodies() {
        let mut rig = Rig::new(true);
        let before = rig.press(body);
        let (whole_N, controller_N) = (rig.total_N(), rig.state.before.controller_N);
        let scene_N = whole_N - controller_N;
        assert!(controller_N > 5.0 && scene_N > 0.5, "{controller_N} {scene_N}");
        rig.now_ns = rig.setpoint.received_ns + rig.setpoint.ttl_ns + 1;
        let mut last_N = controller_N;
        for step in 0..=RAMP_MS {
            let report = rig.tick();
            let now_N = rig.state.before.controller_N;
            let expected_N = controller_N * (1.0 - step as f64 / RAMP_MS as f64);
            assert!((now_N - expected_N).abs() < 0.02 * controller_N, "{now_N}, step {step}");
            assert!(now_N <= last_N + 1e-9 && last_N - now_N < 0.03 * controller_N);
            for (was, is) in before.contacts().iter().zip(report.contacts()) {
                let share = is.normal_N / was.normal_N;
                let of_controller = was.source == crate::environment::Source::Controller;
                let expected = if of_controller { now_N / controller_N } else { 1.0 };
                assert!((share - expected).abs() < 0.2, "{share} of {}, step {step}", was.id);
            }
            assert_eq!(report.limits.contains(Limit::Stale), step < RAMP_MS);
            last_N = now_N;
        }
        assert_eq!(rig.state.before.controller_N, 0.0);
        assert!((rig.total_N() / scene_N) > 0.9, "the scene stays");
    }
}

#[test]
fn a_command_that_returns_during_its_fade_does_not_step_back_up() {
    for (index, body) in bodies().into_iter().enumerate() {
        for back_ms in [1, 10, 30, 49] {
            let mut rig = Rig::new(false);
            rig.press(body);
            rig.now_ns = rig.setpoint.received_ns + rig.setpoint.ttl_ns + 1;
            for _ in 0..back_ms {
                rig.tick();
            }
            // What goes to the actuators: walls as asked, soft forces after their slew.
            let given_N = |rig: &Rig, report: &Report| {
                let walls_N: f64 = report.contacts().iter().map(|contact| contact.normal_N).sum();
                walls_N + rig.state.soft_BH_N.norm()
            };
            let report = rig.tick();
            let mut last_N = given_N(&rig, &report);
            let most_N = rig.plan.guards.slew_N_per_s * rig.plan.tick_s() + 1e-9;
            for _ in 0..100 {
                rig.command(body);
                let report = rig.tick();
                let now_N = given_N(&rig, &report);
                assert!(now_N - last_N <= most_N, "body {index}: {last_N} to {now_N} N");
                last_N = now_N;
            }
            // Deeper, the walls are there again; a field was there all along.
            rig.x_m += 0.002;
            rig.command(body);
            let report = rig.tick();
            assert!(given_N(&rig, &report) > 3.0, "body {index}: {}", given_N(&rig, &report));
        }
    }
}

#[test]
fn a_clutch_fades_everything_keeps_it_away_and_gives_it_back_without_a_step() {
    for body in bodies() {
        let mut rig = Rig::new(true);
        rig.press(body);
        let whole_N = rig.total_N();
        let mut last_N = whole_N;
        for step in 0..200 {
            rig.command(clutched(body));
            let report = rig.tick();
            assert!(report.limits.contains(Limit::Clutch) && !report.limits.contains(Limit::Stale));
            let most_N = whole_N * (1.0 - f64::from(step) / RAMP_MS as f64).max(0.0);
            assert!(rig.total_N() <= most_N + 1e-9, "{} N in step {step}", rig.total_N());
            assert!(last_N - rig.total_N() < 0.05 * whole_N + 1e-9, "no step down either");
            last_N = rig.total_N();
            if step > 60 {
                rig.x_m = 0.352 + 0.0001 * f64::from(step - 60);
                assert_eq!(report.contact_count, 0);
            }
        }
        assert_eq!(rig.total_N(), 0.0);
        rig.command(body);
        let report = rig.tick();
        assert!(!report.limits.contains(Limit::Clutch));
        let walls_N: f64 = report.contacts().iter().map(|contact| contact.normal_N).sum();
        assert!(walls_N < 1e-6, "{walls_N} N of walls on release");
        let slew_N = rig.plan.guards.slew_N_per_s * rig.plan.tick_s();
        assert!(rig.state.soft_BH_N.norm() <= slew_N + 1e-9);
        for _ in 0..20 {
            rig.command(body);
            rig.tick();
        }
        rig.x_m += 0.002;
        rig.command(body);
        rig.tick();
        assert!(rig.total_N() > 3.0, "and it is felt again");
    }
}

#[test]
fn a_clutch_let_go_while_it_still_fades_does_not_step_back_up() {
    for held_ms in [1, 10, 25, 49] {
        let mut rig = Rig::new(true);
        rig.press(Setpoint::NONE.with_contacts(&contacts()));
        for _ in 0..held_ms {
            rig.command(clutched(Setpoint::NONE));
            rig.tick();
        }
        let before_N = rig.total_N();
        rig.command(Setpoint::NONE.with_contacts(&contacts()));
        rig.tick();
        assert!(rig.total_N() <= before_N, "{before_N} to {} N", rig.total_N());
        rig.x_m += 0.002;
        rig.command(Setpoint::NONE.with_contacts(&contacts()));
        rig.tick();
        assert!(rig.total_N() > 3.0);
    }
}

#[test]
fn a_clutch_whose_controller_falls_silent_ends_and_only_the_scene_comes_back() {
    let mut rig = Rig::new(true);
    rig.press(Setpoint::NONE.with_contacts(&contacts()));
    rig.command(clutched(Setpoint::NONE));
    rig.tick();
    assert_eq!(rig.state.before.controller_N, 0.0, "an empty body lets the contacts go");
    for _ in 0..99 {
        rig.tick();
    }
    let report = rig.tick();
    assert!(report.limits.contains(Limit::Clutch));
    let report = rig.tick();
    assert!(!report.limits.contains(Limit::Clutch) && rig.total_N() < 1e-6, "given away");
    rig.x_m += 0.002;
    let report = rig.tick();
    assert!(report.contact_count == 1 && rig.total_N() > 3.0);
}

#[test]
fn a_longer_ramp_that_is_set_during_a_fade_does_not_raise_the_force() {
    let mut rig = Rig::new(false);
    rig.plan.guards.stale_ramp_ns = 1_000 * MS;
    rig.press(Setpoint::NONE.with_contacts(&contacts()));
    let whole_N = rig.total_N();
    rig.now_ns = rig.setpoint.received_ns + rig.setpoint.ttl_ns + 1;
    let mut last_N = whole_N;
    for ms in 0..=1_000 {
        if ms == 900 {
            rig.plan.guards.stale_ramp_ns = 10_000 * MS;
            assert!(last_N < 0.11 * whole_N && last_N > 0.0);
        }
        rig.tick();
        assert!(rig.total_N() <= last_N + 1e-9, "{last_N} to {} N, {ms} ms", rig.total_N());
        last_N = rig.total_N();
    }
    assert_eq!(last_N, 0.0);
}
