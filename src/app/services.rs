//! The service runtime: gRPC, HTTP, upkeep of the metrics, and the ear for signals.

use std::future::Future;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context;
use tokio::runtime::Runtime;
use tokio::sync::watch;
use tokio::task::JoinHandle;

use super::Signals;
use crate::archive::Archive;
use crate::net::{self, Door, HttpParts, SessionDesk};

/// Time for open calls to be answered when the daemon stops.
const FAREWELL: Duration = Duration::from_millis(500);

/// Between two upkeeps of the metrics.
const UPKEEP: Duration = Duration::from_secs(2);

/// What is served, and how its end is asked for. Prepared first, serving later, so that all
/// the system may refuse is known before there is anything to serve.
#[derive(Debug)]
pub struct Services {
    /// `None` once it has stopped.
    runtime: Option<Runtime>,
    signals: Signals,
    doors: Option<(Door, Door)>,
    shutdown: watch::Sender<bool>,
    serving: Vec<JoinHandle<()>>,
}

impl Services {
    /// Takes the bound listeners and begins to hear signals.
    pub fn prepare(
        grpc: std::net::TcpListener,
        http: std::net::TcpListener,
    ) -> anyhow::Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("hapticd-services")
            .enable_all()
            .build()
            .context("cannot start the thread of the services")?;
        let inside = runtime.enter();
        let signals = Signals::register().context("cannot listen to signals")?;
        let doors = Some((Door::new(grpc)?, Door::new(http)?));
        drop(inside);
        let (shutdown, _) = watch::channel(false);
        Ok(Self { runtime: Some(runtime), signals, doors, shutdown, serving: Vec::new() })
    }

    /// Begins to serve.
    pub fn serve(&mut self, http_parts: HttpParts, sessions: SessionDesk, archive: Arc<Archive>) {
        let (Some(runtime), Some((grpc, http))) = (&self.runtime, self.doors.take()) else {
            return;
        };
        let stopped = self.shutdown.subscribe();
        let http_port = http.port();
        let browser = Arc::clone(&http_parts.browser);
        let (scrape, hosts) = (http_parts.scrape.clone(), http_parts.hosts.clone());
        let serving = net::serve_grpc(grpc, http_port, hosts, sessions, archive, stopped.clone());
        self.serving.push(runtime.spawn(async move {
            if let Err(error) = serving.await {
                tracing::error!(%error, "the services stopped");
            }
        }));
        let serving = net::serve_http(http, http_parts, stopped);
        self.serving.push(runtime.spawn(async move {
            if let Err(error) = serving.await {
                tracing::error!(%error, "HTTP stopped");
            }
        }));
        runtime.spawn(async move {
            let mut interval = tokio::time::interval(UPKEEP);
            loop {
                interval.tick().await;
                scrape.upkeep();
                browser.renew();
            }
        });
    }

    /// Waits for Ctrl-C or SIGTERM, at most until `until`; true when one has come, be it
    /// before the call. True at once when the services have stopped.
    pub fn wait_for_signal(&mut self, until: Option<Instant>) -> bool {
        let Some(runtime) = &self.runtime else { return true };
        let received = self.signals.received();
        runtime.block_on(async {
            match until {
                None => received.await,
                Some(until) => return ended(received, until).await,
            }
            true
        })
    }

    /// No new calls from now on; those under way go on to their answer.
    pub fn close(&self) {
        self.shutdown.send_replace(true);
    }

    /// Waits for the calls under way, but not for ever, and ends.
    pub fn stop(&mut self) {
        self.close();
        let Some(runtime) = self.runtime.take() else { return };
        let until = Instant::now() + FAREWELL;
        for serving in self.serving.drain(..) {
            runtime.block_on(ended(serving, until));
        }
        runtime.shutdown_timeout(FAREWELL);
    }
}

/// Whether something came to its end in time.
async fn ended<T>(work: impl Future<Output = T>, until: Instant) -> bool {
    tokio::time::timeout_at(until.into(), work).await.is_ok()
}
