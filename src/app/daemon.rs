//! A running daemon: one device, its threads, its sockets.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::JoinHandle;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use anyhow::Context;
use rustix::event::{EventfdFlags, eventfd};

use super::reachable;
use super::services::Services;
use super::sockets::Sockets;
use crate::archive::{Archive, Keeper};
use crate::client::ConnectString;
use crate::clock::now_ns;
use crate::config::{
    DeviceDefinition, RealtimePolicy, Scene, SceneFile, ServerConfig, StateDir, build_plan,
    default_state_dir,
};
use crate::control::{ControlState, Mode, Setpoint};
use crate::device::{HandProgram, Pointer, PointerInput, SimulatedDevice};
use crate::host::DeviceHost;
use crate::link::bridge;
use crate::net::{self, Identity, StreamHandle, StreamParts};
use crate::recording::Recorder;
use crate::rt::{self, Cycle, Realtime, Right, RtConfig, RtHandle};
use crate::session::SessionConfig;
use crate::telemetry::{
    self, DeviceMetrics, LatestReport, RoundTrips, RunFigures, RunSummary, Telemetry,
};

/// Seed of the simulated hand and noise: a run is as repeatable as its timing.
const SEED: u64 = 1;

/// SCHED_FIFO priority of the stream thread, or just below the loop's where that is lower.
const STREAM_PRIORITY: u8 = 40;

/// Setpoints that may wait for the recorder, which looks every few milliseconds.
const RECORDED_SETPOINTS: usize = 256;

/// How a daemon is started, beside its configuration.
#[derive(Clone, Copy, Debug, Default)]
pub struct Start {
    /// Replace ports in use by free ones.
    pub or_free_ports: bool,
}

/// A running daemon.
#[derive(Debug)]
pub struct Daemon {
    stream: StreamHandle,
    services: Services,
    rt: RtHandle,
    feed: Feed,
    keeper: Keeper,
    // Waits for recordings under way when it goes, so it goes after the recorder.
    _archive: Arc<Archive>,
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
        let ready = Ready::new(config, start)?;
        let Ready { definition, state_dir, scene, scene_file, device, archive, .. } = ready;
        let sha256 = ready.identity.sha256();
        let grpc_address = ready.sockets.grpc.local_addr()?;
        let http_address = ready.sockets.http.local_addr()?;
        let mut services = Services::prepare(ready.sockets.grpc, ready.sockets.http)?;

        let telemetry = Telemetry::new()?;
        let rights = telemetry.device(definition.name.as_str());
        let metrics = telemetry.device(definition.name.as_str());
        let (rt_end, stream_end, records, supervisor) = bridge(&Setpoint::NONE);
        let doorbell = eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?;
        let round_trips = RoundTrips::default();
        let (setpoints, recorded_setpoints) = rtrb::RingBuffer::new(RECORDED_SETPOINTS);
        let (to_recorder, inbox) = mpsc::channel();
        let (to_keeper, frozen) = mpsc::channel();
        let keep_ns = (config.black_box_s * 1e9) as u64;
        let recorder = Recorder::new(recorded_setpoints, inbox, to_keeper, keep_ns);
        let stream = net::spawn_stream(StreamParts {
            socket: ready.sockets.stream,
            identity: ready.identity,
            sessions: session_config(config, &definition, grpc_address.port()),
            link: stream_end,
            setpoints,
            pointer: ready.pointer,
            doorbell: doorbell.try_clone()?,
            metrics: telemetry.stream(),
            round_trips: round_trips.clone(),
            on_start: raise_stream(config.rt_priority),
        })?;

