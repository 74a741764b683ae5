//! A server that asks for credentials: who comes in, who may do what, and what is kept of it.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use hapticd::app::{Daemon, Start};
use hapticd::audit;
use hapticd::client::{Client, ClientError, ConnectString, Options, Services, Transport, services};
use hapticd::config::ServerConfig;
use hapticd::credentials::{CredentialFile, Grant, Wanted};
use hapticd::proto::{
    AcquireLeaseRequest, ByeReason, CloseSessionRequest, DeleteRecordingRequest, DisableRequest,
    EnableRequest, GetStateRequest, Hello, ListDevicesRequest, ListSessionsRequest,
    OpenSessionRequest, ReplaceSceneRequest, Role, Settings, StartRecordingRequest,
    StopRecordingRequest, StopRequest, UpdateSettingsRequest, WatchStateRequest,
};
use hapticd::utc::Utc;
use tonic::{Code, Status};

use super::support::{DEVICE, PATIENCE, Rig, command_until, next_state, wait_until, wall_at};

/// A server that asks everybody, with these credentials; and how each of them connects.
pub struct Guarded {
    pub rig: Rig,
    tokens: Vec<String>,
}

pub const ANNA: usize = 0;
pub const BEN: usize = 1;
const BOSS: usize = 2;
const ELSEWHERE: usize = 3;

fn issue(file: &CredentialFile, name: &str, grant: Grant, device: Option<&str>) -> String {
    let (name, device) = (name.to_owned(), device.map(str::to_owned));
    let wanted = Wanted { name, grant, device, days: None, replace: false };
    file.issue(wanted, Utc::now()).unwrap().0.as_str().to_owned()
}

impl Guarded {
    fn start() -> Self {
        Self::with(|_| ())
    }

    /// With a configuration changed like that.
    pub fn with(change: impl FnOnce(&mut ServerConfig)) -> Self {
        let mut tokens = Vec::new();
        let rig = Rig::with(|config| {
            config.require_credentials = true;
            change(config);
            let file = CredentialFile::in_directory(config.state_dir.as_ref().unwrap());
            tokens.push(issue(&file, "anna", Grant::Controller, Some(DEVICE)));
            tokens.push(issue(&file, "ben", Grant::Observer, None));
            tokens.push(issue(&file, "boss", Grant::Operator, None));
            tokens.push(issue(&file, "elsewhere", Grant::Operator, Some("devices/other")));
        });
        Self { rig, tokens }
    }

    pub fn target(&self, who: usize) -> ConnectString {
        self.with_token(&self.tokens[who])
    }

    fn with_token(&self, token: &str) -> ConnectString {
        ConnectString { token: Some(token.to_owned()), ..self.rig.target().clone() }
    }

    pub async fn client(&self, who: usize, role: Role) -> Result<Client, ClientError> {
        Client::connect(&self.target(who), Options::new("a scene", role)).await
    }

    pub async fn services(&self, who: usize) -> Services {
        services(&self.target(who)).await.unwrap()
    }

    pub fn file(&self) -> CredentialFile {
        CredentialFile::in_directory(self.rig.state_dir())
    }

    /// What the audit log has, once it has this many lines of a kind.
    pub fn audited(&self, what: audit::What, count: usize) -> Vec<audit::Line> {
        let mut found = Vec::new();
        wait_until(&format!("{count} lines of {what:?}"), || {
            let lines = audit::tail(self.rig.state_dir(), 1000).unwrap();
            let lines = lines.iter().filter_map(|line| serde_json::from_str(line).ok());
            found = lines.filter(|line: &audit::Line| line.what == Some(what)).collect();
            found.len() >= count
        });
        found
    }
}

fn denied(error: &ClientError, words: &str) {
    let bye = matches!(error, ClientError::Bye { reason: ByeReason::Denied, .. });
    let said = error.to_string();
    assert!((bye || matches!(error, ClientError::Call(_))) && said.contains(words), "{said}");
}

#[test]
fn a_server_that_nobody_could_reach_does_not_start() {
    let folder = tempfile::tempdir().unwrap();
    let config = ServerConfig {
        require_credentials: true,
        grpc_port: 0,
        stream_port: 0,
        udp_port: 0,
        http_port: 0,
        state_dir: Some(folder.path().to_owned()),
        ..ServerConfig::default()
    };
    let said = format!("{:#}", Daemon::start(&config, Start::default()).unwrap_err());
    assert!(
        said.contains("nobody has a credential yet") && said.contains("hapticd pair"),
        "{said}"
    );
}

