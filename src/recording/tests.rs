//! A run in virtual time, recorded as a server does, read, replayed, broken and compared.

mod comparison;
mod fed;

use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel, sync_channel};

use nalgebra::Vector3;
use prost::Message as _;

use super::exact::framed;
use super::*;
use crate::actuation::Strategy;
use crate::config::{DeviceDefinition, Id, ObjectKind, Scene, SceneObject, build_plan};
use crate::control::{
    ControlCommand, ControlReply, ControlState, Inputs, Mode, ModeCommand, Obeyed, Plan, Record,
    Setpoint, TickInput, tick,
};
use crate::device::{Device, HandProgram, SimulatedDevice};
use crate::environment::{Contact, Material, Shape, Surface};
use crate::proto::RecordEntry;
use crate::proto::record_entry::Entry;

const MS: u64 = 1_000_000;

/// A loop with its recorder, both in this thread.
struct World {
    definition: DeviceDefinition,
    scene: Scene,
    device: SimulatedDevice,
    state: ControlState,
    plan: Box<Plan>,
    setpoint: Setpoint,
    setpoints: rtrb::Producer<Setpoint>,
    recorder: Recorder,
    tell: Sender<Message>,
    frozen: Receiver<BlackBox>,
    obeyed: [Option<Obeyed>; 2],
    /// Snapshots that the recorder is told of some ticks later.
    late: Vec<(u64, Message)>,
    now_ns: u64,
}

impl World {
    fn new(sensor: bool, keep_ns: u64) -> Self {
        Self::of("cho-2005", sensor, keep_ns)
    }

    fn of(device: &str, sensor: bool, keep_ns: u64) -> Self {
        let mut definition = DeviceDefinition::load(device).unwrap();
        if !sensor {
            definition.force_sensor = None;
        }
        let simulation = definition.simulation(HandProgram::default());
        let device = SimulatedDevice::new(simulation, 7).unwrap();
        let scene = Scene::default();
        let plan = Box::new(build_plan(&definition, &scene));
        let (setpoints, consumer) = rtrb::RingBuffer::new(8);
        let ((tell, inbox), (freeze, frozen)) = (channel(), channel());
        let world = Self {
            definition,
            scene,
            device,
            state: ControlState::new(Mode::Enabled),
            plan,
            setpoint: Setpoint::NONE,
            setpoints,
            recorder: Recorder::new(consumer, inbox, freeze, keep_ns),
            tell,
            frozen,
            obeyed: [None; 2],
            late: Vec::new(),
            now_ns: 0,
        };
        world.announce(&world.plan);
        world
    }

    fn announce(&self, plan: &Plan) {
        let entry = plan_entry(plan, &self.definition, &self.scene).into();
        self.tell.send(Message::Plan { generation: plan.generation, entry }).unwrap();
    }

    fn apply(&mut self, command: ControlCommand) -> ControlReply {
        let place = self.obeyed.iter_mut().find(|place| place.is_none()).unwrap();
        *place = Some(command.obeyed());
        self.state.apply(command, &mut self.plan)
    }

    fn snapshot(&mut self, late_ticks: u64) {
        let copy = Box::new(ControlState::new(Mode::Disabled));
        let ControlReply::Snapshot(state) = self.apply(ControlCommand::Snapshot(copy)) else {
            panic!("not what was asked")
        };
        let (after_tick, entry) = (state.ticks(), snapshot_entry(&state));
        self.late.push((after_tick + late_ticks, Message::Snapshot { after_tick, entry }));
    }

    fn wall(&mut self, id: &str, x_m: f64) {
        let kind =
            ObjectKind::HalfSpace { point_m: Vector3::new(x_m, 0.0, 0.0), normal: -Vector3::x() };
        let material = Material { stiffness_N_per_m: 1e7, ..Material::default() };
        let id = Id::parse("id", id).unwrap();
        let object = SceneObject::new(id, kind, Some(material), false).unwrap();
        self.scene.create(object, None).unwrap();
        self.swap();
    }

    fn swap(&mut self) {
        let generation = self.plan.generation + 1;
        let plan = Plan { generation, ..build_plan(&self.definition, &self.scene) };
        self.announce(&plan);
        self.apply(ControlCommand::SwapPlan(Box::new(plan)));
    }

