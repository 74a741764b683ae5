//! Commands in, States and events out.

use super::*;
use crate::proto::SessionState;

#[test]
fn a_command_becomes_the_setpoint_and_is_echoed() {
    let mut sessions = sessions();
    let id = join(&mut sessions, "first", Role::Controller, 0);
    sessions.on_report(&report(1), MS);
    drain(&mut sessions);
    sessions.on_datagram(id, &datagram(wall_command(4, 123, 1)), MS + 300_000);
    let outputs = drain(&mut sessions);
    let setpoint = setpoints(&outputs)[0];
    assert_eq!((setpoint.epoch, setpoint.seq, setpoint.state_tick), (1, 4, 1));
    assert_eq!((setpoint.received_ns, setpoint.ttl_ns), (MS + 300_000, 100 * MS));
    assert_eq!(outputs.len(), 1);
    sessions.on_report(&report(2), 2 * MS);
    let (_, state) = states(&drain(&mut sessions)).remove(0);
    assert_eq!((state.echo_client_time_ns, state.echo_hold_ns), (123, 700_000));
    assert_eq!(state.session_state(), SessionState::Commanding);
}

#[test]
fn an_observer_cannot_command() {
    let mut sessions = sessions();
    let controller = join(&mut sessions, "controller", Role::Controller, 0);
    let observer = join(&mut sessions, "observer", Role::Observer, 0);
    sessions.on_datagram(controller, &datagram(wall_command(1, 0, 0)), 1);
    drain(&mut sessions);
    for seq in [2, 100] {
        sessions.on_datagram(observer, &datagram(wall_command(seq, 0, 0)), 2);
    }
    assert!(drain(&mut sessions).is_empty());
    assert_eq!(count(&sessions, Outcome::NotAllowed), 2);
    sessions.on_datagram(controller, &datagram(wall_command(2, 0, 0)), 3);
    assert_eq!(setpoints(&drain(&mut sessions))[0].seq, 2, "its numbers were not used up");
    sessions.on_report(&report(1), 4);
    let states = states(&drain(&mut sessions));
    assert_eq!(states[1].1.session_state(), SessionState::Monitoring);
    assert_eq!(states[1].1.echo_hold_ns, 0, "nothing of its own is echoed");
}

#[test]
fn old_and_repeated_commands_are_counted_and_change_nothing() {
    let mut sessions = sessions();
    let id = join(&mut sessions, "first", Role::Controller, 0);
    sessions.on_datagram(id, &datagram(wall_command(5, 50, 0)), 1);
    drain(&mut sessions);
    for seq in [5, 4, 1] {
        sessions.on_datagram(id, &datagram(wall_command(seq, 99, 0)), 600 * MS);
    }
    assert!(drain(&mut sessions).is_empty());
    assert_eq!((count(&sessions, Outcome::Old), count(&sessions, Outcome::Accepted)), (3, 1));
    sessions.on_report(&report(600), 600 * MS);
    let (_, state) = states(&drain(&mut sessions)).remove(0);
    assert_eq!(state.echo_client_time_ns, 50);
    assert_eq!(state.session_state(), SessionState::Monitoring, "old commands are no commands");
}

#[test]
fn an_invalid_command_is_refused_as_a_whole_and_says_why_in_the_list() {
    let mut sessions = sessions();
    let id = join(&mut sessions, "first", Role::Controller, 0);
    let mut bad = wall_command(1, 0, 0);
    if let Some(command::Body::Contacts(contacts)) = &mut bad.body {
        contacts.contacts.push(Contact {
            id: 2,
            kinetic_friction: f32::NAN,
            ..contacts.contacts[0].clone()
        });
    }
    sessions.on_datagram(id, &datagram(bad), 1);
    let future = wall_command(2, 0, 1);
    sessions.on_datagram(id, &datagram(future), 2);
    assert!(drain(&mut sessions).is_empty());
    assert_eq!(count(&sessions, Outcome::Invalid), 2);
    let info = sessions.list(3).next().unwrap();
    let refusal = info.last_refusal.unwrap().to_string();
    assert_eq!(refusal, "state_seq = 1: must be a State sent, at most 0");
    assert_eq!(info.state, SessionState::Idle);
    sessions.on_datagram(id, &datagram(wall_command(1, 0, 0)), 4);
    assert_eq!(setpoints(&drain(&mut sessions)).len(), 1, "number 1 was not used up");
}

