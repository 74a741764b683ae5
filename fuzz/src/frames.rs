//! The reliable stream: the same messages and the same end however its bytes are cut up.

use hapticd::proto::StreamMessage;
use hapticd::wire::{FrameDecoder, FrameError, MAX_FRAME_BYTES, encode_frame};
use prost::Message;

/// The first byte says how many bytes say where to cut, the rest is the stream.
pub fn check(data: &[u8]) {
    let Some((&count, rest)) = data.split_first() else { return };
    let (cuts, stream) = rest.split_at(usize::from(count % 16).min(rest.len()));
    let (whole, end) = read([stream]);
    let (in_parts, end_in_parts) = read(parts(stream, cuts));
    assert_eq!((&whole, end), (&in_parts, end_in_parts), "where it is cut does not matter");
    let mut copy = Vec::new();
    for bytes in &whole {
        let message = StreamMessage::decode(bytes.as_slice()).expect("it was read");
        let frame = encode_frame(&message);
        assert!(frame.len() <= MAX_FRAME_BYTES + 3, "it was a frame");
        copy.extend(frame);
    }
    let (again, end) = read([copy.as_slice()]);
    assert_eq!((again, end), (whole, None), "what was read can be written and read again");
}

/// Cut after so many bytes each, then after one.
fn parts<'a>(stream: &'a [u8], cuts: &'a [u8]) -> impl Iterator<Item = &'a [u8]> {
    let mut rest = stream;
    let lengths = cuts.iter().map(|cut| usize::from(*cut)).chain(std::iter::repeat(1));
    lengths.map_while(move |length| {
        if rest.is_empty() {
            return None;
        }
        let (part, after) = rest.split_at(length.min(rest.len()));
        rest = after;
        Some(part)
    })
}

/// The messages, as bytes, and the error that ends them.
fn read<'a>(parts: impl IntoIterator<Item = &'a [u8]>) -> (Vec<Vec<u8>>, Option<FrameError>) {
    let mut decoder = FrameDecoder::default();
    let mut messages = Vec::new();
    let mut end = None;
    for mut part in parts {
        loop {
            let before = part.len();
            match decoder.next(&mut part) {
                Ok(Some(message)) => {
                    assert!(end.is_none(), "a stream that failed has no meaning any more");
                    messages.push(message.encode_to_vec());
                }
                Ok(None) => {
                    assert!(part.is_empty() && end.is_none(), "it asks for more");
                    break;
                }
                Err(error) => {
                    assert!(end.is_none_or(|end| end == error), "it repeats its error");
                    assert!(end.is_none() || part.len() == before, "and reads no further");
                    end = Some(error);
                    break;
                }
            }
        }
    }
    (messages, end)
}
