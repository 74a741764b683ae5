//! Late controllers on the plant, in virtual time: what diverges without the account is bounded
//! with it, and what is healthy is left alone.
//!
//! The motion is the plant's own; what its motors did to it is in the plant's books, which know
//! nothing of the account.

use std::collections::VecDeque;
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::*;
use crate::config::{DeviceDefinition, Scene, build_plan};
use crate::control::{
    ActuatorCommand, ActuatorCommands, ControlState, Decision, Limit, Mode, Sample, Setpoint,
    TickInput, Wrench, tick,
};
use crate::device::{HandProgram, Plant, PlantParameters};
use crate::environment::ForceField;
use crate::notation::MAX_ACTUATORS;

/// Motor or brake, of each shaft.
type Kinds = [ActuatorKind; MAX_ACTUATORS];

/// Time between ticks, seconds.
const TICK_S: f64 = 1e-3;

/// One way and back.
const DELAY_TICKS: usize = 50;

/// A device, a hand on it, and a simulator that sees it late.
struct Rig {
    plan: Plan,
    plant: Plant,
    state: ControlState,
    /// Where the simulator wants the handle.
    home: PlaneVector,
    /// Poses and velocities, the oldest first: of as many ticks as the simulator is late.
    seen: VecDeque<[PlaneVector; 2]>,
    ticks: u64,
}

/// What came of a run. Pairs: over all of it, and over its last two seconds.
#[derive(Clone, Copy, Debug, Default)]
struct Course {
    /// Work of the motors.
    fed_J: [f64; 2],
    /// Largest distance from home; metres, or radians of a device that turns.
    off: [f64; 2],
    /// Largest difference between the force asked for, once it had time to rise, and given.
    error_N: [f64; 2],
    /// Largest change of the force from tick to tick.
    jump_N: [f64; 2],
    /// Force in the end.
    last_N: f64,
    /// Ticks in which something was held back.
    held_back: u32,
    /// Largest power of the actuators, each by its own sign.
    most_W: f64,
    /// Most that the handle had beyond what the hand gave it.
    gained_J: f64,
}

/// Time in which a force rises to what is asked.
const RISES_TICKS: u64 = 50;

impl Rig {
    fn new(name: &str, home: PlaneVector, start: PlaneVector, delay_ticks: usize) -> Self {
        Self::of(name, None, home, start, delay_ticks)
    }

    /// With other actuators than its file says.
    fn of(
        name: &str,
        kinds: Option<Kinds>,
        home: PlaneVector,
        start: PlaneVector,
        delay_ticks: usize,
    ) -> Self {
        let device = DeviceDefinition::load(name).expect("built in");
        let simulated = device.simulation(HandProgram::default());
        let mut plan = build_plan(&device, &Scene::default());
        plan.guards.activation_ramp_ns = 0;
        plan.actuators.kinds = kinds.unwrap_or(simulated.kinds);
        let parameters = PlantParameters {
            mechanism: Arc::clone(&simulated.mechanism),
            kinds: plan.actuators.kinds,
            max_torque_Nm: simulated.max_torque_Nm,
            lag_s: simulated.lag_s,
            residual_Nm: simulated.residual_Nm,
            imperfections: simulated.imperfections,
            damping_N_m_s_per_rad: simulated.damping_N_m_s_per_rad,
            resolution_Nm: simulated.resolution_Nm,
        };
        Self {
            plan,
            plant: Plant::new(parameters, &(home + start)).expect("regular"),
            state: ControlState::new(Mode::Enabled),
            home,
            seen: vec![[home + start, PlaneVector::zeros()]; delay_ticks + 1].into(),
            ticks: 0,
        }
    }

    /// The motors may feed whatever they are told.
    fn unwatched(mut self) -> Self {
        self.plan.guards.passivity_reserve_J = f64::INFINITY;
        self
    }

