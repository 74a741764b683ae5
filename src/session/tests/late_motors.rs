//! A late spring on motors behind bad networks: where the session takes its wrench, the handle
//! swings ever wider without the account of its energy and stays bounded with it; where the
//! session refuses it, the handle rests.
//!
//! Everything is real but the wire and the clock: a simulator answers the newest State with the
//! wrench of a spring, a path each way loses and delays both, the sessions judge path and command,
//! and the tick drives the simulated device, every millisecond of virtual time.

use super::link::{self, Link, Packet};
use super::*;
use crate::config::{DeviceDefinition, Scene, build_plan};
use crate::control::{ControlState, Guards, Limit, Mode, Plan, TickInput, tick};
use crate::device::{Device, HandAction, HandProgram, HandPull, SimulatedDevice};
use crate::impairment::Impairment;
use crate::notation::PlaneVector;
use crate::proto::{Pong, WrenchCommand};
use crate::session::ping;

/// One-way delays; 95 ms there and back leave a State less than 200 ms old, 100 ms do not.
const TAKEN_MS: [u64; 3] = [25, 50, 95];
const TOO_LATE_MS: [u64; 2] = [100, 200];

/// Share of datagrams that is lost, each way, and how many in a row.
const TAKEN_LOSSES: [(f64, f64); 3] = [(0.0, 1.0), (0.03, 1.0), (0.03, 5.0)];
const TOO_MUCH_LOST: [(f64, f64); 3] = [(0.1, 1.0), (0.3, 1.0), (0.5, 1.0)];

/// What a path takes besides.
const LEAST_DELAY_NS: u64 = 100_000;

/// Length of a run, and of its end, in which it is seen what came of it.
const TICKS: u64 = 12_000;
const LAST_TICKS: u64 = 2_000;

/// Middle of the workspace of `singh`, where the spring pulls to.
const MIDDLE: PlaneVector = PlaneVector::new(0.0, 0.15, 0.0);
const STIFFNESS_N_PER_M: f64 = 400.0;

/// Each of these delays with each of these losses, the same each way.
fn paths(delays_ms: &[u64], losses: &[(f64, f64)]) -> Vec<Impairment> {
    let of = |delay_ms: &u64| {
        let delay_ns = delay_ms * MS + LEAST_DELAY_NS;
        let path = move |(loss, burst)| Impairment { delay_ns, loss, burst, ..Impairment::NONE };
        losses.iter().copied().map(path)
    };
    delays_ms.iter().flat_map(of).collect()
}

/// What a hand does at a time, for where the handle is from the middle and how it moves.
type Pull = fn(f64, &PlaneVector, &PlaneVector) -> PlaneVector;

/// Fingers that rest on the handle, and push it once.
fn light(at_s: f64, off: &PlaneVector, v: &PlaneVector) -> PlaneVector {
    let push_N = if (1.5..1.6).contains(&at_s) { 3.0 } else { 0.0 };
    PlaneVector::new(push_N, 0.0, 0.0) - 50.0 * off - 1.0 * v
}

/// A hand that leads the handle to and fro, whatever is felt.
fn leading(at_s: f64, off: &PlaneVector, v: &PlaneVector) -> PlaneVector {
    let to = PlaneVector::new(0.03 * (6.0 * at_s).sin(), 0.01 * (4.0 * at_s).sin(), 0.0);
    2000.0 * (to - off) - 20.0 * v
}

#[derive(Debug)]
struct Hand {
    pull: Pull,
    at_s: f64,
}

impl HandPull for Hand {
    fn act(&mut self, p_BH: &PlaneVector, v_BH: &PlaneVector, dt_s: f64) -> HandAction {
        self.at_s += dt_s;
        let F_hand_BH_N = (self.pull)(self.at_s, &(p_BH - MIDDLE), v_BH);
        HandAction { F_hand_BH_N, buttons: 0 }
    }
}

/// The simulator, and the path each way.
struct Simulator {
    id: SessionId,
    up: Link,
    down: Link,
    seq: u64,
    newest_state: u64,
    states: u64,
}

