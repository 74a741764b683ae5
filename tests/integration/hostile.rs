//! What a client of our own would never send: each is counted for what it is and changes
//! nothing. The client here is bare quinn; it knows the server by its certificate file.

use std::collections::VecDeque;
use std::sync::Arc;

use hapticd::proto::datagram::Body;
use hapticd::proto::stream_message::Body as Message;
use hapticd::proto::{
    Bye, ByeReason, Command, Contact, Contacts, Hello, Ping, Pong, Role, State, StreamMessage,
    command, contact,
};
use hapticd::quic;
use hapticd::wire::{self, FrameDecoder, MAX_COMMAND_BYTES, PROTOCOL, encode_frame};
use quinn::crypto::rustls::QuicClientConfig;
use quinn::{Connection, ConnectionError, Endpoint, RecvStream, SendStream, TransportConfig};
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject;

use super::support::{Rig, next_state, wait_until, wall_at};

/// A connection, and the reliable stream on it.
struct Bare {
    connection: Connection,
    send: SendStream,
    receive: RecvStream,
    frames: FrameDecoder,
    heard: VecDeque<Message>,
    _endpoint: Endpoint,
}

impl Bare {
    async fn connect(rig: &Rig) -> Self {
        Self::with(rig, quic::client_transport()).await
    }

    async fn with(rig: &Rig, transport: Arc<TransportConfig>) -> Self {
        let pem = std::fs::read(rig.state_dir().join("identity.pem")).unwrap();
        let mut roots = rustls::RootCertStore::empty();
        roots.add(CertificateDer::from_pem_slice(&pem).unwrap()).unwrap();
        let mut tls = rustls::ClientConfig::builder_with_provider(quic::provider())
            .with_protocol_versions(&[&rustls::version::TLS13])
            .unwrap()
            .with_root_certificates(roots)
            .with_no_client_auth();
        tls.alpn_protocols = vec![quic::alpn()];
        let tls = QuicClientConfig::try_from(tls).unwrap();
        let mut config = quinn::ClientConfig::new(Arc::new(tls));
        config.transport_config(transport);
        let endpoint = Endpoint::client(([127, 0, 0, 1], 0).into()).unwrap();
        let address = (std::net::Ipv4Addr::LOCALHOST, rig.target().stream_port).into();
        let connecting = endpoint.connect_with(config, address, "hapticd").unwrap();
        let connection = connecting.await.unwrap();
        let (send, receive) = connection.open_bi().await.unwrap();
        let (frames, heard) = (FrameDecoder::default(), VecDeque::new());
        Self { connection, send, receive, frames, heard, _endpoint: endpoint }
    }

    /// The same after a good Hello.
    async fn controller(rig: &Rig) -> Self {
        let mut bare = Self::connect(rig).await;
        bare.say(hello()).await;
        let Message::Welcome(_) = bare.hear().await else { panic!("no Welcome") };
        bare
    }

    async fn say(&mut self, message: Message) {
        self.send.write_all(&frame(message)).await.unwrap();
    }

    /// The next message that is no Event.
    async fn hear(&mut self) -> Message {
        loop {
            if let Some(message) = self.heard.pop_front() {
                return message;
            }
            let chunk = self.receive.read_chunk(4096, true).await.unwrap().unwrap();
            let mut bytes: &[u8] = &chunk.bytes;
            while let Some(message) = self.frames.next(&mut bytes).unwrap() {
                let message = message.body.unwrap();
                let event = matches!(message, Message::Event(_));
                self.heard.extend((!event).then_some(message));
            }
        }
    }

    async fn bye(&mut self) -> (ByeReason, String) {
        match self.hear().await {
            Message::Bye(bye) => (bye.reason(), bye.detail),
            other => panic!("{other:?}"),
        }
    }

    /// The State of a tick that began after everything sent before was received.
    async fn state_after(&self, device_time_ns: u64) -> State {
        loop {
            let bytes = self.connection.read_datagram().await.unwrap();
            match wire::decode(&bytes) {
                Ok(Body::State(state)) if state.device_time_ns > device_time_ns => return state,
                _ => {}
            }
        }
    }
}

fn frame(body: Message) -> Vec<u8> {
    encode_frame(&StreamMessage { body: Some(body) })
}

fn hello() -> Message {
    Message::Hello(Hello {
        versions: vec![PROTOCOL.into()],
        client_name: "hostile".into(),
        role: Role::Controller.into(),
        ..Hello::default()
    })
}

