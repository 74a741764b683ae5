//! What was done to others before, done to a real server: one test for each line.
//!
//! The attacks on a surgical robot over unauthenticated UDP (Bonaci et al. 2015: delay and
//! reordering, changes in flight, hijack by leading sequence numbers, a packet over the limits
//! again and again to hold the emergency stop), amplification, and pages whose names point here.
//! Who is between the ends sees and sends any packet but knows no key; who has a session is
//! bound by its role. A million of them at full speed are in `benches/flood.rs`.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::sync::Arc;
use std::time::{Duration, Instant};

use hapticd::client::{Client, ClientError, Options};
use hapticd::proto::datagram::Body;
use hapticd::proto::{
    ByeReason, Command, Contacts, GetStateRequest, Mode, Ping, Role, State, StopRequest, command,
};
use hapticd::quic;
use hapticd::sealed::{Kind, Opener, Sealer};
use hapticd::wire;
use quinn::Endpoint;
use quinn::crypto::rustls::QuicClientConfig;
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject;
use url::Url;
use web_transport_quinn::Session;
use web_transport_quinn::proto::ConnectRequest;

use super::support::{
    DEVICE, PATIENCE, Rig, command_until, next_state, state_where, wait_until, wall_at,
};
use super::transports::opened;

/// A controller over sealed UDP whose packets somebody on the way sees.
struct Victim {
    sealer: Sealer,
    opener: Opener,
    socket: UdpSocket,
    seq: u64,
}

impl Victim {
    /// Streamed to already.
    fn join(rig: &Rig) -> Self {
        let (sealer, opener, socket) = opened(rig, Role::Controller);
        let mut victim = Self { sealer, opener, socket, seq: 0 };
        let here = victim.sealer.seal(Kind::Here, &[0; 32]).unwrap();
        victim.socket.send(&here).unwrap();
        let (kind, cookie) = victim.hear().expect("a challenge");
        assert_eq!(kind, Kind::Challenge);
        let here = victim.sealer.seal(Kind::Here, &cookie).unwrap();
        victim.socket.send(&here).unwrap();
        victim.state();
        victim
    }

    fn hear(&mut self) -> Option<(Kind, Vec<u8>)> {
        let mut bytes = [0; 2048];
        let length = self.socket.recv(&mut bytes).ok()?;
        let (kind, body) = self.opener.open(&mut bytes[..length]).ok()?;
        Some((kind, body.to_vec()))
    }

    /// The newest State. A ping goes with it: whoever is silent for two seconds is gone.
    fn state(&mut self) -> State {
        let ping = Ping { seq: 1, sent_ns: 1 };
        let ping = self.sealer.seal(Kind::Datagram, &wire::encode(&Body::Ping(ping))).unwrap();
        self.socket.send(&ping).unwrap();
        let mut newest = None;
        self.socket.set_nonblocking(true).unwrap();
        while let Some(heard) = self.hear() {
            newest = state_in(heard).or(newest);
        }
        self.socket.set_nonblocking(false).unwrap();
        let deadline = Instant::now() + PATIENCE;
        while Instant::now() < deadline {
            newest = self.hear().and_then(state_in).or(newest);
            if let Some(state) = newest {
                return state;
            }
        }
        panic!("no State comes");
    }

    /// A genuine packet with the next command.
    fn command(&mut self, state_seq: u64) -> Vec<u8> {
        self.seq += 1;
        let contacts = Contacts { contacts: vec![wall_at(0.29)] };
        let body = Some(command::Body::Contacts(contacts));
        let command = Command { seq: self.seq, state_seq, ttl_ms: 200, body, ..Command::default() };
        self.sealer.seal(Kind::Datagram, &wire::encode(&Body::Command(command))).unwrap()
    }

    fn send(&self, packet: &[u8]) {
        self.socket.send(packet).unwrap();
    }

    /// Its session and who comes after it go on: a command of now is taken.
    fn is_well(&mut self) {
        let taken = self.seq;
        wait_until("the victim's next command", || {
            let state = self.state();
            let next = self.command(state.seq);
            self.send(&next);
            self.state().command_seq > taken
        });
    }
}

fn state_in((kind, body): (Kind, Vec<u8>)) -> Option<State> {
    match (kind, wire::decode(&body)) {
        (Kind::Datagram, Ok(Body::State(state))) => Some(state),
        _ => None,
    }
}

/// Datagrams that a session heard over sealed UDP, by what became of them.
fn over_udp(rig: &Rig, outcome: &str) -> f64 {
    let labels =
        format!("{{device=\"cho-2005\",transport=\"udp\",direction=\"in\",outcome=\"{outcome}\"}}");
    rig.scrape().value(&format!("hapticd_datagrams_total{labels}"))
}

