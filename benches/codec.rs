//! Time and size of the stream's messages: from a Report to the bytes of a State, and from the
//! bytes of a Command to a Setpoint, beside protobuf alone on the same messages.
//!
//! The Reports are those of the wall-following experiment while the hand slides. The unit is
//! protobuf's encoding of one State.

#![allow(non_snake_case)]

mod experiment;
mod measure;

use std::hint::black_box;

use experiment::{Experiment, WALL_N_PER_M, WALL_X_M, scene, wall_contact};
use hapticd::control::Report;
use hapticd::device::HandProgram;
use hapticd::proto::{
    Command, Contact, Contacts, Datagram, HalfSpaceContact, Hello, Role, State, StreamMessage,
    command, contact, datagram, stream_message,
};
use hapticd::session::{Output, SessionConfig, SessionId, Sessions, Transport};
use hapticd::wire;
use measure::{Series, clock_alone, print_table, rounds};
use prost::Message;

/// One tick, nanoseconds.
const TICK_NS: u64 = 1_000_000;

fn main() {
    let reports = reports(rounds(100_000));
    let (mut sessions, controller) = one_controller();
    let mut states = Vec::with_capacity(reports.len());
    let mut report = Series::new("State: Report to bytes (session)");
    for tick in &reports {
        let sent = report.time(|| answer(&mut sessions, tick));
        states.push(sent.expect("the controller gets every tick's State"));
    }
    let [mut encode, mut decode, mut read] =
        ["State: encode (prost alone)", "State: decode (prost alone)", "State: bytes read (wire)"]
            .map(Series::new);
    for bytes in &states {
        let Ok(datagram::Body::State(state)) = read.time(|| wire::decode(black_box(bytes))) else {
            panic!("a State that cannot be read");
        };
        let body = encode.time(|| black_box(&state).encode_to_vec());
        decode.time(|| State::decode(black_box(&body[..])).is_ok());
    }
    let [one, eight] =
        [1, 8].map(|contacts| commands(&mut sessions, controller, reports.len(), contacts));
    let clock = clock_alone();
    let rows = [&report, &encode, &decode, &read];
    let rows = rows.into_iter().chain(&one.rows).chain(&eight.rows).chain([&clock]);
    print_table("one message", &encode, rows);

    let sizes = states.iter().map(Vec::len);
    let mean = sizes.clone().sum::<usize>() as f64 / states.len() as f64;
    println!(
        "State while sliding: {mean:.1} bytes in the mean, {} at most (bound {})",
        sizes.max().unwrap_or(0),
        wire::MAX_STATE_BYTES
    );
    println!(
        "Command: {} bytes with 1 wall, {} with 8 (bound {})",
        one.bytes,
        eight.bytes,
        wire::MAX_COMMAND_BYTES
    );
}

/// Reports of ticks that touch the wall.
fn reports(count: usize) -> Vec<Report> {
    let mut experiment = Experiment::new(HandProgram::default(), scene([]), &[wall_contact()]);
    let touching = std::iter::repeat_with(|| experiment.step().report);
    touching.filter(|report| report.contact_count > 0).take(count).collect()
}

fn one_controller() -> (Sessions, SessionId) {
    let mut sessions = Sessions::new(SessionConfig {
        max_age_ms: u32::MAX,
        ..SessionConfig::new("cho-2005", TICK_NS, 2, 4)
    });
    let id = sessions.connect(Transport::Quic, 0).expect("room for one");
    let hello = Hello {
        versions: vec![wire::PROTOCOL.into()],
        client_name: "bench".into(),
        role: Role::Controller.into(),
        ..Hello::default()
    };
    let hello = StreamMessage { body: Some(stream_message::Body::Hello(hello)) };
    sessions.on_message(id, hello, 0);
    while sessions.poll_output().is_some() {}
    (sessions, id)
}

/// Everything that the session does of one tick, and the State's bytes.
fn answer(sessions: &mut Sessions, report: &Report) -> Option<Vec<u8>> {
    sessions.on_report(black_box(report), report.time_ns);
    let mut state = None;
    while let Some(output) = sessions.poll_output() {
        if let Output::Datagram { bytes, .. } = output {
            state = Some(bytes);
        }
    }
    state
}

struct Commands {
    rows: [Series; 3],
    bytes: usize,
}

/// Commands with this many walls, there and back.
fn commands(sessions: &mut Sessions, id: SessionId, count: usize, contacts: usize) -> Commands {
    let row = |name: &str| Series::new(format!("Command of {contacts}: {name}"));
    let [mut setpoint, mut encode, mut decode] =
        ["bytes to Setpoint (session)", "encode (prost alone)", "decode (prost alone)"].map(row);
    let mut bytes = 0;
    for _ in 0..count {
        let command = next_command(contacts);
        let body = datagram::Body::Command(command);
        let datagram = Datagram { body: Some(body) };
        let encoded = encode.time(|| black_box(&datagram).encode_to_vec());
        bytes = encoded.len();
        decode.time(|| Datagram::decode(black_box(&encoded[..])).is_ok());
        let taken = setpoint.time(|| {
            sessions.on_datagram(id, black_box(&encoded), 1_000_000_000);
            sessions.poll_output()
        });
        assert!(matches!(taken, Some(Output::Setpoint(_))), "every command is taken");
    }
    Commands { rows: [setpoint, encode, decode], bytes }
}

/// The next command with so many walls; numbers grow from call to call.
fn next_command(contacts: usize) -> Command {
    use std::sync::atomic::{AtomicU64, Ordering};
    static SEQ: AtomicU64 = AtomicU64::new(0);
    let seq = SEQ.fetch_add(1, Ordering::Relaxed) + 1;
    let wall = |id: usize| Contact {
        id: id as u32 + 1,
        revision: 1,
        shape: Some(contact::Shape::HalfSpace(HalfSpaceContact {
            point_m: vec![WALL_X_M as f32, 0.0, 0.0],
            normal: vec![-1.0, 0.0, 0.0],
        })),
        stiffness_n_per_m: WALL_N_PER_M as f32,
        ..Contact::default()
    };
    Command {
        seq,
        client_time_ns: seq * TICK_NS,
        state_seq: 0,
        ttl_ms: 100,
        body: Some(command::Body::Contacts(Contacts {
            contacts: (0..contacts).map(wall).collect(),
        })),
        ..Command::default()
    }
}