    /// Runs for so many seconds: what the simulator sends for what it sees, from home, and what
    /// the hand does at a time for where the handle is.
    fn run(
        &mut self,
        seconds: f64,
        mut simulator: impl FnMut(&PlaneVector, &PlaneVector) -> Setpoint,
        mut hand: impl FnMut(f64, &PlaneVector, &PlaneVector) -> PlaneVector,
    ) -> Course {
        let mut course = Course::default();
        let ticks = (seconds / TICK_S) as u64;
        let (before, mut last_N) = (*self.plant.energy(), Vector3::zeros());
        for number in 0..ticks {
            let [p, v] = *self.seen.front().expect("never empty");
            let Decision { commands, report } = self.tick(simulator(&(p - self.home), &v));
            course.most_W = course.most_W.max(self.power_W(&commands));
            self.plant.command(&commands);
            for _ in 0..10 {
                let at_s = self.ticks as f64 * TICK_S;
                let push = hand(at_s, &(self.plant.p_BH() - self.home), self.plant.v_BH());
                self.plant.step(&push, 0.1 * TICK_S);
            }
            let v = report.v_WT_m_per_s;
            self.seen.pop_front();
            self.seen.push_back([report.p_BH, PlaneVector::new(v.x, v.y, 0.0)]);
            let given_N = report.achievable.force_N;
            let found = [
                self.plant.energy().motors_J - before.motors_J,
                self.off(),
                (report.requested.force_N - given_N).xy().norm(),
                (given_N - last_N).norm(),
            ];
            last_N = given_N;
            course.see(found, number, ticks);
            course.held_back += u32::from(report.limits.contains(Limit::Passivity));
            let by_hand_J = self.plant.energy().hand_J - before.hand_J;
            course.gained_J = course.gained_J.max(self.plant.kinetic_J() - by_hand_J);
        }
        course.last_N = last_N.norm();
        course
    }

    fn tick(&mut self, mut setpoint: Setpoint) -> Decision {
        self.ticks += 1;
        let now_ns = self.ticks * self.plan.tick_ns;
        (setpoint.epoch, setpoint.seq) = (1, self.ticks);
        (setpoint.received_ns, setpoint.ttl_ns) = (now_ns, 20_000_000);
        let mut sample = Sample::default();
        let per_rad = self.plan.actuators.counts_per_revolution / std::f64::consts::TAU;
        for i in 0..MAX_ACTUATORS {
            sample.counts[i] = (self.plant.shaft_rad()[i] * per_rad[i]).round() as i64;
        }
        let (sample, plan) = (Ok(sample), &self.plan);
        let input = TickInput { sample, setpoint: &setpoint, plan, now_ns, overruns_in_row: 0 };
        tick(&mut self.state, &input)
    }

    fn off(&self) -> f64 {
        let off = self.plant.p_BH() - self.home;
        if self.plan.mechanism.freedoms() == 3 { off.z.abs() } else { off.xy().norm() }
    }

    /// What these commands do to a handle that moves as this one does: nothing in it is passive
    /// by construction.
    fn power_W(&self, commands: &ActuatorCommands) -> f64 {
        let posture = self.plan.mechanism.posture_at(self.plant.p_BH()).expect("regular");
        let rates = posture.reference.tr_mul(self.plant.v_BH());
        let signed = |(i, command): (usize, &ActuatorCommand)| match command {
            ActuatorCommand::Brake { capacity_Nm } => -rates[i].abs() * capacity_Nm,
            ActuatorCommand::Motor { torque_Nm } => rates[i] * torque_Nm,
        };
        commands.iter().enumerate().map(signed).sum()
    }

    /// Most that the account lets pass in this time.
    fn promised_J(&self, seconds: f64) -> f64 {
        let guards = Guards::default();
        2.0 * guards.passivity_reserve_J + guards.passivity_power_W * seconds
    }
}