#[test]
fn of_two_commands_between_outputs_the_newest_wins() {
    let mut sessions = sessions();
    let id = join(&mut sessions, "first", Role::Controller, 0);
    sessions.on_datagram(id, &datagram(wall_command(1, 0, 0)), 1);
    sessions.on_datagram(id, &datagram(wall_command(2, 0, 0)), 2);
    let setpoints = setpoints(&drain(&mut sessions));
    assert_eq!(setpoints.iter().map(|s| s.seq).collect::<Vec<_>>(), [2]);
}

#[test]
fn the_controller_is_served_first_and_observers_at_their_own_interval() {
    let mut sessions = sessions();
    let slow = Hello { state_interval_us: 4_000, ..hello("slow", Role::Observer) };
    let (slow, _) = meet(&mut sessions, slow, 0);
    let controller = join(&mut sessions, "controller", Role::Controller, 0);
    let mut received = [0, 0];
    for tick in 1000..2000 {
        sessions.on_report(&report(tick), tick * MS);
        let states = states(&drain(&mut sessions));
        assert_eq!(states[0].0, controller);
        for (to, state) in states {
            assert_eq!(state.seq, tick);
            received[usize::from(to == slow)] += 1;
        }
    }
    assert_eq!(received, [1000, 250]);
}

#[test]
fn events_reach_everyone_with_their_numbers() {
    let mut sessions = sessions();
    let ids =
        [join(&mut sessions, "a", Role::Observer, 0), join(&mut sessions, "b", Role::Observer, 0)];
    let mut report = report(3);
    report.events[..2].copy_from_slice(&[Some(Event::StuckBegin), Some(Event::StuckEnd)]);
    report.last_event = 12;
    sessions.on_report(&report, 3 * MS);
    let outputs = drain(&mut sessions);
    for id in ids {
        let numbers: Vec<u64> = outputs
            .iter()
            .filter_map(|output| match output {
                Output::Message { to, message } if *to == id => match &message.body {
                    Some(Body::Event(event)) => Some(event.id),
                    _ => None,
                },
                _ => None,
            })
            .collect();
        assert_eq!(numbers, [11, 12]);
    }
}

#[test]
fn a_force_whose_time_ran_out_is_counted_and_a_released_one_not_twice() {
    let mut sessions = sessions();
    let id = join(&mut sessions, "first", Role::Controller, 0);
    let mut stale = report(200);
    stale.events[0] = Some(Event::Stale);
    stale.last_event = 1;
    sessions.on_datagram(id, &datagram(wall_command(1, 0, 0)), MS);
    sessions.on_report(&stale, 200 * MS);
    assert_eq!(sessions.counters().stale(StaleReason::Ttl), 1);
    sessions.on_datagram(id, &datagram(wall_command(2, 0, 200)), 201 * MS);
    drain(&mut sessions);
    let bye = crate::proto::Bye { reason: ByeReason::Done.into(), detail: String::new() };
    sessions.on_message(id, StreamMessage { body: Some(Body::Bye(bye)) }, 202 * MS);
    sessions.on_report(&stale, 203 * MS);
    assert_eq!(sessions.counters().stale(StaleReason::Ttl), 1);
    assert_eq!(sessions.counters().stale(StaleReason::Released), 1);
    assert!(setpoints(&drain(&mut sessions))[0].released, "let go on purpose");
}
