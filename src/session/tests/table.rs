//! Every message and datagram of a client in every state of its session: what comes of it.

use super::*;
use crate::proto::{
    Ack, Bye, ForceFieldCommand, HandTarget, Ping, Pong, SessionState, WrenchCommand,
};

/// Rows: what is sent. Columns: in which state. Datagrams have the name of their outcome;
/// messages lead to a Welcome, to a Bye with its reason, or to a farewell without an answer.
const TABLE: &str = "
               awaiting   observer    hand        idle        commanding  monitoring  loser       clutched
hello          welcome    invalid     invalid     invalid     invalid     invalid     invalid     invalid
bad_hello      invalid    invalid     invalid     invalid     invalid     invalid     invalid     invalid
goodbye        farewell   farewell    farewell    farewell    farewell    farewell    farewell    farewell
welcome        invalid    invalid     invalid     invalid     invalid     invalid     invalid     invalid
event          invalid    invalid     invalid     invalid     invalid     invalid     invalid     invalid
no_body        invalid    invalid     invalid     invalid     invalid     invalid     invalid     invalid
broken_stream  invalid    invalid     invalid     invalid     invalid     invalid     invalid     invalid
contacts       unexpected not_allowed not_allowed accepted    accepted    accepted    not_allowed accepted
empty_world    unexpected not_allowed not_allowed accepted    accepted    accepted    not_allowed accepted
wrench         unexpected not_allowed not_allowed accepted    accepted    accepted    not_allowed accepted
force_field    unexpected not_allowed not_allowed accepted    accepted    accepted    not_allowed accepted
clutch         unexpected not_allowed not_allowed accepted    accepted    accepted    not_allowed accepted
no_command     unexpected not_allowed not_allowed invalid     invalid     invalid     not_allowed invalid
bad_contact    unexpected not_allowed not_allowed invalid     invalid     invalid     not_allowed invalid
bad_wrench     unexpected not_allowed not_allowed invalid     invalid     invalid     not_allowed invalid
repeated       unexpected not_allowed not_allowed accepted    old         old         not_allowed old
from_future    unexpected not_allowed not_allowed invalid     invalid     invalid     not_allowed invalid
from_the_past  unexpected not_allowed not_allowed stale       stale       stale       not_allowed stale
wall_of_the_past unexpected not_allowed not_allowed accepted  accepted    accepted    not_allowed accepted
hand_target    unexpected not_allowed accepted    not_allowed not_allowed not_allowed not_allowed not_allowed
bad_target     unexpected not_allowed invalid     not_allowed not_allowed not_allowed not_allowed not_allowed
old_target     unexpected not_allowed old         not_allowed not_allowed not_allowed not_allowed not_allowed
ack            unexpected accepted    accepted    accepted    accepted    accepted    accepted    accepted
ack_of_none    unexpected invalid     invalid     invalid     invalid     invalid     invalid     invalid
ping           unexpected accepted    accepted    accepted    accepted    accepted    accepted    accepted
pong           unexpected unexpected  unexpected  unexpected  unexpected  unexpected  unexpected  unexpected
state          unexpected unexpected  unexpected  unexpected  unexpected  unexpected  unexpected  unexpected
junk           malformed  malformed   malformed   malformed   malformed   malformed   malformed   malformed
too_long       oversize   oversize    oversize    oversize    oversize    oversize    oversize    oversize
";

const NOW_NS: u64 = 1_000 * MS;

/// A session core one second old, and a session in this state.
fn in_state(state: &str) -> (Sessions, SessionId) {
    let mut sessions = sessions();
    for tick in 1..=1_000 {
        sessions.on_report(&report(tick), tick * MS);
    }
    drain(&mut sessions);
    // The second before this one, for a wrench to be late and a controller to be silent.
    let (joined_ns, role) = match state {
        "observer" => (NOW_NS, Role::Observer),
        "hand" => (NOW_NS, Role::Hand),
        _ => (NOW_NS - 100 * MS, Role::Controller),
    };
    if state == "awaiting" {
        let id = sessions.connect(Transport::Quic, NOW_NS).unwrap();
        return (sessions, id);
    }
    let id = join(&mut sessions, state, role, joined_ns);
    let commanded = |sessions: &mut Sessions, now_ns| {
        sessions.on_datagram(id, &datagram(wall_command(5, 0, 990)), now_ns);
    };
    match state {
        "hand" => sessions.on_datagram(id, &target(5, vec![0.3, 0.0, 0.0]), NOW_NS),
        "commanding" => commanded(&mut sessions, NOW_NS),
        "monitoring" => commanded(&mut sessions, NOW_NS - 90 * MS),
        "clutched" => {
            let clutched = Command { clutched: true, ..wall_command(5, 0, 990) };
            sessions.on_datagram(id, &datagram(clutched), NOW_NS);
        }
        "loser" => {
            commanded(&mut sessions, NOW_NS);
            let winner = Hello { takeover: true, ..hello("winner", Role::Controller) };
            meet(&mut sessions, winner, NOW_NS);
        }
        _ => {}
    }
    drain(&mut sessions);
    let info = sessions.list(NOW_NS).find(|info| info.id == id).unwrap();
    let expected = match state {
        "observer" | "loser" | "monitoring" => SessionState::Monitoring,
        "idle" => SessionState::Idle,
        _ => SessionState::Commanding,
    };
    assert_eq!((info.state, info.clutched), (expected, state == "clutched"), "{state}");
    (sessions, id)
}

fn target(seq: u64, position_m: Vec<f32>) -> Vec<u8> {
    let target = HandTarget { seq, position_m, held: true, ..HandTarget::default() };
    wire::encode(&DatagramBody::HandTarget(target))
}