    /// A controller's soft wall, there for 20 ms.
    fn command(&mut self, x_m: f64) {
        let material = Material { stiffness_N_per_m: 2e3, ..Material::default() };
        let shape =
            Shape::HalfSpace { point_W_m: Vector3::new(x_m, 0.0, 0.0), normal_W: -Vector3::x() };
        let surface = Surface { shape, material, hollow: false, blend_s: 0.0 };
        self.send(Setpoint::NONE.with_contacts(&[Contact { id: 1, revision: 1, surface }]));
    }

    fn send(&mut self, mut next: Setpoint) {
        (next.epoch, next.seq, next.number) = (1, self.setpoint.seq + 1, self.setpoint.number + 1);
        (next.received_ns, next.ttl_ns) = (self.now_ns, 20 * MS);
        let _ = self.setpoints.push(next);
        self.setpoint = next;
    }

    /// A tick that the recorder is not told of.
    fn unobserved_tick(&mut self) -> Record {
        self.now_ns += MS;
        let sample = self.device.read(self.now_ns);
        let inputs = Inputs {
            sample,
            overruns_in_row: 0,
            setpoint: self.setpoint.number,
            plan: self.plan.generation,
            obeyed: std::mem::take(&mut self.obeyed),
        };
        let input = TickInput {
            sample,
            setpoint: &self.setpoint,
            plan: &self.plan,
            now_ns: self.now_ns,
            overruns_in_row: 0,
        };
        let decision = tick(&mut self.state, &input);
        self.device.write(&decision.commands).unwrap();
        Record { report: decision.report, inputs, ..Record::default() }
    }

    fn tick(&mut self) {
        let record = self.unobserved_tick();
        let now = record.report.tick;
        self.recorder.observe(&record);
        let (due, later) =
            std::mem::take(&mut self.late).into_iter().partition(|(at, _)| *at <= now);
        self.late = later;
        let due: Vec<(u64, Message)> = due;
        due.into_iter().for_each(|(_, message)| self.tell.send(message).unwrap());
        if now.is_multiple_of(4) {
            self.recorder.flush();
        }
    }

    fn ticks(&mut self, count: u64) {
        (0..count).for_each(|_| self.tick());
    }

    fn begin(&self, id: u64, length_ns: u64) -> Receiver<Delivery> {
        let (to, deliveries) = sync_channel(10_000);
        let sink = Sink { id, length_ns, to, lost: Arc::default() };
        self.tell.send(Message::Begin(sink)).unwrap();
        deliveries
    }
}

fn file_of(deliveries: impl IntoIterator<Item = Delivery>) -> Vec<u8> {
    let mut bytes = header("cho-2005", 0, "test");
    deliveries.into_iter().for_each(|delivery| bytes.extend_from_slice(&delivery.bytes));
    bytes
}

/// Two seconds with all that can happen: edits, modes, commands, states early and late.
fn eventful() -> Vec<u8> {
    let mut world = World::new(true, 0);
    world.ticks(300);
    let deliveries = world.begin(1, 10_000 * MS);
    world.apply(ControlCommand::Mode(ModeCommand::Disable));
    world.snapshot(6);
    world.ticks(100);
    world.apply(ControlCommand::Mode(ModeCommand::Enable));
    world.wall("wall", 0.3);
    for i in 0..600 {
        if i % 3 == 0 {
            world.command(0.2995);
        }
        world.tick();
    }
    world.snapshot(0);
    world.wall("second", 0.31);
    world.ticks(700);
    world.scene.delete("wall", None).unwrap();
    world.swap();
    world.apply(ControlCommand::Mode(ModeCommand::Stop));
    world.ticks(200);
    world.apply(ControlCommand::Mode(ModeCommand::Disable));
    world.apply(ControlCommand::Mode(ModeCommand::Enable));
    world.ticks(400);
    world.recorder.finish();
    file_of(deliveries)
}

fn entries(bytes: &[u8]) -> Vec<RecordEntry> {
    let mut rest = bytes;
    let next = |rest: &mut &[u8]| RecordEntry::decode_length_delimited(rest).unwrap();
    std::iter::from_fn(|| (!rest.is_empty()).then(|| next(&mut rest))).collect()
}

fn bytes_of(entries: Vec<RecordEntry>) -> Vec<u8> {
    entries.into_iter().flat_map(|entry| framed(entry.entry.unwrap())).collect()
}

