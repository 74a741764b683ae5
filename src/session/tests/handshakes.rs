//! Who gets in, under which lease, and how sessions end.

use super::*;
use crate::proto::Bye;

#[test]
fn a_good_hello_is_welcomed_with_what_a_client_has_to_know() {
    let mut sessions = sessions();
    sessions.on_report(&Report { scene_revision: 5, ..report(1) }, 0);
    let (id, outputs) = meet(&mut sessions, hello("trainer", Role::Controller), 7);
    let expected = Welcome {
        version: "hapticd/1".into(),
        session: "sessions/1".into(),
        device: "devices/cho-2005".into(),
        tick_period_us: 1000,
        scene_revision: 5,
        lease_epoch: 1,
        device_time_ns: 7,
        utc_time_ns: 1007,
        freedoms: 2,
        actuators: 4,
        max_ttl_ms: 200,
        grpc_port: 7350,
        felt_stiffness_ratio: 1.0,
        max_age_ms: 200,
        max_contacts_age_ms: 1000,
        example_wall: None,
    };
    assert_eq!(welcome(&outputs), Some(&expected));
    assert_eq!(lease_news(&outputs, id), [1]);
    let info: Vec<_> = sessions.list(7).collect();
    assert_eq!((info[0].id, info[0].role, info[0].client_name), (id, Role::Controller, "trainer"));
    assert_eq!(info[0].state, crate::proto::SessionState::Idle);
}

#[test]
fn a_bad_hello_is_refused_closed_and_changes_nothing() {
    let mut sessions = sessions();
    let bad = Hello { command_interval_us: 7, ..hello("x", Role::Controller) };
    let (id, outputs) = meet(&mut sessions, bad, 0);
    let detail = "command_interval_us = 7: must be 0 or 1000 to 50000 us".to_string();
    assert_eq!(bye(&outputs, id), Some((ByeReason::Invalid, detail)));
    assert_eq!(outputs.len(), 2, "Bye and Close, nothing else: {outputs:?}");
    assert_eq!((sessions.list(0).count(), sessions.next_timeout()), (0, None));
    let (_, outputs) = meet(&mut sessions, hello("y", Role::Controller), 0);
    assert_eq!(welcome(&outputs).unwrap().lease_epoch, 1, "no epoch was used up");
}

#[test]
fn a_second_controller_is_refused_by_the_name_of_the_first_which_goes_on_commanding() {
    let mut sessions = sessions();
    let first = join(&mut sessions, "first", Role::Controller, 0);
    let (second, outputs) = meet(&mut sessions, hello("second", Role::Controller), 1);
    let (reason, detail) = bye(&outputs, second).unwrap();
    assert_eq!(reason, ByeReason::LeaseHeld);
    assert!(detail.contains("\"first\"") && detail.contains("sessions/1"), "{detail}");
    sessions.on_datagram(second, &datagram(wall_command(1, 0, 0)), 2);
    assert!(drain(&mut sessions).is_empty(), "the refused session is gone");
    sessions.on_datagram(first, &datagram(wall_command(1, 0, 0)), 3);
    let setpoints = setpoints(&drain(&mut sessions));
    assert_eq!((setpoints[0].epoch, setpoints[0].seq), (1, 1));
}

#[test]
fn the_lease_passes_after_a_disconnect_under_a_higher_epoch() {
    let mut sessions = sessions();
    let observer = join(&mut sessions, "watcher", Role::Observer, 0);
    let first = join(&mut sessions, "first", Role::Controller, 0);
    sessions.on_datagram(first, &datagram(wall_command(9, 0, 0)), 1);
    drain(&mut sessions);
    sessions.disconnect(first, 2);
    let outputs = drain(&mut sessions);
    assert!(setpoints(&outputs).is_empty(), "its force is left to its time-to-live");
    assert_eq!(lease_news(&outputs, observer), [0], "free");

    let (second, outputs) = meet(&mut sessions, hello("second", Role::Controller), 3);
    assert_eq!(welcome(&outputs).unwrap().lease_epoch, 2);
    assert_eq!(lease_news(&outputs, observer), [2]);
    sessions.on_datagram(second, &datagram(wall_command(1, 0, 0)), 4);
    let taken = setpoints(&drain(&mut sessions))[0];
    assert_eq!((taken.epoch, taken.seq, taken.released), (2, 1, false), "a new count begins");
}

