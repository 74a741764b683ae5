//! The same session over QUIC, WebTransport and sealed UDP.

use std::net::UdpSocket;
use std::time::Duration;

use hapticd::client::{Client, ClientError, ConnectString, Options, Transport};
use hapticd::proto::{
    ByeReason, ListSessionsRequest, OpenSessionRequest, Role, State, Transport as Wanted,
};
use hapticd::sealed::{Direction, Kind, Sealer, ends};

use super::support::{Rig, command_until, next_state, run, state_where, wait_until, wall_at};

fn options(name: &str, role: Role, transport: Transport) -> Options {
    Options { transport, ..Options::new(name, role) }
}

async fn client(rig: &Rig, role: Role, transport: Transport) -> Client {
    let name = transport.name();
    Client::connect(rig.target(), options(name, role, transport)).await.unwrap()
}

#[test]
fn a_wall_is_felt_and_a_session_listed_over_each_of_them() {
    let rig = Rig::start();
    for transport in Transport::ALL {
        rig.run(async {
            let mut scene = client(&rig, Role::Controller, transport).await;
            assert_eq!(scene.welcome().device, "devices/cho-2005");
            let mut observer = client(&rig, Role::Observer, transport).await;
            let wall = [wall_at(0.3)];
            let touched = |state: &State| state.contact_id == [1];
            let state = command_until(&mut scene, &wall, touched).await;
            assert!(state.contact_depth_m[0] > 0.0 && state.command_seq > 0, "{state:?}");
            state_where(&mut observer, touched).await;
            let mut services = rig.services().await;
            let listed = services.sessions.list_sessions(ListSessionsRequest::default()).await;
            let sessions = listed.unwrap().into_inner().sessions;
            let carried: Vec<_> = sessions.iter().map(|session| &session.transport[..]).collect();
            assert_eq!(carried, [transport.name(), transport.name()]);
            let label = format!("transport=\"{}\"", transport.name());
            wait_until("the metric", || {
                let metrics = rig.scrape();
                let of = |role: &str| {
                    metrics.value(&format!(
                        "hapticd_sessions{{device=\"cho-2005\",role=\"{role}\",{label}}}"
                    ))
                };
                (of("controller"), of("observer")) == (1.0, 1.0)
            });
            scene.close().await;
            observer.close().await;
        });
        wait_until("both are gone", || {
            let list = async {
                let request = ListSessionsRequest::default();
                rig.services().await.sessions.list_sessions(request).await
            };
            rig.run(list).unwrap().into_inner().sessions.is_empty()
        });
    }
}

#[test]
fn the_last_place_is_one_for_sealed_udp_too() {
    let rig = Rig::with(|config| config.session.max_sessions = 1);
    let mut only = rig.run(client(&rig, Role::Observer, Transport::Udp));
    rig.run(next_state(&mut only));
    let late = options("late", Role::Observer, Transport::Udp);
    let refused = rig.run(Client::connect(rig.target(), late));
    assert!(
        matches!(&refused, Err(ClientError::Call(why)) if why.contains("at most 1")),
        "{refused:?}"
    );
    rig.run(only.close());
}

#[test]
fn what_a_server_says_last_is_heard_over_each_of_them() {
    for transport in Transport::ALL {
        let rig = Rig::start();
        let mut observer = rig.run(client(&rig, Role::Observer, transport));
        rig.run(next_state(&mut observer));
        let holder = rig.run(client(&rig, Role::Controller, transport));
        let refused = rig.run(async {
            Client::connect(rig.target(), options("late", Role::Controller, transport)).await
        });
        match (transport, refused) {
            // Its session is opened by a call, and that is what is refused.
            (Transport::Udp, Err(ClientError::Call(why))) => {
                assert!(why.contains("lease") || why.contains("controller"), "{why}");
            }
            (_, Err(ClientError::Bye { reason, .. })) => assert_eq!(reason, ByeReason::LeaseHeld),
            (_, other) => panic!("{transport}: {other:?}"),
        }
        drop(holder);
        let (runtime, _state) = rig.stop();
        let last = runtime.block_on(async {
            loop {
                match observer.next().await {
                    Ok(_) => {}
                    Err(error) => break error,
                }
            }
        });
        let shutdown = matches!(&last, ClientError::Bye { reason: ByeReason::Shutdown, .. });
        assert!(shutdown, "{transport}: {last}");
    }
}