fn with_body(body: Option<command::Body>) -> Vec<u8> {
    datagram(Command { body, ..wall_command(6, 0, 1_000) })
}

fn wrench(numbers: usize) -> Option<command::Body> {
    Some(command::Body::Wrench(WrenchCommand { wrench: vec![1.0; numbers] }))
}

fn bytes(name: &str) -> Option<Vec<u8>> {
    let field = ForceFieldCommand { origin_m: vec![0.0; 3], ..ForceFieldCommand::default() };
    let contacts = |contacts| Some(command::Body::Contacts(Contacts { contacts }));
    Some(match name {
        "contacts" => datagram(wall_command(6, 0, 1_000)),
        "empty_world" => with_body(contacts(vec![])),
        "wrench" => with_body(wrench(3)),
        "force_field" => with_body(Some(command::Body::ForceField(field))),
        "clutch" => datagram(Command { clutched: true, body: None, ..wall_command(6, 0, 1_000) }),
        "no_command" => with_body(None),
        "bad_contact" => with_body(contacts(vec![Contact::default()])),
        "bad_wrench" => with_body(wrench(4)),
        "repeated" => datagram(wall_command(5, 0, 1_000)),
        "from_future" => datagram(wall_command(6, 0, 1_001)),
        "from_the_past" => datagram(Command { body: wrench(3), ..wall_command(6, 0, 700) }),
        "wall_of_the_past" => datagram(wall_command(6, 0, 1)),
        "hand_target" => target(6, vec![0.4, 0.0, 0.0]),
        "bad_target" => target(6, vec![0.4, 0.0]),
        "old_target" => target(5, vec![0.4, 0.0, 0.0]),
        "ack" => wire::encode(&DatagramBody::Ack(Ack { event_id: 0 })),
        "ack_of_none" => wire::encode(&DatagramBody::Ack(Ack { event_id: 1 })),
        "ping" => wire::encode(&DatagramBody::Ping(Ping::default())),
        "pong" => wire::encode(&DatagramBody::Pong(Pong::default())),
        "state" => wire::encode(&DatagramBody::State(State::default())),
        "junk" => vec![0x12, 0x01],
        "too_long" => vec![0x12; 1_200],
        _ => return None,
    })
}

fn message(name: &str) -> StreamMessage {
    match name {
        "hello" => say(Body::Hello(hello("again", Role::Observer))),
        "bad_hello" => {
            say(Body::Hello(Hello { state_interval_us: 1, ..hello("x", Role::Observer) }))
        }
        "goodbye" => say(Body::Bye(Bye::default())),
        "welcome" => say(Body::Welcome(Welcome::default())),
        "event" => say(Body::Event(crate::proto::Event::default())),
        "no_body" => StreamMessage { body: None },
        other => panic!("{other} is no row"),
    }
}

/// Sends it and tells what came of it.
fn outcome_of(name: &str, sessions: &mut Sessions, id: SessionId) -> String {
    if let Some(bytes) = bytes(name) {
        let before = Outcome::ALL.map(|outcome| count(sessions, outcome));
        sessions.on_datagram(id, &bytes, NOW_NS);
        let counted = Outcome::ALL.into_iter().zip(before).filter(|(outcome, before)| {
            assert!(count(sessions, *outcome) <= before + 1);
            count(sessions, *outcome) > *before
        });
        let counted: Vec<_> = counted.map(|(outcome, _)| outcome.name()).collect();
        assert_eq!(counted.len(), 1, "{name}: each datagram is counted once: {counted:?}");
        return counted[0].to_owned();
    }
    match name {
        "broken_stream" => sessions.on_broken_stream(id, FrameError::TooLong, NOW_NS),
        _ => sessions.on_message(id, message(name), NOW_NS),
    }
    String::new()
}

/// What the outputs make of an outcome; checks that nothing else came out.
fn told(name: &str, outcome: String, outputs: &[Output], id: SessionId) -> String {
    let forces = setpoints(outputs).iter().filter(|setpoint| !setpoint.released).count();
    let commands = "contacts empty_world wrench force_field clutch repeated wall_of_the_past";
    let taken = outcome == "accepted" && commands.split(' ').any(|command| command == name);
    assert_eq!(forces, usize::from(taken), "{name}: a force only from an accepted command");
    let hands = outputs.iter().filter(|output| matches!(output, Output::Hand(to) if to.held));
    assert_eq!(hands.count(), usize::from(outcome == "accepted" && name == "hand_target"));
    if !outcome.is_empty() {
        return outcome;
    }
    let left = |output: &Output| matches!(output, Output::Close { to, .. } if *to == id);
    if welcome(outputs).is_some() {
        "welcome".into()
    } else if let Some((reason, _)) = bye(outputs, id) {
        reason.as_str_name().trim_start_matches("BYE_REASON_").to_lowercase()
    } else if outputs.iter().any(left) {
        "farewell".into()
    } else {
        "nothing".into()
    }
}

#[test]
fn whatever_is_sent_in_whatever_state_the_table_says_what_comes_of_it() {
    let mut rows = TABLE.lines().skip(1);
    let states: Vec<_> = rows.next().unwrap().split_whitespace().collect();
    let mut wrong = Vec::new();
    for row in rows {
        let mut cells = row.split_whitespace();
        let name = cells.next().unwrap();
        for (state, expected) in states.iter().zip(cells) {
            let (mut sessions, id) = in_state(state);
            let outcome = outcome_of(name, &mut sessions, id);
            let outputs = drain(&mut sessions);
            let found = told(name, outcome, &outputs, id);
            if found != expected {
                wrong.push(format!("{name} in {state}: {found}, not {expected}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