impl Course {
    fn see(&mut self, [fed_J, off, error_N, jump_N]: [f64; 4], number: u64, ticks: u64) {
        let late = number + 2_000 >= ticks;
        let most = |pair: &mut [f64; 2], found: f64| {
            pair[0] = pair[0].max(found);
            pair[1] = if late { pair[1].max(found) } else { 0.0 };
        };
        most(&mut self.off, off);
        most(&mut self.jump_N, jump_N);
        if number >= RISES_TICKS {
            most(&mut self.error_N, error_N);
        }
        self.fed_J[1] += if late { fed_J - self.fed_J[0] } else { 0.0 };
        self.fed_J[0] = fed_J;
    }
}

fn wrench(planar: &PlaneVector) -> Setpoint {
    let force_N = Vector3::new(planar.x, planar.y, 0.0);
    Setpoint::NONE.with_wrench(Wrench { force_N, moment_Nm: Vector3::new(0.0, 0.0, planar.z) })
}

/// The same force always.
fn constant(x_N: f64) -> impl FnMut(&PlaneVector, &PlaneVector) -> Setpoint {
    move |_, _| wrench(&PlaneVector::new(x_N, 0.0, 0.0))
}

/// A spring of the simulator's own, sent as a wrench.
fn spring(stiffness_N_per_m: f64) -> impl FnMut(&PlaneVector, &PlaneVector) -> Setpoint {
    move |off, _| wrench(&(-stiffness_N_per_m * PlaneVector::new(off.x, off.y, 0.0)))
}

/// A field of this stiffness about a place, told from the middle of `singh`.
fn field(origin: PlaneVector, stiffness_N_per_m: f64) -> Setpoint {
    let origin = MIDDLE + origin;
    Setpoint::NONE.with_field(ForceField {
        origin_W_m: Vector3::new(origin.x, origin.y, 0.0),
        force_W_N: Vector3::zeros(),
        moment_W_Nm: Vector3::zeros(),
        stiffness_N_per_m: Matrix3::identity() * stiffness_N_per_m,
        damping_Ns_per_m: Matrix3::zeros(),
        radius_m: f64::INFINITY,
    })
}

/// Fingers that rest on the handle.
fn light(_: f64, off: &PlaneVector, v: &PlaneVector) -> PlaneVector {
    -50.0 * off - 1.0 * v
}

/// A hand that leads the handle to and fro, whatever is felt.
fn leading(t_s: f64, off: &PlaneVector, v: &PlaneVector) -> PlaneVector {
    let to = PlaneVector::new(0.03 * (6.0 * t_s).sin(), 0.01 * (4.0 * t_s).sin(), 0.0);
    2000.0 * (to - off) - 20.0 * v
}

/// A hand that holds the handle where it is, and trembles at 8 Hz.
fn holding(t_s: f64, off: &PlaneVector, v: &PlaneVector) -> PlaneVector {
    -500.0 * off - 10.0 * v + PlaneVector::new(2.0 * (50.0 * t_s).sin(), 0.0, 0.0)
}

/// Middle of `singh`'s workspace, and a little beside it.
const MIDDLE: PlaneVector = PlaneVector::new(0.0, 0.15, 0.0);
const BESIDE: PlaneVector = PlaneVector::new(0.005, 0.0, 0.0);

const LONG_S: f64 = 10.0;

fn late() -> Rig {
    Rig::new("singh", MIDDLE, BESIDE, DELAY_TICKS)
}

/// Without the account energy is fed without end, with it there is little and then no more than
/// the power.
fn diverges_and_is_bounded(what: &str, runs: [Course; 2], promised_J: f64) {
    let [without, with] = runs;
    println!("{what}: without {without:.3?}, with {with:.3?}");
    assert!(without.fed_J[0] > 20.0 && without.fed_J[1] > 3.0, "{what}: {without:?}");
    assert_eq!(without.held_back, 0);
    assert!(with.fed_J[0] <= promised_J && with.held_back > 100, "{what}: {with:?}");
    // Two seconds begin and end somewhere in a swing.
    let power_W = Guards::default().passivity_power_W;
    assert!(with.fed_J[1] <= 2.0 * power_W + 0.05, "{what}: {with:?}");
}

