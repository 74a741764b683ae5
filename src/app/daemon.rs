//! A running daemon: one device, its threads, its sockets.

use std::net::SocketAddr;
use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::{Context, bail};
use rustix::event::{EventfdFlags, eventfd};
use tokio::runtime::Runtime;
use tokio::sync::watch;

use super::Signals;
use super::sockets::Sockets;
use crate::client::ConnectString;
use crate::clock::now_ns;
use crate::config::{
    DeviceDefinition, RealtimePolicy, ServerConfig, StateDir, build_plan, default_state_dir,
};
use crate::control::{ControlState, Mode};
use crate::device::SimulatedDevice;
use crate::host::DeviceHost;
use crate::link::bridge;
use crate::net::{self, Identity, StreamHandle, StreamParts};
use crate::rt::{self, Cycle, Realtime, Right, RtConfig, RtHandle};
use crate::session::SessionConfig;
use crate::telemetry::{self, LatestReport, RoundTrips, RunFigures, RunSummary, Telemetry};

/// Seed of the simulated hand and noise: a run is as repeatable as its timing.
const SEED: u64 = 1;

/// SCHED_FIFO priority of the stream thread, or just below the loop's where that is lower.
const STREAM_PRIORITY: u8 = 40;

/// Time for open calls to end when the daemon stops.
const FAREWELL: Duration = Duration::from_millis(500);

/// Between two upkeeps of the metrics.
const UPKEEP: Duration = Duration::from_secs(2);

/// How a daemon is started, beside its configuration.
#[derive(Clone, Copy, Debug, Default)]
pub struct Start {
    /// Replace ports in use by free ones.
    pub or_free_ports: bool,
}

/// A running daemon.
#[derive(Debug)]
pub struct Daemon {
    // In the order in which they stop.
    rt: RtHandle,
    stream: StreamHandle,
    services: Option<Runtime>,
    signals: Signals,
    shutdown: watch::Sender<bool>,
    feed: Option<JoinHandle<()>>,
    feed_stop: Arc<AtomicBool>,
    summary: Arc<Mutex<RunSummary>>,
    round_trips: RoundTrips,
    host: Arc<DeviceHost>,
    connect: ConnectString,
    /// Where `/metrics` is.
    pub http_address: SocketAddr,
    /// Where the services are.
    pub grpc_address: SocketAddr,
    // Keeps the state directory locked.
    _state_dir: StateDir,
}

impl Daemon {
    /// Starts everything.
    pub fn start(config: &ServerConfig, start: Start) -> anyhow::Result<Self> {
        let definition = DeviceDefinition::load(&config.device)?;
        let state_dir = StateDir::open(state_path(config)?)?;
        let (scene_file, scene) = state_dir.scene(&definition.name)?;
        let identity = Identity::load_or_create(state_dir.path())?;
        let sha256 = identity.sha256();
        let sockets = Sockets::bind(config, start.or_free_ports)?;
        let grpc_address = sockets.grpc.local_addr()?;
        let http_address = sockets.http.local_addr()?;

        let telemetry = Telemetry::new()?;
        let metrics = telemetry.device(definition.name.as_str());
        let summary = Arc::new(Mutex::new(RunSummary::new(definition.tick_ns)));
        let (rt_end, stream_end, records, supervisor) = bridge(&crate::control::Setpoint::NONE);
        let latest = LatestReport::default();

        let device = SimulatedDevice::new(definition.simulation(config.hand), SEED)
            .with_context(|| format!("device {}", definition.name))?;
        let plan = Box::new(build_plan(&definition, &scene));
        // A simulated device harms nobody and is enabled at once.
        let cycle = Cycle::new(device, ControlState::new(Mode::Enabled), plan, rt_end);
        let doorbell = eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?;
        let doorbell_rt: OwnedFd = doorbell.try_clone()?;
        let rt = rt::spawn(cycle, rt_config(config), doorbell_rt)?;
        for right in Right::ALL {
            metrics
                .realtime_granted(right, !rt.denied().iter().any(|(denied, _)| *denied == right));
        }
        for (right, why) in rt.denied() {
            tracing::warn!(right = right.name(), why, "real-time right denied, going on without");
        }

        let round_trips = RoundTrips::default();
        let feed_stop = Arc::new(AtomicBool::new(false));
        let feed = telemetry::spawn(
            records,
            metrics,
            latest.clone(),
            Some(Arc::clone(&summary)),
            Arc::clone(&feed_stop),
        )?;
        let stream = net::spawn_stream(StreamParts {
            socket: sockets.stream,
            identity,
            sessions: session_config(config, &definition, grpc_address.port()),
            link: stream_end,
            doorbell,
            metrics: telemetry.stream(),
            round_trips: round_trips.clone(),
            on_start: raise_stream(config.rt_priority),
        })?;
        let host = DeviceHost::new(definition, supervisor, scene, scene_file, latest);
        let host = Arc::new(host);
        let connect = ConnectString {
            host: stream.address.ip().to_string(),
            stream_port: stream.address.port(),
            grpc_port: grpc_address.port(),
            sha256: Some(sha256),
            token: None,
        };
        let (shutdown, stopped) = watch::channel(false);
        let services =
            Services { grpc: sockets.grpc, http: sockets.http, telemetry: &telemetry, stopped };
        let services = services.start(&host)?;
        let signals = {
            let _inside = services.enter();
            Signals::register()?
        };
        Ok(Self {
            rt,
            stream,
            services: Some(services),
            signals,
            shutdown,
            feed: Some(feed),
            feed_stop,
            summary,
            round_trips,
            host,
            connect,
            http_address,
            grpc_address,
            _state_dir: state_dir,
        })
    }

