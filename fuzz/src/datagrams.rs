//! Datagrams, both ways: the decoder beside the generated one, and what comes out of it.
//!
//! `wire::decode` reads the envelope by hand, so it is compared with prost, which knows the
//! contract alone: what the one takes the other takes too, as the same message.

use hapticd::proto::{Datagram, datagram::Body};
use hapticd::wire::{MAX_COMMAND_BYTES, WireError, decode, encode, get_pair, get3};
use prost::Message;

/// Bytes as they come from the network.
pub fn check(data: &[u8]) {
    let decoded = decode(data);
    if data.len() > MAX_COMMAND_BYTES {
        assert_eq!(decoded, Err(WireError::Oversize { bytes: data.len() }));
    }
    let Ok(body) = decoded else { return };
    let by_prost = Datagram::decode(data).expect("the strict envelope is one of the contract");
    // Compared as bytes: numbers may be NaN here, which no message is equal to.
    let bytes = encode(&body);
    let datagram = Datagram { body: Some(body.clone()) };
    assert_eq!(by_prost.encode_to_vec(), bytes, "both read the same message");
    assert_eq!(datagram.encode_to_vec(), bytes, "both write the same bytes");
    if bytes.len() <= MAX_COMMAND_BYTES {
        let again = decode(&bytes).expect("what was written can be read");
        assert_eq!(encode(&again), bytes, "written once more it is the same");
        check_envelope(&bytes);
    }
    check_vectors(&body);
}

/// Not a byte more and not a byte less.
fn check_envelope(bytes: &[u8]) {
    assert!(decode(&bytes[..bytes.len() - 1]).is_err());
    if bytes.len() < MAX_COMMAND_BYTES {
        let longer = [bytes, &[0]].concat();
        assert_eq!(decode(&longer), Err(WireError::Trailing { bytes: 1 }));
    }
}

/// Whatever the floats are, the doors behind which they become vectors let finite ones in only.
fn check_vectors(body: &Body) {
    let arrays: &[&Vec<f32>] = match body {
        Body::State(s) => &[&s.position_m, &s.twist, &s.requested, &s.rendered, &s.proxy_m],
        Body::HandTarget(target) => &[&target.position_m],
        _ => &[],
    };
    for floats in arrays {
        if let Ok(vector) = get3("field", floats) {
            assert!(vector.iter().all(|value| value.is_finite()));
        }
        if let Ok((first, second)) = get_pair("field", floats) {
            assert!(first.iter().chain(&second).all(|value| value.is_finite()));
        }
    }
}
