//! One controller takes the lease of another; hands and their turns.

use super::*;
use crate::proto::{HandTarget, SessionState};

fn taker(name: &str) -> Hello {
    Hello { takeover: true, ..hello(name, Role::Controller) }
}

#[test]
fn the_loser_is_told_stays_and_watches_and_its_late_commands_never_act() {
    let mut sessions = sessions();
    let first = join(&mut sessions, "first", Role::Controller, 0);
    sessions.on_datagram(first, &datagram(wall_command(1, 0, 0)), MS);
    drain(&mut sessions);

    let (second, outputs) = meet(&mut sessions, taker("second"), 2 * MS);
    assert_eq!(welcome(&outputs).unwrap().lease_epoch, 2);
    let Output::Setpoint(released) = &outputs[0] else { panic!("first of all: {outputs:?}") };
    assert!(released.released && released.epoch == 1, "the old force goes by the ramp");
    assert_eq!((lease_news(&outputs, first), lease_news(&outputs, second)), (vec![2], vec![2]));
    assert_eq!(sessions.counters().stale(StaleReason::TakenOver), 1);

    for seq in 2..50 {
        sessions.on_datagram(first, &datagram(wall_command(seq, 0, 0)), 3 * MS);
    }
    assert!(drain(&mut sessions).is_empty());
    assert_eq!(count(&sessions, Outcome::NotAllowed), 48);
    sessions.on_datagram(second, &datagram(wall_command(1, 0, 0)), 4 * MS);
    assert_eq!(setpoints(&drain(&mut sessions))[0].epoch, 2);

    sessions.on_report(&report(1), 5 * MS);
    let states = states(&drain(&mut sessions));
    assert_eq!(states[0].0, second, "the controller is served first");
    assert_eq!(states[1].1.session_state(), SessionState::Monitoring);
    let roles: Vec<_> = sessions.list(5 * MS).map(|info| info.role).collect();
    assert_eq!(roles, [Role::Observer, Role::Controller]);

    // Its leaving ends nothing, and takes no force away.
    sessions.disconnect(first, 6 * MS);
    assert!(drain(&mut sessions).is_empty());
    sessions.on_datagram(second, &datagram(wall_command(2, 0, 0)), 7 * MS);
    assert_eq!(setpoints(&drain(&mut sessions)).len(), 1);
}

#[test]
fn without_takeover_nothing_is_taken_and_a_free_lease_needs_none() {
    let mut sessions = sessions();
    let (first, outputs) = meet(&mut sessions, taker("first"), 0);
    assert_eq!(welcome(&outputs).unwrap().lease_epoch, 1);
    let (second, outputs) = meet(&mut sessions, hello("second", Role::Controller), 1);
    assert_eq!(bye(&outputs, second).unwrap().0, ByeReason::LeaseHeld);
    sessions.on_datagram(first, &datagram(wall_command(1, 0, 0)), 2);
    assert_eq!(setpoints(&drain(&mut sessions))[0].epoch, 1);
}

#[test]
fn the_force_of_one_that_vanished_is_released_when_the_next_one_comes() {
    let mut sessions = sessions();
    let first = join(&mut sessions, "first", Role::Controller, 0);
    sessions.on_datagram(first, &datagram(wall_command(1, 0, 0)), MS);
    sessions.disconnect(first, 2 * MS);
    assert!(setpoints(&drain(&mut sessions)).iter().all(|setpoint| !setpoint.released));
    let (_, outputs) = meet(&mut sessions, hello("second", Role::Controller), 3 * MS);
    assert!(setpoints(&outputs)[0].released, "an old epoch does not act under a new one");
    assert_eq!(sessions.counters().stale(StaleReason::Disconnected), 1);
}

fn pull(x_m: f32, seq: u64) -> Vec<u8> {
    let target = HandTarget {
        seq,
        position_m: vec![x_m, 0.0, 0.0],
        held: true,
        buttons: 1,
        client_time_ns: 0,
    };
    wire::encode(&DatagramBody::HandTarget(target))
}

fn pulls(outputs: &[Output]) -> Vec<(bool, f64)> {
    let pulled = outputs.iter().filter_map(|output| match output {
        Output::Hand(target) => Some((target.held, target.position_W_m.x)),
        _ => None,
    });
    pulled.collect()
}

#[test]
fn the_newest_hand_pulls_and_when_it_goes_the_one_before_does_again() {
    let mut sessions = sessions();
    let old = join(&mut sessions, "old", Role::Hand, 0);
    sessions.on_datagram(old, &pull(0.25, 1), 1);
    assert_eq!(pulls(&drain(&mut sessions)), [(true, 0.25)]);
    let (new, outputs) = meet(&mut sessions, hello("new", Role::Hand), 2);
    assert_eq!(pulls(&outputs), [(false, 0.0)], "the old one is made to let go");
    sessions.on_datagram(old, &pull(0.25, 2), 3);
    sessions.on_datagram(new, &pull(0.5, 1), 4);
    assert_eq!(pulls(&drain(&mut sessions)), [(true, 0.5)]);
    assert_eq!(count(&sessions, Outcome::NotAllowed), 1);
    sessions.disconnect(new, 5);
    assert_eq!(pulls(&drain(&mut sessions)), [(false, 0.0)]);
    sessions.on_datagram(old, &pull(0.25, 3), 6);
    assert_eq!(pulls(&drain(&mut sessions)), [(true, 0.25)]);
}

#[test]
fn a_silent_hand_lets_go_and_a_hand_commands_nothing() {
    let mut sessions = sessions();
    let hand = join(&mut sessions, "hand", Role::Hand, 0);
    let controller = join(&mut sessions, "controller", Role::Controller, 0);
    sessions.on_datagram(hand, &pull(0.25, 1), MS);
    sessions.on_datagram(hand, &datagram(wall_command(2, 0, 0)), MS);
    sessions.on_datagram(controller, &datagram(wall_command(1, 0, 0)), MS);
    let outputs = drain(&mut sessions);
    assert_eq!((pulls(&outputs), setpoints(&outputs).len()), (vec![(true, 0.25)], 1));
    let mut let_go_ns = None;
    while let_go_ns.is_none() {
        let now_ns = sessions.next_timeout().unwrap();
        sessions.on_timeout(now_ns);
        let_go_ns = (!pulls(&drain(&mut sessions)).is_empty()).then_some(now_ns);
    }
    assert_eq!(let_go_ns, Some(251 * MS));
}

#[test]
fn a_hand_pulls_in_its_own_workspace() {
    let mut sessions = sessions();
    let workspace = crate::proto::Workspace { scale: 2.0, offset_m: vec![1.0, 0.0, 0.0] };
    let hello = Hello { workspace: Some(workspace), ..hello("hand", Role::Hand) };
    let (id, _) = meet(&mut sessions, hello, 0);
    sessions.on_datagram(id, &pull(1.5, 1), 1);
    assert_eq!(pulls(&drain(&mut sessions)), [(true, 0.25)]);
}
