//! Writes the seeds: real messages, files and scripts, for a fuzzer to begin with.
//!
//! `cargo run --example seeds` in `fuzz/`; the same every time, so `git status` shows what a
//! change of the contract changes in them.

use std::path::Path;

use hapticd::config::BUILT_IN;
use hapticd::proto::datagram::Body;
use hapticd::proto::{
    Ack, Bye, Command, Event, HandTarget, Hello, Ping, Pong, State, StreamMessage, stream_message,
};
use hapticd::wire::{encode, encode_frame};
use hapticd_fuzz::script::Script;
use hapticd_fuzz::{TARGETS, messages, objects, packets, recordings, sessions};
use prost::Message;
use rand::{RngCore, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Scripts of each target that reads one; more would only repeat themselves.
const SCRIPTS: u64 = 6;

fn main() -> std::io::Result<()> {
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("seeds");
    for (target, check) in TARGETS {
        let directory = seeds.join(target);
        let _ = std::fs::remove_dir_all(&directory);
        std::fs::create_dir_all(&directory)?;
        for (name, bytes) in seeds_of(target) {
            check(&bytes);
            std::fs::write(directory.join(name), bytes)?;
        }
    }
    Ok(())
}

type Seeds = Vec<(String, Vec<u8>)>;

fn named<const N: usize>(seeds: [(&str, Vec<u8>); N]) -> Seeds {
    seeds.into_iter().map(|(name, bytes)| (name.to_owned(), bytes)).collect()
}

fn seeds_of(target: &str) -> Seeds {
    match target {
        "access" => [
            ("address", "127.0.0.1:7353"),
            ("ipv6", "[::1]:7354\nhttps://[::1]:7354"),
            ("name", "lab.example:7354\nhttps://page.example"),
            ("localhost", "LOCALHOST\nhttp://page.localhost:8080"),
            ("stranger", "evil.example\nhttps://evil.example"),
        ]
        .map(|(name, text)| (name.to_owned(), text.as_bytes().to_vec()))
        .into(),
        "connect_string" => connect_strings(),
        "datagram" => datagrams(),
        "device_file" => BUILT_IN
            .iter()
            .map(|(name, text)| (format!("{name}.toml"), text.as_bytes().to_vec()))
            .collect(),
        "frames" => frames(),
        "object_message" => {
            objects::examples().into_iter().map(|(name, o)| (name, o.encode_to_vec())).collect()
        }
        "recording" => recording(),
        "scene_file" => {
            let [by_people, state] = objects::example_files();
            let empty = b"object = []\n".to_vec();
            named([("by-people.toml", by_people), ("state.toml", state), ("empty.toml", empty)])
        }
        "server_file" => {
            let devices =
                b"[[devices]]\nname = \"left\"\ndevice = \"cho-2005\"\nrt_cpu = 1\n".to_vec();
            named([
                ("example.toml", hapticd::config::EXAMPLE.as_bytes().to_vec()),
                ("devices.toml", devices),
            ])
        }
        "sealed" => packets(),
        "session_events" => [named([("story", story())]), scripts()].concat(),
        _ => scripts(),
    }
}

fn scripts() -> Seeds {
    (0..SCRIPTS).map(|number| (format!("script-{number}"), random(number, 600))).collect()
}

/// What clients do on a usual day, as a script of `session_events`: two controllers of one
/// device, of which the second takes the lease; both command, both are asked how they are. After
/// half a second without a State a wrench is too old, and a wall is not. A third, which watches,
/// comes over sealed UDP.
fn story() -> Vec<u8> {
    let mut bytes = vec![0; 5]; // the clock begins at zero
    let connect = [0, 0]; // by QUIC
    // Who, usual, device, controller, takes the lease or not, no detail, nothing else.
    let hello = |who, takeover| [1, who, 0, 0, 1, takeover, 0, 0, 0, 0];
    // On a device, several, how many; each without a move, a loss or a delay.
    let ticks =
        |count: u8| [[12, 0, 3, count].as_slice(), &vec![0; 3 * usize::from(count)]].concat();
    // Who, as of the newest State, for 100 ms; a wrench of three numbers; not clutched, once.
    let wrench = |who| {
        let head = [3, who, 0, 0, 0, 0, 0, 100, 4, 0, 0];
        let force = [0, 0, 192, 0, 0, 128, 0, 0, 128];
        [head.as_slice(), &force, &[0, 0, 0]].concat()
    };
    // As of the newest State, for 100 ms; one half-space, of which everything else is usual.
    let wall =
        |who| [[3, who, 0, 0, 0, 0, 0, 100, 0, 0, 1].as_slice(), &[0; 41], &[0, 0, 0]].concat();
    let half_a_second = [15, 8, 0];
    // A call, of nobody in particular, that opens: usual, device, observer, nothing else; ticket.
    let opened = [17, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8];
    let come_sealed = [18, 2];
    for part in [
        connect.as_slice(),
        &hello(0, 0),
        &ticks(10),
        &wrench(0),
        &ticks(30),
        &wrench(0),
        &connect,
        &hello(1, 1),
        &ticks(4),
        &wrench(1),
        &wrench(0), // of an observer by now
        &ticks(40),
        &half_a_second,
        &wrench(1), // too old
        &wall(1),
        &opened,
        &come_sealed,
        &ticks(60),
        &[11, 1, 0, 0], // Bye
        &ticks(4),
    ] {
        bytes.extend_from_slice(part);
    }
    let seen = sessions::run(&bytes);
    assert_eq!((seen.welcomed, seen.setpoints), (3, 6), "four commands, and two let go");
    bytes
}

fn random(seed: u64, count: usize) -> Vec<u8> {
    let mut bytes = vec![0; count];
    ChaCha8Rng::seed_from_u64(seed).fill_bytes(&mut bytes);
    bytes
}

fn connect_strings() -> Seeds {
    let hash = "0123456789abcdef".repeat(4);
    let printed = format!("hapticd://haptic.local:7351/?sha256={hash}&grpc=7400&token=a%20b");
    named([
        ("printed", printed.into_bytes()),
        ("host", b"localhost".to_vec()),
        ("ipv6", b"[::1]:7351".to_vec()),
    ])
}

fn commands() -> [Command; 4] {
    [1, 2, 3, 4].map(|seed| {
        let (bytes, seq) = (random(seed, 400), 100 + seed);
        let body = messages::body(&mut Script::new(&bytes));
        Command { seq, client_time_ns: 2, state_seq: 3, ttl_ms: 100, body, ..Command::default() }
    })
}

fn state() -> State {
    State {
        seq: 12,
        device_time_ns: 12_000_000,
        position_m: vec![0.3, 0.0, 0.0],
        twist: vec![0.1, 0.0, 0.0],
        proxy_m: vec![0.299, 0.0, 0.0],
        measured_cf: vec![3.0, 1.0, 0.0],
        requested: vec![-12.0, 0.0, 0.0],
        achievable: vec![-11.0, 1.0, 0.0],
        rendered: vec![-10.0, 1.0, 0.0, 0.0, 0.0, 0.1],
        approximation_angle_rad: Some(0.1),
        contact_id: vec![1, 1 << 31],
        contact_depth_m: vec![1e-3, 5e-4],
        contact_normal_n: vec![12.0, 5.0],
        contact_friction_n: vec![1.0, 0.0],
        contact_sticking: 1,
        event_id: vec![4],
        event_kind: vec![1],
        event_value: vec![1],
        actuator_rad: vec![0.1; 4],
        ..State::default()
    }
}

fn datagrams() -> Seeds {
    let target =
        HandTarget { seq: 1, held: true, position_m: vec![0.1; 3], ..HandTarget::default() };
    let pong = Pong { seq: 1, sent_ns: 2, received_ns: 3, returned_ns: 4, states_received: 5 };
    let mut seeds = named([
        ("state", encode(&Body::State(state()))),
        ("ping", encode(&Body::Ping(Ping { seq: 1, sent_ns: 2 }))),
        ("pong", encode(&Body::Pong(pong))),
        ("hand-target", encode(&Body::HandTarget(target))),
        ("ack", encode(&Body::Ack(Ack { event_id: 3 }))),
    ]);
    for (number, command) in commands().into_iter().enumerate() {
        seeds.push((format!("command-{number}"), encode(&Body::Command(command))));
    }
    seeds
}

fn frames() -> Seeds {
    use stream_message::Body::{Bye as SayBye, Event as Tell, Hello as SayHello};
    let hello = Hello {
        versions: vec!["hapticd/1".to_owned()],
        client_name: "seed".to_owned(),
        device: "devices/cho-2005".to_owned(),
        role: 2,
        takeover: true,
        ..Hello::default()
    };
    let event = Event { id: 1, device_time_ns: 2, kind: 1, value: 3 };
    let bye = Bye { reason: 1, detail: "done".to_owned() };
    let frame = |body| encode_frame(&StreamMessage { body: Some(body) });
    let all = [frame(SayHello(hello.clone())), frame(Tell(event)), frame(SayBye(bye))].concat();
    let in_parts = [&[3, 1, 7, 40], all.as_slice()].concat();
    named([("hello", [vec![0], frame(SayHello(hello))].concat()), ("in-parts", in_parts)])
}

/// Of each kind; the script is of a client that comes, speaks and moves, and a server that answers.
fn packets() -> Seeds {
    let mut exchange = vec![255, 0, 0, 0, 0, 0]; // the clock begins at zero
    let knock = [0];
    // Not from elsewhere, and only once.
    let deliver = [8, 0, 0, 0];
    let sends = |what: u8, text: &str| {
        [&[what, text.len() as u8], text.as_bytes(), &[0]].concat() // not a long one
    };
    let says = |what, text| [sends(what, text).as_slice(), &[0]].concat(); // and once
    let arrives = [knock.as_slice(), &deliver, &deliver, &knock, &deliver].concat();
    let five_ms = [17, 2];
    for part in [
        arrives.as_slice(),
        &sends(1, "a command"),
        &deliver,
        &says(6, "welcome"),
        &[7], // all that the server has to say
        &deliver,
        &deliver,
        &says(2, "bye"),
        &[3], // all that the client has
        &deliver,
        &deliver,
        &[18, 1], // the client is elsewhere
        &five_ms,
        &arrives,
        &sends(5, "a state"),
        &deliver,
    ] {
        exchange.extend_from_slice(part);
    }
    let seen = packets::run(&exchange[1..]);
    assert_eq!(seen, packets::Seen { joined: true, datagrams: 2, messages: 2 });
    let mut seeds = named([
        ("exchange", exchange),
        ("header-alone", [vec![0], [0; 34].to_vec()].concat()),
        ("message", [[0].as_slice(), &[0, 0, 0, 1], b"bye"].concat()),
        ("changed", [[32].as_slice(), &[1], b"a command"].concat()),
    ]);
    for number in 0..SCRIPTS {
        seeds.push((format!("numbers-{number}"), [vec![64], random(number, 300)].concat()));
        seeds.push((format!("script-{number}"), [vec![96], random(number, 600)].concat()));
    }
    seeds
}

/// One file as it is, and scripts for changes of one.
fn recording() -> Seeds {
    let header = hapticd::recording::header("cho-2005", 0, "seed");
    let mut seeds = named([
        ("header-alone", [vec![0], header].concat()),
        ("unchanged", vec![255]),
        ("ticks-and-setpoints", [vec![64], recordings::without_plans()].concat()),
    ]);
    for number in 0..SCRIPTS {
        seeds.push((format!("changes-{number}"), [vec![255], random(number, 60)].concat()));
    }
    seeds
}