/// The same file with its entries changed.
fn changed(mut change: impl FnMut(&mut Entry) -> bool) -> Recorded {
    let mut all = entries(&eventful());
    all.retain_mut(|entry| change(entry.entry.as_mut().unwrap()));
    Recorded::read(bytes_of(all)).unwrap()
}

#[test]
fn an_eventful_run_is_replayed_to_the_last_bit() {
    let recorded = Recorded::read(eventful()).unwrap();
    let verdict = replay(&recorded);
    assert_eq!((verdict.difference.as_ref(), verdict.gaps.as_slice()), (None, &[][..]));
    assert_eq!((verdict.ticks, verdict.equal, verdict.end), (2_000, 2_000, End::Whole));
    let touched = recorded.reports().filter(|(_, report)| !report.contacts.is_empty()).count();
    assert!(touched > 300, "{touched} ticks touch something");
    let commanded = recorded.reports().filter(|(_, report)| report.command_seq > 0).count();
    assert!(commanded > 500, "{commanded} ticks have a command");
}

#[test]
fn a_second_segment_can_be_replayed_without_the_first() {
    let mut world = World::new(true, 0);
    world.wall("wall", 0.3);
    let first = world.begin(1, 100_000 * MS);
    world.command(0.2995);
    world.snapshot(0);
    world.ticks(900);
    let second = world.begin(2, 500 * MS);
    world.snapshot(3);
    world.ticks(900);
    world.recorder.finish();
    assert_eq!(replay(&Recorded::read(file_of(first)).unwrap()).equal, 1_800);
    let verdict = replay(&Recorded::read(file_of(second)).unwrap());
    // Its length counts from its first tick, which is in it.
    assert_eq!((verdict.ticks, verdict.equal, verdict.gaps.len()), (501, 501, 0));
}

#[test]
fn a_flipped_bit_in_a_sample_is_found_where_it_is() {
    let recorded = changed(|entry| {
        if let Entry::Tick(tick) = entry
            && tick.tick == 900
        {
            let hand = &mut tick.sample.as_mut().unwrap().hand_plane_n[1];
            *hand = f64::from_bits(hand.to_bits() ^ 1);
        }
        true
    });
    let difference = replay(&recorded).difference.unwrap();
    assert_eq!((difference.tick, difference.field), (900, "hand"));
}

#[test]
fn a_flipped_sign_of_a_zero_in_a_report_is_found() {
    let recorded = changed(|entry| {
        if let Entry::Tick(tick) = entry
            && tick.tick == 700
        {
            let turn = &mut tick.report.as_mut().unwrap().angular_velocity_rad_per_s[0];
            *turn = -*turn;
        }
        true
    });
    let difference = replay(&recorded).difference.unwrap();
    assert_eq!((difference.tick, difference.field), (700, "angular_velocity_rad_per_s"));
}

#[test]
fn what_is_missing_is_told_and_the_next_state_goes_on() {
    let without_tick = |entry: &mut Entry| !matches!(entry, Entry::Tick(tick) if tick.tick == 800);
    let verdict = replay(&changed(without_tick));
    assert!(verdict.difference.is_none());
    assert_eq!((verdict.gaps[0].tick, verdict.gaps.len()), (800, 1));
    // Until tick 799, and again from the state after tick 1000 on.
    assert_eq!(verdict.equal, 499 + 1_300);
    let mut seen = 0;
    let without_setpoint = |entry: &mut Entry| {
        seen += u32::from(matches!(entry, Entry::Setpoint(_)));
        !(matches!(entry, Entry::Setpoint(_)) && seen == 5)
    };
    let verdict = replay(&changed(without_setpoint));
    assert!(verdict.difference.is_none());
    assert!(verdict.gaps[0].why.contains("setpoint 5 "), "{:?}", verdict.gaps);
    let verdict =
        replay(&changed(|entry| !matches!(entry, Entry::Plan(plan) if plan.generation == 2)));
    assert!(verdict.gaps[0].why.contains("plan 2 "), "{:?}", verdict.gaps);
}

#[test]
fn a_file_that_is_cut_short_is_read_up_to_the_cut() {
    let bytes = eventful();
    for cut in [bytes.len() - 1, bytes.len() - 300, bytes.len() / 2] {
        let recorded = Recorded::read(bytes[..cut].to_vec()).unwrap();
        assert!(matches!(recorded.end, End::CutShort { at_byte } if at_byte < cut));
        let verdict = replay(&recorded);
        assert!(verdict.difference.is_none());
        assert!(verdict.equal > 800 && verdict.equal == verdict.ticks, "{verdict:?}");
    }
}