fn command(contacts: Vec<Contact>) -> Command {
    let body = Some(command::Body::Contacts(Contacts { contacts }));
    Command { seq: 1, ttl_ms: 100, body, ..Command::default() }
}

fn encoded(command: Command) -> Vec<u8> {
    wire::encode(&Body::Command(command))
}

/// A command with one wall, changed.
fn with_wall(change: impl FnOnce(&mut Contact)) -> Vec<u8> {
    let mut wall = wall_at(0.29);
    change(&mut wall);
    encoded(command(vec![wall]))
}

/// The same with its plane changed.
fn with_plane(point_x_m: f32, normal_x: f32) -> Vec<u8> {
    with_wall(|wall| {
        let Some(contact::Shape::HalfSpace(plane)) = &mut wall.shape else { panic!() };
        plane.point_m[0] = point_x_m;
        plane.normal[0] = normal_x;
    })
}

/// Bytes, and what they have to be counted as.
fn bad_datagrams() -> Vec<(&'static str, Vec<u8>)> {
    let ping = wire::encode(&Body::Ping(Ping { seq: 1, sent_ns: 2 }));
    let good = with_wall(|_| ());
    let many = (0..9).map(|id| Contact { id, ..wall_at(0.29) }).collect();
    vec![
        ("malformed", vec![]),
        ("malformed", vec![0xff; 40]),
        ("malformed", [ping.as_slice(), &[0]].concat()),
        ("malformed", good[..good.len() - 1].to_vec()),
        ("malformed", vec![0x12, 0x02, 0xff, 0xff]),
        ("oversize", vec![0x12; MAX_COMMAND_BYTES + 1]),
        (
            "oversize",
            [good.as_slice(), &[0; MAX_COMMAND_BYTES]].concat()[..=MAX_COMMAND_BYTES].to_vec(),
        ),
        ("unexpected", wire::encode(&Body::State(State::default()))),
        ("unexpected", wire::encode(&Body::Pong(Pong { seq: 77, ..Pong::default() }))),
        ("invalid", with_wall(|wall| wall.stiffness_n_per_m = f32::NAN)),
        ("invalid", with_wall(|wall| wall.stiffness_n_per_m = -1.0)),
        ("invalid", with_wall(|wall| wall.stiffness_n_per_m = f32::INFINITY)),
        ("invalid", with_wall(|wall| wall.damping_ns_per_m = f32::NAN)),
        ("invalid", with_wall(|wall| wall.kinetic_friction = f32::MAX)),
        ("invalid", with_wall(|wall| wall.static_friction = Some(-0.1))),
        ("invalid", with_wall(|wall| wall.surface_velocity_m_per_s = vec![f32::NAN; 3])),
        ("invalid", with_wall(|wall| wall.shape = Some(contact::Shape::Box(Default::default())))),
        ("invalid", with_wall(|wall| wall.shape = Some(contact::Shape::Guide(Default::default())))),
        ("invalid", with_wall(|wall| wall.id = 1 << 31)),
        ("invalid", with_wall(|wall| wall.shape = None)),
        ("invalid", with_plane(f32::NAN, -1.0)),
        ("invalid", with_plane(0.29, 0.0)),
        ("invalid", with_plane(0.29, f32::NAN)),
        ("invalid", encoded(command(many))),
        ("invalid", encoded(command(vec![wall_at(0.29), wall_at(0.3)]))),
        ("invalid", encoded(Command { body: None, ..command(vec![]) })),
        ("invalid", encoded(Command { seq: 0, ..command(vec![wall_at(0.29)]) })),
        ("invalid", encoded(Command { seq: u64::MAX, ..command(vec![wall_at(0.29)]) })),
        ("invalid", encoded(Command { state_seq: u64::MAX, ..command(vec![wall_at(0.29)]) })),
    ]
}

