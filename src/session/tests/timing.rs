//! Pings, silence, and who counts as late.

use super::*;
use crate::proto::{Ping, Pong, SessionState};

fn pings(outputs: &[Output]) -> Vec<(SessionId, Ping)> {
    outputs
        .iter()
        .filter_map(|output| match output {
            Output::Datagram { to, bytes, .. } => match wire::decode(bytes) {
                Ok(DatagramBody::Ping(ping)) => Some((*to, ping)),
                _ => None,
            },
            _ => None,
        })
        .collect()
}

fn pong(ping: Ping, held_ns: u64) -> Vec<u8> {
    wire::encode(&DatagramBody::Pong(Pong {
        seq: ping.seq,
        sent_ns: ping.sent_ns,
        received_ns: 1,
        returned_ns: 1 + held_ns,
        ..Pong::default()
    }))
}

#[test]
fn a_ping_is_answered_at_once_with_the_device_clock() {
    let mut sessions = sessions();
    let id = join(&mut sessions, "first", Role::Observer, 0);
    let ping = Ping { seq: 3, sent_ns: 42 };
    sessions.on_datagram(id, &wire::encode(&DatagramBody::Ping(ping)), 9 * MS);
    let Some(Output::Datagram { to, bytes, .. }) = sessions.poll_output() else { panic!("a Pong") };
    let expected =
        Pong { seq: 3, sent_ns: 42, received_ns: 9 * MS, returned_ns: 9 * MS, ..Pong::default() };
    assert_eq!((to, wire::decode(&bytes)), (id, Ok(DatagramBody::Pong(expected))));
}

#[test]
fn round_trips_are_measured_ten_times_a_second() {
    let mut sessions = sessions();
    let id = join(&mut sessions, "first", Role::Observer, 0);
    let mut measured = Vec::new();
    while let Some(now_ns) = sessions.next_timeout().filter(|next_ns| *next_ns < S) {
        sessions.on_timeout(now_ns);
        for (to, ping) in pings(&drain(&mut sessions)) {
            sessions.on_datagram(to, &pong(ping, MS), now_ns + 5 * MS);
            let is_rtt = |output: &Output| matches!(output, Output::Rtt { .. });
            measured.extend(drain(&mut sessions).into_iter().filter(is_rtt));
        }
    }
    let expected = Output::Rtt { transport: Transport::Quic, rtt_ns: 4 * MS };
    assert_eq!(measured, vec![expected; 10]);
    let info = sessions.list(S).next().unwrap();
    assert_eq!((info.id, info.rtt_ns), (id, Some(4 * MS)));
}

#[test]
fn a_pong_to_nothing_is_unexpected() {
    let mut sessions = sessions();
    let id = join(&mut sessions, "first", Role::Observer, 0);
    let ping = Ping { seq: 9, sent_ns: 0 };
    sessions.on_datagram(id, &pong(ping, 0), 1);
    assert!(drain(&mut sessions).is_empty());
    assert_eq!(count(&sessions, Outcome::Unexpected), 1);
}

/// Runs timers until the session is gone; returns when, and what was put out then.
fn until_closed(sessions: &mut Sessions) -> (u64, Vec<Output>) {
    loop {
        let now_ns = sessions.next_timeout().unwrap();
        sessions.on_timeout(now_ns);
        let outputs = drain(sessions);
        if outputs.iter().any(|output| matches!(output, Output::Close { .. })) {
            return (now_ns, outputs);
        }
    }
}

#[test]
fn silence_closes_a_session_and_frees_its_lease() {
    let mut sessions = sessions();
    let id = join(&mut sessions, "first", Role::Controller, 0);
    sessions.on_datagram(id, &datagram(wall_command(1, 0, 0)), 300 * MS);
    drain(&mut sessions);
    let (closed_ns, outputs) = until_closed(&mut sessions);
    assert_eq!(closed_ns, 2300 * MS);
    let detail = "nothing was heard for 2 s".to_string();
    assert_eq!(bye(&outputs, id), Some((ByeReason::Silent, detail)));
    assert!(setpoints(&outputs).is_empty(), "its time-to-live had taken its force before");
    let (_, outputs) = meet(&mut sessions, hello("next", Role::Controller), 3 * S);
    assert_eq!(welcome(&outputs).unwrap().lease_epoch, 2);
}

#[test]
fn a_quiet_observer_that_answers_pings_stays() {
    let mut sessions = sessions();
    join(&mut sessions, "quiet", Role::Observer, 0);
    while let Some(now_ns) = sessions.next_timeout().filter(|next_ns| *next_ns < 10 * S) {
        sessions.on_timeout(now_ns);
        for (to, ping) in pings(&drain(&mut sessions)) {
            sessions.on_datagram(to, &pong(ping, 0), now_ns);
        }
    }
    assert_eq!(sessions.list(10 * S).count(), 1);
}

#[test]
fn without_a_hello_a_connection_lasts_ten_seconds_whatever_else_it_sends() {
    let mut sessions = sessions();
    let id = sessions.connect(Transport::Quic, 0).unwrap();
    for now_ms in 0..9999 {
        sessions.on_datagram(id, &datagram(wall_command(1, 0, 0)), now_ms * MS);
    }
    let (closed_ns, outputs) = until_closed(&mut sessions);
    assert_eq!(closed_ns, 10 * S);
    assert_eq!(bye(&outputs, id).unwrap().1, "no Hello came within 10 s");
}

/// What a controller that announced `interval_us` is called just before each of its frames,
/// which come at 72 Hz, up to 6 ms late, every tenth one lost.
fn states_at_72_hz(interval_us: u32) -> Vec<SessionState> {
    let mut sessions = sessions();
    let headset = Hello { command_interval_us: interval_us, ..hello("headset", Role::Controller) };
    let (id, _) = meet(&mut sessions, headset, 0);
    let mut states = Vec::new();
    for frame in (1..=720u64).filter(|frame| frame % 10 != 0) {
        let now_ns = frame * 13_889_000 + frame * 7919 % 7 * MS;
        states.push(sessions.list(now_ns).next().unwrap().state);
        sessions.on_datagram(id, &datagram(wall_command(frame, 0, 0)), now_ns);
    }
    states
}

#[test]
fn a_72_hz_headset_is_never_late_by_its_own_interval() {
    let states = states_at_72_hz(13_889);
    assert_eq!(states[0], SessionState::Idle);
    assert!(states[1..].iter().all(|state| *state == SessionState::Commanding));
}

#[test]
fn a_client_that_announced_1_khz_is_late_where_a_72_hz_frame_is_missing() {
    let states = states_at_72_hz(1_000);
    let late = states.iter().filter(|state| **state == SessionState::Monitoring);
    assert!((60..=80).contains(&late.count()), "one in nine or ten");
}

#[test]
fn of_reports_that_waited_only_the_newest_becomes_state_and_no_event_is_lost() {
    let mut sessions = sessions();
    join(&mut sessions, "first", Role::Observer, 0);
    let mut pressed = report(5);
    (pressed.events[0], pressed.last_event) = (Some(crate::control::Event::Button(1)), 1);
    sessions.on_late_report(&pressed);
    sessions.on_report(&report(6), 6 * MS);
    let outputs = drain(&mut sessions);
    let ticks: Vec<_> = states(&outputs).iter().map(|(_, state)| state.seq).collect();
    assert_eq!(ticks, [6]);
    let told = |output: &Output| match output {
        Output::Message { message, .. } => matches!(message.body, Some(Body::Event(_))),
        _ => false,
    };
    assert_eq!(outputs.iter().filter(|output| told(output)).count(), 1);
}