#[test]
fn a_late_spring_diverges_without_the_account_and_stays_bounded_with_it() {
    for stiffness_N_per_m in [400.0, 800.0] {
        let run = |mut rig: Rig| rig.run(LONG_S, spring(stiffness_N_per_m), light);
        let runs = [run(late().unwatched()), run(late())];
        let what = format!("spring of {stiffness_N_per_m} N/m, 50 ms late");
        diverges_and_is_bounded(&what, runs, late().promised_J(LONG_S));
        let [without, with] = runs;
        assert!(without.off[1] > 0.05, "{without:?}");
        assert!(with.off[0] < 0.04 && with.off[1] < 0.004, "{with:?}");
    }
}

/// A field is evaluated here, at the tick: what is late in it is its origin. One that follows the
/// handle late drags at it.
#[test]
fn a_field_whose_origin_lags_takes_energy_and_one_whose_origin_runs_ahead_is_bounded() {
    let ahead =
        |ahead_s: f64| move |off: &PlaneVector, v: &PlaneVector| field(off + v * ahead_s, 400.0);
    let lagging = late().unwatched().run(LONG_S, ahead(0.0), leading);
    println!("origin 50 ms behind: {lagging:.3?}");
    assert!(lagging.fed_J[0] < -1.0, "{lagging:?}");
    // A simulator that hides 50 ms by telling where the handle will be, and goes too far.
    let run = |mut rig: Rig| rig.run(LONG_S, ahead(0.1), light);
    let runs = [run(late().unwatched()), run(late())];
    diverges_and_is_bounded("origin 50 ms ahead", runs, late().promised_J(LONG_S));
    assert!(runs[0].off[1] > 0.05 && runs[1].off[1] < 0.015, "{runs:?}");
}

#[test]
fn a_simulated_body_on_a_late_coupling_is_bounded() {
    let coupling_N_per_m = 400.0;
    let body = || {
        let (mass_kg, mut x, mut v) = (0.5, BESIDE, PlaneVector::zeros());
        move |off: &PlaneVector, _: &PlaneVector| {
            v += (off - x) * (coupling_N_per_m / mass_kg * TICK_S);
            x += v * TICK_S;
            field(x, coupling_N_per_m)
        }
    };
    let run = |mut rig: Rig| rig.run(LONG_S, body(), light);
    let runs = [run(late().unwatched()), run(late())];
    diverges_and_is_bounded("body of 0.5 kg", runs, late().promised_J(LONG_S));
    assert!(runs[0].off[1] > 0.05 && runs[1].off[1] < 0.005, "{runs:?}");
}

/// Nothing is late but the loop itself.
#[test]
fn a_field_that_is_too_stiff_for_the_motors_comes_to_rest() {
    for stiffness_N_per_m in [1e4, 1e5, 1e7] {
        let stiff =
            |_: &PlaneVector, _: &PlaneVector| field(PlaneVector::zeros(), stiffness_N_per_m);
        let rig = || Rig::new("singh", MIDDLE, BESIDE, 0);
        let without = rig().unwatched().run(5.0, stiff, light);
        let with = rig().run(5.0, stiff, light);
        println!("field of {stiffness_N_per_m:e} N/m: without {without:.5?}, with {with:.5?}");
        assert!(without.off[1] > 0.01 && with.off[1] < 0.001, "{without:?} {with:?}");
        assert!(with.fed_J[0] <= rig().promised_J(5.0), "{with:?}");
    }
}

