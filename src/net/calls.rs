//! The services' way to the sessions: questions that the stream thread answers in its turn.
//!
//! The sessions have one owner, and no lock. A question waits in a short queue until that
//! thread has nothing more urgent; whoever asks waits for the answer, never the other way.

use tokio::sync::{mpsc, oneshot};

use super::gate::{Caller, Refused};
use super::guests::Guest;
use super::hub::Hub;
use super::sealed_udp::SealedUdpOffer;
use crate::proto::{ByeReason, Hello, Welcome};
use crate::session::{CallRefusal, LeaseInfo, SessionId, Switchboard, Ticket};

/// Questions that may wait.
const WAITING: usize = 64;

/// One question.
type Call = Box<dyn FnOnce(&mut Hub, u64) + Send>;

/// The stream thread's end.
pub struct SessionCalls(mpsc::Receiver<Call>);

/// Everybody else's end; cheap to clone.
#[derive(Clone, Debug)]
pub struct SessionDesk {
    ask: mpsc::Sender<Call>,
    udp_port: u16,
}

/// Why a call did nothing.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DeskRefusal {
    /// The sessions refuse it to everybody.
    #[error(transparent)]
    Call(#[from] CallRefusal),
    /// It is not for this caller.
    #[error(transparent)]
    Caller(#[from] Refused),
    /// There are no sessions any more.
    #[error("the stream has ended")]
    Ended,
}

/// Both ends; sealed UDP is heard on this port.
pub fn session_calls(udp_port: u16) -> (SessionDesk, SessionCalls) {
    let (ask, calls) = mpsc::channel(WAITING);
    (SessionDesk { ask, udp_port }, SessionCalls(calls))
}

impl SessionCalls {
    pub(super) async fn next(&mut self) -> Option<Call> {
        self.0.recv().await
    }
}

impl SessionDesk {
    /// Asks with the device clock of the moment of the answer; `None` when the stream has ended.
    pub async fn ask<T: Send + 'static>(
        &self,
        question: impl FnOnce(&mut Switchboard, u64) -> T + Send + 'static,
    ) -> Option<T> {
        self.ask_hub(move |hub, now_ns| question(&mut hub.sessions, now_ns)).await
    }

    /// Opens a session for a stream that is to come with this ticket, or over sealed UDP with
    /// what was offered.
    pub async fn open(
        &self,
        (caller, from): (Caller, String),
        hello: Hello,
        ticket: Ticket,
        offer: Option<SealedUdpOffer>,
    ) -> Result<Welcome, DeskRefusal> {
        let open =
            move |hub: &mut Hub, now_ns| open(hub, (caller, from), &hello, ticket, offer, now_ns);
        self.ask_hub(open).await.unwrap_or(Err(DeskRefusal::Ended))
    }

    /// Sends a session away.
    pub async fn close(&self, who: (Caller, String), id: SessionId) -> Result<(), DeskRefusal> {
        let close = move |hub: &mut Hub, who: &(Caller, String), now_ns| {
            hub.sessions.close(id, now_ns)?;
            hub.guests.closed_by(id, who.0.name());
            hub.lease_changed(who);
            Ok(())
        };
        self.decide(who, id, close).await
    }

    /// Makes a session the controller of its device.
    pub async fn acquire_lease(
        &self,
        who: (Caller, String),
        id: SessionId,
        takeover: bool,
    ) -> Result<LeaseInfo, DeskRefusal> {
        let acquire = move |hub: &mut Hub, who: &(Caller, String), now_ns| {
            hub.guests.may_command(id)?;
            let lease = hub.sessions.acquire_lease(id, takeover, now_ns)?;
            hub.lease_changed(who);
            Ok(lease)
        };
        self.decide(who, id, acquire).await
    }

    /// Makes the controller an observer.
    pub async fn release_lease(
        &self,
        who: (Caller, String),
        id: SessionId,
    ) -> Result<LeaseInfo, DeskRefusal> {
        let release = move |hub: &mut Hub, who: &(Caller, String), now_ns| {
            let lease = hub.sessions.release_lease(id, now_ns)?;
            hub.lease_changed(who);
            Ok(lease)
        };
        self.decide(who, id, release).await
    }

    /// Where sealed UDP is heard.
    pub fn udp_port(&self) -> u16 {
        self.udp_port
    }

    /// About one's own session, or as an operator about that of another.
    async fn decide<T: Send + 'static>(
        &self,
        who: (Caller, String),
        id: SessionId,
        what: impl FnOnce(&mut Hub, &(Caller, String), u64) -> Result<T, DeskRefusal> + Send + 'static,
    ) -> Result<T, DeskRefusal> {
        let decided = move |hub: &mut Hub, now_ns| {
            hub.guests.may_decide(id, &who.0)?;
            what(hub, &who, now_ns)
        };
        self.ask_hub(decided).await.unwrap_or(Err(DeskRefusal::Ended))
    }

    async fn ask_hub<T: Send + 'static>(
        &self,
        question: impl FnOnce(&mut Hub, u64) -> T + Send + 'static,
    ) -> Option<T> {
        let (answer, answered) = oneshot::channel();
        let call = move |hub: &mut Hub, now_ns| {
            // Who asked may have gone meanwhile.
            let _ = answer.send(question(hub, now_ns));
        };
        self.ask.send(Box::new(call)).await.ok()?;
        answered.await.ok()
    }
}

fn open(
    hub: &mut Hub,
    (caller, from): (Caller, String),
    hello: &Hello,
    ticket: Ticket,
    offer: Option<SealedUdpOffer>,
    now_ns: u64,
) -> Result<Welcome, DeskRefusal> {
    let guest = hub.sessions.device_meant(hello).map(|device| Guest {
        caller,
        from,
        device,
        closed_by: None,
        association: offer.map(|offer| offer.association),
    });
    if let Some(guest) = &guest {
        hub.guests.check(guest, hello)?;
    }
    if let Some(offer) = offer {
        hub.sealed.open(&offer, now_ns).map_err(|full| CallRefusal::Refused {
            reason: ByeReason::TooManySessions,
            detail: full.to_string(),
        })?;
    }
    // Whoever may call comes before any who have not said Hello yet.
    hub.sessions.make_room(|_| Some(0), now_ns);
    let opened = hub.sessions.open(hello, ticket, now_ns);
    match (&opened, guest, offer) {
        (Err(_), _, Some(offer)) => hub.sealed.forget(offer.association),
        (Ok(welcome), Some(guest), _) => {
            let id = SessionId::parse(&welcome.session);
            if let Some(info) = id.and_then(|id| hub.sessions.info(id, now_ns)) {
                hub.guests.arrived(info.id, guest, &info);
            }
        }
        _ => {}
    }
    Ok(opened?)
}
