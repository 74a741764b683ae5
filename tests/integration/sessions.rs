//! SessionService on a real server: who is there, who commands, and a session opened by a call.

use hapticd::client::{Client, Incoming, Options};
use hapticd::proto::{
    AcquireLeaseRequest, CloseSessionRequest, EventKind, Hello, ListSessionsRequest,
    OpenSessionRequest, ReleaseLeaseRequest, Role, Session, SessionState,
};
use tonic::Code;

use super::support::{DEVICE, Rig, command_until, next_state, run, wall_at};

async fn list(rig: &Rig) -> Vec<Session> {
    let mut sessions = rig.services().await.sessions;
    let listed = sessions.list_sessions(ListSessionsRequest::default()).await.unwrap();
    listed.into_inner().sessions
}

/// A client that says nothing while it is listed soon commands no more, and listing takes time
/// on a busy machine.
async fn list_while_commanding(rig: &Rig, client: &mut Client) -> [Session; 2] {
    for _ in 0..50 {
        command_until(client, &[wall_at(0.29)], |state| state.contact_id == [1]).await;
        let listed: [Session; 2] = list(rig).await.try_into().unwrap();
        if listed[0].state() == SessionState::Commanding {
            return listed;
        }
    }
    panic!("it is never listed as commanding");
}

#[test]
fn sessions_are_listed_given_the_lease_and_closed() {
    let rig = Rig::start();
    rig.run(async {
        let mut one = rig.client("one", Role::Controller).await;
        let mut two = rig.client("two", Role::Observer).await;
        let [first, second] = list_while_commanding(&rig, &mut one).await;
        assert_eq!((first.client_name.as_str(), first.role()), ("one", Role::Controller));
        assert_eq!((first.state(), first.lease_epoch), (SessionState::Commanding, 1));
        assert_eq!((second.device.as_str(), second.role()), (DEVICE, Role::Observer));
        assert_eq!((second.transport.as_str(), second.lease_epoch), ("quic", 0));

        let mut sessions = rig.services().await.sessions;
        let name = second.name.clone();
        let acquire = |takeover| AcquireLeaseRequest { name: name.clone(), takeover };
        let held = sessions.acquire_lease(acquire(false)).await.unwrap_err();
        assert_eq!(held.code(), Code::FailedPrecondition);
        assert!(held.message().contains("sessions/1 (\"one\") holds the lease"), "{held}");
        let lease = sessions.acquire_lease(acquire(true)).await.unwrap().into_inner();
        assert_eq!((&lease.session, lease.epoch), (&name, 2));
        // What it commands from now on is felt.
        command_until(&mut two, &[wall_at(0.29)], |state| state.contact_id == [1]).await;
        let released = sessions.release_lease(ReleaseLeaseRequest { name: name.clone() }).await;
        assert_eq!(released.unwrap().into_inner().session, "");
        let again = sessions.release_lease(ReleaseLeaseRequest { name: name.clone() }).await;
        assert_eq!(again.unwrap_err().code(), Code::FailedPrecondition);

        sessions.close_session(CloseSessionRequest { name: name.clone() }).await.unwrap();
        let said = loop {
            if let Err(error) = two.next().await {
                break error.to_string();
            }
        };
        assert!(said.contains("closed by a call"), "{said}");
        let gone = sessions.close_session(CloseSessionRequest { name }).await.unwrap_err();
        assert_eq!(gone.code(), Code::NotFound);
        for bad in ["", "2", "sessions/02", "devices/cho-2005"] {
            let close = CloseSessionRequest { name: bad.into() };
            let refused = sessions.close_session(close).await.unwrap_err();
            assert_eq!(refused.code(), Code::InvalidArgument, "{bad}");
        }
    });
}

#[test]
fn a_stream_joins_what_a_call_has_opened() {
    let rig = Rig::start();
    rig.run(async {
        let mut sessions = rig.services().await.sessions;
        let hello = Hello {
            versions: vec!["hapticd/1".into()],
            client_name: "by call".into(),
            device: DEVICE.into(),
            role: Role::Controller.into(),
            ..Hello::default()
        };
        let open = OpenSessionRequest { hello: Some(hello), transport: 0 };
        let opened = sessions.open_session(open.clone()).await.unwrap().into_inner();
        let welcome = opened.welcome.unwrap();
        assert_eq!(welcome.lease_epoch, 1);
        let [waiting] = list(&rig).await.try_into().unwrap();
        assert!(waiting.waiting && waiting.name == welcome.session);
        let twice = sessions.open_session(open).await.unwrap_err();
        assert_eq!(twice.code(), Code::FailedPrecondition, "{twice}");

        let join = || Options { ticket: opened.ticket.clone(), ..Options::new("", Role::Observer) };
        let mut client = Client::connect(rig.target(), join()).await.unwrap();
        assert_eq!(client.welcome().session, welcome.session);
        command_until(&mut client, &[wall_at(0.29)], |state| state.contact_id == [1]).await;
        assert!(!list(&rig).await[0].waiting);
        let refused = Client::connect(rig.target(), join()).await.unwrap_err().to_string();
        assert!(refused.contains("ticket"), "{refused}");
        // It lives on undisturbed.
        next_state(&mut client).await;
        client.close().await;
    });
}

#[test]
fn ctl_shows_sessions_and_moves_the_lease() {
    let rig = Rig::start();
    let connect = rig.target().to_string();
    let ctl = |arguments: &[&str]| run(&[&["ctl", "--connect", &connect], arguments].concat());
    assert!(ctl(&["session", "list"]).ok().stdout.contains("nobody is connected"));
    let mut client = rig.run(rig.client("headset", Role::Observer));
    let listed = ctl(&["session", "list"]).ok().stdout;
    assert!(listed.contains("sessions/1") && listed.contains("headset"), "{listed}");
    let as_json = ctl(&["session", "list", "--json", "--device", "cho-2005"]).ok().stdout;
    assert!(as_json.contains("\"client_name\":\"headset\""), "{as_json}");
    ctl(&["session", "list", "--device", "omega"]).refused(&["devices/omega", DEVICE]);
    let acquired = ctl(&["lease", "acquire", "1"]).ok().stdout;
    assert_eq!(acquired, "sessions/1 commands, epoch 1\n");
    let told = rig.run(async {
        loop {
            if let Incoming::Event(event) = client.next().await.unwrap()
                && event.kind() == EventKind::Lease
            {
                break event.value;
            }
        }
    });
    assert_eq!(told, 1);
    assert_eq!(ctl(&["lease", "release", "1"]).ok().stdout, "nobody commands\n");
    ctl(&["lease", "release", "7"]).refused(&["sessions/7"]);
    ctl(&["session", "close", "1"]).ok();
}