impl Simulator {
    fn new(sessions: &mut Sessions, path: Impairment) -> Self {
        let id = sessions.connect(Transport::Quic, 0).unwrap();
        // Every delay has its own luck.
        let [mut up, down] = [1, 2].map(|way| Link::new(path, path.delay_ns + way));
        link::send(&mut up, Packet::Message(say(Body::Hello(hello("far", Role::Controller)))), 0);
        Self { id, up, down, seq: 0, newest_state: 0, states: 0 }
    }

    fn receive(&mut self, now_ns: u64) {
        while let Some(packet) = self.down.receive(now_ns) {
            let Packet::Datagram(bytes) = packet else { continue };
            let answer = match wire::decode(&bytes).unwrap() {
                DatagramBody::State(state) => self.command(&state, now_ns),
                DatagramBody::Ping(ping) => {
                    let answer = ping::answer(&ping, now_ns);
                    Some(DatagramBody::Pong(Pong { states_received: self.states, ..answer }))
                }
                other => panic!("{other:?} is not for a client"),
            };
            if let Some(answer) = answer {
                link::send(&mut self.up, Packet::Datagram(wire::encode(&answer)), now_ns);
            }
        }
    }

    /// The spring as a wrench, for where the handle was.
    fn command(&mut self, state: &State, now_ns: u64) -> Option<DatagramBody> {
        self.states += 1;
        if state.seq <= self.newest_state {
            return None;
        }
        (self.newest_state, self.seq) = (state.seq, self.seq + 1);
        let pull_N = |i: usize| -STIFFNESS_N_PER_M * (f64::from(state.position_m[i]) - MIDDLE[i]);
        let wrench = vec![pull_N(0) as f32, pull_N(1) as f32, 0.0];
        Some(DatagramBody::Command(Command {
            seq: self.seq,
            client_time_ns: now_ns,
            state_seq: state.seq,
            body: Some(command::Body::Wrench(WrenchCommand { wrench })),
            ..Command::default()
        }))
    }
}

/// `singh` with its hand, its loop and its sessions, and the simulator far away.
struct Rig {
    plan: Plan,
    device: SimulatedDevice,
    control: ControlState,
    sessions: Sessions,
    /// The newest, and how many there were.
    setpoint: (Setpoint, u64),
    simulator: Simulator,
    now_ns: u64,
}

/// What came of a run. Pairs: over all of it, and over its last two seconds.
#[derive(Clone, Copy, Debug, Default)]
struct Course {
    /// Ticks from the first command on, and those of them with one in force.
    asked: u64,
    taken: u64,
    /// Commands that were taken, that the path was not good enough for, and that were stale.
    commands: [u64; 3],
    /// Work of the motors.
    fed_J: [f64; 2],
    /// Largest distance from the middle.
    off_m: [f64; 2],
    /// Ticks in which something was held back.
    held_back: u64,
    /// Where the handle is in the end.
    end_BH: PlaneVector,
}

impl Rig {
    fn new(path: Impairment, pull: Pull, reserve_J: f64) -> Self {
        let singh = DeviceDefinition::load("singh").expect("built in");
        let mut plan = build_plan(&singh, &Scene::default());
        plan.guards.passivity_reserve_J = reserve_J;
        let mut simulation = singh.simulation(HandProgram::default());
        simulation.start_m = [MIDDLE.x, MIDDLE.y];
        let mut device = SimulatedDevice::new(simulation, 1).expect("regular");
        device.hand_over(Box::new(Hand { pull, at_s: 0.0 }));
        let mut sessions = Sessions::new(SessionConfig::new("singh", MS, 2, 2));
        let simulator = Simulator::new(&mut sessions, path);
        let (control, setpoint) = (ControlState::new(Mode::Enabled), (Setpoint::NONE, 0));
        Self { plan, device, control, sessions, setpoint, simulator, now_ns: 0 }
    }

    fn run(mut self) -> Course {
        let mut course = Course::default();
        for number in 1..=TICKS {
            self.run_until(number * MS);
            course.held_back += u64::from(self.tick());
            let of = |outcome| count(&self.sessions, outcome);
            course.commands = [self.setpoint.1, of(Outcome::Quality), of(Outcome::Stale)];
            course.asked += u64::from(course.commands != [0; 3]);
            course.taken += u64::from(self.setpoint.0.is_fresh(self.now_ns));
            let truth = self.device.truth();
            course.see(truth.energy.motors_J, (truth.p_BH - MIDDLE).norm(), number);
            course.end_BH = truth.p_BH;
        }
        course
    }