#[test]
fn a_goodbye_releases_the_force_and_closes_without_an_answer() {
    let mut sessions = sessions();
    let id = join(&mut sessions, "first", Role::Controller, 0);
    sessions.on_datagram(id, &datagram(wall_command(1, 0, 0)), 1);
    drain(&mut sessions);
    sessions.on_message(id, say(Body::Bye(Bye::default())), 2);
    let outputs = drain(&mut sessions);
    assert!(setpoints(&outputs)[0].released);
    assert!(matches!(&outputs[1], Output::Close { reason: ByeReason::Done, .. }));
    assert_eq!((outputs.len(), sessions.counters().stale(StaleReason::Released)), (2, 1));
}

#[test]
fn a_controller_that_never_commanded_leaves_nothing_to_release() {
    let mut sessions = sessions();
    let id = join(&mut sessions, "idle", Role::Controller, 0);
    sessions.disconnect(id, 1);
    assert!(drain(&mut sessions).is_empty());
    assert_eq!(
        StaleReason::ALL.map(|reason| sessions.counters().stale(reason)),
        [0; StaleReason::ALL.len()]
    );
}

#[test]
fn what_a_client_must_not_say_ends_its_session() {
    let wrong = [
        say(Body::Hello(hello("again", Role::Controller))),
        say(Body::Welcome(Welcome::default())),
        say(Body::Event(crate::proto::Event::default())),
        StreamMessage { body: None },
    ];
    for message in wrong {
        let mut sessions = sessions();
        let id = join(&mut sessions, "first", Role::Controller, 0);
        sessions.on_datagram(id, &datagram(wall_command(1, 0, 0)), 1);
        drain(&mut sessions);
        sessions.on_message(id, message, 2);
        let outputs = drain(&mut sessions);
        assert_eq!(bye(&outputs, id).unwrap().0, ByeReason::Invalid);
        assert!(setpoints(&outputs)[0].released, "its force goes with it");
    }
}

#[test]
fn a_stream_that_cannot_be_read_ends_its_session() {
    let mut sessions = sessions();
    let id = join(&mut sessions, "first", Role::Observer, 0);
    sessions.on_broken_stream(id, FrameError::TooLong, 1);
    let (reason, detail) = bye(&drain(&mut sessions), id).unwrap();
    assert_eq!(reason, ByeReason::Invalid);
    assert_eq!(detail, "a message of more than 65536 bytes is announced");
}

#[test]
fn nothing_is_answered_before_hello() {
    let mut sessions = sessions();
    let id = sessions.connect(Transport::Quic, 0).unwrap();
    sessions.on_datagram(id, &wire::encode(&DatagramBody::Ping(crate::proto::Ping::default())), 1);
    sessions.on_datagram(id, &datagram(wall_command(1, 0, 0)), 2);
    sessions.on_report(&report(1), 3);
    assert!(drain(&mut sessions).is_empty());
    assert_eq!(count(&sessions, Outcome::Unexpected), 2);
}

#[test]
fn one_session_too_many_is_told_so_and_opens_nothing() {
    let mut sessions = Sessions::new(SessionConfig {
        max_sessions: 2,
        ..SessionConfig::new("cho-2005", MS, 2, 4)
    });
    let first = sessions.connect(Transport::Quic, 0).unwrap();
    sessions.connect(Transport::Quic, 0).unwrap();
    let refusal = sessions.connect(Transport::Quic, 0).unwrap_err();
    let Some(Body::Bye(bye)) = refusal.bye().body else { panic!("a Bye") };
    assert_eq!(bye.reason(), ByeReason::TooManySessions);
    assert_eq!(bye.detail, "sessions = 2: at most 2 at a time");
    sessions.disconnect(first, 1);
    assert!(sessions.connect(Transport::Quic, 1).is_ok());
}

#[test]
fn shutdown_says_bye_to_everyone_and_releases_the_force() {
    let mut sessions = sessions();
    let controller = join(&mut sessions, "a", Role::Controller, 0);
    let observer = join(&mut sessions, "b", Role::Observer, 0);
    let waiting = sessions.connect(Transport::Quic, 0).unwrap();
    sessions.on_datagram(controller, &datagram(wall_command(1, 0, 0)), 1);
    drain(&mut sessions);
    sessions.shutdown(2);
    let outputs = drain(&mut sessions);
    for id in [controller, observer, waiting] {
        assert_eq!(bye(&outputs, id).unwrap().0, ByeReason::Shutdown);
    }
    assert!(setpoints(&outputs)[0].released);
    assert_eq!(outputs.len(), 7);
    assert_eq!((sessions.list(2).count(), sessions.next_timeout()), (0, None));
}
