//! The socket of sealed UDP: packets in and out of the [`Associations`].

use std::io;
use std::net::SocketAddr;
use std::rc::Rc;

use tokio::net::UdpSocket;

use super::associations::{Associations, Heard, TooManyAssociations};
use super::hub::{Carrier, Hub, Shared};
use crate::clock::now_ns;
use crate::sealed::{AssociationId, MAX_PACKET_BYTES, Secret, Unsealed};
use crate::session::{SessionId, Ticket, Transport};
use crate::telemetry::TurnedAway;
use crate::wire::FrameDecoder;

/// Packets heard before others have their turn, however many wait.
const IN_A_ROW: usize = 32;

/// What opens an association: made by the service, and told to the client over its channel.
#[derive(Clone, Copy, Debug)]
pub struct SealedUdpOffer {
    /// Names the association.
    pub association: AssociationId,
    /// Known to both ends alone.
    pub secret: Secret,
    /// Of the session that is to be joined.
    pub ticket: Ticket,
}

/// The socket with its associations.
pub(super) struct SealedUdp {
    socket: Rc<UdpSocket>,
    table: Associations,
}

impl SealedUdp {
    /// On a socket that is bound; cookies are made with this secret.
    pub fn new(socket: std::net::UdpSocket, cookies: &Secret) -> io::Result<Self> {
        socket.set_nonblocking(true)?;
        let socket = Rc::new(UdpSocket::from_std(socket)?);
        Ok(Self { socket, table: Associations::new(cookies) })
    }

    /// A client is to come with this.
    pub fn open(&mut self, offer: &SealedUdpOffer, now_ns: u64) -> Result<(), TooManyAssociations> {
        self.table.open(offer.association, &offer.secret, offer.ticket, now_ns)
    }

    /// It is not to be after all.
    pub fn forget(&mut self, association: AssociationId) {
        self.table.forget(association);
    }

    /// Never waits; false where the datagram is lost.
    pub fn send(&mut self, to: SessionId, bytes: &[u8]) -> bool {
        let sealed = self.table.seal(to, bytes);
        sealed.is_some_and(|(packet, address)| self.post(&packet, address))
    }

    /// Says it until it is taken; false where too much waits already.
    pub fn say(&mut self, to: SessionId, frame: &[u8]) -> bool {
        self.table.say(to, frame)
    }

    /// The session is over.
    pub fn end(&mut self, session: SessionId) {
        self.table.end(session, now_ns());
    }

    /// Says again what was not taken, and forgets who is gone.
    pub fn repeat(&mut self) {
        for (packet, address) in self.table.due(now_ns()) {
            self.post(&packet, address);
        }
    }

    /// Nobody is left to say anything to.
    pub fn is_idle(&self) -> bool {
        self.table.is_empty()
    }

    fn post(&self, packet: &[u8], to: SocketAddr) -> bool {
        // What the socket does not take is lost, as on any network.
        self.socket.try_send_to(packet, to).is_ok()
    }
}

/// Hears all clients of sealed UDP.
pub(super) async fn hear(hub: Shared) {
    let socket = Rc::clone(&hub.borrow().sealed.socket);
    let mut buffer = [0; MAX_PACKET_BYTES + 1];
    while socket.readable().await.is_ok() {
        hear_some(&mut hub.borrow_mut(), &socket, &mut buffer);
        tokio::task::yield_now().await;
    }
}

fn hear_some(hub: &mut Hub, socket: &UdpSocket, buffer: &mut [u8]) {
    for _ in 0..IN_A_ROW {
        // An error is one client's port that is closed by now, or nothing more to hear.
        let Ok((length, from)) = socket.try_recv_from(buffer) else { break };
        hear_one(hub, &mut buffer[..length], from);
    }
    hub.act();
}

fn hear_one(hub: &mut Hub, packet: &mut [u8], from: SocketAddr) {
    match hub.sealed.table.on_packet(packet, from, now_ns()) {
        Heard::Nothing => {}
        Heard::Unsealed(why) => hub.gate.count(turned_away(why)),
        Heard::Answer(answer) => {
            hub.sealed.post(&answer, from);
        }
        Heard::Arrived { association, ticket } => arrive(hub, association, &ticket, from),
        Heard::Datagram { session, body } => {
            hub.sessions.on_datagram(session, body, now_ns());
        }
        Heard::Message { session, mut frame, answer } => {
            hub.sealed.post(&answer, from);
            let mut frames = FrameDecoder::default();
            match frames.next(&mut frame) {
                Ok(Some(message)) => drop(hub.on_message(session, message)),
                // A message is whole, or nothing.
                Ok(None) => {}
                Err(error) => hub.sessions.on_broken_stream(session, error, now_ns()),
            }
        }
    }
}

fn turned_away(why: Option<Unsealed>) -> TurnedAway {
    match why {
        None => TurnedAway::SealedUnknown,
        Some(Unsealed::Replayed) => TurnedAway::SealedReplayed,
        Some(Unsealed::Malformed | Unsealed::Forged) => TurnedAway::SealedForged,
    }
}

/// Its Hello was said by the call, and its session waits for it.
fn arrive(hub: &mut Hub, association: AssociationId, ticket: &Ticket, from: SocketAddr) {
    let joined = hub.sessions.join_by_ticket(ticket, Transport::SealedUdp, now_ns());
    let Some(session) = joined else { return };
    hub.peers.insert(session, Carrier::Sealed { from });
    hub.guests.joined(session, from.to_string());
    hub.sealed.table.join(association, session);
    tracing::debug!(%session, "connected over sealed UDP");
}
