//! A State within its bytes: what goes first when not everything fits.
//!
//! A State never grows beyond [`MAX_STATE_BYTES`], actuators aside. Contacts and events are
//! rows that are added while they fit: the deepest contact before all, then the
//! [`FIRST_EVENTS`] oldest events, then the other contacts, then the other events. The rest
//! fits by its own bounds (ticks below 2^42, revisions below 2^35, and what `session` keeps
//! small) but for a few bytes at the end of every bound; there the angle goes first, then the
//! proxy. Even with every counter at the end of its type it stays below 300 bytes, which
//! every peer takes. Actuators ([`Detail`]) come on top, for those who asked.

use super::datagram::{STATE, enclose, enclosed_len};
use crate::proto::State;

/// The longest State datagram without detail.
pub const MAX_STATE_BYTES: usize = 260;

/// Events that go before the second contact.
const FIRST_EVENTS: usize = 2;

/// The longest State datagram with the detail of so many actuators: five arrays, each with
/// key, length and floats.
pub const fn max_detailed_bytes(actuators: usize) -> usize {
    MAX_STATE_BYTES + 5 * (3 + 4 * actuators)
}

/// What one surface did, as State carries it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactPart {
    /// Contact or object.
    pub id: u32,
    /// Metres.
    pub depth_m: f32,
    /// Newtons.
    pub normal_N: f32,
    /// Newtons.
    pub friction_N: f32,
    /// It does not slip.
    pub sticking: bool,
}

/// Something that happened, as State carries it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EventPart {
    /// Its number.
    pub id: u64,
    /// As `Event.kind`.
    pub kind: u32,
    /// As `Event.value`.
    pub value: u32,
}

/// What every actuator does; one number each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Detail {
    /// Angle of its shaft.
    pub rad: Vec<f32>,
    /// Rate of its shaft.
    pub rad_per_s: Vec<f32>,
    /// The least it could give.
    pub lower_Nm: Vec<f32>,
    /// The most it could give.
    pub upper_Nm: Vec<f32>,
    /// What it was told.
    pub commanded_Nm: Vec<f32>,
}

/// What is added to a State while it fits.
#[derive(Clone, Copy, Debug, Default)]
pub struct StateParts<'a> {
    /// The surfaces entered.
    pub deepest_first: &'a [ContactPart],
    /// What was not acknowledged.
    pub oldest_first: &'a [EventPart],
    /// For those who asked.
    pub detail: Option<&'a Detail>,
}

/// The datagram of a State with as many of these parts as fit, replacing those it has.
pub fn encode_state(state: &mut State, parts: &StateParts<'_>) -> Vec<u8> {
    set_contacts(state, parts.deepest_first);
    set_events(state, parts.oldest_first);
    set_detail(state, &Detail::default());
    let (angle, mut proxy) = (state.approximation_angle_rad, Vec::new());
    while enclosed_len(state) > MAX_STATE_BYTES {
        if !drop_row(state) && state.approximation_angle_rad.take().is_none() {
            proxy = std::mem::take(&mut state.proxy_m);
            break;
        }
    }
    if let Some(detail) = parts.detail {
        set_detail(state, detail);
    }
    let bytes = enclose(STATE, state);
    // The next session's State begins with what this one had.
    state.approximation_angle_rad = angle;
    if !proxy.is_empty() {
        state.proxy_m = proxy;
    }
    bytes
}

fn set_contacts(state: &mut State, contacts: &[ContactPart]) {
    state.contact_id.clear();
    state.contact_depth_m.clear();
    state.contact_normal_n.clear();
    state.contact_friction_n.clear();
    state.contact_sticking = 0;
    for (row, contact) in contacts.iter().take(32).enumerate() {
        state.contact_id.push(contact.id);
        state.contact_depth_m.push(contact.depth_m);
        state.contact_normal_n.push(contact.normal_N);
        state.contact_friction_n.push(contact.friction_N);
        state.contact_sticking |= u32::from(contact.sticking) << row;
    }
}

fn set_events(state: &mut State, events: &[EventPart]) {
    state.event_id.clear();
    state.event_kind.clear();
    state.event_value.clear();
    for event in events {
        state.event_id.push(event.id);
        state.event_kind.push(event.kind);
        state.event_value.push(event.value);
    }
}