#[test]
fn rubbish_and_other_versions_are_refused() {
    assert_eq!(Recorded::read(Vec::new()).unwrap_err(), FileError::NotARecording);
    assert_eq!(
        Recorded::read(b"PK\x03\x04 a zip file".to_vec()).unwrap_err(),
        FileError::NotARecording
    );
    let mut all = entries(&eventful());
    let ticks_first = bytes_of(all.split_off(1));
    assert_eq!(Recorded::read(ticks_first).unwrap_err(), FileError::NotARecording);
    let Some(Entry::Header(mut old)) = all.remove(0).entry else { panic!("a header first") };
    old.version = "0.0.1".to_owned();
    let refused = Recorded::read(framed(Entry::Header(old))).unwrap_err().to_string();
    assert!(refused.contains("hapticd 0.0.1") && refused.contains("that version"), "{refused}");
}

/// Whatever the bytes, a replay says something and does not panic.
#[test]
fn broken_bytes_are_survived() {
    let bytes = eventful();
    let begin = header("cho-2005", 0, "test").len();
    for i in 0..80_usize {
        let mut broken = bytes[..bytes.len() / 8].to_vec();
        let place = begin + i * 7_919 % (broken.len() - begin);
        broken[place] ^= 1 << (i % 8);
        let recorded = Recorded::read(broken).unwrap();
        replay(&recorded);
        let _ = compare(&recorded, Strategy::Optimal);
    }
}

#[test]
fn the_black_box_keeps_the_last_seconds_and_goes_out_at_a_fault() {
    let mut world = World::new(true, 500 * MS);
    world.wall("wall", 0.3);
    for _ in 0..20 {
        world.snapshot(2);
        world.ticks(100);
    }
    assert!(world.frozen.try_recv().is_err(), "nothing has happened");
    world.plan.guards.max_overruns = 0;
    world.ticks(150);
    assert!(world.frozen.try_recv().is_err(), "it goes on for a moment");
    world.ticks(60);
    let black_box = world.frozen.try_recv().unwrap();
    assert_eq!((black_box.fault.name(), black_box.tick), ("overrun", 2_001));
    let mut bytes = header("cho-2005", 0, "fault");
    black_box.segments.iter().for_each(|segment| bytes.extend_from_slice(segment));
    let recorded = Recorded::read(bytes).unwrap();
    // What is kept is 0.5 s to 0.6 s, and the moment after the fault.
    assert!((700..=900).contains(&recorded.len()), "{}", recorded.len());
    let last = recorded.ticks().last().unwrap();
    assert_eq!(last.tick, 2_201);
    // The plan was changed behind the loop's back, so the fault itself is no part of it.
    let difference = replay(&recorded).difference.unwrap();
    assert_eq!((difference.tick, difference.field), (2_001, "mode"));
}

#[test]
fn a_reader_that_is_too_slow_loses_ticks_that_are_counted() {
    let mut world = World::new(true, 0);
    let (to, deliveries) = sync_channel(3);
    let lost = Arc::default();
    let sink = Sink { id: 1, length_ns: 100_000 * MS, to, lost: Arc::clone(&lost) };
    world.tell.send(Message::Begin(sink)).unwrap();
    world.snapshot(0);
    world.ticks(100);
    world.recorder.finish();
    let taken: Vec<_> = deliveries.into_iter().collect();
    let ticks: u64 = taken.iter().map(|delivery| delivery.ticks).sum();
    let lost = lost.load(std::sync::atomic::Ordering::Relaxed);
    assert_eq!((ticks + lost, taken.len()), (100, 3));
    assert_eq!(replay(&Recorded::read(file_of(taken)).unwrap()).equal, ticks);
}

