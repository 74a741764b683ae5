//! Ctrl-C and SIGTERM, heard from the moment they are registered.

use std::io;

use tokio::signal::unix::{Signal, SignalKind, signal};

/// Both signals. Registered before anything is announced, so that a stop asked for at once
/// is an orderly one too.
#[derive(Debug)]
pub struct Signals {
    interrupt: Signal,
    terminate: Signal,
}

impl Signals {
    /// Begins to listen; inside a runtime.
    pub fn register() -> io::Result<Self> {
        let interrupt = signal(SignalKind::interrupt())?;
        let terminate = signal(SignalKind::terminate())?;
        Ok(Self { interrupt, terminate })
    }

    /// Done when one of them has come. Cancel safe.
    pub async fn received(&mut self) {
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.terminate.recv() => {}
        }
    }
}
