//! The services' way to the sessions: questions that the stream thread answers in its turn.
//!
//! The sessions have one owner, and no lock. A question waits in a short queue until that
//! thread has nothing more urgent; whoever asks waits for the answer, never the other way.

use tokio::sync::{mpsc, oneshot};

use crate::session::Switchboard;

/// Questions that may wait.
const WAITING: usize = 64;

/// One question.
type Call = Box<dyn FnOnce(&mut Switchboard, u64) + Send>;

/// The stream thread's end.
pub struct SessionCalls(mpsc::Receiver<Call>);

/// Everybody else's end; cheap to clone.
#[derive(Clone, Debug)]
pub struct SessionDesk(mpsc::Sender<Call>);

/// Both ends.
pub fn session_calls() -> (SessionDesk, SessionCalls) {
    let (ask, calls) = mpsc::channel(WAITING);
    (SessionDesk(ask), SessionCalls(calls))
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
        let (answer, answered) = oneshot::channel();
        let call = move |sessions: &mut Switchboard, now_ns| {
            // Who asked may have gone meanwhile.
            let _ = answer.send(question(sessions, now_ns));
        };
        self.0.send(Box::new(call)).await.ok()?;
        answered.await.ok()
    }
}