#[test]
fn over_every_transport_a_token_decides_who_comes_in() {
    let guarded = Guarded::start();
    guarded.rig.run(async {
        for transport in [Transport::Quic, Transport::WebTransport, Transport::Udp] {
            let connect = async |target: ConnectString, role| {
                let options = Options { transport, ..Options::new("a scene", role) };
                Client::connect(&target, options).await
            };
            let without = ConnectString { token: None, ..guarded.rig.target().clone() };
            if transport != Transport::Udp {
                // The call that opens sealed UDP is TLS, which only a token asks for here.
                denied(
                    &connect(without, Role::Observer).await.unwrap_err(),
                    "credential is needed",
                );
            }
            let guessed = connect(guarded.with_token("guessed"), Role::Observer).await;
            denied(&guessed.unwrap_err(), "not known here");
            let ben = connect(guarded.target(BEN), Role::Controller).await;
            denied(&ben.unwrap_err(), "role = observer: this needs controller");
            let elsewhere = connect(guarded.target(ELSEWHERE), Role::Observer).await;
            denied(&elsewhere.unwrap_err(), "it is not valid for devices/cho-2005");
            next_state(&mut connect(guarded.target(BEN), Role::Observer).await.unwrap()).await;
            let mut anna = connect(guarded.target(ANNA), Role::Controller).await.unwrap();
            command_until(&mut anna, &[wall_at(0.29)], |state| state.contact_id == [1]).await;
            anna.close().await;
        }
        let mut boss = guarded.services(BOSS).await.sessions;
        let list = boss.list_sessions(ListSessionsRequest::default()).await;
        let list = list.unwrap().into_inner().sessions;
        assert!(list.len() <= 3, "who was refused is not there: {list:?}");
    });
    let opened = guarded.audited(audit::What::SessionOpened, 6);
    assert_eq!((opened[0].who.as_str(), opened[1].who.as_str()), ("ben", "anna"));
    assert!(opened[0].from.starts_with("127.0.0.1:"), "{opened:?}");
    let acquired = guarded.audited(audit::What::LeaseAcquired, 3);
    assert_eq!((acquired[0].who.as_str(), acquired[0].device.as_str()), ("anna", DEVICE));
    let refused = guarded.audited(audit::What::Refused, 11);
    assert_eq!((refused[0].who.as_str(), refused[2].who.as_str()), ("", "ben"));
    let kept = std::fs::read_to_string(guarded.rig.state_dir().join("audit.jsonl")).unwrap();
    assert!(guarded.tokens.iter().all(|token| !kept.contains(token)), "no secret is kept");
}

#[test]
fn the_services_speak_tls_and_each_call_needs_its_grant() {
    let guarded = Guarded::start();
    // HTTP/2 as it begins in plaintext (RFC 9113 section 3.4): the line goes, without a word.
    let mut plain = TcpStream::connect(guarded.rig.daemon().grpc_address).unwrap();
    plain.set_read_timeout(Some(PATIENCE)).unwrap();
    plain.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0").unwrap();
    assert!(plain.read(&mut [0; 100]).unwrap_or(0) == 0, "plaintext is answered");
    guarded.rig.run(async {
        let code = |result: Result<_, Status>| result.map(|_| ()).map_err(|status| status.code());
        let state = || GetStateRequest { name: DEVICE.into() };
        let mut guessed = services(&guarded.with_token("guessed")).await.unwrap();
        let answer = code(guessed.devices.list_devices(ListDevicesRequest {}).await.map(drop));
        assert_eq!(answer, Err(Code::Unauthenticated));
        let other = ConnectString { sha256: Some([7; 32]), ..guarded.target(BOSS) };
        let said = services(&other).await.unwrap_err().to_string();
        assert!(said.contains("is not the one in the connect string"), "{said}");

        let disable = || DisableRequest { name: DEVICE.into() };
        let stop = || StopRequest { name: DEVICE.into() };
        let (denied, allowed) = (Err(Code::PermissionDenied), Ok(()));
        for (who, sees, stops, disables) in [
            (BEN, allowed, allowed, denied),
            (ANNA, allowed, allowed, denied),
            (BOSS, allowed, allowed, allowed),
            (ELSEWHERE, denied, denied, denied),
        ] {
            let mut devices = guarded.services(who).await.devices;
            assert_eq!(code(devices.get_state(state()).await.map(drop)), sees, "{who}");
            assert_eq!(code(devices.stop(stop()).await.map(drop)), stops, "{who}");
            assert_eq!(code(devices.disable(disable()).await.map(drop)), disables, "{who}");
            let listed = devices.list_devices(ListDevicesRequest {}).await.unwrap().into_inner();
            assert_eq!(listed.devices.len(), usize::from(sees.is_ok()), "{who}");
        }
    });
    let stopped = guarded.audited(audit::What::Stopped, 3);
    let who: Vec<_> = stopped.iter().map(|line| line.who.as_str()).collect();
    assert_eq!(who, ["ben", "anna", "boss"]);
    assert_eq!(guarded.audited(audit::What::Disabled, 1)[0].who, "boss");
}

