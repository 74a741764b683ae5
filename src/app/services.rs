//! The service runtime: gRPC, HTTP, upkeep of the metrics, and the ear for signals.

use std::future::Future;
use std::net::TcpListener;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context;
use tokio::runtime::Runtime;
use tokio::sync::watch;
use tokio::task::JoinHandle;

use super::Signals;
use crate::clock::now_ns;
use crate::net::{self, Door, GrpcParts, HttpParts, Reach, Security};

/// Time for open calls to be answered when the daemon stops.
const FAREWELL: Duration = Duration::from_millis(500);

/// Between two upkeeps of the metrics.
const UPKEEP: Duration = Duration::from_secs(2);

/// Between two looks for changed credentials.
const LOOK: Duration = Duration::from_millis(500);

/// Bound, with what is spoken on each.
#[derive(Debug)]
pub struct Listeners {
    /// gRPC.
    pub grpc: (TcpListener, Security),
    /// Plain HTTP.
    pub http: (TcpListener, Reach),
    /// HTTPS.
    pub https: Option<(TcpListener, Security)>,
}

impl Listeners {
    /// Inside a runtime.
    fn into_doors(self) -> std::io::Result<Vec<Served>> {
        let (grpc, security) = self.grpc;
        let (http, reach) = self.http;
        let door = |listener, security, as_what| {
            Door::new(listener, security).map(|door| Served { door, as_what })
        };
        let mut doors =
            vec![door(grpc, security, As::Grpc)?, door(http, Security::Plain, As::Http(reach))?];
        if let Some((https, security)) = self.https {
            doors.push(door(https, security, As::Http(Reach::Encrypted))?);
        }
        Ok(doors)
    }
}

/// A door and what is behind it.
#[derive(Debug)]
struct Served {
    door: Door,
    as_what: As,
}

/// What is behind a door.
#[derive(Clone, Copy, Debug)]
enum As {
    Grpc,
    Http(Reach),
}

/// What is served, and how its end is asked for. Prepared first, serving later, so that all
/// the system may refuse is known before there is anything to serve.
#[derive(Debug)]
pub struct Services {
    /// `None` once it has stopped.
    runtime: Option<Runtime>,
    signals: Signals,
    doors: Vec<Served>,
    shutdown: watch::Sender<bool>,
    serving: Vec<JoinHandle<()>>,
}

impl Services {
    /// Takes the bound listeners and begins to hear signals.
    pub fn prepare(listeners: Listeners) -> anyhow::Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("hapticd-services")
            .enable_all()
            .build()
            .context("cannot start the thread of the services")?;
        let inside = runtime.enter();
        let signals = Signals::register().context("cannot listen to signals")?;
        let doors = listeners.into_doors()?;
        drop(inside);
        let (shutdown, _) = watch::channel(false);
        Ok(Self { runtime: Some(runtime), signals, doors, shutdown, serving: Vec::new() })
    }

    /// Begins to serve.
    pub fn serve(&mut self, http: &HttpParts, grpc: GrpcParts) -> anyhow::Result<()> {
        let Some(runtime) = &self.runtime else { return Ok(()) };
        let (scrape, browser) = (http.scrape.clone(), Arc::clone(&http.browser));
        let gate = Arc::clone(&grpc.gate);
        let routes = net::grpc_routes(grpc, self.shutdown.subscribe());
        let routes = runtime.block_on(routes).context("cannot set up the services")?;
        for Served { door, as_what } in self.doors.drain(..) {
            let (routes, stopped) = (routes.clone(), self.shutdown.subscribe());
            let http = http.clone();
            self.serving.push(runtime.spawn(async move {
                match as_what {
                    As::Grpc => net::serve_grpc(door, routes, stopped).await,
                    As::Http(reach) => net::serve_http(door, reach, http, routes, stopped).await,
                }
            }));
        }
        runtime.spawn(every(UPKEEP, move || {
            scrape.upkeep();
            browser.renew();
        }));
        runtime.spawn(every(LOOK, move || {
            let gate = Arc::clone(&gate);
            // A disk may take its time.
            drop(tokio::task::spawn_blocking(move || gate.refresh(now_ns())));
        }));
        Ok(())
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

async fn every(period: Duration, work: impl Fn() + Send + 'static) {
    let mut interval = tokio::time::interval(period);
    loop {
        interval.tick().await;
        work();
    }
}

/// Whether something came to its end in time.
async fn ended<T>(work: impl Future<Output = T>, until: Instant) -> bool {
    tokio::time::timeout_at(until.into(), work).await.is_ok()
}
