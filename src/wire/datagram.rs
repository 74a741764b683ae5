//! One datagram is one message: key, length, body, and not a byte more.
//!
//! The envelope is that of `proto::Datagram`, read by hand: its single field must fill the
//! datagram exactly, so that junk is refused before anything is allocated. Inside the body
//! unknown fields are passed over, as protobuf has it: newer peers may add some.
//!
//! A State never grows beyond [`MAX_STATE_BYTES`]: contact results are added to it, deepest
//! first, only while they fit. Its other fields fit by their own bounds (ticks below 2^42,
//! revisions below 2^35, and what `session` keeps small); even with every counter at the
//! end of its type they are below 300 bytes, which every peer takes.

use prost::Message;

use crate::proto::{Command, Ping, Pong, State, datagram::Body};

/// The longest State datagram.
pub const MAX_STATE_BYTES: usize = 260;

/// The longest Command datagram, and the longest datagram that is read at all.
pub const MAX_COMMAND_BYTES: usize = 1100;

// Protobuf keys of the fields of `Datagram`: number * 8 + 2 (length-delimited).
const STATE: u8 = 0x0a;
const COMMAND: u8 = 0x12;
const PING: u8 = 0x1a;
const PONG: u8 = 0x22;

/// Why a datagram cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// Longer than any datagram of the protocol.
    #[error("{bytes} bytes; a datagram has at most {MAX_COMMAND_BYTES}")]
    Oversize { bytes: usize },
    /// No body.
    #[error("an empty datagram")]
    Empty,
    /// Something follows the body.
    #[error("{bytes} bytes after the body")]
    Trailing { bytes: usize },
    /// Cut short, of no known kind, or not protobuf.
    #[error("not a datagram of hapticd/1")]
    Malformed,
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
}

/// The message in a datagram.
pub fn decode(bytes: &[u8]) -> Result<Body, WireError> {
    if bytes.len() > MAX_COMMAND_BYTES {
        return Err(WireError::Oversize { bytes: bytes.len() });
    }
    let (key, mut body) = bytes.split_first().ok_or(WireError::Empty)?;
    let length = prost::decode_length_delimiter(&mut body).map_err(|_| WireError::Malformed)?;
    if body.len() > length {
        return Err(WireError::Trailing { bytes: body.len() - length });
    }
    if body.len() < length {
        return Err(WireError::Malformed);
    }
    let message = match *key {
        STATE => State::decode(body).map(Body::State),
        COMMAND => Command::decode(body).map(Body::Command),
        PING => Ping::decode(body).map(Body::Ping),
        PONG => Pong::decode(body).map(Body::Pong),
        _ => return Err(WireError::Malformed),
    };
    message.map_err(|_| WireError::Malformed)
}

/// The datagram that holds a message.
pub fn encode(body: &Body) -> Vec<u8> {
    match body {
        Body::State(state) => enclose(STATE, state),
        Body::Command(command) => enclose(COMMAND, command),
        Body::Ping(ping) => enclose(PING, ping),
        Body::Pong(pong) => enclose(PONG, pong),
    }
}

/// The datagram of a State with as many of these contacts as fit, replacing those it has.
pub fn encode_state(state: &mut State, deepest_first: &[ContactPart]) -> Vec<u8> {
    set_contacts(state, deepest_first);
    while !state.contact_id.is_empty() && enclosed_len(state) > MAX_STATE_BYTES {
        drop_last_contact(state);
    }
    enclose(STATE, state)
}

fn set_contacts(state: &mut State, contacts: &[ContactPart]) {
    state.contact_id.clear();
    state.contact_depth_m.clear();
    state.contact_normal_n.clear();
    state.contact_friction_n.clear();
    for contact in contacts {
        state.contact_id.push(contact.id);
        state.contact_depth_m.push(contact.depth_m);
        state.contact_normal_n.push(contact.normal_N);
        state.contact_friction_n.push(contact.friction_N);
    }
}

fn drop_last_contact(state: &mut State) {
    state.contact_id.pop();
    state.contact_depth_m.pop();
    state.contact_normal_n.pop();
    state.contact_friction_n.pop();
}

