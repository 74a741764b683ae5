//! One device as the services see it: its description, its mode, its scene, its last report.
//!
//! The only way from configuration to the real-time thread: whoever wants something of a
//! running device comes through here, one at a time. A scene edit is made on a copy, checked,
//! written to disk, put in force at a tick's edge, and only then true; if the device does not
//! take it, the disk is put back. Blocking calls, milliseconds; never from the stream thread.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use std::time::{Duration, Instant};

use crate::clock::now_ns;
use crate::config::{DeviceDefinition, Scene, SceneError, SceneFile, StateError, build_plan};
use crate::control::{
    ControlCommand, ControlReply, ControlState, Mode, ModeCommand, ModeRefusal, Plan, Report,
};
use crate::link::SupervisorEnd;
use crate::recording::{Message, plan_entry, snapshot_entry};
use crate::telemetry::LatestReport;

/// A command waits this long for the loop; at 1 kHz it takes a millisecond.
const PATIENCE: Duration = Duration::from_millis(1000);

/// Pause between two looks at the reply ring.
const PAUSE: Duration = Duration::from_micros(200);

/// A loop whose newest report is older than this does not turn.
const DEAD_AFTER: Duration = Duration::from_millis(500);

/// The supervisor's end of the bridges.
pub type Supervisor = SupervisorEnd<(u64, ControlCommand), (u64, ControlReply)>;

