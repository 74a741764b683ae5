//! The services' way to the sessions: questions that the stream thread answers in its turn.
//!
//! The sessions have one owner, and no lock. A question waits in a short queue until that
//! thread has nothing more urgent; whoever asks waits for the answer, never the other way.

use tokio::sync::{mpsc, oneshot};

use super::sealed_udp::{SealedUdp, SealedUdpOffer};
use crate::proto::{ByeReason, Hello, Welcome};
use crate::session::{CallRefusal, Switchboard, Ticket};

/// Questions that may wait.
const WAITING: usize = 64;

/// One question.
type Call = Box<dyn FnOnce(&mut Switchboard, &mut SealedUdp, u64) + Send>;

/// The stream thread's end.
pub struct SessionCalls(mpsc::Receiver<Call>);

/// Everybody else's end; cheap to clone.
#[derive(Clone, Debug)]
pub struct SessionDesk {
    ask: mpsc::Sender<Call>,
    udp_port: u16,
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
        self.ask_both(move |board, _, now_ns| question(board, now_ns)).await
    }

    /// Opens a session for a stream that is to come with this ticket, or over sealed UDP with
    /// what was offered.
    pub async fn open(
        &self,
        hello: Hello,
        ticket: Ticket,
        offer: Option<SealedUdpOffer>,
    ) -> Option<Result<Welcome, CallRefusal>> {
        let open = move |board: &mut Switchboard, sealed: &mut SealedUdp, now_ns| {
            if let Some(offer) = offer {
                sealed.open(&offer, now_ns).map_err(|full| CallRefusal::Refused {
                    reason: ByeReason::TooManySessions,
                    detail: full.to_string(),
                })?;
            }
            let opened = board.open(&hello, ticket, now_ns);
            if let (Err(_), Some(offer)) = (&opened, &offer) {
                sealed.forget(offer);
            }
            opened
        };
        self.ask_both(open).await
    }

    /// Where sealed UDP is heard.
    pub fn udp_port(&self) -> u16 {
        self.udp_port
    }

    async fn ask_both<T: Send + 'static>(
        &self,
        question: impl FnOnce(&mut Switchboard, &mut SealedUdp, u64) -> T + Send + 'static,
    ) -> Option<T> {
        let (answer, answered) = oneshot::channel();
        let call = move |board: &mut Switchboard, sealed: &mut SealedUdp, now_ns| {
            // Who asked may have gone meanwhile.
            let _ = answer.send(question(board, sealed, now_ns));
        };
        self.ask.send(Box::new(call)).await.ok()?;
        answered.await.ok()
    }
}
