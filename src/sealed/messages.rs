//! The few messages that must arrive, over a path that loses datagrams: each is numbered and
//! said again until the other end has taken it, and they are heard in order.
//!
//! No window and no estimate of the round trip: a welcome, events, a farewell.

use std::collections::VecDeque;

use super::MAX_BODY_BYTES;

/// Messages that may wait to be taken; an end that takes none loses its association.
pub const WAITING_MESSAGES: usize = 256;

/// Between two times that a message is said.
const AGAIN_NS: u64 = 50_000_000;

/// So many are said at a time.
const AT_A_TIME: usize = 8;

/// Number, in front of each message.
const NUMBER_BYTES: usize = 4;

/// A longer one fits no packet: it would wait for ever, and all others behind it.
const MAX_MESSAGE_BYTES: usize = MAX_BODY_BYTES - NUMBER_BYTES;

/// Both directions of one end.
#[derive(Debug, Default)]
pub struct Messages {
    /// Number of the last that was given to say.
    last: u32,
    /// Bodies, the oldest first, and when each was said last.
    waiting: VecDeque<(u32, Vec<u8>, Option<u64>)>,
    /// Number of the last that was heard.
    heard: u32,
}

impl Messages {
    /// A message to say; false where too many wait already, or it is too long.
    pub fn say(&mut self, message: &[u8]) -> bool {
        if self.waiting.len() >= WAITING_MESSAGES || message.len() > MAX_MESSAGE_BYTES {
            return false;
        }
        self.last = self.last.wrapping_add(1);
        let body = [&self.last.to_be_bytes()[..], message].concat();
        self.waiting.push_back((self.last, body, None));
        true
    }

    /// What is to be said now.
    pub fn due(&mut self, now_ns: u64) -> impl Iterator<Item = &[u8]> {
        let due = move |said: &Option<u64>| said.is_none_or(|ns| now_ns >= ns + AGAIN_NS);
        self.waiting.iter_mut().take(AT_A_TIME).filter(move |(.., said)| due(said)).map(
            move |(_, body, said)| {
                *said = Some(now_ns);
                &body[..]
            },
        )
    }

    /// Nothing waits to be taken.
    pub fn is_done(&self) -> bool {
        self.waiting.is_empty()
    }

    /// The other end has all up to the number in this body.
    pub fn on_taken(&mut self, body: &[u8]) {
        let Ok(number) = body.try_into().map(u32::from_be_bytes) else { return };
        let Some(place) = self.waiting.iter().position(|(n, ..)| *n == number) else { return };
        self.waiting.drain(..=place);
    }

    /// A message came. What to acknowledge, and the message where it is the next one.
    pub fn on_message<'a>(&mut self, body: &'a [u8]) -> ([u8; NUMBER_BYTES], Option<&'a [u8]>) {
        let next = self.heard.wrapping_add(1);
        let found = body
            .split_first_chunk::<NUMBER_BYTES>()
            .filter(|(number, _)| u32::from_be_bytes(**number) == next);
        if found.is_some() {
            self.heard = next;
        }
        (self.heard.to_be_bytes(), found.map(|(_, message)| message))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impairment::{ImpairedPath, Impairment};
    use crate::sealed::{Direction, Kind, ends};

    const MS: u64 = 1_000_000;

    #[test]
    fn all_messages_arrive_once_and_in_order_over_a_path_that_loses_half() {
        for seed in 0..8 {
            let bad = Impairment {
                loss: 0.5,
                duplicates: 0.2,
                delay_ns: 30 * MS,
                jitter_ns: 40 * MS,
                ..Impairment::NONE
            };
            let (mut one, mut other) = (Messages::default(), Messages::default());
            let mut there = ImpairedPath::new(bad, seed);
            let mut back = ImpairedPath::new(bad, seed + 100);
            let (mut heard, mut said) = (Vec::new(), 0_u32);
            for now_ns in (0..20_000).map(|ms| ms * MS) {
                if said < 40 && now_ns % (100 * MS) == 0 {
                    said += 1;
                    assert!(one.say(format!("message {said}").as_bytes()));
                }
                for body in one.due(now_ns) {
                    there.send(body.to_vec(), now_ns);
                }
                while let Some(body) = there.receive(now_ns) {
                    let (taken, message) = other.on_message(&body);
                    heard.extend(
                        message.map(|message| String::from_utf8_lossy(message).into_owned()),
                    );
                    back.send(taken.to_vec(), now_ns);
                }
                while let Some(taken) = back.receive(now_ns) {
                    one.on_taken(&taken);
                }
            }
            let expected: Vec<_> = (1..=40).map(|n| format!("message {n}")).collect();
            assert_eq!(heard, expected);
            assert!(one.is_done());
        }
    }

    #[test]
    fn what_nobody_takes_is_bounded_and_said_a_few_at_a_time() {
        let mut messages = Messages::default();
        for _ in 0..WAITING_MESSAGES {
            assert!(messages.say(b"x"));
        }
        assert!(!messages.say(b"x"));
        assert_eq!(messages.due(0).count(), AT_A_TIME);
        assert_eq!(messages.due(AGAIN_NS - 1).count(), 0);
        assert_eq!(messages.due(AGAIN_NS).count(), AT_A_TIME);
    }

    #[test]
    fn the_longest_message_fits_a_packet_and_a_longer_one_stops_no_other() {
        let mut messages = Messages::default();
        assert!(messages.say(&[7; 1_176]));
        assert!(!messages.say(&[7; 1_177]));
        assert!(messages.say(b"x"));
        let due: Vec<_> = messages.due(0).map(<[u8]>::to_vec).collect();
        let (mut sealer, mut opener) = (
            ends(&[7; 32], *b"somebody", Direction::Up).0,
            ends(&[7; 32], *b"somebody", Direction::Down).1,
        );
        let mut other = Messages::default();
        for (number, body) in due.iter().enumerate() {
            let mut packet = sealer.seal(Kind::Message, body).unwrap();
            let (_, body) = opener.open(&mut packet).unwrap();
            let length = [1_176, 1][number];
            assert_eq!(other.on_message(body).1.map(<[u8]>::len), Some(length));
        }
        assert_eq!(due.len(), 2);
    }

    #[test]
    fn rubbish_and_numbers_of_the_past_and_future_change_nothing() {
        let mut messages = Messages::default();
        messages.say(b"x");
        for body in [&[][..], &[0, 0], &[0, 0, 0, 9], &[0; 40]] {
            messages.on_taken(body);
            let (taken, message) = messages.on_message(body);
            assert_eq!((taken, message), ([0; 4], None));
        }
        assert!(!messages.is_done());
        messages.on_taken(&[0, 0, 0, 1]);
        assert!(messages.is_done());
    }
}