/// Why something was not done.
#[derive(Debug, thiserror::Error)]
pub enum HostError {
    /// The mode does not allow it.
    #[error(transparent)]
    Mode(#[from] ModeRefusal),
    /// The scene does not allow it.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// It could not be kept.
    #[error(transparent)]
    State(#[from] StateError),
    /// The real-time thread has not taken what was asked of it before.
    #[error("the device's loop is busy with earlier commands; nothing was changed")]
    Busy,
    /// The real-time thread does not answer.
    #[error("the device's loop did not answer within {} ms; a mode change may still take effect", PATIENCE.as_millis())]
    Unresponsive,
}

/// One device.
#[derive(Debug)]
pub struct DeviceHost {
    definition: DeviceDefinition,
    /// With the number of the last command.
    supervisor: Mutex<(u64, Supervisor)>,
    scene: Mutex<KeptScene>,
    /// The scene in force, for readers: an edit holds `scene` while it waits for disk and loop.
    in_force: Mutex<Arc<Scene>>,
    latest: LatestReport,
    recorder: mpsc::Sender<Message>,
    /// Generation of the last plan made.
    generation: AtomicU64,
    /// When the last reply of the loop was seen.
    acknowledged_ns: AtomicU64,
}

#[derive(Debug)]
struct KeptScene {
    scene: Scene,
    file: SceneFile,
}

impl DeviceHost {
    /// A running device with the scene that it runs with, in a plan of the first generation.
    pub fn new(
        definition: DeviceDefinition,
        supervisor: Supervisor,
        scene: Scene,
        file: SceneFile,
        latest: LatestReport,
        recorder: mpsc::Sender<Message>,
    ) -> Self {
        let in_force = Mutex::new(Arc::new(scene.clone()));
        let scene = Mutex::new(KeptScene { scene, file });
        let supervisor = Mutex::new((0, supervisor));
        let acknowledged_ns = AtomicU64::new(0);
        let generation = AtomicU64::new(0);
        let host = Self {
            definition,
            supervisor,
            scene,
            in_force,
            latest,
            recorder,
            generation,
            acknowledged_ns,
        };
        host.next_plan(&host.scene());
        host
    }

    /// The next plan for the device, which the recorder is told of before it can be in force.
    fn next_plan(&self, scene: &Scene) -> Box<Plan> {
        let mut plan = Box::new(build_plan(&self.definition, scene));
        plan.generation = self.generation.fetch_add(1, Ordering::Relaxed) + 1;
        let entry = plan_entry(&plan, &self.definition, scene).into();
        self.tell_recorder(Message::Plan { generation: plan.generation, entry });
        plan
    }

    /// Tells the recorder; one that has ended records no more.
    pub fn tell_recorder(&self, message: Message) {
        let _ = self.recorder.send(message);
    }

    /// Has the loop copy its state for the recorder: from there on a recording can be replayed.
    pub fn snapshot(&self) -> Result<(), HostError> {
        // One that has just begun is waited for here, where nobody else is kept waiting.
        let deadline = Instant::now() + PATIENCE;
        while !self.is_alive() {
            if Instant::now() > deadline {
                return Err(HostError::Unresponsive);
            }
            std::thread::sleep(PAUSE);
        }
        let copy = Box::new(ControlState::new(Mode::Disabled));
        if let ControlReply::Snapshot(state) = self.execute(ControlCommand::Snapshot(copy), None)? {
            let (after_tick, entry) = (state.ticks(), snapshot_entry(&state));
            self.tell_recorder(Message::Snapshot { after_tick, entry });
        }
        Ok(())
    }

    /// What the device is.
    pub fn definition(&self) -> &DeviceDefinition {
        &self.definition
    }

    /// What the last tick sensed and decided.
    pub fn report(&self) -> Report {
        self.latest.get()
    }

    /// True of a report whose tick began after all that was acknowledged. Reports pass
    /// through the telemetry thread and come some milliseconds later than a reply.
    pub fn is_current(&self, report: &Report) -> bool {
        report.time_ns > self.acknowledged_ns.load(Ordering::Acquire)
    }

    /// True while the loop turns.
    pub fn is_alive(&self) -> bool {
        let age_ns = now_ns().saturating_sub(self.report().time_ns);
        Duration::from_nanos(age_ns) < DEAD_AFTER
    }

    /// Changes the mode; returns the mode then.
    pub fn change_mode(&self, command: ModeCommand) -> Result<Mode, HostError> {
        match self.execute(ControlCommand::Mode(command), None)? {
            ControlReply::Mode(answer) => Ok(answer?),
            ControlReply::Retired(_) | ControlReply::Snapshot(_) => Err(HostError::Unresponsive),
        }
    }

    /// The resident scene in force. Waits for no edit.
    pub fn scene(&self) -> Arc<Scene> {
        Arc::clone(&lock(&self.in_force))
    }

    /// Edits the scene; returns what `edit` returned and the scene then.
    pub fn edit_scene<T>(
        &self,
        edit: impl FnOnce(&mut Scene) -> Result<T, SceneError>,
    ) -> Result<(T, Arc<Scene>), HostError> {
        let mut kept = lock(&self.scene);
        let mut next = kept.scene.clone();
        let result = edit(&mut next)?;
        if let Err(error) = kept.file.save(&next) {
            // It may have been put in place before it failed; what was acknowledged stays.
            let KeptScene { scene, file } = &mut *kept;
            let _ = file.save(scene);
            return Err(error.into());
        }
        let swap = |scene| ControlCommand::SwapPlan(self.next_plan(scene));
        let (edit, undo) = (swap(&next), swap(&kept.scene));
        if let Err(error) = self.execute(edit, Some(undo)) {
            let KeptScene { scene, file } = &mut *kept;
            file.save(scene)?;
            return Err(error);
        }
        kept.scene = next.clone();
        let next = Arc::new(next);
        *lock(&self.in_force) = Arc::clone(&next);
        Ok((result, next))
    }

    /// Sends one command and waits for its reply. Where none comes, `undo` follows it, should
    /// the loop come back and find both waiting.
    fn execute(
        &self,
        command: ControlCommand,
        undo: Option<ControlCommand>,
    ) -> Result<ControlReply, HostError> {
        let mut supervisor = lock(&self.supervisor);
        let (last, ends) = &mut *supervisor;
        // Replies that nobody waited for keep the loop from taking more commands.
        while ends.replies.pop().is_ok() {}
        // An edit needs room for its undoing, and leaves some for a Stop, as does a snapshot.
        let waits = undo.is_some() || matches!(command, ControlCommand::Snapshot(_));
        let needed = if waits { 3 } else { 1 };
        if ends.commands.slots() < needed {
            return Err(HostError::Busy);
        }
        *last += 1;
        ends.commands.push((*last, command)).map_err(|_| HostError::Busy)?;
        let deadline = Instant::now() + PATIENCE;
        loop {
            match ends.replies.pop() {
                Ok((number, reply)) if number == *last => {
                    self.acknowledged_ns.fetch_max(now_ns(), Ordering::Release);
                    return Ok(reply);
                }
                // Nobody waited for that one any more.
                Ok(_) => continue,
                Err(_) => {}
            }
            if Instant::now() > deadline {
                // There is room: it was seen above, and nobody else holds this end.
                undo.map(|undo| ends.commands.push((0, undo)));
                return Err(HostError::Unresponsive);
            }
            std::thread::sleep(PAUSE);
        }
    }
}

/// A panic elsewhere leaves whole values behind: every change here is one assignment.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
