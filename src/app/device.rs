//! One running device: its loop, what telemetry makes of it, and the services' way to it.

use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::JoinHandle;

use anyhow::Context;
use nalgebra::Vector3;
use rustix::event::{EventfdFlags, eventfd};

use crate::archive::{Archive, Keeper};
use crate::config::{
    DemoWall, DeviceDefinition, Scene, SceneFile, ServedDevice, StateDir, build_plan,
};
use crate::control::{ControlState, Mode, Mount, Record, Setpoint};
use crate::device::{HandProgram, Pointer, PointerInput, SimulatedDevice};
use crate::host::DeviceHost;
use crate::link::bridge;
use crate::net::StreamDevice;
use crate::recording::{BlackBox, Recorder};
use crate::rt::{self, Cycle, Right, RtConfig, RtHandle};
use crate::session::{ExampleWall, SessionConfig};
use crate::telemetry::{
    self, DeviceMetrics, LatestReport, RoundTrips, RunFigures, RunSummary, Telemetry,
};

/// Seed of the simulated hand and noise: a run is as repeatable as its timing.
const SEED: u64 = 1;

/// Setpoints that may wait for the recorder, which looks every few milliseconds.
const RECORDED_SETPOINTS: usize = 256;

/// What a device needs before its loop starts: whatever is wrong with it is said by now.
pub(super) struct ReadyDevice {
    pub definition: DeviceDefinition,
    scene: Scene,
    scene_file: SceneFile,
    device: SimulatedDevice,
    pointer: Option<PointerInput>,
    /// Where `served.hand` looks for it.
    wall: DemoWall,
}

impl ReadyDevice {
    pub fn new(
        served: &ServedDevice,
        definition: DeviceDefinition,
        state_dir: &StateDir,
    ) -> anyhow::Result<Self> {
        let (scene_file, scene) = state_dir.scene(&definition.name)?;
        definition
            .check_scene(&scene, &definition.tool)
            .with_context(|| format!("the scene kept for device {}", definition.name))?;
        if definition.largest_stiffness_N_per_m() == 0.0 {
            tracing::warn!(
                device = definition.name.as_str(),
                "no wall can be felt: motors whose shafts damp nothing would feed every one; the device file says what they damp by damping_N_m_s_per_rad"
            );
        }
        let mut device = SimulatedDevice::new(definition.simulation(served.hand), SEED)
            .with_context(|| format!("device {}", definition.name))?;
        let pointer = (served.hand == HandProgram::Pointer).then(|| {
            let (p_WB_m, q_WB) = (definition.mount.p_WB_m, definition.mount.q_WB);
            let (pointer, input) = Pointer::new(p_WB_m, q_WB, definition.tool.offset_B_m);
            device.follow(pointer);
            input
        });
        let wall = definition.demo_wall(served.hand);
        Ok(Self { definition, scene, scene_file, device, pointer, wall })
    }

    /// What a client may try first: the wall of the experiment.
    pub fn example_wall(&self) -> ExampleWall {
        let Mount { p_WB_m, q_WB } = self.definition.mount;
        ExampleWall {
            point_W_m: p_WB_m + q_WB * Vector3::new(self.wall.x_m, 0.0, 0.0),
            normal_W: q_WB * -Vector3::x(),
            stiffness_N_per_m: self.wall.stiffness_N_per_m,
        }
    }

    /// Whether a session can pull its handle.
    pub fn takes_hands(&self) -> bool {
        self.pointer.is_some()
    }

