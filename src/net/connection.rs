//! One client on the QUIC port from the end of its handshake to farewell: `hapticd/1` as it is, or inside a
//! WebTransport session (`h3`). The name of the protocol in the handshake says which.

use std::cell::Cell;
use std::net::IpAddr;
use std::rc::Rc;
use std::time::Duration;

use quinn::Connection;
use quinn::crypto::rustls::HandshakeData;
use tokio::sync::mpsc;
use web_transport_quinn::{Request, Session, http::StatusCode};

use super::access::Access;
use super::hub::{Carrier, Shared};
use crate::clock::now_ns;
use crate::proto::StreamMessage;
use crate::quic::{self, WEBTRANSPORT_PATH};
use crate::session::{SessionId, Transport};
use crate::wire::{FrameDecoder, encode_frame};

/// Messages that may wait on a reliable stream; a client that reads nothing loses it.
const WAITING_MESSAGES: usize = 256;

/// Time for a message to be taken by a client that is slow to read.
const PATIENCE: Duration = Duration::from_secs(1);

/// Time for the request that makes a WebTransport session.
const REQUEST: Duration = Duration::from_secs(10);

/// Time for a Bye to reach its client before the connection is closed.
pub(super) const FAREWELL: Duration = Duration::from_millis(250);

/// One client from the end of its handshake to farewell.
pub(super) async fn attend(hub: Shared, connection: Connection, access: Rc<Access>) {
    let Some((session, transport)) = begin(connection, &access).await else { return };
    let connected = {
        let mut hub = hub.borrow_mut();
        hub.make_room(session.remote_address().ip());
        let connected = hub.sessions.connect(transport, now_ns());
        // Somebody else may have to go.
        hub.act();
        connected
    };
    let id = match connected {
        Ok(id) => id,
        Err(full) => return refuse(&session, &full.bye()).await,
    };
    let (messages, outgoing) = mpsc::channel(WAITING_MESSAGES);
    let carrier = Carrier::Stream { session: Box::new(session.clone()), messages };
    hub.borrow_mut().peers.insert(id, carrier);
    tracing::debug!(session = %id, address = %session.remote_address(), "connected");
    // It may come to join a session that waits for it.
    let id = &Cell::new(id);
    tokio::select! {
        () = hear_datagrams(&hub, id, &session) => {}
        () = converse(&hub, id, &session, outgoing) => {}
    }
    let id = id.get();
    hub.borrow_mut().leave(id);
    // A WebTransport session does not end its connection by itself.
    session.close(0, b"gone");
    tracing::debug!(session = %id, "gone");
}

/// The session that a connection carries: the connection itself, or the one that its client
/// asks for by HTTP/3.
async fn begin(connection: Connection, access: &Access) -> Option<(Session, Transport)> {
    if !speaks_http(&connection) {
        return Some((Session::raw(connection), Transport::Quic));
    }
    let ip = connection.remote_address().ip();
    let accepted = tokio::time::timeout(REQUEST, accept(connection, ip, access)).await;
    Some((accepted.ok()??, Transport::WebTransport))
}

fn speaks_http(connection: &Connection) -> bool {
    let data = connection.handshake_data().and_then(|data| data.downcast::<HandshakeData>().ok());
    data.is_some_and(|data| data.protocol.as_deref() == Some(web_transport_quinn::ALPN.as_bytes()))
}

/// Pages of strangers are refused before there is a session.
async fn accept(connection: Connection, ip: IpAddr, access: &Access) -> Option<Session> {
    let request = Request::accept(connection).await.ok()?;
    let host = request.url.host_str().unwrap_or_default().to_owned();
    let origin = request.headers.get("origin").map(|origin| origin.as_bytes().to_vec());
    let origin = origin.as_deref().map(String::from_utf8_lossy);
    if request.url.path() != WEBTRANSPORT_PATH {
        return reject(request, StatusCode::NOT_FOUND).await;
    }
    if let Err(refusal) = access.check(&host, origin.as_deref()) {
        tracing::debug!(%ip, %refusal, "a WebTransport session is refused");
        return reject(request, StatusCode::FORBIDDEN).await;
    }
    request.ok().await.ok()
}

/// The answer is heard before the connection goes.
async fn reject(request: Request, status: StatusCode) -> Option<Session> {
    let connection = request.conn().clone();
    let _ = request.reject(status).await;
    let _ = tokio::time::timeout(FAREWELL, connection.closed()).await;
    None
}

/// Tells a client for whom there is no room.
async fn refuse(session: &Session, bye: &StreamMessage) {
    let farewell = async {
        if let Ok((mut send, _)) = session.accept_bi().await {
            let _ = send.write_all(&encode_frame(bye)).await;
            let _ = send.finish();
            let _ = send.stopped().await;
        }
    };
    let _ = tokio::time::timeout(FAREWELL, farewell).await;
    session.close(1, b"too many sessions");
}

async fn hear_datagrams(hub: &Shared, id: &Cell<SessionId>, session: &Session) {
    while let Ok(bytes) = session.read_datagram().await {
        let mut hub = hub.borrow_mut();
        hub.sessions.on_datagram(id.get(), &bytes, now_ns());
        hub.act();
    }
}

/// The reliable stream, both ways; ends when the client is to be left.
async fn converse(
    hub: &Shared,
    id: &Cell<SessionId>,
    session: &Session,
    mut outgoing: mpsc::Receiver<Vec<u8>>,
) {
    let opened = tokio::select! {
        opened = session.accept_bi() => opened,
        // Over before it began: there is no stream to say Bye on.
        () = drained(&mut outgoing) => return session.close(3, b"no Hello"),
    };
    let Ok((mut send, mut receive)) = opened else { return };
    let reading = async {
        let mut frames = FrameDecoder::default();
        while let Ok(Some(chunk)) = receive.read_chunk(quic::CHUNK_BYTES, true).await {
            let mut bytes: &[u8] = &chunk.bytes;
            let mut hub = hub.borrow_mut();
            loop {
                match frames.next(&mut bytes) {
                    Ok(Some(message)) => id.set(hub.on_message(id.get(), message)),
                    Ok(None) => break,
                    Err(error) => {
                        hub.sessions.on_broken_stream(id.get(), error, now_ns());
                        break;
                    }
                }
            }
            hub.act();
        }
        // The client has closed its side; the session lives on by datagrams until it is
        // silent or says Bye.
        std::future::pending::<()>().await;
    };
    let writing = async {
        while let Some(bytes) = outgoing.recv().await {
            // A client that takes nothing would hold its connection open for ever.
            let written = tokio::time::timeout(PATIENCE, send.write_all(&bytes)).await;
            if !matches!(written, Ok(Ok(()))) {
                return session.close(2, b"you do not read");
            }
        }
        // No more to say: the session is over, its Bye is written.
        let _ = send.finish();
        let _ = tokio::time::timeout(FAREWELL, send.stopped()).await;
        session.close(0, b"bye");
    };
    tokio::select! {
        () = reading => {}
        () = writing => {}
    }
}

/// Done when the session wants nothing said any more, because it has ended.
async fn drained(outgoing: &mut mpsc::Receiver<Vec<u8>>) {
    while outgoing.recv().await.is_some() {}
}