#[test]
fn changed_in_flight_or_cut_short_a_command_is_none() {
    let rig = Rig::start();
    let mut victim = Victim::join(&rig);
    let tick = victim.state().seq;
    let genuine = victim.command(tick);
    for place in 0..genuine.len() {
        let mut forged = genuine.clone();
        forged[place] ^= 1 << (place % 8);
        victim.send(&forged);
        victim.send(&genuine[..place]);
    }
    victim.send(&[genuine.as_slice(), &[0]].concat());
    assert_eq!(victim.state().command_seq, 0, "nothing was commanded");
    for outcome in ["malformed", "invalid", "unexpected", "not_allowed", "old", "stale"] {
        assert_eq!(over_udp(&rig, outcome), 0.0, "{outcome}: none of them reached the session");
    }
    // What was tried used up no number: the genuine one still counts, and by then all of them
    // have been heard.
    victim.is_well();
    for outcome in ["malformed", "invalid", "unexpected", "not_allowed", "old", "stale"] {
        assert_eq!(over_udp(&rig, outcome), 0.0, "{outcome}");
    }
}

#[test]
fn heard_again_a_packet_is_nothing_and_leads_no_stream_away() {
    let rig = Rig::start();
    let mut victim = Victim::join(&rig);
    let tick = victim.state().seq;
    let genuine = victim.command(tick);
    victim.send(&genuine);
    wait_until("the command", || victim.state().command_seq == 1);
    let heard = over_udp(&rig, "accepted") + over_udp(&rig, "old");
    let elsewhere = UdpSocket::bind("127.0.0.1:0").unwrap();
    elsewhere.connect(victim.socket.peer_addr().unwrap()).unwrap();
    elsewhere.set_read_timeout(Some(Duration::from_millis(300))).unwrap();
    for _ in 0..500 {
        victim.send(&genuine);
        elsewhere.send(&genuine).unwrap();
    }
    assert!(elsewhere.recv(&mut [0; 2048]).is_err(), "nobody is answered there");
    victim.is_well();
    let refused = over_udp(&rig, "accepted") + over_udp(&rig, "old") - heard;
    assert!(refused < 100.0, "{refused} of a thousand reached the session");
}

#[test]
fn held_back_and_sent_in_another_order_the_newest_wins() {
    let rig = Rig::start();
    let mut victim = Victim::join(&rig);
    let tick = victim.state().seq;
    let held: Vec<_> = (0..20).map(|_| victim.command(tick)).collect();
    for packet in held.iter().rev() {
        victim.send(packet);
    }
    wait_until("all of them", || over_udp(&rig, "old") == 19.0);
    assert_eq!(victim.state().command_seq, 20);
    // So late that a force from then would be wrong: refused, however new its number is.
    let late = victim.command(tick);
    std::thread::sleep(Duration::from_millis(1_200));
    victim.state();
    victim.send(&late);
    wait_until("the late one", || over_udp(&rig, "stale") == 1.0);
    assert_eq!(victim.state().contact_id, [0_u32; 0], "and the force has gone");
    victim.is_well();
}

#[test]
fn a_leading_number_hijacks_nobody() {
    let rig = Rig::start();
    let mut victim = Victim::join(&rig);
    victim.is_well();
    // Somebody with a session of its own, which commands nothing, says that it is far ahead.
    rig.run(async {
        let mut other = rig.client("hijacker", Role::Observer).await;
        for _ in 0..50 {
            let state = next_state(&mut other).await;
            other.send_contacts(state.seq, 200, vec![wall_at(0.2)]).unwrap();
        }
        other.close().await;
    });
    // Who has the lease may count on from wherever it likes, and hurts itself alone.
    let tick = victim.state().seq;
    victim.seq = 1 << 48;
    let ahead = victim.command(tick);
    victim.send(&ahead);
    wait_until("the leading one", || victim.state().command_seq > 1 << 48);
    rig.run(async {
        let takeover = Options { takeover: true, ..Options::new("next", Role::Controller) };
        let mut next = Client::connect(rig.target(), takeover).await.unwrap();
        // Numbers begin anew with each lease.
        let state = command_until(&mut next, &[wall_at(0.29)], |s| s.contact_id == [1]).await;
        assert!(state.command_seq < 1 << 20, "{}", state.command_seq);
        next.close().await;
    });
}

