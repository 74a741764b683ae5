//! Recordings from outside: read, replayed and compared, whatever is in the file.
//!
//! The first byte says what the rest is: a whole file, what follows a good header, or a script
//! that changes a recording made here. Only the last gets far into plans and states, because
//! lengths stay right.

use std::sync::mpsc::{channel, sync_channel};
use std::sync::{Arc, OnceLock};

use hapticd::actuation::Strategy;
use hapticd::config::{DeviceDefinition, Id, ObjectKind, Scene, SceneObject, build_plan};
use hapticd::control::{
    ControlCommand, ControlReply, ControlState, Inputs, Mode, ModeCommand, Obeyed, Plan, Record,
    Setpoint, TickInput, tick,
};
use hapticd::environment::{Contact, Material, Shape, Surface};
use hapticd::notation::PlaneVector;
use hapticd::proto::{RecordEntry, record_entry::Entry};
use hapticd::recording::{
    Message, Recorded, Recorder, Sink, compare, draw, header, plan_entry, replay, snapshot_entry,
};
use nalgebra::Vector3;
use prost::Message as _;

use crate::script::Script;
use crate::ticks::sample_at;

const MS: u64 = 1_000_000;
const TICKS: u64 = 24;

/// More than this is a test of patience.
const MOST_TICKS: usize = 200;

/// A recording of a hand that goes into a wall while somebody commands, as the server makes it.
pub fn base() -> &'static [u8] {
    static BASE: OnceLock<Vec<u8>> = OnceLock::new();
    BASE.get_or_init(|| {
        let bytes = record();
        // Were it not whole, changes of it would be changes of nothing.
        let recorded = Recorded::read(bytes.clone()).expect("a recording");
        let verdict = replay(&recorded);
        assert!(verdict.is_bit_equal() && verdict.ticks == TICKS - 1, "{verdict:?}");
        bytes
    })
}

/// The input, by its first byte.
pub fn check(data: &[u8]) {
    let Some((&kind, rest)) = data.split_first() else { return };
    let script = &mut Script::new(rest);
    let bytes = match kind {
        0..=63 => rest.to_vec(),
        64..=127 => [header("cho-2005", 0, "fuzz").as_slice(), rest].concat(),
        _ => changed(script),
    };
    let Ok(recorded) = Recorded::read(bytes) else { return };
    if recorded.len() > MOST_TICKS {
        return;
    }
    assert!(recorded.reports().count() <= recorded.len());
    let verdict = replay(&recorded);
    assert!(verdict.equal <= verdict.ticks && verdict.ticks == recorded.len() as u64);
    assert!(verdict.gaps.len() <= 2 * recorded.len(), "no more gaps than there can be");
    let law = script.one_of(&Strategy::ALL);
    // Ten times as slow as all before.
    if script.rarely(8)
        && let Ok(comparison) = compare(&recorded, law)
    {
        let picture = draw(&comparison);
        assert!(picture.starts_with("<svg") && picture.trim_end().ends_with("</svg>"));
        assert!(!picture.contains("NaN") && !picture.contains("inf"), "{picture}");
    }
}

/// The recording made here, changed by a script.
fn changed(script: &mut Script<'_>) -> Vec<u8> {
    let mut entries = entries(base());
    while !script.is_over() && !entries.is_empty() {
        let place = script.below(entries.len());
        let entry = &mut entries[place];
        match script.below(10) {
            0 => {
                let at = usize::from(script.u16()) % entry.len().max(1);
                let count = script.below(16);
                for (byte, new) in entry[at..].iter_mut().zip(script.bytes(count)) {
                    *byte = *new;
                }
            }
            1 => {
                let at = usize::from(script.u16()) % entry.len().max(1);
                let flip = script.u8();
                entry.iter_mut().skip(at).take(1).for_each(|byte| *byte ^= flip);
            }
            2 => drop(entries.remove(place)),
            3 => {
                let twin = entry.clone();
                if entries.len() < 2 * TICKS as usize {
                    let to = script.below(entries.len() + 1);
                    entries.insert(to, twin);
                }
            }
            4 => entry.truncate(usize::from(script.u16())),
            5 => {
                *entry = {
                    let count = script.below(200);
                    script.bytes(count).to_vec()
                }
            }
            _ => {
                let Ok(RecordEntry { entry: Some(mut read) }) =
                    RecordEntry::decode(entry.as_slice())
                else {
                    continue;
                };
                change_field(script, &mut read);
                *entry = RecordEntry { entry: Some(read) }.encode_to_vec();
            }
        }
    }
    let mut bytes = header("cho-2005", 0, "fuzz");
    entries.iter().for_each(|entry| append(&mut bytes, entry));
    bytes
}