fn set_detail(state: &mut State, detail: &Detail) {
    state.actuator_rad.clone_from(&detail.rad);
    state.actuator_rad_per_s.clone_from(&detail.rad_per_s);
    state.actuator_lower_nm.clone_from(&detail.lower_Nm);
    state.actuator_upper_nm.clone_from(&detail.upper_Nm);
    state.actuator_commanded_nm.clone_from(&detail.commanded_Nm);
}

/// Drops the least needed contact or event; false when there is none left.
fn drop_row(state: &mut State) -> bool {
    let (contacts, events) = (state.contact_id.len(), state.event_id.len());
    match (contacts, events) {
        (0, 0) => return false,
        (_, FIRST_EVENTS..) if events > FIRST_EVENTS => drop_last_event(state),
        (2.., _) | (_, 0) => drop_last_contact(state),
        _ => drop_last_event(state),
    }
    true
}

fn drop_last_event(state: &mut State) {
    state.event_id.pop();
    state.event_kind.pop();
    state.event_value.pop();
}

fn drop_last_contact(state: &mut State) {
    state.contact_id.pop();
    state.contact_depth_m.pop();
    state.contact_normal_n.pop();
    state.contact_friction_n.pop();
    state.contact_sticking &= (1 << state.contact_id.len()) - 1;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proto::datagram::Body;
    use crate::wire::decode;

    fn hex(text: &str) -> Vec<u8> {
        let digits: Vec<char> = text.chars().filter(char::is_ascii_hexdigit).collect();
        let byte = |pair: &[char]| u8::from_str_radix(&String::from_iter(pair), 16).unwrap();
        digits.chunks(2).map(byte).collect()
    }

    fn encode_with(state: &mut State, contacts: &[ContactPart], events: &[EventPart]) -> Vec<u8> {
        let parts = StateParts { deepest_first: contacts, oldest_first: events, detail: None };
        encode_state(state, &parts)
    }

    fn event(id: u64) -> EventPart {
        EventPart { id, kind: 9, value: u32::MAX }
    }

    /// The largest State that a device with three freedoms can produce.
    fn worst_state() -> State {
        let six = vec![-f32::MAX; 6];
        State {
            seq: (1 << 42) - 1,
            device_time_ns: u64::MAX,
            position_m: vec![-f32::MAX; 3],
            orientation: vec![-0.5; 4],
            twist: six.clone(),
            proxy_m: vec![-f32::MAX; 3],
            measured_cf: six.clone(),
            requested: six.clone(),
            achievable: six.clone(),
            rendered: six,
            rendered_source: 3,
            region: 3,
            approximation_angle_rad: Some(-f32::MAX),
            stuck: true,
            limits: 0x3fff,
            law: 4,
            mode: 4,
            buttons: u32::MAX,
            command_seq: (1 << 49) - 1,
            command_lag_ticks: 16_383,
            echo_client_time_ns: u64::MAX,
            echo_hold_ns: u32::MAX,
            scene_revision: (1 << 35) - 1,
            session_state: 3,
            session_quality: 4,
            ..State::default()
        }
    }

    fn part(id: u32) -> ContactPart {
        ContactPart {
            id,
            depth_m: -f32::MAX,
            normal_N: f32::MAX,
            friction_N: f32::MAX,
            sticking: true,
        }
    }

    #[test]
    fn the_worst_state_fits_its_260_bytes_and_gives_up_only_the_angle() {
        let contacts = [1, 2, 3, 4].map(|id| part(u32::MAX - id));
        let mut state = worst_state();
        let bytes = encode_with(&mut state, &contacts, &[event(1)]);
        assert!(bytes.len() <= MAX_STATE_BYTES, "{}", bytes.len());
        let Ok(Body::State(sent)) = decode(&bytes) else { panic!("a State") };
        assert_eq!(sent.approximation_angle_rad, None);
        assert_eq!((sent.proxy_m.len(), sent.twist.len()), (3, 6));
        assert_eq!(state.approximation_angle_rad, Some(-f32::MAX), "the next session's is whole");
    }

    #[test]
    fn a_state_at_the_end_of_every_type_still_passes_any_path() {
        let mut state = State {
            seq: u64::MAX,
            limits: u32::MAX,
            command_seq: u64::MAX,
            command_lag_ticks: u32::MAX,
            scene_revision: u64::MAX,
            ..worst_state()
        };
        assert!(encode_with(&mut state, &[part(1)], &[event(u64::MAX)]).len() < 300);
        assert_eq!(state.proxy_m.len(), 3);
    }

    #[test]
    fn rows_are_left_out_in_their_order_until_the_rest_fits() {
        let contacts = [1, 2, 3, 4].map(|id| part(u32::MAX - id));
        let events = [1, 2, 3, 4].map(event);
        let mut expected = [(4, 4), (4, 3), (4, 2), (3, 2), (2, 2), (1, 2), (1, 1), (1, 0), (0, 0)]
            .into_iter()
            .peekable();
        // The rest grows byte by byte.
        for filling in 0..220 {
            let mut state = State { seq: 1, ..State::default() };
            state.measured_cf = vec![1.0; filling / 4];
            let bytes = encode_with(&mut state, &contacts, &events);
            let kept = (state.contact_id.len(), state.event_id.len());
            while *expected.peek().unwrap() != kept {
                expected.next();
            }
            assert!(bytes.len() <= MAX_STATE_BYTES);
            assert_eq!(state.contact_friction_n.len(), kept.0, "arrays stay parallel");
            assert_eq!((state.event_kind.len(), state.event_value.len()), (kept.1, kept.1));
            assert_eq!(state.contact_sticking, (1 << kept.0) - 1);
            assert!(kept.0 == 0 || state.contact_id[0] == u32::MAX - 1, "the deepest stays");
            assert!(kept.1 == 0 || state.event_id[0] == 1, "and the oldest");
        }
        assert!(expected.peek() != Some(&(4, 4)), "some were left out");
    }

    #[test]
    fn detail_comes_on_top_and_does_not_stay() {
        for actuators in [2, 4, 6] {
            let row = || vec![1.0; actuators];
            let detail = Detail {
                rad: row(),
                rad_per_s: row(),
                lower_Nm: row(),
                upper_Nm: row(),
                commanded_Nm: row(),
            };
            let mut state = worst_state();
            let plain = encode_with(&mut state, &[], &[]).len();
            let parts = StateParts { detail: Some(&detail), ..StateParts::default() };
            let detailed = encode_state(&mut state, &parts);
            assert!(detailed.len() <= max_detailed_bytes(actuators), "{}", detailed.len());
            assert_eq!(detailed.len() - plain, 5 * (3 + 4 * actuators));
            assert_eq!(encode_with(&mut state, &[], &[]).len(), plain);
        }
    }

    #[test]
    fn a_state_has_these_bytes() {
        let mut state = State {
            seq: 300,
            device_time_ns: 0x0102_0304_0506_0708,
            position_m: vec![0.5, -1.0, 0.0],
            rendered: vec![2.0, 0.0, 0.0],
            rendered_source: 1,
            region: 2,
            approximation_angle_rad: Some(0.0),
            stuck: true,
            limits: 5,
            law: 4,
            mode: 2,
            command_seq: 7,
            echo_client_time_ns: 9,
            echo_hold_ns: 10,
            session_state: 3,
            session_quality: 3,
            ..State::default()
        };
        let contact =
            ContactPart { id: 3, depth_m: 0.25, normal_N: 4.0, friction_N: -2.0, sticking: true };
        let events = [EventPart { id: 300, kind: 1, value: 3 }];
        let expected = hex(concat!(
            "0a 7d",
            "08 ac02  11 0807060504030201",         // seq, device time
            "1a 0c 0000003f 000080bf 00000000",     // position
            "52 0c 00000040 00000000 00000000",     // rendered
            "58 01  60 02  6d 00000000",            // source, region, an angle of zero
            "70 01  78 05  8001 04  8801 02",       // stuck, limits, law, mode
            "9801 07  a901 0900000000000000",       // command seq, echo
            "b501 0a000000  c001 03",               // hold, session state
            "ca01 01 03  d201 04 0000803e",         // contact: id, depth
            "da01 04 00008040  e201 04 000000c0",   // normal, friction
            "e801 03  f001 01",                     // quality, sticking
            "fa01 02 ac02  8202 01 01  8a02 01 03", // event: id, kind, value
        ));
        let bytes = encode_with(&mut state, &[contact], &events);
        assert_eq!(bytes, expected);
        assert_eq!(decode(&bytes), Ok(Body::State(state)));
    }
}