    /// All that arrives, or is due, until then.
    fn run_until(&mut self, end_ns: u64) {
        while let Some(next_ns) = self.next_ns().filter(|next_ns| *next_ns <= end_ns) {
            self.now_ns = next_ns.max(self.now_ns);
            self.simulator.receive(self.now_ns);
            while let Some(packet) = self.simulator.up.receive(self.now_ns) {
                let (id, now_ns) = (self.simulator.id, self.now_ns);
                match packet {
                    Packet::Datagram(bytes) => self.sessions.on_datagram(id, &bytes, now_ns),
                    Packet::Message(message) => self.sessions.on_message(id, message, now_ns),
                }
                self.act();
            }
            self.sessions.on_timeout(self.now_ns);
            self.act();
        }
        self.now_ns = end_ns;
    }

    fn next_ns(&self) -> Option<u64> {
        let Simulator { up, down, .. } = &self.simulator;
        [up.next_ns(), down.next_ns(), self.sessions.next_timeout()].into_iter().flatten().min()
    }

    fn act(&mut self) {
        while let Some(output) = self.sessions.poll_output() {
            let packet = match output {
                Output::Datagram { bytes, .. } => Packet::Datagram(bytes),
                Output::Message { message, .. } => Packet::Message(message),
                Output::Setpoint(setpoint) => {
                    self.setpoint = (*setpoint, self.setpoint.1 + 1);
                    continue;
                }
                Output::Rtt { .. } | Output::OneWay { .. } => continue,
                Output::Close { .. } | Output::Hand(_) => panic!("{output:?}"),
            };
            link::send(&mut self.simulator.down, packet, self.now_ns);
        }
    }

    /// One turn; true where something of the wrench was held back.
    fn tick(&mut self) -> bool {
        let now_ns = self.now_ns;
        let (sample, setpoint) = (self.device.read(now_ns), &self.setpoint.0);
        let input = TickInput { sample, setpoint, plan: &self.plan, now_ns, overruns_in_row: 0 };
        let decision = tick(&mut self.control, &input);
        self.device.write(&decision.commands).unwrap();
        assert_eq!(decision.report.fault, None);
        self.sessions.on_report(&decision.report, now_ns);
        self.act();
        decision.report.limits.contains(Limit::Passivity)
    }
}

impl Course {
    fn see(&mut self, fed_J: f64, off_m: f64, number: u64) {
        let last = number > TICKS - LAST_TICKS;
        self.fed_J[1] += if last { fed_J - self.fed_J[0] } else { 0.0 };
        self.fed_J[0] = fed_J;
        self.off_m[0] = self.off_m[0].max(off_m);
        self.off_m[1] = if last { self.off_m[1].max(off_m) } else { 0.0 };
    }

    /// Share of the ticks, from the first command on, with one in force.
    fn share_taken(&self) -> f64 {
        self.taken as f64 / self.asked as f64
    }
}

/// Without the account, and with it.
fn runs(path: Impairment, pull: Pull) -> [Course; 2] {
    let reserve_J = Guards::default().passivity_reserve_J;
    [f64::INFINITY, reserve_J].map(|reserve_J| Rig::new(path, pull, reserve_J).run())
}

/// Always on a path that loses evenly; one that loses in bursts is not good enough at times.
fn check_taken(path: Impairment, course: &Course) {
    let expected = if path.burst > 1.0 { 0.5..0.99 } else { 0.95..1.01 };
    assert!(expected.contains(&course.share_taken()), "{path:?}: {course:?}");
    assert_eq!(course.commands[2], 0, "none is stale: {path:?}: {course:?}");
}