fn change_field(script: &mut Script<'_>, entry: &mut Entry) {
    let whole = |script: &mut Script<'_>, old: u64| match script.below(4) {
        0 => script.u64(),
        1 => 0,
        _ => old.wrapping_add(u64::from(script.u8())).wrapping_sub(128),
    };
    match entry {
        Entry::Header(header) => header.device = script.text(),
        Entry::Plan(plan) => match script.below(4) {
            0 => plan.generation = whole(script, plan.generation),
            1 => plan.device_toml.insert_str(0, "# fuzz\n"),
            _ => change_number(script, &mut plan.exact),
        },
        Entry::Setpoint(setpoint) => match script.below(4) {
            0 => setpoint.number = whole(script, setpoint.number),
            _ => change_number(script, &mut setpoint.exact),
        },
        Entry::Snapshot(snapshot) => match script.below(6) {
            0 => snapshot.after_tick = whole(script, snapshot.after_tick),
            _ => change_number(script, &mut snapshot.exact),
        },
        Entry::Tick(tick) => match script.below(8) {
            0 => tick.tick = whole(script, tick.tick),
            1 => tick.time_ns = whole(script, tick.time_ns),
            2 => tick.setpoint = whole(script, tick.setpoint),
            3 => tick.plan = whole(script, tick.plan),
            4 => tick.overruns_in_row = script.u32(),
            5 => {
                let count = tick.sample.as_mut().and_then(|sample| sample.counts.first_mut());
                count.into_iter().for_each(|count| *count = whole(script, *count as u64) as i64);
            }
            6 => {
                let force = script.number(-50.0, 50.0);
                let hand = tick.sample.as_mut().and_then(|s| s.hand_plane_n.first_mut());
                hand.into_iter().for_each(|part| *part = force);
            }
            _ => {
                let place = script.number(-1.0, 1.0);
                let handle =
                    tick.report.as_mut().and_then(|report| report.handle_plane.first_mut());
                handle.into_iter().for_each(|part| *part = place);
            }
        },
    }
}

/// A double somewhere in what serde has stored.
fn change_number(script: &mut Script<'_>, exact: &mut [u8]) {
    let at = usize::from(script.u16()) % exact.len().max(1);
    let new = script.number(-10.0, 10.0).to_le_bytes();
    for (byte, new) in exact[at..].iter_mut().zip(new) {
        *byte = new;
    }
}

/// Setpoints and ticks of the recording made here: short enough for a seed.
pub fn without_plans() -> Vec<u8> {
    let small = |body: &Vec<u8>| body.len() < 700;
    let of_base: Vec<_> = entries(base()).into_iter().skip(1).filter(small).take(6).collect();
    let mut bytes = Vec::new();
    of_base.into_iter().for_each(|body| append(&mut bytes, &body));
    bytes
}

fn append(bytes: &mut Vec<u8>, body: &[u8]) {
    prost::encode_length_delimiter(body.len(), bytes).expect("a Vec has room");
    bytes.extend_from_slice(body);
}

/// The bodies of a file's entries.
fn entries(mut file: &[u8]) -> Vec<Vec<u8>> {
    let mut bodies = Vec::new();
    while let Ok(length) = prost::decode_length_delimiter(&mut file) {
        let (body, rest) = file.split_at(length);
        bodies.push(body.to_vec());
        file = rest;
    }
    bodies
}

