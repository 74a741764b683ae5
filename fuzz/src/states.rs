//! State, written: whatever a tick reports, it fits, is finite and its rows belong together.

use hapticd::proto::{State, datagram::Body};
use hapticd::wire::{
    ContactPart, Detail, EventPart, MAX_STATE_BYTES, StateParts, decode, encode_state,
    max_detailed_bytes, number, put_pair, put3,
};

use crate::script::Script;

/// With every counter at the end of its type; what every peer takes.
const WORST_BYTES: usize = 300;

/// A script of what a report holds.
pub fn check(data: &[u8]) {
    let script = &mut Script::new(data);
    let mut state = state(script);
    let contacts: Vec<_> = (0..script.below(40)).map(|_| contact(script)).collect();
    let events: Vec<_> = (0..script.below(9)).map(|_| event(script)).collect();
    let detail = script.rarely(3).then(|| detail(script));
    let parts =
        StateParts { deepest_first: &contacts, oldest_first: &events, detail: detail.as_ref() };
    let counters = state.clone();
    let bytes = encode_state(&mut state, &parts);
    let actuators = detail.as_ref().map_or(0, |detail| detail.rad.len());
    let room = max_detailed_bytes(actuators) - MAX_STATE_BYTES;
    assert!(bytes.len() <= WORST_BYTES + if actuators == 0 { 0 } else { room });
    let Ok(Body::State(read)) = decode(&bytes) else { panic!("what was written can be read") };
    let rows = read.contact_id.len();
    assert!(rows <= contacts.len().min(32));
    assert_eq!(
        [rows; 3],
        [&read.contact_depth_m, &read.contact_normal_n, &read.contact_friction_n].map(Vec::len)
    );
    assert!(u64::from(read.contact_sticking) >> rows == 0, "no stick without its row");
    assert!(contacts.iter().zip(&read.contact_id).all(|(part, id)| part.id == *id), "the deepest");
    assert_eq!([read.event_id.len(); 2], [read.event_kind.len(), read.event_value.len()]);
    assert!(events.iter().zip(&read.event_id).all(|(part, id)| part.id == *id), "the oldest");
    assert_eq!(read.seq, counters.seq);
    assert_eq!(read.command_seq, counters.command_seq);
    assert!(is_finite(&read));
    // The next session's State begins with what this one had.
    assert_eq!(state.approximation_angle_rad, counters.approximation_angle_rad);
    assert_eq!(state.proxy_m, counters.proxy_m);
    let all = encode_state(&mut state, &parts);
    assert_eq!(all, bytes, "written twice it is the same");
}

/// Every float of a State.
pub fn is_finite(state: &State) -> bool {
    let arrays = [
        &state.position_m,
        &state.orientation,
        &state.twist,
        &state.proxy_m,
        &state.measured_cf,
        &state.requested,
        &state.achievable,
        &state.rendered,
        &state.contact_depth_m,
        &state.contact_normal_n,
        &state.contact_friction_n,
        &state.actuator_rad,
        &state.actuator_rad_per_s,
        &state.actuator_lower_nm,
        &state.actuator_upper_nm,
        &state.actuator_commanded_nm,
    ];
    let angle = state.approximation_angle_rad.unwrap_or_default();
    arrays.into_iter().flatten().chain([&angle]).all(|value| value.is_finite())
}

fn triple(script: &mut Script<'_>) -> [f64; 3] {
    [(); 3].map(|()| script.number(-1e3, 1e3))
}

fn state(script: &mut Script<'_>) -> State {
    let mut state = State {
        seq: script.u64(),
        device_time_ns: script.u64(),
        rendered_source: i32::from(script.u8() % 4),
        region: i32::from(script.u8() % 4),
        stuck: script.rarely(2),
        limits: script.u32() >> 16,
        law: i32::from(script.u8() % 16),
        mode: i32::from(script.u8() % 5),
        buttons: script.u32(),
        command_seq: script.u64() >> 15,
        command_lag_ticks: script.u32() % 16_384,
        echo_client_time_ns: script.u64(),
        echo_hold_ns: script.u32(),
        scene_revision: script.u64(),
        session_state: i32::from(script.u8() % 4),
        session_quality: i32::from(script.u8() % 5),
        ..State::default()
    };
    put3(&mut state.position_m, triple(script));
    put3(&mut state.proxy_m, triple(script));
    if script.rarely(2) {
        state.orientation = [(); 4].map(|()| number(script.number(-1.0, 1.0))).to_vec();
    }
    for pair in [
        &mut state.twist,
        &mut state.measured_cf,
        &mut state.requested,
        &mut state.achievable,
        &mut state.rendered,
    ] {
        if !script.rarely(4) {
            let second = if script.rarely(2) { triple(script) } else { [0.0; 3] };
            put_pair(pair, triple(script), second);
        }
    }
    if script.rarely(2) {
        state.approximation_angle_rad = Some(number(script.number(0.0, 3.2)));
    }
    state
}

fn contact(script: &mut Script<'_>) -> ContactPart {
    ContactPart {
        id: script.u32(),
        depth_m: number(script.number(0.0, 0.01)),
        normal_N: number(script.number(0.0, 1e3)),
        friction_N: number(script.number(0.0, 1e3)),
        sticking: script.rarely(2),
    }
}

fn event(script: &mut Script<'_>) -> EventPart {
    EventPart { id: script.u64(), kind: u32::from(script.u8() % 10), value: script.u32() }
}

fn detail(script: &mut Script<'_>) -> Detail {
    let count = script.below(7);
    let mut array = || (0..count).map(|_| number(script.number(-1e3, 1e3))).collect();
    Detail {
        rad: array(),
        rad_per_s: array(),
        lower_Nm: array(),
        upper_Nm: array(),
        commanded_Nm: array(),
    }
}
