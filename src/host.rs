//! The devices as the services see them: description, mode, settings, scene, last report.
//!
//! The only way from configuration to the real-time thread: whoever wants something of a
//! running device comes through here, one at a time. A scene edit is made on a copy, checked,
//! written to disk, put in force at a tick's edge, and only then true; if the device does not
//! take it, the disk is put back. Blocking calls, milliseconds; never from the stream thread.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use std::time::{Duration, Instant};

use crate::clock::now_ns;
use crate::config::{
    DeviceDefinition, Scene, SceneError, SceneFile, Settings, SettingsError, StateError, plan_with,
};
use crate::control::{
    ControlCommand, ControlReply, ControlState, HomeRefusal, Mode, ModeCommand, ModeRefusal, Plan,
    Report,
};
use crate::link::SupervisorEnd;
use crate::recording::{Message, plan_entry, snapshot_entry};
use crate::telemetry::{EventHistory, LatestReport};
use crate::units::FieldError;

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
    /// The device cannot be homed now, or need not be.
    #[error(transparent)]
    Home(#[from] HomeRefusal),
    /// The scene does not allow it.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The settings do not allow it.
    #[error(transparent)]
    Settings(#[from] SettingsError),
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
    kept: Mutex<Kept>,
    /// The scene in force, for readers: an edit holds `kept` while it waits for disk and loop.
    in_force: Mutex<Arc<Scene>>,
    /// The settings, for readers.
    settings: Mutex<SettingsInForce>,
    latest: LatestReport,
    recorder: mpsc::Sender<Message>,
    /// A person pulls its simulated handle, where mount and tool of the device file say.
    has_pointer: bool,
    /// Generation of the last plan made.
    generation: AtomicU64,
    /// When the last reply of the loop was seen.
    acknowledged_ns: AtomicU64,
}

/// What a plan is made of besides the device.
#[derive(Debug)]
struct Kept {
    scene: Scene,
    file: SceneFile,
    settings: SettingsInForce,
}

/// Settings with the number of their last change.
#[derive(Clone, Copy, Debug)]
pub struct SettingsInForce {
    /// What they are.
    pub settings: Settings,
    /// Grows by one with every change, from 1.
    pub revision: u64,
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
        let settings = SettingsInForce { settings: Settings::of(&definition), revision: 1 };
        let kept = Mutex::new(Kept { scene, file, settings });
        let settings = Mutex::new(settings);
        let supervisor = Mutex::new((0, supervisor));
        let acknowledged_ns = AtomicU64::new(0);
        let generation = AtomicU64::new(0);
        let host = Self {
            definition,
            supervisor,
            kept,
            in_force,
            settings,
            latest,
            recorder,
            has_pointer: false,
            generation,
            acknowledged_ns,
        };
        host.next_plan(&host.settings().settings, &host.scene());
        host
    }

    /// The next plan for the device, which the recorder is told of before it can be in force.
    fn next_plan(&self, settings: &Settings, scene: &Scene) -> Box<Plan> {
        let mut plan = Box::new(plan_with(&self.definition, settings, scene));
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

    /// The same device with a hand that a person moves: its mount and tool offset stay.
    #[must_use]
    pub fn with_pointer(self) -> Self {
        Self { has_pointer: true, ..self }
    }

    /// Whether a person pulls its handle.
    pub fn has_pointer(&self) -> bool {
        self.has_pointer
    }

    /// What the device is.
    pub fn definition(&self) -> &DeviceDefinition {
        &self.definition
    }

    /// What the last tick sensed and decided.
    pub fn report(&self) -> Report {
        self.latest.get()
    }

    /// What happened lately.
    pub fn events(&self) -> &EventHistory {
        self.latest.events()
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
            _ => Err(HostError::Unresponsive),
        }
    }

    /// The handle is at its home place now.
    pub fn home(&self) -> Result<(), HostError> {
        match self.execute(ControlCommand::Home, None)? {
            ControlReply::Home(answer) => Ok(answer?),
            _ => Err(HostError::Unresponsive),
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
        let mut kept = lock(&self.kept);
        let mut next = kept.scene.clone();
        let result = edit(&mut next)?;
        let tool = &kept.settings.settings.tool;
        self.definition.check_scene(&next, tool).map_err(SceneError::from)?;
        if let Err(error) = kept.file.save(&next) {
            // It may have been put in place before it failed; what was acknowledged stays.
            let Kept { scene, file, .. } = &mut *kept;
            let _ = file.save(scene);
            return Err(error.into());
        }
        let swap = |scene| self.swap(&kept.settings.settings, scene);
        let (edit, undo) = (swap(&next), swap(&kept.scene));
        if let Err(error) = self.execute(edit, Some(undo)) {
            let Kept { scene, file, .. } = &mut *kept;
            file.save(scene)?;
            return Err(error);
        }
        kept.scene = next.clone();
        let next = Arc::new(next);
        *lock(&self.in_force) = Arc::clone(&next);
        Ok((result, next))
    }

    /// The settings in force. Waits for no edit.
    pub fn settings(&self) -> SettingsInForce {
        *lock(&self.settings)
    }

    /// Changes the settings as `edit` does, if they still have this revision (0: whatever they
    /// have); returns those then. Not kept on disk.
    pub fn edit_settings(
        &self,
        revision: u64,
        edit: impl FnOnce(&mut Settings) -> Result<(), FieldError>,
    ) -> Result<SettingsInForce, HostError> {
        let mut kept = lock(&self.kept);
        let SettingsInForce { settings: before, revision: actual } = kept.settings;
        if revision != 0 && revision != actual {
            return Err(SettingsError::StaleRevision { expected: revision, actual }.into());
        }
        let mut settings = before;
        edit(&mut settings).map_err(SettingsError::from)?;
        if settings.tool != before.tool {
            let checked = self.definition.check_scene(&kept.scene, &settings.tool);
            checked.map_err(|error| SettingsError::from(error.within("settings.tool: scene")))?;
        }
        let swap = |settings| self.swap(settings, &kept.scene);
        self.execute(swap(&settings), Some(swap(&before)))?;
        kept.settings = SettingsInForce { settings, revision: actual + 1 };
        *lock(&self.settings) = kept.settings;
        Ok(kept.settings)
    }

    fn swap(&self, settings: &Settings, scene: &Scene) -> ControlCommand {
        ControlCommand::SwapPlan(self.next_plan(settings, scene))
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
        // Whatever it is leaves room for a Stop; an edit needs some for its undoing, too.
        let needed = match (&command, &undo) {
            (ControlCommand::Mode(ModeCommand::Stop), _) => 1,
            (_, None) => 2,
            (_, Some(_)) => 3,
        };
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

/// The devices of a server; cheap to clone.
#[derive(Clone, Debug)]
pub struct Hosts(Arc<[Arc<DeviceHost>]>);

impl Hosts {
    /// These devices, each of a name of its own.
    pub fn new(hosts: Vec<Arc<DeviceHost>>) -> Self {
        Self(hosts.into())
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = &Arc<DeviceHost>> {
        self.0.iter()
    }
}

/// A panic elsewhere leaves whole values behind: every change here is one assignment.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::StateDir;
    use crate::control::{Record, Setpoint};
    use crate::link::bridge;

    #[test]
    fn whatever_waits_for_a_loop_that_hangs_there_is_a_place_for_stop() {
        let state = tempfile::tempdir().unwrap();
        let definition = DeviceDefinition::load("two-link").unwrap();
        let state = StateDir::open(state.path()).unwrap();
        let (file, scene) = state.scene(&definition.name).unwrap();
        let (_loop, _stream, _records, supervisor) =
            bridge::<Setpoint, Report, Record, _, _>(&Setpoint::NONE);
        let (recorder, _messages) = mpsc::channel();
        let latest = LatestReport::default();
        let host = DeviceHost::new(definition, supervisor, scene, file, latest, recorder);
        let asked = [ModeCommand::Enable, ModeCommand::Disable, ModeCommand::Enable];
        for command in asked {
            assert!(matches!(host.change_mode(command), Err(HostError::Unresponsive)));
        }
        assert!(matches!(host.change_mode(ModeCommand::Disable), Err(HostError::Busy)));
        assert!(matches!(host.home(), Err(HostError::Busy)));
        // It is on its way, and comes into force when the loop goes on.
        assert!(matches!(host.change_mode(ModeCommand::Stop), Err(HostError::Unresponsive)));
    }
}