#[test]
fn a_server_that_is_another_or_not_there_is_said_over_each_of_them() {
    let rig = Rig::start();
    for transport in [Transport::Quic, Transport::WebTransport] {
        let other = ConnectString { sha256: Some([7; 32]), ..rig.target().clone() };
        let refused = rig.run(Client::connect(&other, options("x", Role::Observer, transport)));
        assert!(matches!(refused, Err(ClientError::WrongServer { .. })), "{refused:?}");
    }
    let nobody: ConnectString = "hapticd://127.0.0.1:1/?grpc=1".parse().unwrap();
    for transport in Transport::ALL {
        let refused = rig.run(Client::connect(&nobody, options("x", Role::Observer, transport)));
        let said = refused.unwrap_err().to_string();
        assert!(said.contains("127.0.0.1:1"), "{transport}: {said}");
    }
    let scene = ["scene", "wall", "--seconds", "1", "--transport", "carrier-pigeon"];
    run(&scene).refused(&["carrier-pigeon", "quic, webtransport or udp"]);
}

/// Opened by a call, and not yet anywhere.
pub fn opened(rig: &Rig, role: Role) -> (Sealer, hapticd::sealed::Opener, UdpSocket) {
    let hello = hapticd::proto::Hello {
        versions: vec!["hapticd/1".into()],
        role: role.into(),
        ..Default::default()
    };
    let transport = Wanted::SealedUdp.into();
    let request = OpenSessionRequest { hello: Some(hello), transport };
    let open = async { rig.services().await.sessions.open_session(request).await };
    let sealed = rig.run(open).unwrap().into_inner().sealed_udp.unwrap();
    let [association, secret] = [sealed.association, sealed.secret];
    let (sealer, opener) =
        ends(&secret.try_into().unwrap(), association.try_into().unwrap(), Direction::Up);
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(("127.0.0.1", sealed.port as u16)).unwrap();
    socket.set_read_timeout(Some(Duration::from_millis(300))).unwrap();
    (sealer, opener, socket)
}

fn heard(socket: &UdpSocket) -> Option<Vec<u8>> {
    let mut bytes = [0; 2048];
    socket.recv(&mut bytes).ok().map(|length| bytes[..length].to_vec())
}

#[test]
fn who_shows_no_cookie_gets_one_small_answer_and_no_stream() {
    let rig = Rig::start();
    let (mut sealer, mut opener, socket) = opened(&rig, Role::Observer);
    let here = sealer.seal(Kind::Here, &[0; 32]).unwrap();
    socket.send(&here).unwrap();
    let mut answer = heard(&socket).expect("a challenge");
    assert!(answer.len() <= here.len());
    assert_eq!(heard(&socket), None, "nothing is streamed");
    // The same again is a replay.
    socket.send(&here).unwrap();
    assert_eq!(heard(&socket), None);
    // What is not sealed, or by somebody else, is not answered.
    let stranger = ends(&[0; 32], [0; 8], Direction::Up).0.seal(Kind::Here, &[0; 32]).unwrap();
    for rubbish in [&[0_u8; 66][..], &here[..40], &stranger] {
        socket.send(rubbish).unwrap();
    }
    assert_eq!(heard(&socket), None);
    let (kind, cookie) = opener.open(&mut answer).unwrap();
    assert_eq!(kind, Kind::Challenge);
    socket.send(&sealer.seal(Kind::Here, cookie).unwrap()).unwrap();
    assert!(heard(&socket).is_some(), "now it is");
}
