//! The rules of takeover, age, quality, clocks, events and clutch on bad networks.

use nalgebra::Vector3;

use super::world::{BAD, GOOD, World};
use super::*;
use crate::impairment::Impairment;
use crate::proto::WrenchCommand;

fn wrench_command(seq: u64, clock_ns: u64, state: &State) -> Command {
    let wrench = WrenchCommand { wrench: vec![1.0, 0.0, 0.0] };
    let body = Some(command::Body::Wrench(wrench));
    Command { body, ttl_ms: 0, ..wall_command(seq, clock_ns, state.seq) }
}

#[test]
fn a_takeover_holds_whatever_the_network_delivers_late_or_twice() {
    for seed in 0..4 {
        let mut world = World::new();
        let first = world.add(Role::Controller, BAD, 10 * seed);
        world.run_until(S);
        let taker = Hello { takeover: true, ..hello("taker", Role::Controller) };
        let second = world.add_with(taker, BAD, 10 * seed + 5);
        // A path that loses a fifth is slowed down, and with the States the answers.
        world.run_until(6 * S);
        world.check_setpoints();
        let [first, second] = [first, second].map(|index| &world.clients[index]);
        assert!(first.welcomed && second.welcomed && world.closed.is_empty());
        assert!(first.states > 1500, "it stays and watches: {}", first.states);
        let taken = world.setpoints.iter().position(|setpoint| setpoint.epoch == 2).unwrap();
        let released = &world.setpoints[taken - 1];
        assert!(released.epoch == 1 && released.released);
        assert!(world.setpoints[taken..].iter().all(|setpoint| setpoint.epoch == 2));
        assert!(world.setpoints.len() > taken + 200);
        assert_eq!(world.sessions.counters().stale(StaleReason::TakenOver), 1);
        assert!(count(&world.sessions, Outcome::NotAllowed) > 500, "it goes on trying");
    }
}

#[test]
fn quality_follows_the_network_and_decides_what_is_taken() {
    let path = |loss, jitter_ms: u64| Impairment {
        loss,
        duplicates: 0.1,
        delay_ns: 30 * MS,
        jitter_ns: jitter_ms * MS,
        ..Impairment::NONE
    };
    // Only States that came are answered, so what is lost on the way down costs no number.
    let table = [
        (GOOD, Quality::Excellent, true, true),
        (path(0.03, 2), Quality::Good, true, true),
        (path(0.15, 2), Quality::Fair, false, true),
        (path(0.0, 40), Quality::Fair, false, true),
        (path(0.6, 2), Quality::Poor, false, true),
    ];
    for (network, quality, wrench, contacts) in table {
        for (direct, taken) in [(true, wrench), (false, contacts)] {
            let mut world = World::new();
            let client = world.add(Role::Controller, network, 3);
            if direct {
                world.clients[client].answer = wrench_command;
            }
            world.run_until(4 * S);
            world.check_setpoints();
            let info = world.sessions.list(world.now_ns).next().unwrap();
            assert_eq!(info.quality, quality, "{network:?}: {} {}", info.loss, info.variation_ns);
            let newest_ns = world.setpoints.last().unwrap().received_ns;
            assert_eq!(world.now_ns - newest_ns < 200 * MS, taken, "{network:?} {direct}");
            assert_eq!(count(&world.sessions, Outcome::Quality) > 100, !taken);
        }
    }
}

#[test]
fn over_a_path_longer_than_the_greatest_age_nothing_is_taken_however_fresh_it_looks() {
    let far = |delay_ms: u64| Impairment { delay_ns: delay_ms * MS, ..GOOD };
    for (wrench, delay_ms, taken) in
        [(true, 90, true), (true, 110, false), (false, 490, true), (false, 510, false)]
    {
        let mut world = World::new();
        let client = world.add(Role::Controller, far(delay_ms), 1);
        if wrench {
            world.clients[client].answer = wrench_command;
        }
        world.run_until(3 * S);
        assert_eq!(!world.setpoints.is_empty(), taken);
        assert_eq!(count(&world.sessions, Outcome::Stale) > 1000, !taken);
    }
}

#[test]
fn the_clock_is_found_through_delay_and_jitter_within_its_bound() {
    for (ahead_ns, network) in [(0, GOOD), (40 * S, BAD), (7, BAD)] {
        let mut world = World::new();
        let client = world.add(Role::Observer, network, 8);
        world.clients[client].ahead_ns = ahead_ns;
        world.run_until(6 * S);
        let clock = world.sessions.list(world.now_ns).next().unwrap().clock.unwrap();
        assert!(clock.offset_ns.abs_diff(ahead_ns as i64) <= clock.bound_ns, "{clock:?}");
        let (least_ns, most_ns) = (network.delay_ns, network.delay_ns + network.jitter_ns);
        assert!((least_ns..=most_ns).contains(&clock.bound_ns));
        assert!(world.delays.len() > 40);
        for (_, delay_ns, bound_ns) in &world.delays {
            let (low, high) = (least_ns.saturating_sub(*bound_ns), most_ns + bound_ns);
            assert!((low..=high).contains(delay_ns), "{delay_ns} in {low} to {high}");
        }
    }
}

#[test]
fn every_event_is_seen_in_state_alone_and_in_order() {
    for seed in 0..4 {
        let mut world = World::new();
        world.device = |tick| {
            let mut pressed = report(tick);
            pressed.last_event = tick / 50;
            pressed.events[0] = (tick % 50 == 0).then_some(Event::Button(tick as u32));
            pressed
        };
        let client = world.add(Role::Controller, BAD, seed);
        world.run_until(3 * S);
        let seen = &world.clients[client].events;
        let first = seen[0];
        assert!(first <= 2 && seen.len() > 55, "{seen:?}");
        assert!(seen.iter().copied().eq(first..first + seen.len() as u64), "{seen:?}");
    }
}

/// The device swings by 0.1 m, at up to 0.8 m/s.
fn swinging(tick: u64) -> Report {
    let x_m = 0.35 + 0.1 * (tick as f64 * 0.008).sin();
    Report { p_WT_m: Vector3::new(x_m, 0.0, 0.0), ..report(tick) }
}

#[test]
fn a_clutch_does_not_jump_on_a_bad_network() {
    for seed in 0..4 {
        let mut world = World::new();
        world.device = swinging;
        let client = world.add(Role::Controller, BAD, seed);
        // A third of the time clutched.
        world.clients[client].answer = |seq, clock_ns, state| Command {
            clutched: state.seq / 100 % 3 == 1,
            ..wall_command(seq, clock_ns, state.seq)
        };
        world.run_until(4 * S);
        world.check_setpoints();
        let positions_m = &world.clients[client].positions_m;
        let mut moved_less = 0;
        for pair in positions_m.windows(2) {
            let [(before, from_m), (after, to_m)] = [pair[0], pair[1]];
            let ticks = (after - before) as f64;
            // A clutch that begins or ends between two States is seen within a tick.
            assert!((to_m - from_m).abs() <= 0.0008 * ticks + 1e-6, "{pair:?}");
            moved_less += u32::from(to_m == from_m);
        }
        assert!(moved_less > 200, "it stood still: {moved_less}");
        let clutched = world.setpoints.iter().filter(|setpoint| setpoint.clutched).count();
        assert!(clutched > 100 && clutched < world.setpoints.len() / 2);
    }
}