    /// How clients reach it.
    pub fn connect_string(&self) -> &ConnectString {
        &self.connect
    }

    /// Its device.
    pub fn host(&self) -> &Arc<DeviceHost> {
        &self.host
    }

    /// The figures of the run so far.
    pub fn figures(&self) -> RunFigures {
        let summary = self.summary.lock().unwrap_or_else(PoisonError::into_inner).clone();
        summary.figures(&self.round_trips)
    }

    /// Waits for Ctrl-C or SIGTERM; one that came since the start counts.
    pub fn wait_for_signal(&mut self) -> anyhow::Result<()> {
        let Some(services) = &self.services else { bail!("the daemon is stopped") };
        services.block_on(self.signals.received());
        Ok(())
    }

    /// Stops in order: clients are told, the device is let go, everything written is kept.
    /// Returns the figures of the whole run.
    pub fn stop(mut self) -> RunFigures {
        self.stop_parts();
        self.figures()
    }

    fn stop_parts(&mut self) {
        self.stream.stop();
        self.rt.stop();
        let _ = self.shutdown.send(true);
        if let Some(services) = self.services.take() {
            services.shutdown_timeout(FAREWELL);
        }
        self.feed_stop.store(true, Ordering::Release);
        if let Some(feed) = self.feed.take() {
            // Its panic, if any, has been printed; the figures so far are still good.
            let _ = feed.join();
        }
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        self.stop_parts();
    }
}

/// A force waits for the stream thread too. Always below the loop, above everything ordinary;
/// denied, it goes on as it is: the loop has said so already.
fn raise_stream(rt_priority: u8) -> Box<dyn Fn() + Send> {
    let priority = STREAM_PRIORITY.min(rt_priority.saturating_sub(1));
    Box::new(move || {
        if priority > 0 {
            let _ = rt::fifo(priority);
        }
    })
}

fn state_path(config: &ServerConfig) -> anyhow::Result<PathBuf> {
    let default = || default_state_dir(|name| std::env::var_os(name));
    config.state_dir.clone().or_else(default).context(
        "state_dir is not set (--state-dir), and neither XDG_STATE_HOME nor HOME is: say where state may be kept",
    )
}

fn rt_config(config: &ServerConfig) -> RtConfig {
    let realtime = match config.realtime {
        RealtimePolicy::BestEffort => Realtime::BestEffort,
        RealtimePolicy::Enforce => Realtime::Enforce,
    };
    RtConfig { realtime, priority: config.rt_priority, cpu: config.rt_cpu }
}

fn session_config(
    config: &ServerConfig,
    device: &DeviceDefinition,
    grpc_port: u16,
) -> SessionConfig {
    let mechanism = &device.mechanism;
    let utc_ns = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos());
    SessionConfig {
        max_sessions: config.session.max_sessions,
        default_ttl_ms: config.session.default_ttl_ms,
        max_ttl_ms: config.session.max_ttl_ms,
        grpc_port,
        utc_minus_device_ns: (utc_ns as i64).wrapping_sub(now_ns() as i64),
        ..SessionConfig::new(
            device.name.as_str(),
            device.tick_ns,
            mechanism.freedoms() as u32,
            mechanism.actuators() as u32,
        )
    }
}

/// What the service runtime serves.
struct Services<'a> {
    grpc: std::net::TcpListener,
    http: std::net::TcpListener,
    telemetry: &'a Telemetry,
    stopped: watch::Receiver<bool>,
}

impl Services<'_> {
    fn start(self, host: &Arc<DeviceHost>) -> anyhow::Result<Runtime> {
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("hapticd-services")
            .enable_all()
            .build()?;
        let _inside = runtime.enter();
        let grpc = tokio::net::TcpListener::from_std(self.grpc)?;
        let http = tokio::net::TcpListener::from_std(self.http)?;
        let until = |mut stopped: watch::Receiver<bool>| async move {
            // The sender gone means the same.
            let _ = stopped.wait_for(|stopped| *stopped).await;
        };
        let scrape = self.telemetry.scrape();
        let serving = net::serve_grpc(grpc, Arc::clone(host), until(self.stopped.clone()));
        runtime.spawn(async move {
            if let Err(error) = serving.await {
                tracing::error!(%error, "the services stopped");
            }
        });
        let serving =
            net::serve_http(http, scrape.clone(), Arc::clone(host), until(self.stopped.clone()));
        runtime.spawn(async move {
            if let Err(error) = serving.await {
                tracing::error!(%error, "HTTP stopped");
            }
        });
        runtime.spawn(async move {
            let mut interval = tokio::time::interval(UPKEEP);
            loop {
                interval.tick().await;
                scrape.upkeep();
            }
        });
        Ok(runtime)
    }
}
