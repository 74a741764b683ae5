//! The reliable stream: messages one after another, each preceded by its length.
//!
//! The length is a varint and at most [`MAX_FRAME_BYTES`]. The decoder is fed with whatever
//! chunks arrive and takes from each only what completes one message, so it never holds
//! more than one frame. After an error the stream has no meaning any more: every further
//! call repeats the error.

use prost::Message;

use crate::proto::StreamMessage;

/// The longest message on the reliable stream.
pub const MAX_FRAME_BYTES: usize = 64 * 1024;

/// Bytes that a varint up to [`MAX_FRAME_BYTES`] needs.
const MAX_PREFIX_BYTES: u32 = 3;

/// Why a stream cannot be read on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// The announced length is out of bounds.
    #[error("a message of more than {MAX_FRAME_BYTES} bytes is announced")]
    TooLong,
    /// The frame does not hold a message.
    #[error("not a message of hapticd/1")]
    Malformed,
}

/// A message as the stream carries it.
pub fn encode_frame(message: &StreamMessage) -> Vec<u8> {
    message.encode_length_delimited_to_vec()
}

/// Takes messages out of a stream of bytes.
#[derive(Debug, Default)]
pub struct FrameDecoder {
    step: Step,
    body: Vec<u8>,
}

#[derive(Clone, Copy, Debug)]
enum Step {
    Prefix { length: usize, bytes: u32 },
    Body { length: usize },
    Failed(FrameError),
}

impl Default for Step {
    fn default() -> Self {
        Self::Prefix { length: 0, bytes: 0 }
    }
}

impl FrameDecoder {
    /// The next message that `chunk` completes, cutting off what was used of it; `None`
    /// once it is used up. Call it until then.
    pub fn next(&mut self, chunk: &mut &[u8]) -> Result<Option<StreamMessage>, FrameError> {
        loop {
            match self.step {
                Step::Failed(error) => return Err(error),
                Step::Prefix { length, bytes } => {
                    let Some((byte, rest)) = chunk.split_first() else {
                        return Ok(None);
                    };
                    *chunk = rest;
                    self.step = after_prefix_byte(length, bytes, *byte);
                }
                Step::Body { length } => {
                    let missing = length.saturating_sub(self.body.len());
                    let (used, rest) = chunk.split_at(missing.min(chunk.len()));
                    self.body.extend_from_slice(used);
                    *chunk = rest;
                    if self.body.len() < length {
                        return Ok(None);
                    }
                    return self.finish().map(Some);
                }
            }
        }
    }

    fn finish(&mut self) -> Result<StreamMessage, FrameError> {
        let message = StreamMessage::decode(self.body.as_slice());
        self.body.clear();
        match message {
            Ok(message) => {
                self.step = Step::default();
                Ok(message)
            }
            Err(_) => {
                self.step = Step::Failed(FrameError::Malformed);
                Err(FrameError::Malformed)
            }
        }
    }
}

fn after_prefix_byte(length: usize, bytes: u32, byte: u8) -> Step {
    let length = length | usize::from(byte & 0x7f) << (7 * bytes);
    let (more, bytes) = (byte & 0x80 != 0, bytes + 1);
    if length > MAX_FRAME_BYTES || more && bytes == MAX_PREFIX_BYTES {
        Step::Failed(FrameError::TooLong)
    } else if more {
        Step::Prefix { length, bytes }
    } else {
        Step::Body { length }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proto::{Bye, Hello, stream_message::Body};
    use proptest::prelude::*;

    fn bye(length: usize) -> StreamMessage {
        StreamMessage { body: Some(Body::Bye(Bye { reason: 1, detail: "x".repeat(length) })) }
    }

    fn take_all(decoder: &mut FrameDecoder, bytes: &[u8], chunk: usize) -> Vec<StreamMessage> {
        let mut messages = Vec::new();
        for mut piece in bytes.chunks(chunk) {
            while let Some(message) = decoder.next(&mut piece).unwrap() {
                messages.push(message);
            }
        }
        messages
    }

    #[test]
    fn messages_come_out_whole_however_the_bytes_are_cut() {
        let hello = StreamMessage { body: Some(Body::Hello(Hello::default())) };
        let sent = [bye(0), StreamMessage { body: None }, bye(200), hello, bye(60_000)];
        let bytes: Vec<u8> = sent.iter().flat_map(encode_frame).collect();
        for chunk in [1, 2, 3, 7, 1000, bytes.len()] {
            assert_eq!(take_all(&mut FrameDecoder::default(), &bytes, chunk), sent);
        }
    }

    #[test]
    fn the_largest_frame_passes_and_a_larger_one_fails_at_its_prefix() {
        let overhead = encode_frame(&bye(60_000)).len() - 3 - 60_000;
        let largest = encode_frame(&bye(MAX_FRAME_BYTES - overhead));
        assert_eq!(largest.len(), MAX_FRAME_BYTES + 3);
        assert_eq!(take_all(&mut FrameDecoder::default(), &largest, 1500).len(), 1);
        for prefix in [&[0x81, 0x80, 0x04][..], &[0x80, 0x80, 0x80][..], &[0xff; 10][..]] {
            let mut decoder = FrameDecoder::default();
            assert_eq!(decoder.next(&mut &*prefix), Err(FrameError::TooLong));
            assert!(decoder.body.capacity() == 0, "nothing was set aside for it");
        }
    }

    #[test]
    fn after_an_error_nothing_is_read_any_more() {
        let mut decoder = FrameDecoder::default();
        let mut bytes = &[0x01, 0xff][..];
        assert_eq!(decoder.next(&mut bytes), Err(FrameError::Malformed));
        let good = encode_frame(&bye(1));
        assert_eq!(decoder.next(&mut good.as_slice()), Err(FrameError::Malformed));
    }

    proptest! {
        #[test]
        fn no_bytes_make_the_decoder_panic_or_hoard(
            chunks in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..300), 0..20),
        ) {
            let mut decoder = FrameDecoder::default();
            for chunk in &chunks {
                let mut chunk = chunk.as_slice();
                while let Ok(Some(_)) = decoder.next(&mut chunk) {}
                prop_assert!(decoder.body.len() <= MAX_FRAME_BYTES);
            }
        }
    }
}