#[test]
fn a_late_turning_spring_on_a_plate_is_bounded() {
    let turn = |off: &PlaneVector, _: &PlaneVector| wrench(&PlaneVector::new(0.0, 0.0, -off.z));
    let fingers = |_: f64, off: &PlaneVector, v: &PlaneVector| {
        let push = -200.0 * off - 5.0 * v;
        PlaneVector::new(push.x, push.y, -0.02 * off.z)
    };
    let start = PlaneVector::new(0.0, 0.0, 0.05);
    let rig = || Rig::new("kim-2003", PlaneVector::zeros(), start, DELAY_TICKS);
    let run = |mut rig: Rig| rig.run(LONG_S, turn, fingers);
    let runs = [run(rig().unwatched()), run(rig())];
    diverges_and_is_bounded("1 N m/rad", runs, rig().promised_J(LONG_S));
    assert!(runs[0].off[1] > 0.4 && runs[1].off[1] < 0.1, "{runs:?}");
}

const MOTOR: ActuatorKind = ActuatorKind::Motor;
const BRAKE: ActuatorKind = ActuatorKind::Brake;

/// A two-link arm, with motors, or one motor and one brake.
fn arm(kinds: [ActuatorKind; 2]) -> Rig {
    let mut all = [BRAKE; MAX_ACTUATORS];
    all[..2].copy_from_slice(&kinds);
    Rig::of("two-link", Some(all), PlaneVector::new(0.285, 0.35, 0.0), BESIDE, DELAY_TICKS)
}

#[test]
fn an_arm_with_two_motors_is_bounded() {
    let run = |mut rig: Rig| rig.run(LONG_S, spring(400.0), light);
    let kinds = [MOTOR, MOTOR];
    let runs = [run(arm(kinds).unwatched()), run(arm(kinds))];
    diverges_and_is_bounded("two motors", runs, arm(kinds).promised_J(LONG_S));
}

/// What the handle was fed in all: the work of the motors, but for what the brakes took.
fn net_J(rig: &Rig) -> f64 {
    rig.plant.energy().motors_J - rig.plant.energy().dissipated_J
}

#[test]
fn an_arm_with_a_motor_and_a_brake_is_bounded() {
    for kinds in [[MOTOR, BRAKE], [BRAKE, MOTOR]] {
        let run = |mut rig: Rig| {
            let course = rig.run(LONG_S, spring(400.0), light);
            (net_J(&rig), course)
        };
        let [without, with] = [run(arm(kinds).unwatched()), run(arm(kinds))];
        println!("{kinds:?}: without {without:.3?}, with {with:.3?}");
        assert!(without.0 > 50.0, "{without:?}");
        assert!(with.0 <= arm(kinds).promised_J(LONG_S) && with.1.held_back > 100, "{with:?}");
    }
}

/// One motor alone gives of a force across the motion what it can: along its own line, which
/// feeds although what was asked does not.
#[test]
fn beside_a_brake_a_force_across_the_motion_feeds_no_more_than_it_may() {
    let rig = || {
        let mut rig = arm([BRAKE, MOTOR]);
        rig.seen.truncate(1);
        rig
    };
    let posture = rig().plan.mechanism.posture_at(&rig().home).expect("regular");
    let line = posture.reference.column(1).xy();
    let across = |_: &PlaneVector, v: &PlaneVector| {
        let across = Vector3::z().cross(v);
        let feeds = (across.xy().dot(&line) * v.xy().dot(&line)).signum();
        wrench(&(across.try_normalize(1e-6).unwrap_or_default() * (10.0 * feeds)))
    };
    let [mut unwatched, mut watched] = [rig().unwatched(), rig()];
    unwatched.run(20.0, across, leading);
    let course = watched.run(20.0, across, leading);
    let (without_J, with_J) = (net_J(&unwatched), net_J(&watched));
    println!("across: without {without_J:.3} J, with {with_J:.3} J");
    assert!(without_J > 1.5 * rig().promised_J(20.0), "{without_J} J");
    assert!(with_J <= rig().promised_J(20.0) && course.held_back > 100, "{with_J} J {course:?}");
}