#[test]
fn bad_datagrams_are_counted_for_what_they_are_and_change_nothing() {
    let rig = Rig::start();
    rig.run(async {
        let bare = Bare::controller(&rig).await;
        assert!(bare.connection.max_datagram_size().unwrap() > MAX_COMMAND_BYTES);
        for (number, (outcome, bytes)) in bad_datagrams().into_iter().enumerate() {
            let before = rig.scrape();
            bare.connection.send_datagram(bytes.into()).unwrap();
            wait_until(&format!("the count of number {number} as {outcome}"), || {
                rig.scrape().datagrams(outcome) == before.datagrams(outcome) + 1.0
            });
            let state = bare.state_after(hapticd::clock::now_ns()).await;
            assert_eq!((state.command_seq, state.contact_id.len()), (0, 0), "number {number}");
            assert!(state.requested.iter().all(|part| *part == 0.0), "number {number}");
            assert_eq!(rig.scrape().datagrams("accepted"), 0.0, "number {number}");
        }
        // The session is as good as before, and none of them used up a number.
        let state_seq = bare.state_after(hapticd::clock::now_ns()).await.seq;
        let good = encoded(Command { state_seq, ..command(vec![wall_at(0.29)]) });
        bare.connection.send_datagram(good.clone().into()).unwrap();
        rig.wait_for_datagrams("accepted", 1.0);
        bare.connection.send_datagram(good.into()).unwrap();
        rig.wait_for_datagrams("old", 1.0);
        bare.connection.close(0u32.into(), b"");
    });
}

#[test]
fn datagrams_before_hello_do_nothing() {
    let rig = Rig::start();
    rig.run(async {
        let mut bare = Bare::connect(&rig).await;
        bare.connection.send_datagram(with_wall(|_| ()).into()).unwrap();
        rig.wait_for_datagrams("unexpected", 1.0);
        bare.say(hello()).await;
        let Message::Welcome(_) = bare.hear().await else { panic!("no Welcome") };
        let state = bare.state_after(0).await;
        assert_eq!((state.command_seq, state.contact_id.len()), (0, 0));
    });
}

#[test]
fn a_client_that_takes_nothing_is_let_go_while_the_others_go_on() {
    let rig = Rig::start();
    rig.run(async {
        let mut witness = rig.client("witness", Role::Controller).await;
        let mut narrow = TransportConfig::default();
        // Room for less than a Welcome, and nothing is read.
        narrow.stream_receive_window(16u32.into());
        let mut bare = Bare::with(&rig, Arc::new(narrow)).await;
        bare.say(Message::Hello(Hello {
            versions: vec![PROTOCOL.into()],
            role: Role::Observer.into(),
            ..Hello::default()
        }))
        .await;
        let mut answered = 0;
        let ended = loop {
            tokio::select! {
                ended = bare.connection.closed() => break ended,
                state = next_state(&mut witness) => {
                    witness.send_contacts(state.seq, 100, vec![wall_at(0.29)]).unwrap();
                    answered += 1;
                }
            }
        };
        let ConnectionError::ApplicationClosed(close) = ended else { panic!("{ended}") };
        assert_eq!((close.error_code, &close.reason[..]), (2u32.into(), &b"you do not read"[..]));
        let state = next_state(&mut witness).await;
        assert!(state.command_seq > 0 && answered > 0, "{answered} commands");
        witness.close().await;
    });
}

#[test]
fn a_broken_reliable_stream_ends_its_own_session_only() {
    let rig = Rig::start();
    rig.run(async {
        let witness = rig.client("witness", Role::Observer).await;
        let version =
            Message::Hello(Hello { versions: vec!["hapticd/9".into()], ..Hello::default() });
        let role = Message::Hello(Hello { versions: vec![PROTOCOL.into()], ..Hello::default() });
        let event = Message::Event(hapticd::proto::Event::default());
        let twice = [frame(hello()), frame(hello())].concat();
        let table = [
            (frame(version), ByeReason::Version, "hapticd/9"),
            (frame(role), ByeReason::Invalid, "role = 0"),
            (frame(event), ByeReason::Invalid, "only Hello"),
            (vec![0xff; 64], ByeReason::Invalid, "65536 bytes"),
            (vec![0x02, 0xff, 0xff], ByeReason::Invalid, "not a message of hapticd/1"),
            (twice, ByeReason::Invalid, "second Hello"),
        ];
        for (bytes, expected, words) in table {
            let mut bare = Bare::connect(&rig).await;
            bare.send.write_all(&bytes).await.unwrap();
            let (reason, detail) = match bare.hear().await {
                // It was welcome before it said Hello again.
                Message::Welcome(_) => bare.bye().await,
                Message::Bye(Bye { reason, detail }) => (reason.try_into().unwrap(), detail),
                other => panic!("{other:?}"),
            };
            assert_eq!(reason, expected, "{detail}");
            assert!(detail.contains(words), "{detail}");
        }
        // The lease of the one that was welcome is free again.
        rig.client("after", Role::Controller).await.close().await;
        witness.close().await;
    });
}