#[test]
fn what_is_changed_is_told_with_who_changed_it() {
    let guarded = Guarded::start();
    guarded.rig.run(async {
        let mut boss = guarded.services(BOSS).await;
        let name = || DEVICE.to_owned();
        let limit = |force_limit_n| {
            let settings = Settings { name: name(), force_limit_n, ..Settings::default() };
            let update_mask = Some(prost_types::FieldMask { paths: vec!["force_limit_n".into()] });
            UpdateSettingsRequest { settings: Some(settings), update_mask }
        };
        assert!(boss.devices.update_settings(limit(-1.0)).await.is_err());
        boss.devices.update_settings(limit(20.0)).await.unwrap();
        let clear = ReplaceSceneRequest { name: format!("{DEVICE}/scene"), ..Default::default() };
        boss.scenes.replace_scene(clear).await.unwrap();
        boss.devices.disable(DisableRequest { name: name() }).await.unwrap();
        boss.devices.enable(EnableRequest { name: name() }).await.unwrap();
        let recordings = &mut boss.recordings;
        let start = StartRecordingRequest { parent: name(), seconds: 60.0 };
        let name = recordings.start_recording(start).await.unwrap().into_inner().name;
        recordings.stop_recording(StopRecordingRequest { name: name.clone() }).await.unwrap();
        recordings.delete_recording(DeleteRecordingRequest { name }).await.unwrap();
    });
    for (what, words) in [
        (audit::What::SettingsChanged, "force_limit"),
        (audit::What::SceneChanged, "replaced"),
        (audit::What::Disabled, ""),
        (audit::What::Enabled, ""),
        (audit::What::RecordingStarted, ""),
        (audit::What::RecordingDeleted, ""),
    ] {
        let told = guarded.audited(what, 1);
        let [line] = &told[..] else { panic!("{what:?} is told {} times", told.len()) };
        assert_eq!((line.who.as_str(), line.device.as_str()), ("boss", DEVICE), "{line:?}");
        assert!(line.detail.contains(words) && line.from.starts_with("127.0.0.1:"), "{line:?}");
    }
}

#[test]
fn a_session_is_its_owners_and_the_operators() {
    let guarded = Guarded::start();
    guarded.rig.run(async {
        let anna = guarded.client(ANNA, Role::Controller).await.unwrap();
        let ben = guarded.client(BEN, Role::Observer).await.unwrap();
        let of = |client: &Client| client.welcome().session.clone();
        let close = |client: &Client| CloseSessionRequest { name: of(client) };
        let acquire = |client: &Client| AcquireLeaseRequest { name: of(client), takeover: true };
        let mut annas = guarded.services(ANNA).await.sessions;
        let said = annas.close_session(close(&ben)).await.unwrap_err();
        assert_eq!(said.code(), Code::PermissionDenied, "{said}");
        let said = annas.acquire_lease(acquire(&ben)).await.unwrap_err();
        assert_eq!(said.code(), Code::PermissionDenied, "{said}");
        assert_eq!(annas.acquire_lease(acquire(&anna)).await.unwrap().into_inner().epoch, 1);
        let mut boss = guarded.services(BOSS).await.sessions;
        let said = boss.acquire_lease(acquire(&ben)).await.unwrap_err();
        assert!(said.message().contains("credential ben: role = observer"), "{said}");
        boss.close_session(close(&anna)).await.unwrap();
        boss.close_session(close(&ben)).await.unwrap();
    });
    let closed = guarded.audited(audit::What::SessionClosed, 2);
    assert!(
        closed[0].who == "anna" && closed[0].detail.contains("by a call of boss"),
        "{closed:?}"
    );
    let released = guarded.audited(audit::What::LeaseReleased, 1);
    assert!(released[0].who == "boss" && released[0].detail.contains("of anna"), "{released:?}");
    // Anna at ben's session, twice, and ben's session that was to command.
    assert_eq!(guarded.audited(audit::What::Refused, 3)[0].who, "anna");
}