    /// The bridges, and the stream's end of them.
    pub fn connect(
        self,
        sessions: SessionConfig,
        telemetry: &Telemetry,
        black_box_s: f64,
    ) -> anyhow::Result<(ConnectedDevice, StreamDevice)> {
        let takes_hands = self.takes_hands();
        let Self { definition, scene, scene_file, device, pointer, .. } = self;
        let name = definition.name.as_str();
        let (rights, metrics) = (telemetry.device(name), telemetry.device(name));
        let (rt_end, link, records, supervisor) = bridge(&Setpoint::NONE);
        let doorbell = eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?;
        let round_trips = RoundTrips::default();
        let (setpoints, recorded_setpoints) = rtrb::RingBuffer::new(RECORDED_SETPOINTS);
        let (to_recorder, inbox) = mpsc::channel();
        let (to_keeper, frozen) = mpsc::channel();
        let keep_ns = (black_box_s * 1e9) as u64;
        let recorder = Recorder::new(recorded_setpoints, inbox, to_keeper, keep_ns);
        let stream = StreamDevice {
            sessions,
            link,
            setpoints,
            pointer,
            doorbell: doorbell.try_clone()?,
            metrics: telemetry.stream(name),
            round_trips: round_trips.clone(),
        };
        let plan = Box::new(build_plan(&definition, &scene));
        // A simulated device harms nobody and is enabled at once, where its place is known.
        let mode = if definition.home_m.is_some() { Mode::Disabled } else { Mode::Enabled };
        let cycle = Cycle::new(device, ControlState::new(mode), plan, rt_end);
        let feed = Feed::prepare(definition.tick_ns);
        let latest = feed.latest.clone();
        let host = DeviceHost::new(definition, supervisor, scene, scene_file, latest, to_recorder);
        let host = if takes_hands { host.with_pointer() } else { host };
        let connected = ConnectedDevice {
            host: Arc::new(host),
            cycle,
            doorbell,
            feed,
            records,
            recorder,
            frozen,
            has_black_box: keep_ns > 0,
            metrics,
            rights,
            round_trips,
        };
        Ok((connected, stream))
    }
}

/// A device whose loop has everything but a thread.
pub(super) struct ConnectedDevice {
    host: Arc<DeviceHost>,
    cycle: Cycle<SimulatedDevice>,
    doorbell: OwnedFd,
    feed: Feed,
    records: rtrb::Consumer<Record>,
    recorder: Recorder,
    frozen: mpsc::Receiver<BlackBox>,
    has_black_box: bool,
    metrics: DeviceMetrics,
    rights: DeviceMetrics,
    round_trips: RoundTrips,
}

impl ConnectedDevice {
    /// Starts telemetry, then the loop, then the keeper of its black boxes.
    pub fn start(
        mut self,
        config: RtConfig,
        state_dir: &StateDir,
        archive: &Archive,
    ) -> anyhow::Result<RunningDevice> {
        self.feed.start(self.records, self.metrics, self.recorder)?;
        let rt = rt::spawn(self.cycle, config, self.doorbell)?;
        tell_rights(&self.host, &rt, &self.rights);
        let Self { host, feed, frozen, has_black_box, round_trips, .. } = self;
        let (path, under_way) = (state_dir.path(), archive.under_way());
        let keeper = Keeper::start(Arc::clone(&host), frozen, path, has_black_box, under_way)?;
        Ok(RunningDevice { host, rt, feed, keeper, round_trips })
    }
}

/// A device at work.
#[derive(Debug)]
pub struct RunningDevice {
    host: Arc<DeviceHost>,
    rt: RtHandle,
    feed: Feed,
    keeper: Keeper,
    round_trips: RoundTrips,
}

impl RunningDevice {
    /// The device as the services see it.
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

    /// Lets go of the device.
    pub(super) fn let_go(&mut self) {
        self.rt.stop();
    }

    /// Takes in what the loop has left behind: everything that the device did is in the figures
    /// then, and its black boxes on disk.
    pub(super) fn stop(&mut self) {
        self.let_go();
        self.feed.stop();
        self.keeper.join();
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
    fn prepare(tick_ns: u64) -> Self {
        Self {
            latest: LatestReport::default(),
            summary: Arc::new(Mutex::new(RunSummary::new(tick_ns))),
            stop: Arc::new(AtomicBool::new(false)),
            thread: None,
        }
    }

    fn start(
        &mut self,
        records: rtrb::Consumer<Record>,
        metrics: DeviceMetrics,
        recorder: Recorder,
    ) -> anyhow::Result<()> {
        let (latest, summary) = (self.latest.clone(), Arc::clone(&self.summary));
        let stop = Arc::clone(&self.stop);
        let thread =
            telemetry::spawn(records, metrics, latest, Some(summary), Some(recorder), stop)?;
        self.thread = Some(thread);
        Ok(())
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
fn tell_rights(host: &DeviceHost, rt: &RtHandle, metrics: &DeviceMetrics) {
    for right in Right::ALL {
        metrics.realtime_granted(right, !rt.denied().iter().any(|(denied, _)| *denied == right));
    }
    for (right, why) in rt.denied() {
        let device = host.definition().name.as_str();
        tracing::warn!(
            device,
            right = right.name(),
            why,
            "real-time right denied, going on without"
        );
    }
}
