//! One datagram is one message: key, length, body, and not a byte more.
//!
//! The envelope is that of `proto::Datagram`, read by hand: its single field must fill the
//! datagram exactly, so that junk is refused before anything is allocated. Inside the body
//! unknown fields are passed over, as protobuf has it: newer peers may add some.
//! How a State is kept small is the business of [`super::encode_state`].

use prost::Message;

use crate::proto::{Ack, Command, HandTarget, Ping, Pong, State, datagram::Body};

/// The longest Command datagram, and the longest datagram that is read at all.
pub const MAX_COMMAND_BYTES: usize = 1100;

// Protobuf keys of the fields of `Datagram`: number * 8 + 2 (length-delimited).
pub(super) const STATE: u8 = 0x0a;
const COMMAND: u8 = 0x12;
const PING: u8 = 0x1a;
const PONG: u8 = 0x22;
const HAND_TARGET: u8 = 0x2a;
const ACK: u8 = 0x32;

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
        HAND_TARGET => HandTarget::decode(body).map(Body::HandTarget),
        ACK => Ack::decode(body).map(Body::Ack),
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
        Body::HandTarget(target) => enclose(HAND_TARGET, target),
        Body::Ack(ack) => enclose(ACK, ack),
    }
}

pub(super) fn enclosed_len(message: &impl Message) -> usize {
    let length = message.encoded_len();
    1 + prost::length_delimiter_len(length) + length
}

pub(super) fn enclose(key: u8, message: &impl Message) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(enclosed_len(message));
    bytes.push(key);
    let written = message.encode_length_delimited(&mut bytes);
    debug_assert!(written.is_ok(), "a Vec has room");
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proto::{BoxContact, Contact, Contacts, Datagram, SphereContact, command, contact};
    use proptest::prelude::*;

    fn hex(text: &str) -> Vec<u8> {
        let digits: Vec<char> = text.chars().filter(char::is_ascii_hexdigit).collect();
        let byte = |pair: &[char]| u8::from_str_radix(&String::from_iter(pair), 16).unwrap();
        digits.chunks(2).map(byte).collect()
    }

    #[test]
    fn the_worst_command_fits_its_1100_bytes() {
        let wall = |id| Contact {
            id: u32::MAX - id,
            revision: u32::MAX,
            stiffness_n_per_m: f32::MAX,
            damping_ns_per_m: f32::MAX,
            kinetic_friction: f32::MAX,
            static_friction: Some(f32::MAX),
            surface_velocity_m_per_s: vec![-f32::MAX; 3],
            hollow: true,
            blend_ms: u32::MAX,
            // The longest of all shapes: ten numbers.
            shape: Some(contact::Shape::Box(BoxContact {
                centre_m: vec![-f32::MAX; 3],
                half_extents_m: vec![-f32::MAX; 3],
                orientation: vec![-f32::MAX; 4],
            })),
        };
        let command = Command {
            seq: u64::MAX,
            client_time_ns: u64::MAX,
            state_seq: u64::MAX,
            ttl_ms: u32::MAX,
            body: Some(command::Body::Contacts(Contacts { contacts: (0..8).map(wall).collect() })),
            clutched: true,
            event_ack: u64::MAX,
        };
        let bytes = encode(&Body::Command(command));
        assert!(bytes.len() <= MAX_COMMAND_BYTES, "{}", bytes.len());
        assert_eq!(bytes.len(), 888);
        assert!(decode(&bytes).is_ok());
    }

    #[test]
    fn a_command_has_these_bytes() {
        let ball = Contact {
            id: 1,
            revision: 2,
            stiffness_n_per_m: 1000.0,
            damping_ns_per_m: 0.0,
            kinetic_friction: 0.5,
            static_friction: Some(1.0),
            surface_velocity_m_per_s: vec![0.0, 0.0, 0.25],
            hollow: true,
            blend_ms: 1000,
            shape: Some(contact::Shape::Sphere(SphereContact {
                centre_m: vec![0.25, 0.5, 1.0],
                radius_m: 0.125,
            })),
        };
        let command = Command {
            seq: 1,
            client_time_ns: 2,
            state_seq: 3,
            ttl_ms: 100,
            body: Some(command::Body::Contacts(Contacts { contacts: vec![ball] })),
            clutched: true,
            event_ack: 5,
        };
        let expected = hex(concat!(
            "12 52",
            "08 01  11 0200000000000000  18 03  20 64", // seq, time, state seq, ttl
            "2a 3d  0a 3b",                             // contacts, the first
            "08 01  10 02",                             // id, revision
            "1d 00007a44  2d 0000003f  35 0000803f",    // stiffness, kinetic, static friction
            "3a 0c 00000000 00000000 0000803e",         // surface velocity
            "40 01  48 e807",                           // hollow, blend
            "5a 13  0a 0c 0000803e 0000003f 0000803f  15 0000003e", // sphere
            "40 01  48 05",                             // clutched, event ack
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
            Body::HandTarget(HandTarget { seq: 1, held: true, ..HandTarget::default() }),
            Body::Ack(Ack { event_id: 3 }),
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
        assert_eq!(decode(&[0x3a, 0x00]), Err(WireError::Malformed));
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
            key in prop::sample::select(vec![STATE, COMMAND, PING, PONG, HAND_TARGET, ACK]),
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