#[test]
fn a_takeover_is_told_with_both_names() {
    let guarded = Guarded::start();
    guarded.rig.run(async {
        let _anna = guarded.client(ANNA, Role::Controller).await.unwrap();
        let options = Options { takeover: true, ..Options::new("b", Role::Controller) };
        let _boss = Client::connect(&guarded.target(BOSS), options).await.unwrap();
    });
    let takeover = &guarded.audited(audit::What::Takeover, 1)[0];
    assert_eq!(takeover.who, "boss");
    assert!(takeover.detail.contains("of boss from sessions/1 of anna, epoch 2"), "{takeover:?}");
}

/// Short-lived, for one session: what a browser gets for its credential.
#[test]
fn a_ticket_lets_in_once_on_the_terms_of_the_call() {
    let guarded = Guarded::start();
    guarded.rig.run(async {
        let mut bens = guarded.services(BEN).await.sessions;
        let hello = |role: Role| Hello {
            versions: vec!["hapticd/1".into()],
            role: role.into(),
            ..Hello::default()
        };
        let open = |role| OpenSessionRequest { hello: Some(hello(role)), transport: 0 };
        let said = bens.open_session(open(Role::Controller)).await.unwrap_err();
        assert_eq!(said.code(), Code::PermissionDenied, "{said}");
        let opened = bens.open_session(open(Role::Observer)).await.unwrap().into_inner();
        let without = ConnectString { token: None, ..guarded.rig.target().clone() };
        let ticket = opened.ticket.clone();
        // What it says beside the ticket does not count.
        let options = Options { ticket, ..Options::new("a page", Role::Controller) };
        let mut client = Client::connect(&without, options.clone()).await.unwrap();
        next_state(&mut client).await;
        assert_eq!(client.welcome().lease_epoch, 0, "an observer");
        let again = Client::connect(&without, options).await.unwrap_err().to_string();
        assert!(again.contains("no session waits for it"), "{again}");
    });
}

#[test]
fn who_is_revoked_is_sent_away_and_nobody_else() {
    let guarded = Guarded::start();
    guarded.rig.run(async {
        let mut anna = guarded.client(ANNA, Role::Controller).await.unwrap();
        let mut ben = guarded.client(BEN, Role::Observer).await.unwrap();
        let mut annas = guarded.services(ANNA).await.devices;
        let watch = WatchStateRequest { name: DEVICE.into(), interval_ms: 50 };
        let mut watch = annas.watch_state(watch).await.unwrap().into_inner();
        assert!(watch.message().await.unwrap().is_some());
        guarded.file().revoke("anna").unwrap();
        let ended = loop {
            if let Err(error) = anna.next().await {
                break error;
            }
        };
        denied(&ended, "not known here");
        let ended = loop {
            match watch.message().await {
                Ok(Some(_)) => {}
                ended => break ended,
            }
        };
        assert_eq!(ended.unwrap_err().code(), Code::Unauthenticated);
        let stop = annas.stop(StopRequest { name: DEVICE.into() }).await.unwrap_err();
        assert_eq!(stop.code(), Code::Unauthenticated);
        tokio::time::sleep(Duration::from_millis(1500)).await;
        next_state(&mut ben).await;
    });
    guarded.audited(audit::What::CredentialsChanged, 1);
}

#[test]
fn who_starts_and_ends_is_told_and_a_restart_is_seen() {
    let guarded = Guarded::start();
    let started = &guarded.audited(audit::What::Started, 1)[0];
    assert_eq!(
        (started.who.as_str(), started.detail.as_str()),
        ("local", "credentials are needed")
    );
    let (_, state) = guarded.rig.stop();
    let lines = audit::tail(state.path(), 10).unwrap();
    assert!(lines.last().unwrap().contains("\"ended\""), "{lines:?}");
}