/// A file of two segments, 100 ticks each, whose states come before these of its quarters.
fn two_copies(first_at: usize, second_at: usize) -> Recorded {
    let mut world = World::new(true, 0);
    let deliveries = world.begin(1, 100_000 * MS);
    let mut states = Vec::new();
    for quarter in 0..4 {
        if quarter % 2 == 0 {
            world.snapshot(0);
            states.push(world.late.pop().unwrap().1);
        }
        for (at, place) in [(first_at, 0), (second_at, 1)] {
            if at == quarter {
                let message = std::mem::replace(&mut states[place], Message::End { id: 99 });
                world.tell.send(message).unwrap();
            }
        }
        world.ticks(50);
    }
    world.recorder.finish();
    Recorded::read(file_of(deliveries)).unwrap()
}

#[test]
fn two_states_on_their_way_at_a_time_both_arrive() {
    // In time; the first late; both late.
    for (first_at, second_at) in [(0, 2), (1, 3), (2, 2), (3, 2), (3, 3)] {
        let recorded = two_copies(first_at, second_at);
        assert_eq!(recorded.snapshots.len(), 2, "{first_at} {second_at}");
        assert_eq!(replay(&recorded).equal, 200, "{first_at} {second_at}");
    }
}

#[test]
fn two_states_that_come_before_their_ticks_both_arrive() {
    let mut world = World::new(true, 0);
    let deliveries = world.begin(1, 100_000 * MS);
    // The loop is ahead of the recorder: it has copied both before the first tick is observed.
    let mut records = Vec::new();
    for _ in 0..2 {
        world.snapshot(0);
        let (_, message) = world.late.pop().unwrap();
        world.tell.send(message).unwrap();
        records.extend((0..20).map(|_| world.unobserved_tick()));
    }
    records.iter().for_each(|record| world.recorder.observe(record));
    world.recorder.finish();
    let recorded = Recorded::read(file_of(deliveries)).unwrap();
    assert_eq!(recorded.snapshots.len(), 2);
    assert_eq!(replay(&recorded).equal, 40);
}

#[test]
fn nothing_is_encoded_while_nobody_wants_it() {
    let mut world = World::new(true, 0);
    let _deliveries = world.begin(1, 100 * MS);
    world.snapshot(0);
    world.ticks(50);
    assert!(world.recorder.is_open());
    world.ticks(100);
    assert!(!world.recorder.is_open(), "its length is over");
    let _deliveries = world.begin(2, 100_000 * MS);
    world.snapshot(0);
    world.ticks(50);
    assert!(world.recorder.is_open());
    world.tell.send(Message::End { id: 2 }).unwrap();
    world.ticks(4);
    assert!(!world.recorder.is_open(), "it was stopped");
}

#[test]
fn a_recording_without_a_state_is_not_bit_equal() {
    let without_states = changed(|entry| !matches!(entry, Entry::Snapshot(_)));
    let verdict = replay(&without_states);
    assert_eq!((verdict.equal, verdict.is_bit_equal()), (0, false));
    assert!(verdict.gaps[0].why.contains("the state after tick 300 "), "{:?}", verdict.gaps);
    let first = |entry: &mut Entry| !matches!(entry, Entry::Tick(tick) if tick.tick <= 301);
    let verdict = replay(&changed(first));
    assert_eq!((verdict.gaps[0].tick, verdict.equal), (302, 1_300));
    assert!(verdict.gaps[0].why.contains("no state to begin with"), "{:?}", verdict.gaps);
    let nothing = replay(&Recorded::read(header("cho-2005", 0, "test")).unwrap());
    assert!(!nothing.is_bit_equal(), "nothing of nothing");
}

#[test]
fn ticks_whose_numbers_go_back_are_told() {
    for number in [0, 5, u64::MAX] {
        let recorded = changed(|entry| {
            if let Entry::Tick(tick) = entry
                && tick.tick == 700
            {
                tick.tick = number;
            }
            true
        });
        let verdict = replay(&recorded);
        let back = |gap: &Gap| gap.why.contains("go back");
        assert!(verdict.gaps.iter().any(back), "{number}: {:?}", verdict.gaps);
        assert!(!verdict.is_bit_equal());
        compare(&recorded, Strategy::Optimal).unwrap();
    }
}

/// What a plan that `change` made of a good one is refused with.
fn refusal(change: impl FnOnce(&mut Plan)) -> Option<String> {
    let device = DeviceDefinition::load("cho-2005").unwrap();
    let mut plan = build_plan(&device, &Scene::default());
    change(&mut plan);
    let bytes = plan_entry(&plan, &device, &Scene::default());
    let entry = RecordEntry::decode_length_delimited(bytes.as_slice()).unwrap();
    let Some(Entry::Plan(entry)) = entry.entry else { panic!("a plan") };
    super::exact::plan_of(&entry).err()
}