/// Why brakes need none: a capacity has no sign, so whatever is late, a brake only takes. The
/// same late spring, and nobody looks.
#[test]
fn brakes_feed_nothing_to_a_late_spring_and_nothing_is_held_back() {
    for stiffness_N_per_m in [400.0, 800.0, 1e5] {
        for hand in [light, leading] {
            let rig = || Rig::new("singh-brakes", MIDDLE, BESIDE, DELAY_TICKS);
            let (mut unwatched, mut watched) = (rig().unwatched(), rig());
            let without = unwatched.run(5.0, spring(stiffness_N_per_m), hand);
            let with = watched.run(5.0, spring(stiffness_N_per_m), hand);
            assert!(without.most_W <= 0.0, "{stiffness_N_per_m}: {without:?}");
            assert!(without.gained_J < 1e-12, "{stiffness_N_per_m}: {without:?}");
            assert_eq!((without.fed_J[0], with.held_back), (0.0, 0));
            assert_eq!(watched.plant.p_BH(), unwatched.plant.p_BH(), "to the last bit");
            assert!(without.last_N > 0.0, "they were asked: {without:?}");
        }
    }
    let motors = late().unwatched().run(2.0, spring(400.0), light);
    assert!(motors.most_W > 1.0 && motors.gained_J > 0.1, "motors do: {motors:?}");
}

/// Steps of the motors' torque are 0.01 N at the handle.
const LEFT_ALONE_N: f64 = 0.05;

#[test]
fn springs_and_constant_forces_without_delay_are_left_alone() {
    let rig = || Rig::new("singh", MIDDLE, BESIDE, 0);
    for stiffness_N_per_m in [100.0, 400.0] {
        let course = rig().run(LONG_S, spring(stiffness_N_per_m), leading);
        println!("{stiffness_N_per_m} N/m: {course:.4?}");
        assert!(course.held_back == 0 && course.error_N[0] < LEFT_ALONE_N, "{course:?}");
    }
    let course = rig().run(LONG_S, constant(4.0), leading);
    println!("4 N: {course:.4?}");
    assert!(course.held_back == 0 && course.error_N[0] < LEFT_ALONE_N, "{course:?}");
}

#[test]
fn a_guiding_force_against_a_hand_that_holds_is_there_after_a_minute() {
    let course = late().run(60.0, constant(6.0), holding);
    println!("6 N for 60 s: {course:.4?}");
    assert!(course.held_back == 0 && course.error_N[0] < LEFT_ALONE_N, "{course:?}");
    assert!((course.last_N - 6.0).abs() < LEFT_ALONE_N, "{course:?}");
}

#[test]
fn a_guiding_force_that_has_fed_its_reserve_goes_on_slowly_and_smoothly() {
    let yielding = |_: f64, _: &PlaneVector, v: &PlaneVector| -100.0 * v;
    let mut rig = Rig::new("singh", MIDDLE, PlaneVector::new(-0.06, 0.0, 0.0), 0);
    rig.run(2.0, constant(6.0), yielding);
    let from_m = rig.plant.p_BH().x;
    let course = rig.run(4.0, constant(6.0), yielding);
    let speed_m_per_s = (rig.plant.p_BH().x - from_m) / 4.0;
    println!("guided at {speed_m_per_s} m/s: {course:.4?}");
    // The power against the drag of hand and shafts, about 105 N s/m.
    let expected_m_per_s = (rig.plan.guards.passivity_power_W / 105.0_f64).sqrt();
    assert!((speed_m_per_s / expected_m_per_s - 1.0).abs() < 0.1, "{speed_m_per_s} m/s");
    assert!(course.jump_N[1] < 0.5, "{course:?}");
}

#[test]
fn a_controller_that_was_held_back_has_its_whole_force_again_when_the_hand_holds() {
    let mut rig = late();
    let emptied = rig.run(5.0, spring(800.0), light);
    assert!(emptied.held_back > 1_000, "{emptied:?}");
    let course = rig.run(20.0, constant(6.0), holding);
    assert!(course.error_N[1] < LEFT_ALONE_N, "{course:?}");
    assert!(rig.state.account.spent_J < 0.1, "{:?}", rig.state.account);
}
