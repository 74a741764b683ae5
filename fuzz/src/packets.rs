//! Sealed UDP: packets, the window of numbers, cookies and messages, whatever a network does.
//!
//! Nobody guesses a key, so the keys are known here. The first byte says what the rest is: a
//! packet from anywhere; a body whose packet is changed in every byte; numbers for the window;
//! or a script of two ends with a network of bad will between them ([`exchange`]).
//!
//! The modules are the library's own files: its feature `client` would bring tonic and quinn.

mod exchange;

use std::collections::BTreeSet;
use std::net::SocketAddr;

use crate::associations::{Associations, Heard};
use crate::script::Script;
use crate::sealed::{
    AssociationId, Direction, Kind, MAX_PACKET_BYTES, Messages, Opener, ReplayWindow, Sealer,
    Secret, association_of, ends,
};

pub use exchange::{Seen, run};

const ID: AssociationId = *b"trainer1";
const SECRET: Secret = [3; 32];
const TICKET: [u8; 16] = [9; 16];

/// Direction, association, number, kind and tag: what a packet has without a body.
const LEAST_BYTES: usize = 1 + 8 + 8 + 1 + 16;

/// Numbers behind the newest that are told apart, two seconds at 1 kHz.
const REMEMBERED: u64 = 2_048;

/// Cost of an input that is changed in every byte grows with the square of its length.
const MOST_CHANGED_BYTES: usize = 200;

/// The input, by its first byte.
pub fn check(data: &[u8]) {
    let Some((&kind, rest)) = data.split_first() else { return };
    match kind {
        0..=31 => rubbish(rest),
        32..=63 => changed(rest),
        64..=95 => numbers(&mut Script::new(rest)),
        _ => drop(run(rest)),
    }
}

/// The ends of the client and of the server.
fn both() -> [(Sealer, Opener); 2] {
    [Direction::Up, Direction::Down].map(|sends| ends(&SECRET, ID, sends))
}

/// A server that waits for one client since then.
fn server(now_ns: u64) -> Associations {
    let mut table = Associations::new(&[1; 32]);
    table.open(ID, &SECRET, TICKET, now_ns).expect("it is the first");
    table
}

fn at(port: u16) -> SocketAddr {
    ([192, 0, 2, 7], port).into()
}

/// Whatever comes is no packet, behind a good header neither, and costs the next one nothing.
fn rubbish(data: &[u8]) {
    let [(mut sealer, _), (_, mut opener)] = both();
    let mut table = server(0);
    for head in [&[][..], &[0xa1], &[[0xa1].as_slice(), &ID].concat()] {
        let packet = [head, data].concat();
        let fits = (LEAST_BYTES..=MAX_PACKET_BYTES).contains(&packet.len());
        let of = packet.get(1..9).filter(|_| fits && packet[0] == 0xa1);
        assert_eq!(association_of(&packet, Direction::Up).as_ref().map(|id| &id[..]), of);
        assert!(opener.open(&mut packet.clone()).is_err());
        let mut packet = packet.clone();
        let heard = table.on_packet(&mut packet, at(1), 0);
        assert!(matches!(heard, Heard::Nothing | Heard::Unsealed(_)), "{heard:?}");
    }
    let good = sealer.seal(Kind::Datagram, b"x").expect("it is short");
    assert_eq!(opener.open(&mut good.clone()), Ok((Kind::Datagram, &b"x"[..])));
    let mut messages = Messages::default();
    assert!(messages.say(b"x"));
    messages.on_taken(data);
    assert_eq!(messages.is_done(), data == [0, 0, 0, 1]);
    let first = data.strip_prefix(&[0, 0, 0, 1]);
    assert_eq!(messages.on_message(data), ([0, 0, 0, first.is_some().into()], first));
}

/// A packet that is changed in any byte, cut or longer never opens; as it was it opens once.
fn changed(data: &[u8]) {
    let Some((&flip, body)) = data.split_first() else { return };
    let flip = flip.max(1);
    let body = &body[..body.len().min(MOST_CHANGED_BYTES)];
    let [(mut sealer, _), (_, mut opener)] = both();
    let packet = sealer.seal(Kind::Datagram, body).expect("it is short");
    assert_eq!(packet.len(), LEAST_BYTES + body.len());
    for at in 0..packet.len() {
        let mut other = packet.clone();
        other[at] ^= flip;
        assert!(opener.open(&mut other).is_err(), "changed at {at}");
        assert!(opener.open(&mut packet[..at].to_vec()).is_err(), "cut at {at}");
    }
    assert!(opener.open(&mut [&packet[..], &[flip]].concat()).is_err(), "longer");
    assert_eq!(opener.open(&mut packet.clone()), Ok((Kind::Datagram, body)));
    assert!(opener.open(&mut packet.clone()).is_err(), "replayed");
}

/// What a window must do, with a set of all numbers that were ever taken.
#[derive(Debug, Default)]
struct Numbers {
    taken: BTreeSet<u64>,
}

impl Numbers {
    /// True where it is new, and then it is taken.
    fn offer(&mut self, number: u64) -> bool {
        let newest = self.taken.last().copied().unwrap_or_default();
        let known = number > newest || newest - number < REMEMBERED;
        number > 0 && known && self.taken.insert(number)
    }
}

/// The window takes no number twice, and agrees with the set.
fn numbers(script: &mut Script<'_>) {
    let (mut window, mut numbers) = (ReplayWindow::default(), Numbers::default());
    let mut number = script.u64() >> script.below(64);
    while !script.is_over() {
        let edge = [1, 64, REMEMBERED, REMEMBERED + 64][script.below(4)];
        let step = edge.wrapping_add_signed(i64::from(script.u8() as i8));
        number = match script.below(8) {
            0..=3 => number.wrapping_add(step),
            4 | 5 => number.wrapping_sub(step),
            6 => number,
            _ => script.u64() >> script.below(64),
        };
        let new = window.is_new(number);
        let before = window.clone();
        if new {
            window.take(number);
            assert!(!window.is_new(number), "{number} is taken twice");
        }
        assert_eq!(window == before, !new, "what is refused changes nothing");
        assert_eq!(new, numbers.offer(number), "{number}: {window:?}");
    }
}