#[test]
fn a_plan_that_would_break_a_tick_is_refused() {
    assert_eq!(refusal(|_| {}), None);
    let told = |change: fn(&mut Plan), words: &str| {
        let refusal = refusal(change).unwrap_or_else(|| panic!("{words}: not refused"));
        assert!(refusal.contains(words), "{refusal}");
    };
    told(|plan| plan.actuators.max_torque_Nm[0] = f64::NAN, "actuators[0].max_torque_Nm = NaN");
    told(|plan| plan.actuators.max_torque_Nm[3] = -1.0, "actuators[3].max_torque_Nm = -1");
    told(|plan| plan.actuators.max_torque_Nm[4] = 1.0, "actuators[4]");
    told(|plan| plan.actuators.counts_per_revolution[1] = 0.0, "counts_per_revolution = 0");
    told(|plan| plan.actuators.lag_s[2] = f64::INFINITY, "lag_s = inf");
    told(|plan| plan.guards.force_gain = f64::NAN, "force_gain = NaN");
    told(|plan| plan.guards.stale_ramp_ns = u64::MAX, "stale_ramp_ms");
    told(|plan| plan.guards.passivity_reserve_J = f64::INFINITY, "passivity_reserve_J = inf");
    told(|plan| plan.guards.passivity_power_W = -1.0, "passivity_power_W = -1");
    told(|plan| plan.guards.max_device_errors = u32::MAX, "max_device_errors");
    told(|plan| plan.tool.point_count = 9, "tool.point_count = 9");
    told(|plan| plan.mount.p_WB_m.x = f64::NAN, "mount.position_m[0] = NaN");
    told(|plan| plan.tick_ns = 0, "ticks per second = inf");
    let longest = |plan: &mut Plan| plan.guards.activation_ramp_ns = 10_000_000_000;
    assert_eq!(refusal(longest), None, "the longest ramp that can be set");
}

/// For whoever changes the loop or the recorder:
/// `cargo test costs -- --ignored --nocapture`.
#[test]
#[ignore = "prints figures, judges nothing"]
fn what_recording_costs() {
    use std::time::Instant;
    let mut world = World::new(true, 10_000 * MS);
    world.wall("wall", 0.3);
    let mut copies = Vec::new();
    for _ in 0..200 {
        let copy = Box::new(ControlState::new(Mode::Disabled));
        let begin = Instant::now();
        let reply = world.state.apply(ControlCommand::Snapshot(copy), &mut world.plan);
        copies.push(begin.elapsed().as_nanos());
        drop(reply);
        world.ticks(10);
    }
    let mut state = world.state.clone();
    let (mut ticks, mut kept) = (Vec::new(), Vec::new());
    world.snapshot(0);
    for _ in 0..4_000 {
        world.now_ns += MS;
        let sample = world.device.read(world.now_ns);
        let setpoint = &Setpoint::NONE;
        let (plan, now_ns) = (&*world.plan, world.now_ns);
        let input = TickInput { sample, setpoint, plan, now_ns, overruns_in_row: 0 };
        let begin = Instant::now();
        let decision = tick(&mut state, &input);
        ticks.push(begin.elapsed().as_nanos());
        world.device.write(&decision.commands).unwrap();
        let obeyed = std::mem::take(&mut world.obeyed);
        let inputs = Inputs { sample, plan: 2, obeyed, ..Inputs::default() };
        let record = Record { report: decision.report, inputs, ..Record::default() };
        let begin = Instant::now();
        world.recorder.observe(&record);
        world.recorder.flush();
        kept.push(begin.elapsed().as_nanos());
    }
    let median = |mut all: Vec<u128>| {
        all.sort_unstable();
        all[all.len() / 2] as f64
    };
    let (copy, tick, kept) = (median(copies), median(ticks), median(kept));
    println!("tick {tick} ns; copy of the state {copy} ns: {:.2} ticks", copy / tick);
    println!("telemetry thread {kept} ns for each tick: {:.2} ticks", kept / tick);
    let (record, inputs) = (size_of::<Record>(), size_of::<Inputs>());
    println!(
        "Record {record} bytes, {inputs} of them inputs: {:.2}",
        inputs as f64 / record as f64
    );
}