fn wall() -> SceneObject {
    let kind =
        ObjectKind::HalfSpace { point_m: Vector3::new(0.302, 0.0, 0.0), normal: -Vector3::x() };
    let material = Material { stiffness_N_per_m: 1e7, ..Material::default() }.with_friction(0.3);
    let id = Id::parse("id", "wall").expect("an identifier");
    SceneObject::new(id, kind, Some(material), false).expect("a wall")
}

fn record() -> Vec<u8> {
    let device = DeviceDefinition::load("cho-2005").expect("built in");
    let mut scene = Scene::default();
    scene.create(wall(), None).expect("it is the first");
    let mut plan = Box::new(build_plan(&device, &scene));
    let (mut setpoints, consumer) = rtrb::RingBuffer::new(TICKS as usize);
    let ((tell, inbox), (freeze, _frozen)) = (channel(), channel());
    let (to, deliveries) = sync_channel(1_000);
    let mut recorder = Recorder::new(consumer, inbox, freeze, 0);
    let entry = plan_entry(&plan, &device, &scene).into();
    let told = "the recorder is there";
    tell.send(Message::Plan { generation: plan.generation, entry }).expect(told);
    let sink = Sink { id: 1, length_ns: 1_000 * MS, to, lost: Arc::default() };
    tell.send(Message::Begin(sink)).expect(told);

    let mut state = ControlState::new(Mode::Enabled);
    let mut setpoint = Setpoint::NONE;
    for number in 1..=TICKS {
        let mut obeyed = [None; 2];
        if number == 2 || number == TICKS / 2 {
            let copy = Box::new(ControlState::new(Mode::Disabled));
            let command = ControlCommand::Snapshot(copy);
            obeyed[0] = Some(command.obeyed());
            let ControlReply::Snapshot(copy) = state.apply(command, &mut plan) else {
                unreachable!()
            };
            let (after_tick, entry) = (copy.ticks(), snapshot_entry(&copy));
            tell.send(Message::Snapshot { after_tick, entry }).expect(told);
        }
        if number == 6 {
            obeyed[1] = Some(Obeyed::Mode(ModeCommand::Enable));
            let _ = state.apply(ControlCommand::Mode(ModeCommand::Enable), &mut plan);
        }
        if number % 4 == 0 {
            setpoint = command(&setpoint, number);
            setpoints.push(setpoint).expect("there is room");
        }
        recorder.observe(&one_tick(&mut state, &plan, &setpoint, number, obeyed));
    }
    recorder.flush();
    recorder.finish();
    let mut bytes = header("cho-2005", 0, "fuzz");
    deliveries.try_iter().for_each(|delivery| bytes.extend_from_slice(&delivery.bytes));
    bytes
}

/// A soft wall beside the scene's.
fn command(last: &Setpoint, number: u64) -> Setpoint {
    let material = Material { stiffness_N_per_m: 2e3, ..Material::default() };
    let shape =
        Shape::HalfSpace { point_W_m: Vector3::new(0.301, 0.0, 0.0), normal_W: -Vector3::x() };
    let surface = Surface { shape, material, hollow: false, blend_s: 0.0 };
    let contacts = [Contact { id: 1, revision: 1, surface }];
    let mut next = Setpoint::NONE.with_contacts(&contacts);
    (next.epoch, next.seq, next.number) = (1, last.seq + 1, last.number + 1);
    (next.received_ns, next.ttl_ns) = (number * MS, 20 * MS);
    next
}

fn one_tick(
    state: &mut ControlState,
    plan: &Plan,
    setpoint: &Setpoint,
    number: u64,
    obeyed: [Option<Obeyed>; 2],
) -> Record {
    let mut sample = sample_at(plan, 0.3 + 2e-4 * number as f64, 0.0).expect("inside");
    sample.F_hand_BH_N = Some(PlaneVector::new(5.0, 1.0, 0.0));
    let (sample, plan_number) = (Ok(sample), plan.generation);
    let inputs =
        Inputs { sample, overruns_in_row: 0, setpoint: setpoint.number, plan: plan_number, obeyed };
    let now_ns = number * MS;
    let input = TickInput { sample, setpoint, plan, now_ns, overruns_in_row: 0 };
    Record { report: tick(state, &input).report, inputs, ..Record::default() }
}