fn enclosed_len(message: &impl Message) -> usize {
    let length = message.encoded_len();
    1 + prost::length_delimiter_len(length) + length
}

fn enclose(key: u8, message: &impl Message) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(enclosed_len(message));
    bytes.push(key);
    let written = message.encode_length_delimited(&mut bytes);
    debug_assert!(written.is_ok(), "a Vec has room");
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proto::{
        Contact, Contacts, Datagram, HalfSpaceContact, SphereContact, command, contact,
    };
    use proptest::prelude::*;

    fn hex(text: &str) -> Vec<u8> {
        let digits: Vec<char> = text.chars().filter(char::is_ascii_hexdigit).collect();
        let byte = |pair: &[char]| u8::from_str_radix(&String::from_iter(pair), 16).unwrap();
        digits.chunks(2).map(byte).collect()
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
            limits: 0x7f,
            law: 4,
            mode: 4,
            buttons: u32::MAX,
            command_seq: (1 << 49) - 1,
            command_lag_ticks: 16_383,
            echo_client_time_ns: u64::MAX,
            echo_hold_ns: u32::MAX,
            scene_revision: (1 << 35) - 1,
            session_state: 3,
            ..State::default()
        }
    }

    fn part(id: u32) -> ContactPart {
        ContactPart { id, depth_m: -f32::MAX, normal_N: f32::MAX, friction_N: f32::MAX }
    }

    #[test]
    fn the_worst_state_fits_its_260_bytes_with_no_contact_to_spare() {
        let contacts = [1, 2, 3, 4].map(|id| part(u32::MAX - id));
        assert_eq!(encode_state(&mut worst_state(), &contacts).len(), MAX_STATE_BYTES);
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
        assert!(encode_state(&mut state, &[part(1)]).len() < 300);
    }

    #[test]
    fn contacts_are_added_deepest_first_while_they_fit() {
        let contacts = [1, 2, 3, 4].map(|id| part(u32::MAX - id));
        let mut small = State { seq: 1, ..State::default() };
        encode_state(&mut small, &contacts);
        assert_eq!(small.contact_id.len(), 4);
        let mut state = worst_state();
        state.proxy_m.clear();
        state.measured_cf.clear();
        let one = state.clone();
        state.orientation.clear();
        let two = state.clone();
        state.twist.truncate(3);
        for (mut state, kept) in [(one, 1), (two, 2), (state, 3)] {
            let bytes = encode_state(&mut state, &contacts);
            assert_eq!(state.contact_id[0], u32::MAX - 1, "the deepest stays");
            assert_eq!(state.contact_id.len(), kept);
            assert_eq!(state.contact_friction_n.len(), kept, "arrays stay parallel");
            assert!(bytes.len() <= MAX_STATE_BYTES && bytes.len() + 17 > MAX_STATE_BYTES);
        }
    }

    #[test]
    fn the_worst_command_fits_its_1100_bytes() {
        let wall = |id| Contact {
            id: u32::MAX - id,
            revision: u32::MAX,
            shape: Some(contact::Shape::HalfSpace(HalfSpaceContact {
                point_m: vec![-f32::MAX; 3],
                normal: vec![-f32::MAX; 3],
            })),
            stiffness_n_per_m: f32::MAX,
            damping_ns_per_m: f32::MAX,
            friction: f32::MAX,
            hollow: true,
            blend_ms: u32::MAX,
        };
        let command = Command {
            seq: u64::MAX,
            client_time_ns: u64::MAX,
            state_seq: u64::MAX,
            ttl_ms: u32::MAX,
            body: Some(command::Body::Contacts(Contacts { contacts: (0..8).map(wall).collect() })),
        };
        let bytes = encode(&Body::Command(command));
        assert!(bytes.len() <= MAX_COMMAND_BYTES, "{}", bytes.len());
        assert!(decode(&bytes).is_ok());
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
            ..State::default()
        };
        let contact = ContactPart { id: 3, depth_m: 0.25, normal_N: 4.0, friction_N: -2.0 };
        let expected = hex(concat!(
            "0a 6a",
            "08 ac02  11 0807060504030201",       // seq, device time
            "1a 0c 0000003f 000080bf 00000000",   // position
            "52 0c 00000040 00000000 00000000",   // rendered
            "58 01  60 02  6d 00000000",          // source, region, an angle of zero
            "70 01  78 05  8001 04  8801 02",     // stuck, limits, law, mode
            "9801 07  a901 0900000000000000",     // command seq, echo
            "b501 0a000000  c001 03",             // hold, session state
            "ca01 01 03  d201 04 0000803e",       // contact: id, depth
            "da01 04 00008040  e201 04 000000c0", // normal, friction
        ));
        let bytes = encode_state(&mut state, &[contact]);
        assert_eq!(bytes, expected);
        assert_eq!(decode(&bytes), Ok(Body::State(state)));
    }

    #[test]
    fn a_command_has_these_bytes() {
        let ball = Contact {
            id: 1,
            revision: 2,
            shape: Some(contact::Shape::Sphere(SphereContact {
                centre_m: vec![0.25, 0.5, 1.0],
                radius_m: 0.125,
            })),
            stiffness_n_per_m: 1000.0,
            damping_ns_per_m: 0.0,
            friction: 0.5,
            hollow: true,
            blend_ms: 1000,
        };
        let command = Command {
            seq: 1,
            client_time_ns: 2,
            state_seq: 3,
            ttl_ms: 100,
            body: Some(command::Body::Contacts(Contacts { contacts: vec![ball] })),
        };
        let expected = hex(concat!(
            "12 3b",
            "08 01  11 0200000000000000  18 03  20 64", // seq, time, state seq, ttl
            "2a 2a  0a 28",                             // contacts, the first
            "08 01  10 02",                             // id, revision
            "22 13  0a 0c 0000803e 0000003f 0000803f  15 0000003e", // sphere
            "2d 00007a44  3d 0000003f",                 // stiffness, friction
            "40 01  48 e807",                           // hollow, blend
        ));
        let bytes = encode(&Body::Command(command.clone()));
        assert_eq!(bytes, expected);
        assert_eq!(decode(&bytes), Ok(Body::Command(command)));
    }

    #[test]
    fn the_envelope_is_that_of_the_contract() {
        for body in [
            Body::Ping(Ping { seq: 1, sent_ns: 2 }),
            Body::Pong(Pong::default()),
            Body::Command(Command::default()),
        ] {
            let datagram = Datagram { body: Some(body.clone()) };
            assert_eq!(encode(&body), datagram.encode_to_vec());
        }
    }

    #[test]
    fn what_is_too_long_empty_cut_or_followed_by_junk_is_refused() {
        let good = encode(&Body::Ping(Ping { seq: 1, sent_ns: 2 }));
        assert_eq!(decode(&[]), Err(WireError::Empty));
        for end in 1..good.len() {
            assert_eq!(decode(&good[..end]), Err(WireError::Malformed), "{end}");
        }
        let longer = [&good[..], &good[..]].concat();
        let bytes = good.len();
        assert_eq!(decode(&longer), Err(WireError::Trailing { bytes }));
        let huge = vec![COMMAND; MAX_COMMAND_BYTES + 1];
        assert_eq!(decode(&huge), Err(WireError::Oversize { bytes: 1101 }));
        assert_eq!(decode(&[0x2a, 0x00]), Err(WireError::Malformed));
        let endless_length = [0xff; 12];
        assert_eq!(decode(&endless_length), Err(WireError::Malformed));
    }

    proptest! {
        #[test]
        fn no_bytes_make_decoding_panic(bytes in prop::collection::vec(any::<u8>(), 0..1200)) {
            let _ = decode(&bytes);
        }

        #[test]
        fn a_known_envelope_around_any_bytes_does_not_panic(
            key in prop::sample::select(vec![STATE, COMMAND, PING, PONG]),
            body in prop::collection::vec(any::<u8>(), 0..120),
        ) {
            let mut bytes = vec![key, body.len() as u8];
            bytes.extend(body);
            if let Ok(message) = decode(&bytes) {
                prop_assert_eq!(decode(&encode(&message)).is_ok(), true);
            }
        }
    }
}
