//! Whatever a client sends, it gets no force, no growth and no panic.

use super::*;
use proptest::prelude::*;

/// A session core with a commanding controller, and that controller.
fn commanded() -> (Sessions, SessionId) {
    let mut sessions = sessions();
    let id = join(&mut sessions, "first", Role::Controller, 0);
    sessions.on_datagram(id, &datagram(wall_command(100, 1, 0)), 1);
    drain(&mut sessions);
    (sessions, id)
}

/// What the next State tells, which is all that a client can see of the core's state.
fn seen(sessions: &mut Sessions) -> Vec<(SessionId, State)> {
    sessions.on_report(&report(1), 2);
    let outputs = drain(sessions);
    assert!(setpoints(&outputs).is_empty());
    states(&outputs)
}

#[test]
fn malformed_truncated_and_oversize_datagrams_are_counted_and_leave_no_trace() {
    let (mut sessions, id) = commanded();
    let before = seen(&mut sessions);
    let good = datagram(wall_command(101, 2, 0));
    for end in 1..good.len() {
        sessions.on_datagram(id, &good[..end], 2);
    }
    sessions.on_datagram(id, &[], 2);
    sessions.on_datagram(id, &[good.as_slice(), &[0]].concat(), 2);
    sessions.on_datagram(id, &[0; 1101], 2);
    assert!(drain(&mut sessions).is_empty());
    assert_eq!(count(&sessions, Outcome::Malformed), good.len() as u64 + 1);
    assert_eq!(count(&sessions, Outcome::Oversize), 1);
    assert_eq!(seen(&mut sessions), before);
}

#[test]
fn a_state_is_not_for_a_client_to_send() {
    let (mut sessions, id) = commanded();
    let bytes = wire::encode(&DatagramBody::State(State::default()));
    sessions.on_datagram(id, &bytes, 2);
    assert!(drain(&mut sessions).is_empty());
    assert_eq!(count(&sessions, Outcome::Unexpected), 1);
}

#[test]
fn a_caller_that_does_not_drain_loses_datagrams_but_neither_memory_nor_a_goodbye() {
    let (mut sessions, id) = commanded();
    let ping = wire::encode(&DatagramBody::Ping(crate::proto::Ping::default()));
    for _ in 0..100_000 {
        sessions.on_datagram(id, &ping, 2);
    }
    assert!(count(&sessions, Outcome::Dropped) > 90_000);
    sessions.shutdown(3);
    let outputs = drain(&mut sessions);
    assert!(outputs.len() < 1_100);
    assert_eq!(bye(&outputs, id).unwrap().0, ByeReason::Shutdown);
}

#[test]
fn messages_for_a_session_that_is_gone_do_nothing() {
    let (mut sessions, id) = commanded();
    sessions.disconnect(id, 2);
    drain(&mut sessions);
    sessions.on_datagram(id, &datagram(wall_command(101, 1, 0)), 3);
    sessions.on_message(id, say(Body::Hello(hello("back", Role::Controller))), 3);
    sessions.on_broken_stream(id, FrameError::Malformed, 3);
    sessions.disconnect(id, 3);
    assert!(drain(&mut sessions).is_empty());
}

proptest! {
    #[test]
    fn arbitrary_bytes_never_become_a_force(
        packets in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..1200), 1..20),
    ) {
        let (mut sessions, id) = commanded();
        let before = seen(&mut sessions);
        for packet in &packets {
            sessions.on_datagram(id, packet, 2);
            prop_assert!(setpoints(&drain(&mut sessions)).is_empty());
        }
        prop_assert_eq!(seen(&mut sessions), before);
    }

    #[test]
    fn a_damaged_command_is_refused_or_is_still_a_newer_one_in_range(
        place in 0usize..70,
        value in any::<u8>(),
    ) {
        let (mut sessions, id) = commanded();
        let mut bytes = datagram(wall_command(101, 2, 0));
        let place = place % bytes.len();
        bytes[place] = value;
        sessions.on_datagram(id, &bytes, 2);
        for setpoint in setpoints(&drain(&mut sessions)) {
            prop_assert!(setpoint.seq > 100 && setpoint.epoch == 1);
            prop_assert!(setpoint.ttl_ns <= 200 * MS);
        }
    }

    #[test]
    fn any_order_of_calls_keeps_one_controller_and_growing_numbers(
        steps in prop::collection::vec((0u8..9, 0u64..4, any::<u64>()), 1..200),
    ) {
        let mut sessions = sessions();
        let mut newest = (0, 0);
        let mut now_ns = 0;
        for (step, who, number) in steps {
            now_ns += number % (300 * MS);
            let id = SessionId(sessions.last_id.saturating_sub(who));
            match step {
                0 | 1 => drop(sessions.connect(Transport::Quic, now_ns)),
                2 => sessions.on_message(id, say(Body::Hello(hello("c", Role::Controller))), now_ns),
                3 => sessions.on_message(id, say(Body::Hello(hello("o", Role::Observer))), now_ns),
                4 | 5 => sessions.on_datagram(id, &datagram(wall_command(number % 50, 0, 0)), now_ns),
                6 => sessions.disconnect(id, now_ns),
                7 => sessions.on_message(id, say(Body::Bye(crate::proto::Bye::default())), now_ns),
                _ => sessions.on_timeout(now_ns),
            }
            sessions.on_report(&report(1), now_ns);
            for setpoint in setpoints(&drain(&mut sessions)) {
                let key = (setpoint.epoch, setpoint.seq);
                prop_assert!(key > newest || key == newest && setpoint.released);
                newest = key;
            }
            let controllers = sessions.list(now_ns).filter(|info| info.role == Role::Controller);
            prop_assert!(controllers.count() <= 1);
            prop_assert!(sessions.next_timeout().is_none_or(|next_ns| next_ns > now_ns || step != 8));
        }
    }
}
