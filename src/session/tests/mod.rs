//! The sessions of one device in virtual time: each rule, then all of them on a bad network.

mod calls;
mod clutch;
mod commanding;
mod deadband;
mod ending;
mod handshakes;
mod hostile;
mod late_motors;
mod link;
mod network;
mod rules;
mod switchboard;
mod table;
mod takeover;
mod timing;
mod world;

use super::*;
use crate::control::{Event, Report};
use crate::proto::{
    Command, Contact, Contacts, HalfSpaceContact, Hello, Welcome, command, contact,
};

pub const MS: u64 = 1_000_000;
pub const S: u64 = 1_000 * MS;

pub fn sessions() -> Sessions {
    Sessions::new(SessionConfig {
        grpc_port: 7350,
        takes_hands: true,
        utc_minus_device_ns: 1_000,
        ..SessionConfig::new("cho-2005", MS, 2, 4)
    })
}

pub fn hello(name: &str, role: Role) -> Hello {
    Hello {
        versions: vec!["hapticd/1".into()],
        client_name: name.into(),
        role: match role {
            Role::Observer => crate::proto::Role::Observer.into(),
            Role::Controller => crate::proto::Role::Controller.into(),
            Role::Hand => crate::proto::Role::Hand.into(),
        },
        ..Hello::default()
    }
}

pub fn say(body: Body) -> StreamMessage {
    StreamMessage { body: Some(body) }
}

pub fn drain(sessions: &mut Sessions) -> Vec<Output> {
    std::iter::from_fn(|| sessions.poll_output()).collect()
}

/// Connects, says Hello, and returns what came back.
pub fn meet(sessions: &mut Sessions, hello: Hello, now_ns: u64) -> (SessionId, Vec<Output>) {
    let id = sessions.connect(Transport::Quic, now_ns).unwrap();
    sessions.on_message(id, say(Body::Hello(hello)), now_ns);
    (id, drain(sessions))
}

/// A welcomed session.
pub fn join(sessions: &mut Sessions, name: &str, role: Role, now_ns: u64) -> SessionId {
    let (id, outputs) = meet(sessions, hello(name, role), now_ns);
    assert!(welcome(&outputs).is_some(), "{outputs:?}");
    id
}

pub fn welcome(outputs: &[Output]) -> Option<&Welcome> {
    outputs.iter().find_map(|output| match output {
        Output::Message { message, .. } => match &message.body {
            Some(Body::Welcome(welcome)) => Some(welcome),
            _ => None,
        },
        _ => None,
    })
}

/// Reason and detail of the Bye to `id`, checked to be followed by its Close.
pub fn bye(outputs: &[Output], id: SessionId) -> Option<(ByeReason, String)> {
    let position = outputs.iter().position(|output| {
        matches!(output, Output::Message { to, message: StreamMessage { body: Some(Body::Bye(_)) } }
            if *to == id)
    })?;
    match (&outputs[position], &outputs[position + 1]) {
        (Output::Message { message, .. }, Output::Close { to, reason, detail }) => {
            let Some(Body::Bye(bye)) = &message.body else { unreachable!() };
            assert_eq!((*to, *reason, detail), (id, bye.reason(), &bye.detail));
            Some((*reason, detail.clone()))
        }
        _ => panic!("a Bye without its Close"),
    }
}

pub fn setpoints(outputs: &[Output]) -> Vec<Setpoint> {
    outputs
        .iter()
        .filter_map(|output| match output {
            Output::Setpoint(setpoint) => Some(**setpoint),
            _ => None,
        })
        .collect()
}

/// The lease epochs announced to `id`.
pub fn lease_news(outputs: &[Output], id: SessionId) -> Vec<u32> {
    outputs
        .iter()
        .filter_map(|output| match output {
            Output::Message { to, message } if *to == id => match &message.body {
                Some(Body::Event(event)) if event.kind() == crate::proto::EventKind::Lease => {
                    Some(event.value)
                }
                _ => None,
            },
            _ => None,
        })
        .collect()
}

pub fn wall_command(seq: u64, client_time_ns: u64, state_seq: u64) -> Command {
    let wall = Contact {
        id: 1,
        revision: 1,
        shape: Some(contact::Shape::HalfSpace(HalfSpaceContact {
            point_m: vec![0.3, 0.0, 0.0],
            normal: vec![-1.0, 0.0, 0.0],
        })),
        stiffness_n_per_m: 1e7,
        ..Contact::default()
    };
    Command {
        seq,
        client_time_ns,
        state_seq,
        ttl_ms: 100,
        body: Some(command::Body::Contacts(Contacts { contacts: vec![wall] })),
        ..Command::default()
    }
}

pub fn datagram(command: Command) -> Vec<u8> {
    wire::encode(&DatagramBody::Command(command))
}

pub fn report(tick: u64) -> Report {
    Report { tick, time_ns: tick * MS, ..Report::default() }
}

/// The States in some outputs, and whom they went to.
pub fn states(outputs: &[Output]) -> Vec<(SessionId, State)> {
    outputs
        .iter()
        .filter_map(|output| match output {
            Output::Datagram { to, bytes, .. } => match wire::decode(bytes) {
                Ok(DatagramBody::State(state)) => Some((*to, state)),
                _ => None,
            },
            _ => None,
        })
        .collect()
}

pub fn count(sessions: &Sessions, outcome: Outcome) -> u64 {
    sessions.counters().datagrams(Transport::Quic, outcome)
}