/// The emergency stop is not for the network to hold: what is beyond the limits is refused and
/// counted, nothing latches, and a Stop needs no lease.
#[test]
fn over_the_limits_again_and_again_nothing_trips_and_stop_works() {
    let rig = Rig::start();
    rig.run(async {
        let mut attacker = rig.client("attacker", Role::Controller).await;
        let mut devices = rig.services().await.devices;
        let wrenches = [
            vec![1e30, 0.0, 0.0],
            vec![f32::MAX, f32::MIN, 0.0],
            vec![f32::NAN, 0.0, 0.0],
            vec![f32::INFINITY, 0.0, 0.0],
            vec![1.0],
            vec![0.0; 600],
        ];
        for round in 0..200 {
            let state = next_state(&mut attacker).await;
            let wrench = wrenches[round % wrenches.len()].clone();
            match attacker.send_wrench(state.seq, u32::MAX, wrench) {
                Ok(_) | Err(ClientError::Send(_)) => {}
                Err(error) => panic!("{error}"),
            }
        }
        rig.wait_for_datagrams("invalid", 100.0);
        let state = next_state(&mut attacker).await;
        assert!(state.requested.iter().all(|part| part.is_finite() && part.abs() <= 2000.0));
        let get = GetStateRequest { name: DEVICE.into() };
        let now = devices.get_state(get).await.unwrap().into_inner();
        assert_eq!((now.mode(), now.fault), (Mode::Enabled, 0), "nothing latched");
        let stopped = devices.stop(StopRequest { name: DEVICE.into() }).await.unwrap();
        assert_eq!(stopped.into_inner().mode(), Mode::Stopped);
    });
}

#[test]
fn an_observer_that_commands_is_not_heard() {
    let rig = Rig::start();
    rig.run(async {
        let mut watcher = rig.client("watcher", Role::Observer).await;
        for _ in 0..20 {
            let state = next_state(&mut watcher).await;
            watcher.send_contacts(state.seq, 200, vec![wall_at(0.2)]).unwrap();
            watcher.send_wrench(state.seq, 200, vec![5.0, 0.0, 0.0]).unwrap();
            watcher.send_hand([0.2, 0.3, 0.0], true, 1).unwrap();
        }
        // Room for two that wait to be sent: of three at once one may be lost.
        rig.wait_for_datagrams("not_allowed", 20.0);
        let state = next_state(&mut watcher).await;
        assert_eq!((state.command_seq, state.contact_id.len()), (0, 0));
        assert!(state.requested.iter().all(|part| *part == 0.0));
    });
}

#[test]
fn a_second_controller_is_refused_and_the_first_goes_on() {
    let rig = Rig::start();
    rig.run(async {
        let mut first = rig.client("first", Role::Controller).await;
        for _ in 0..5 {
            let second = Options::new("second", Role::Controller);
            let refused = Client::connect(rig.target(), second).await.unwrap_err();
            let ClientError::Bye { reason, .. } = refused else { panic!("{refused}") };
            assert_eq!(reason, ByeReason::LeaseHeld);
            command_until(&mut first, &[wall_at(0.29)], |s| s.contact_id == [1]).await;
        }
    });
}

#[test]
fn under_an_old_epoch_nothing_is_commanded() {
    let rig = Rig::start();
    rig.run(async {
        let mut old = rig.client("old", Role::Controller).await;
        command_until(&mut old, &[wall_at(0.29)], |state| state.contact_id == [1]).await;
        let takeover = Options { takeover: true, ..Options::new("new", Role::Controller) };
        let mut new = Client::connect(rig.target(), takeover).await.unwrap();
        assert_eq!(new.welcome().lease_epoch, 2);
        let mut tick = 0;
        for _ in 0..50 {
            let state = next_state(&mut old).await;
            tick = state.seq;
            old.send_wrench(state.seq, 200, vec![3.0, 0.0, 0.0]).unwrap();
            old.send_contacts(state.seq, 200, vec![wall_at(0.2)]).unwrap();
        }
        rig.wait_for_datagrams("not_allowed", 25.0);
        // The wall of before the takeover has faded by then.
        let after = state_where(&mut new, |state| state.seq > tick + 200).await;
        assert_eq!((after.command_seq, after.contact_id.len()), (0, 0), "not one of them");
        let state = command_until(&mut new, &[wall_at(0.29)], |s| s.contact_id == [1]).await;
        assert_eq!(state.contact_id, [1]);
    });
}

/// A handshake from somebody else's address: less than what came is sent there, and no stream.
#[test]
fn at_an_address_that_is_not_proven_nothing_is_amplified() {
    let rig = Rig::start();
    let first = first_packet(&rig);
    assert!(first.len() >= 1_200, "{} bytes", first.len());
    for asked in [1, 3, 20] {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(700))).unwrap();
        let server = SocketAddr::from(([127, 0, 0, 1], rig.target().stream_port));
        for _ in 0..asked {
            socket.send_to(&first, server).unwrap();
        }
        let (mut answers, mut buffer) = (Vec::new(), [0; 65_536]);
        while let Ok(length) = socket.recv(&mut buffer) {
            answers.push(length);
        }
        let (answered, paid) = (answers.iter().sum::<usize>(), asked * first.len());
        assert!(answered > 0 && answered < paid, "{answers:?} for {paid} bytes");
    }
    // The door is open to others meanwhile.
    rig.run(async { next_state(&mut rig.client("witness", Role::Observer).await).await });
}