        let plan = Box::new(build_plan(&definition, &scene));
        // A simulated device harms nobody and is enabled at once.
        let cycle = Cycle::new(device, ControlState::new(Mode::Enabled), plan, rt_end);
        let feed = Feed::start(records, metrics, recorder, definition.tick_ns)?;
        let rt = rt::spawn(cycle, rt_config(config), doorbell)?;
        tell_rights(&rt, &rights);
        let connect = ConnectString {
            host: reachable::address(stream.address.ip()).to_string(),
            stream_port: stream.address.port(),
            grpc_port: grpc_address.port(),
            sha256: Some(sha256),
            token: None,
        };
        let latest = feed.latest.clone();
        let host = DeviceHost::new(definition, supervisor, scene, scene_file, latest, to_recorder);
        let host = Arc::new(host);
        let (keeps, under_way) = (keep_ns > 0, archive.under_way());
        let keeper = Keeper::start(Arc::clone(&host), frozen, state_dir.path(), keeps, under_way)?;
        services.serve(telemetry.scrape(), &host, &archive);
        Ok(Self {
            stream,
            services,
            rt,
            feed,
            keeper,
            _archive: archive,
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
        let summary = self.feed.summary.lock().unwrap_or_else(PoisonError::into_inner).clone();
        summary.figures(&self.round_trips)
    }

    /// The figures since the start or since this was last called, which then begin anew: a
    /// measurement can leave out what came before it.
    pub fn take_figures(&self) -> RunFigures {
        let summary = self.feed.summary.lock().unwrap_or_else(PoisonError::into_inner).take();
        let figures = summary.figures(&self.round_trips);
        self.round_trips.clear();
        figures
    }

    /// Waits for Ctrl-C or SIGTERM, at most until `until`; true when one has come. One that
    /// came since the start counts.
    pub fn wait_for_signal(&mut self, until: Option<Instant>) -> bool {
        self.services.wait_for_signal(until)
    }

    /// Stops in order: clients are told, calls under way are answered, the device is let go,
    /// and everything it did is in the figures. Returns those of the whole run.
    pub fn stop(mut self) -> RunFigures {
        self.stop_parts();
        self.figures()
    }

    fn stop_parts(&mut self) {
        self.services.close();
        self.stream.stop();
        self.services.stop();
        self.rt.stop();
        self.feed.stop();
        self.keeper.join();
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        self.stop_parts();
    }
}

/// What is read, made and bound before any thread starts; what is wrong with any of it is
/// said here.
struct Ready {
    definition: DeviceDefinition,
    state_dir: StateDir,
    scene: Scene,
    scene_file: SceneFile,
    identity: Identity,
    device: SimulatedDevice,
    pointer: Option<PointerInput>,
    sockets: Sockets,
    archive: Arc<Archive>,
}

impl Ready {
    fn new(config: &ServerConfig, start: Start) -> anyhow::Result<Self> {
        let definition = DeviceDefinition::load(&config.device)?;
        let state_dir = StateDir::open(state_path(config)?)?;
        let (scene_file, scene) = state_dir.scene(&definition.name)?;
        let identity = Identity::load_or_create(state_dir.path())?;
        let mut device = SimulatedDevice::new(definition.simulation(config.hand), SEED)
            .with_context(|| format!("device {}", definition.name))?;
        let pointer = (config.hand == HandProgram::Pointer).then(|| {
            let (p_WB_m, q_WB) = (definition.mount.p_WB_m, definition.mount.q_WB);
            let (pointer, input) = Pointer::new(p_WB_m, q_WB, definition.tool.offset_B_m);
            device.follow(pointer);
            input
        });
        let sockets = Sockets::bind(config, start.or_free_ports)?;
        let archive = Arc::new(Archive::open(state_dir.path())?);
        Ok(Self {
            definition,
            state_dir,
            scene,
            scene_file,
            identity,
            device,
            pointer,
            sockets,
            archive,
        })
    }
}

/// The telemetry thread and what it fills.
#[derive(Debug)]
struct Feed {
    latest: LatestReport,
    summary: Arc<Mutex<RunSummary>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Feed {
    fn start(
        records: rtrb::Consumer<crate::control::Record>,
        metrics: DeviceMetrics,
        recorder: Recorder,
        tick_ns: u64,
    ) -> anyhow::Result<Self> {
        let latest = LatestReport::default();
        let summary = Arc::new(Mutex::new(RunSummary::new(tick_ns)));
        let stop = Arc::new(AtomicBool::new(false));
        let observed = Some(Arc::clone(&summary));
        let thread = telemetry::spawn(
            records,
            metrics,
            latest.clone(),
            observed,
            Some(recorder),
            Arc::clone(&stop),
        )?;
        Ok(Self { latest, summary, stop, thread: Some(thread) })
    }

    /// Ends with everything taken in that was there.
    fn stop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            // Its panic, if any, has been printed; the figures so far are still good.
            let _ = thread.join();
        }
    }
}

/// Says which real-time rights were denied, in the log and in the metrics.
fn tell_rights(rt: &RtHandle, metrics: &DeviceMetrics) {
    for right in Right::ALL {
        metrics.realtime_granted(right, !rt.denied().iter().any(|(denied, _)| *denied == right));
    }
    for (right, why) in rt.denied() {
        tracing::warn!(right = right.name(), why, "real-time right denied, going on without");
    }
}

/// A force waits for the stream thread too. Always below the loop, above everything ordinary;
/// denied, it goes on as it is: the loop is denied the same and says so.
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
        takes_hands: config.hand == HandProgram::Pointer,
        default_ttl_ms: config.session.default_ttl_ms,
        default_wrench_ttl_ms: config.session.default_wrench_ttl_ms,
        max_age_ms: config.session.max_age_ms,
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
