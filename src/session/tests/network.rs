//! A controller and an intruder on a bad network, for seconds of virtual time.

use super::world::{BAD, GOOD, World};
use super::*;
use crate::impairment::Impairment;
use crate::proto::{SessionState, WrenchCommand, command};

#[test]
fn on_a_good_network_every_state_is_answered_and_every_answer_taken() {
    let mut world = World::new();
    let client = world.add(Role::Controller, GOOD, 1);
    world.run_until(3 * S);
    world.check_setpoints();
    let client = &world.clients[client];
    assert!(client.welcomed);
    assert!(client.states > 2990 && world.setpoints.len() > 2990);
    assert!(client.rtts_ns.iter().all(|rtt_ns| *rtt_ns == 200_000), "the echo gives the path");
    let idle = client.states_seen.iter().filter(|s| **s == SessionState::Idle).count();
    assert!(idle <= 2 && client.states_seen.last() == Some(&SessionState::Commanding));
    assert_eq!(count(&world.sessions, Outcome::Old), 0);
}

#[test]
fn loss_delay_reordering_and_duplicates_only_cost_what_they_take() {
    for seed in 0..4 {
        let mut world = World::new();
        let client = world.add(Role::Controller, BAD, 100 * seed);
        world.run_until(4 * S);
        world.check_setpoints();
        let taken = world.setpoints.len();
        let old = count(&world.sessions, Outcome::Old);
        assert!(taken > 500 && old > 100, "{taken} taken, {old} old");
        assert_eq!(count(&world.sessions, Outcome::Malformed), 0);
        assert_eq!(count(&world.sessions, Outcome::Invalid), 0);
        let client = &world.clients[client];
        assert!(client.rtts_ns.iter().all(|rtt_ns| (40 * MS..=70 * MS).contains(rtt_ns)));
        let commanding = client.states_seen.iter().filter(|s| **s == SessionState::Commanding);
        assert!(commanding.count() * 10 > client.states_seen.len() * 9);
        assert!(world.closed.is_empty());
    }
}

#[test]
fn an_intruder_gets_no_setpoint_out_and_a_vanished_controller_is_replaced() {
    let mut world = World::new();
    let first = world.add(Role::Controller, GOOD, 1);
    world.run_until(S);
    let second = world.add(Role::Controller, GOOD, 10);
    let observer = world.add(Role::Observer, BAD, 20);
    world.run_until(2 * S);
    assert_eq!(world.clients[second].refused, Some(ByeReason::LeaseHeld));
    assert!(world.clients[observer].states > 100);
    assert!(count(&world.sessions, Outcome::NotAllowed) > 50, "it tried");
    assert!(world.setpoints.iter().all(|setpoint| setpoint.epoch == 1));

    world.clients[first].dies_ns = world.now_ns;
    let last_taken_ns = world.setpoints.last().unwrap().received_ns;
    world.run_until(5 * S);
    let (closed, closed_ns) = *world.closed.last().unwrap();
    assert_eq!(closed, world.clients[first].id);
    assert!((2 * S..=2 * S + 200 * MS).contains(&(closed_ns - last_taken_ns)));
    let released = world.setpoints.iter().any(|setpoint| setpoint.released);
    assert!(!released, "its time-to-live had taken its force long before");

    world.add(Role::Controller, BAD, 30);
    world.run_until(7 * S);
    world.check_setpoints();
    let last = world.setpoints.last().unwrap();
    assert_eq!((last.epoch, last.released), (2, false));
}

/// A wall that holds for 200 ms from each command that comes.
fn lasting_wall(seq: u64, clock_ns: u64, state: &State) -> Command {
    Command { ttl_ms: 200, ..wall_command(seq, clock_ns, state.seq) }
}

#[test]
fn a_wall_stands_on_the_worst_of_paths_and_a_wrench_does_not() {
    for (delay_ms, loss, burst) in
        [(0, 0.5, 1.0), (0, 0.5, 10.0), (100, 0.3, 10.0), (200, 0.3, 1.0), (200, 0.5, 10.0)]
    {
        let network =
            Impairment { delay_ns: delay_ms * MS + 100_000, loss, burst, ..Impairment::NONE };
        let mut world = World::new();
        let client = world.add(Role::Controller, network, 3 * delay_ms + burst as u64);
        world.clients[client].answer = lasting_wall;
        world.clients[client].at_least_ns = 4 * MS;
        world.run_until(20 * S);
        world.check_setpoints();
        let held =
            |pair: &[Setpoint]| (pair[1].received_ns - pair[0].received_ns).min(pair[0].ttl_ns);
        let stood_ns: u64 = world.setpoints.windows(2).map(held).sum();
        let (first, last) = (&world.setpoints[0], world.setpoints.last().unwrap());
        let stood = stood_ns as f64 / (last.received_ns - first.received_ns) as f64;
        assert!(last.received_ns > 19 * S, "{delay_ms} {loss} {burst}: the wall went for good");
        assert!(stood > 0.99, "{delay_ms} {loss} {burst}: {stood}");

        world.clients[client].answer = |seq, clock_ns, state| Command {
            body: Some(command::Body::Wrench(WrenchCommand { wrench: vec![1.0, 0.0, 0.0] })),
            ..lasting_wall(seq, clock_ns, state)
        };
        let before = world.setpoints.len();
        world.run_until(24 * S);
        let later = world.setpoints[before..].iter();
        let forces = later.filter(|setpoint| setpoint.received_ns > 21 * S).count();
        assert_eq!(forces, 0, "{delay_ms} {loss} {burst}: a force over such a path");
    }
}

#[test]
fn the_same_seed_gives_the_same_run() {
    let run = || {
        let mut world = World::new();
        world.add(Role::Controller, BAD, 5);
        world.add(Role::Observer, BAD, 6);
        world.run_until(2 * S);
        world.setpoints
    };
    assert_eq!(run(), run());
}

/// A line that carries less than half of what 1000 States a second need.
#[test]
fn on_a_slow_line_the_stream_goes_as_fast_as_the_line_and_is_not_late() {
    let slow = crate::impairment::Impairment {
        delay_ns: 20 * MS,
        rate_bit_per_s: 300e3,
        ..crate::impairment::Impairment::NONE
    };
    let mut world = World::new();
    let client = world.add(Role::Observer, slow, 1);
    world.run_until(S);
    let info = |world: &World| {
        let info = world.sessions.list(world.now_ns).next().expect("it is there");
        (info.slowed_by, info.rtt_ns.unwrap_or(0))
    };
    assert!(info(&world).1 > 100 * MS, "the line's queue is full: {:?}", info(&world));
    world.run_until(6 * S);
    assert_eq!(info(&world).0, 4, "a quarter of the States");
    assert!(info(&world).1 < 60 * MS, "nothing waits any more: {:?}", info(&world));
    let before = world.clients[client].states;
    world.run_until(8 * S);
    let rate = (world.clients[client].states - before) / 2;
    assert!((240..=250).contains(&rate), "{rate} States a second");
    // Five seconds later it tries again, and sees at once that it was too early.
    world.run_until(40 * S);
    let before = world.clients[client].states;
    world.run_until(50 * S);
    let rate = (world.clients[client].states - before) / 10;
    assert!((240..=340).contains(&rate), "{rate} States a second");
}
