//! Where places run out: one credential keeps nobody else out, and what it has open ends with it.

use std::time::Duration;

use hapticd::audit;
use hapticd::client::{Client, ClientError, Services};
use hapticd::proto::{
    ByeReason, DownloadRecordingRequest, Hello, OpenSessionRequest, RecordingChunk, Role,
    StartRecordingRequest, StopRecordingRequest, WatchStateRequest,
};
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use tonic::{Code, Streaming};

use super::credentials::{ANNA, BEN, Guarded};
use super::support::{DEVICE, Rig, next_state};

/// More than what can be on its way to a client that reads nothing: 2 MB in a window of HTTP/2, and
/// what the server holds ready for it.
const LONG_BYTES: u64 = 4 << 20;

/// Keeps a session alive beside the test until it is told to say Bye.
fn keep(rig: &Rig, mut client: Client) -> (oneshot::Sender<()>, JoinHandle<()>) {
    let (leave, mut told) = oneshot::channel();
    let living = rig.spawn(async move {
        loop {
            tokio::select! {
                incoming = client.next() => drop(incoming.unwrap()),
                _ = &mut told => return client.close().await,
            }
        }
    });
    (leave, living)
}

#[test]
fn one_credential_has_half_of_the_sessions() {
    let guarded = Guarded::with(|config| config.session.max_sessions = 4);
    guarded.rig.run(async {
        let (first, _) = keep(&guarded.rig, guarded.client(BEN, Role::Observer).await.unwrap());
        let (_stay, second) =
            keep(&guarded.rig, guarded.client(BEN, Role::Observer).await.unwrap());
        let said = "credential ben has 2 of 4 sessions";
        match guarded.client(BEN, Role::Observer).await.unwrap_err() {
            ClientError::Bye { reason: ByeReason::TooManySessions, detail } => {
                assert!(detail.contains(said), "{detail}");
            }
            other => panic!("{other}"),
        }
        let hello = Hello {
            versions: vec!["hapticd/1".into()],
            role: Role::Observer.into(),
            ..Hello::default()
        };
        let open = OpenSessionRequest { hello: Some(hello), transport: 0 };
        let by_call = guarded.services(BEN).await.sessions.open_session(open.clone()).await;
        let by_call = by_call.unwrap_err();
        assert_eq!(by_call.code(), Code::ResourceExhausted, "{by_call}");
        assert!(by_call.message().contains(said), "{by_call}");
        let mut anna = guarded.client(ANNA, Role::Controller).await.unwrap();
        next_state(&mut anna).await;
        first.send(()).unwrap();
        // What a call has opened counts, too, before its stream comes.
        let mut bens = guarded.services(BEN).await.sessions;
        while bens.open_session(open.clone()).await.is_err() {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        assert!(guarded.client(BEN, Role::Observer).await.is_err());
        assert!(!second.is_finished(), "it stays");
    });
    assert_eq!(guarded.audited(audit::What::Refused, 3)[0].who, "ben");
}

#[test]
fn one_credential_has_half_of_the_watches() {
    let guarded = Guarded::with(|_| ());
    guarded.rig.run(async {
        let watch = async |services: &mut Services| {
            let watch = WatchStateRequest { name: DEVICE.into(), interval_ms: 10_000 };
            services.devices.watch_state(watch).await.map(tonic::Response::into_inner)
        };
        let (mut bens, mut annas) = (guarded.services(BEN).await, guarded.services(ANNA).await);
        let mut open = Vec::new();
        let refused = loop {
            match watch(&mut bens).await {
                Ok(answers) => open.push(answers),
                Err(refused) => break refused,
            }
        };
        assert_eq!((open.len(), refused.code()), (32, Code::ResourceExhausted), "{refused}");
        assert!(refused.message().contains("credential ben has 32 of 64"), "{refused}");
        assert!(watch(&mut annas).await.is_ok());
        open.pop();
        // The place comes back once the server has heard that nobody listens.
        while watch(&mut bens).await.is_err() {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    });
}

/// A download that ends early says so: half a recording is not taken for a whole one.
#[test]
fn downloads_are_few_and_end_with_their_credential() {
    let guarded = Guarded::with(|_| ());
    guarded.rig.run(async {
        let annas = &mut guarded.services(ANNA).await.recordings;
        let start = StartRecordingRequest { parent: DEVICE.into(), seconds: 600.0 };
        let name = annas.start_recording(start).await.unwrap().into_inner().name;
        loop {
            let get = hapticd::proto::GetRecordingRequest { name: name.clone() };
            let recording = annas.get_recording(get).await.unwrap().into_inner();
            if recording.bytes > LONG_BYTES {
                break;
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        annas.stop_recording(StopRecordingRequest { name: name.clone() }).await.unwrap();
        let download = || DownloadRecordingRequest { name: name.clone() };
        let mut open = Vec::new();
        let refused = loop {
            match annas.download_recording(download()).await {
                Ok(pieces) => open.push(pieces.into_inner()),
                Err(refused) => break refused,
            }
        };
        assert_eq!((open.len(), refused.code()), (4, Code::ResourceExhausted), "{refused}");
        let bens = &mut guarded.services(BEN).await.recordings;
        let bens = bens.download_recording(download()).await.unwrap().into_inner();
        guarded.file().revoke("anna").unwrap();
        // The first: what came of it fills the window of the connection that they share.
        let mut anna = open.remove(0);
        assert!(anna.message().await.unwrap().is_some(), "what was on its way");
        // Nothing is read until each of the four has been judged again.
        tokio::time::sleep(Duration::from_secs(3)).await;
        drop(open);
        let (read, ended) = to_the_end(anna).await;
        assert!(ended.is_some_and(|status| status.code() == Code::Unauthenticated), "{read} bytes");
        let (read, ended) = to_the_end(bens).await;
        assert!(read > LONG_BYTES && ended.is_none(), "{read} bytes, {ended:?}");
    });
}

async fn to_the_end(mut pieces: Streaming<RecordingChunk>) -> (u64, Option<tonic::Status>) {
    let mut read = 0;
    loop {
        match pieces.message().await {
            Ok(Some(piece)) => read += piece.data.len() as u64,
            Ok(None) => return (read, None),
            Err(status) => return (read, Some(status)),
        }
    }
}