#[test]
fn a_late_spring_that_is_taken_diverges_without_the_account_and_is_bounded_with_it() {
    let Guards { passivity_reserve_J: reserve_J, passivity_power_W: power_W, .. } =
        Guards::default();
    let [all_s, last_s] = [TICKS, LAST_TICKS].map(|ticks| ticks as f64 * 1e-3);
    for path in paths(&TAKEN_MS, &TAKEN_LOSSES) {
        let [without, with] = runs(path, light);
        check_taken(path, &without);
        check_taken(path, &with);
        assert!(without.fed_J[0] > 50.0 && without.off_m[0] > 0.06, "{path:?}: {without:?}");
        // Where the wrench is refused at times, that may be in the end.
        let swings = without.fed_J[1] > 15.0 && without.off_m[1] > 0.05;
        assert!(swings || path.burst > 1.0, "{path:?}: {without:?}");
        assert!(with.fed_J[0] < 2.0 * reserve_J + power_W * all_s, "{path:?}: {with:?}");
        // Two seconds begin and end somewhere in a swing.
        assert!(with.fed_J[1] < power_W * last_s + 0.05, "{path:?}: {with:?}");
        assert!(with.off_m[0] < 0.06 && with.off_m[1] < 0.02, "{path:?}: {with:?}");
        assert!(with.held_back > 1_000, "{path:?}: {with:?}");
    }
}

/// A spring that comes and goes feeds a hand that leads: it is held back even without delay.
#[test]
fn without_delay_the_account_leaves_the_spring_alone() {
    let fingers = paths(&[0], &TAKEN_LOSSES).into_iter().map(|path| (path, light as Pull));
    let leads = paths(&[0], &TAKEN_LOSSES[..2]).into_iter().map(|path| (path, leading as Pull));
    for (path, pull) in fingers.chain(leads) {
        let [without, with] = runs(path, pull);
        check_taken(path, &with);
        assert_eq!(with.held_back, 0, "{path:?}: {with:?}");
        assert_eq!(with.end_BH, without.end_BH, "{path:?}: to the last bit");
        assert!((0.005..0.04).contains(&with.off_m[0]), "{path:?}: {with:?}");
    }
}

/// Nothing of the spring is there when the fingers push, and nothing swings.
#[test]
fn where_the_path_is_too_bad_or_too_long_the_wrench_is_refused_and_the_handle_is_free() {
    let short_ms = [&[0], TAKEN_MS.as_slice()].concat();
    let bad = paths(&short_ms, &TOO_MUCH_LOST);
    let long = paths(&TOO_LATE_MS, &[TAKEN_LOSSES, TOO_MUCH_LOST].concat());
    for path in bad.into_iter().chain(long) {
        for course in runs(path, light) {
            assert!((0.016..0.018).contains(&course.off_m[0]), "{path:?}: {course:?}");
            assert!(course.off_m[1] < 1e-4 && course.held_back == 0, "{path:?}: {course:?}");
            assert!(course.fed_J[0].abs() < 1e-4, "{path:?}: {course:?}");
            let [taken, not_good_enough, stale] = course.commands;
            if path.delay_ns > TOO_LATE_MS[0] * MS {
                assert_eq!((taken, not_good_enough), (0, 0), "{path:?}: {course:?}");
                assert!(stale > 1_000, "{path:?}: {course:?}");
            } else {
                // A fresh session is trusted until enough of its commands were judged.
                assert!(course.share_taken() < 0.05 && taken < 500, "{path:?}: {course:?}");
                assert!(not_good_enough > 1_000 && stale == 0, "{path:?}: {course:?}");
            }
        }
    }
}

/// For `docs/network.md`.
#[test]
#[ignore = "prints figures, judges nothing"]
fn table_of_late_motors() {
    let delays_ms = [&[0], TAKEN_MS.as_slice(), &TOO_LATE_MS].concat();
    println!("| one way | lost | in a row | wrench taken | without | with |");
    println!("{}|", "|---".repeat(6));
    for path in paths(&delays_ms, &[TAKEN_LOSSES, TOO_MUCH_LOST].concat()) {
        let runs = runs(path, light);
        let taken = 100.0 * runs[1].share_taken();
        let [without, with] =
            runs.map(|run| format!("{:.1} mm, {:.2} J", 1e3 * run.off_m[1], run.fed_J[0]));
        let (delay_ms, lost, burst) = (path.delay_ns / MS, 100.0 * path.loss, path.burst);
        println!("| {delay_ms} ms | {lost:.0} % | {burst} | {taken:.1} % | {without} | {with} |");
    }
}