/// The first packet of a client, which a socket that says nothing takes.
fn first_packet(rig: &Rig) -> Vec<u8> {
    let trap = UdpSocket::bind("127.0.0.1:0").unwrap();
    trap.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut target = rig.target().clone();
    target.stream_port = trap.local_addr().unwrap().port();
    let client = rig.spawn(async move {
        // Never answered; given up with the runtime.
        let _ = Client::connect(&target, Options::new("trapped", Role::Observer)).await;
    });
    let mut buffer = [0; 2048];
    // Beside it comes a single byte, which asks whether anybody listens.
    let length = loop {
        let length = trap.recv(&mut buffer).unwrap();
        if length > 1 {
            break length;
        }
    };
    client.abort();
    buffer[..length].to_vec()
}

/// A page can make its own name point here, and its browser then says that name.
#[test]
fn a_name_that_was_made_to_point_here_gets_nothing() {
    let rig = Rig::start();
    let ask = |host: &str, origin: &str, path: &str| {
        let mut stream = TcpStream::connect(rig.daemon().http_address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let origin =
            if origin.is_empty() { String::new() } else { format!("Origin: {origin}\r\n") };
        let request =
            format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n{origin}Connection: close\r\n\r\n");
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer.split(' ').nth(1).unwrap().parse::<u16>().unwrap()
    };
    let here = rig.daemon().http_address.to_string();
    for path in ["/metrics", "/healthz", "/certificate-hashes"] {
        assert_eq!(ask(&here, "", path), 200, "{path}");
        assert_eq!(ask("evil.example:7353", "", path), 403, "{path}");
        assert_eq!(ask("evil.example", "http://evil.example", path), 403, "{path}");
        assert_eq!(ask(&here, "https://evil.example", path), 403, "{path}");
    }
    assert_eq!(ask("evil.example", "", "/hapticd.v1.DeviceService/Stop"), 403);
}

/// The same by WebTransport, and under another path.
#[test]
fn a_webtransport_session_says_whom_it_means() {
    let rig = Rig::start();
    rig.run(async {
        let port = rig.target().stream_port;
        let good = format!("https://127.0.0.1:{port}{}", quic::WEBTRANSPORT_PATH);
        for (url, page, status) in [
            (format!("https://evil.example:{port}{}", quic::WEBTRANSPORT_PATH), None, "403"),
            (format!("https://127.0.0.1:{port}/elsewhere"), None, "404"),
            (good.clone(), Some("https://evil.example"), "403"),
            (good.clone(), Some("null"), "403"),
        ] {
            let said = web_transport(&rig, &url, page).await.unwrap_err();
            assert!(said.contains(status), "{url} of {page:?}: {said}");
        }
        web_transport(&rig, &good, None).await.unwrap();
        web_transport(&rig, &good, Some(&format!("https://127.0.0.1:{port}"))).await.unwrap();
    });
}

async fn web_transport(rig: &Rig, url: &str, page: Option<&str>) -> Result<(), String> {
    let mut roots = rustls::RootCertStore::empty();
    for file in std::fs::read_dir(rig.state_dir()).unwrap().flatten() {
        if file.file_name().to_str().unwrap().starts_with("browser-") {
            let pem = std::fs::read(file.path()).unwrap();
            roots.add(CertificateDer::from_pem_slice(&pem).unwrap()).unwrap();
        }
    }
    let mut tls = rustls::ClientConfig::builder_with_provider(quic::provider())
        .with_protocol_versions(&[&rustls::version::TLS13])
        .unwrap()
        .with_root_certificates(roots)
        .with_no_client_auth();
    tls.alpn_protocols = vec![quic::alpn_webtransport()];
    let mut config = quinn::ClientConfig::new(Arc::new(QuicClientConfig::try_from(tls).unwrap()));
    config.transport_config(quic::client_transport());
    let endpoint = Endpoint::client(([127, 0, 0, 1], 0).into()).unwrap();
    let server = SocketAddr::from(([127, 0, 0, 1], rig.target().stream_port));
    let connecting = endpoint.connect_with(config, server, "localhost").unwrap();
    let connection = connecting.await.map_err(|error| error.to_string())?;
    let mut request = ConnectRequest::new(url.parse::<Url>().unwrap());
    if let Some(page) = page {
        request = request.with_header(http::header::ORIGIN, page.parse().unwrap());
    }
    let session = Session::connect(connection, request);
    session.await.map(drop).map_err(|error| format!("{error:?}"))
}
