//! Sealed datagrams over plain UDP: for clients that have no QUIC.
//!
//! ```text
//! | direction | association | number |       kind, body        | tag |
//! |     1     |      8      |   8    |        1 + n            | 16  |   bytes, big-endian
//!  `------ associated data ------'     `-- encrypted --'
//! ```
//!
//! A call on a trusted channel (`OpenSession`) gives an [`AssociationId`] and a [`Secret`]. Each
//! direction has a key of its own (HKDF-SHA256, RFC 5869) under which a number is used once, as
//! the nonce of ChaCha20-Poly1305 (RFC 8439); what was seen already is not opened again
//! ([`ReplayWindow`], RFC 6479). Small messages that must arrive are repeated until they are
//! acknowledged ([`Messages`]). Used by `net` and `client`, which do not know each other; no
//! socket, no clock, no session.

mod messages;
mod window;

pub use messages::{Messages, WAITING_MESSAGES};
pub use window::ReplayWindow;

use ring::aead::{Aad, CHACHA20_POLY1305, LessSafeKey, Nonce, UnboundKey};
use ring::hkdf;

/// What is shared by the two ends of an association, and by nobody else.
pub type Secret = [u8; 32];

/// Which association a packet belongs to; chosen at random, and no secret.
pub type AssociationId = [u8; 8];

/// Direction, association, number.
const HEADER_BYTES: usize = 17;

/// Of ChaCha20-Poly1305.
const TAG_BYTES: usize = 16;

/// The longest body: the packet with its UDP and IPv6 headers passes every path (1280 bytes).
pub const MAX_BODY_BYTES: usize = 1_180;

/// The longest packet.
pub const MAX_PACKET_BYTES: usize = HEADER_BYTES + 1 + MAX_BODY_BYTES + TAG_BYTES;

const _: () = assert!(MAX_PACKET_BYTES + 48 <= 1_280);
const _: () = assert!(crate::wire::MAX_COMMAND_BYTES <= MAX_BODY_BYTES);

/// Sets these keys apart from any others that are made of the same secret.
const SALT: &[u8] = b"hapticd/1 sealed UDP";

/// Which way a packet goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the client to the server.
    Up,
    /// From the server to the client.
    Down,
}

impl Direction {
    fn byte(self) -> u8 {
        match self {
            Self::Up => 0xa1,
            Self::Down => 0xa2,
        }
    }

    fn info(self) -> &'static [u8] {
        match self {
            Self::Up => b"client to server",
            Self::Down => b"server to client",
        }
    }

    fn other(self) -> Self {
        match self {
            Self::Up => Self::Down,
            Self::Down => Self::Up,
        }
    }
}

/// What a packet is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Up: the client is here; its body is the cookie that it was given, or 32 zeros.
    Here,
    /// Down: show this cookie. As long as what asked for it.
    Challenge,
    /// A datagram of the stream.
    Datagram,
    /// A numbered message of [`Messages`].
    Message,
    /// All messages up to this number have come.
    Taken,
}

impl Kind {
    fn byte(self) -> u8 {
        match self {
            Self::Here => 1,
            Self::Challenge => 2,
            Self::Datagram => 3,
            Self::Message => 4,
            Self::Taken => 5,
        }
    }

    fn of(byte: u8) -> Option<Self> {
        [Self::Here, Self::Challenge, Self::Datagram, Self::Message, Self::Taken]
            .into_iter()
            .find(|kind| kind.byte() == byte)
    }
}

/// Why a packet is not opened. Never said to whoever sent it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unsealed {
    /// Too short, too long, of another direction or association, or of no known kind.
    #[error("not a sealed datagram of this association")]
    Malformed,
    /// It came before, or is too old to tell.
    #[error("a number that was used")]
    Replayed,
    /// Not sealed with this key, or changed on the way.
    #[error("not sealed with this key")]
    Forged,
}

/// The association that a packet going this way says it is of.
pub fn association_of(packet: &[u8], direction: Direction) -> Option<AssociationId> {
    let long_enough = (HEADER_BYTES + 1 + TAG_BYTES..=MAX_PACKET_BYTES).contains(&packet.len());
    if !long_enough || packet[0] != direction.byte() {
        return None;
    }
    packet[1..9].try_into().ok()
}

/// Both halves of one end: what it sends in this direction, and what comes the other way.
pub fn ends(secret: &Secret, association: AssociationId, sends: Direction) -> (Sealer, Opener) {
    let sealer = Sealer { key: key(secret, sends), association, direction: sends, number: 0 };
    let direction = sends.other();
    let window = ReplayWindow::default();
    (sealer, Opener { key: key(secret, direction), association, direction, window })
}

fn key(secret: &Secret, direction: Direction) -> LessSafeKey {
    let info = [direction.info()];
    let key = hkdf::Salt::new(hkdf::HKDF_SHA256, SALT)
        .extract(secret)
        .expand(&info, &CHACHA20_POLY1305)
        .map(UnboundKey::from);
    LessSafeKey::new(key.expect("32 bytes are less than HKDF gives at most"))
}

fn nonce(number: [u8; 8]) -> Nonce {
    let mut bytes = [0; 12];
    bytes[4..].copy_from_slice(&number);
    Nonce::assume_unique_for_key(bytes)
}

/// Seals what goes in one direction.
#[derive(Debug)]
pub struct Sealer {
    key: LessSafeKey,
    association: AssociationId,
    direction: Direction,
    number: u64,
}

impl Sealer {
    /// A packet; `None` where the body is too long for one.
    pub fn seal(&mut self, kind: Kind, body: &[u8]) -> Option<Vec<u8>> {
        if body.len() > MAX_BODY_BYTES {
            return None;
        }
        // At a million a second it lasts for half a million years.
        self.number += 1;
        let number = self.number.to_be_bytes();
        let mut packet = Vec::with_capacity(HEADER_BYTES + 1 + body.len() + TAG_BYTES);
        packet.push(self.direction.byte());
        packet.extend_from_slice(&self.association);
        packet.extend_from_slice(&number);
        packet.push(kind.byte());
        packet.extend_from_slice(body);
        let (header, plain) = packet.split_at_mut(HEADER_BYTES);
        let tag = self.key.seal_in_place_separate_tag(nonce(number), Aad::from(&*header), plain);
        packet.extend_from_slice(tag.ok()?.as_ref());
        Some(packet)
    }
}

/// Opens what comes in one direction.
#[derive(Debug)]
pub struct Opener {
    key: LessSafeKey,
    association: AssociationId,
    direction: Direction,
    window: ReplayWindow,
}

impl Opener {
    /// What is in a packet, decrypted where it lies. One that is refused changes nothing.
    pub fn open<'a>(&mut self, packet: &'a mut [u8]) -> Result<(Kind, &'a [u8]), Unsealed> {
        if association_of(packet, self.direction) != Some(self.association) {
            return Err(Unsealed::Malformed);
        }
        let (header, sealed) = packet.split_at_mut(HEADER_BYTES);
        let number: [u8; 8] = header[9..].try_into().map_err(|_| Unsealed::Malformed)?;
        if !self.window.is_new(u64::from_be_bytes(number)) {
            return Err(Unsealed::Replayed);
        }
        let opened = self.key.open_in_place(nonce(number), Aad::from(&*header), sealed);
        let plain: &[u8] = opened.map_err(|_| Unsealed::Forged)?;
        self.window.take(u64::from_be_bytes(number));
        let (kind, body) = plain.split_first().ok_or(Unsealed::Malformed)?;
        Ok((Kind::of(*kind).ok_or(Unsealed::Malformed)?, body))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ID: AssociationId = *b"somebody";

    fn both() -> ((Sealer, Opener), (Sealer, Opener)) {
        (ends(&[7; 32], ID, Direction::Up), ends(&[7; 32], ID, Direction::Down))
    }

    #[test]
    fn what_is_sealed_at_one_end_is_opened_at_the_other_and_only_once() {
        let ((mut client, mut client_hears), (mut server, mut server_hears)) = both();
        for (from, to, body) in [
            (&mut client, &mut server_hears, &b"a command"[..]),
            (&mut server, &mut client_hears, b""),
        ] {
            let packet = from.seal(Kind::Datagram, body).unwrap();
            assert_eq!(packet.len(), HEADER_BYTES + 1 + body.len() + TAG_BYTES);
            assert!(body.is_empty() || !packet.windows(body.len()).any(|part| part == body));
            let mut copy = packet.clone();
            assert_eq!(to.open(&mut copy), Ok((Kind::Datagram, body)));
            assert_eq!(to.open(&mut packet.clone()), Err(Unsealed::Replayed));
        }
    }

    #[test]
    fn a_packet_of_the_other_direction_is_not_heard_as_ones_own() {
        let ((mut client, mut client_hears), _) = both();
        let packet = client.seal(Kind::Datagram, b"x").unwrap();
        assert_eq!(client_hears.open(&mut packet.clone()), Err(Unsealed::Malformed));
        let mut turned = packet;
        turned[0] = Direction::Down.byte();
        assert_eq!(client_hears.open(&mut turned), Err(Unsealed::Forged));
    }

    /// Else the same number of both would use the same key stream twice, which gives both away.
    #[test]
    fn each_direction_has_a_key_of_its_own() {
        let ((mut client, _), (mut server, _)) = both();
        let sealed = |sealer: &mut Sealer| sealer.seal(Kind::Datagram, &[0; 32]).unwrap();
        let (up, down) = (sealed(&mut client), sealed(&mut server));
        assert_eq!(up[1..HEADER_BYTES], down[1..HEADER_BYTES], "the same association and number");
        let same = up.iter().zip(&down).skip(HEADER_BYTES).filter(|(a, b)| a == b).count();
        assert!(same < 8, "{same} of {} bytes are the same", up.len() - HEADER_BYTES);
    }

    #[test]
    fn another_secret_or_association_opens_nothing() {
        let mut sealer = both().0.0;
        let packet = sealer.seal(Kind::Here, &[0; 32]).unwrap();
        let mut stranger = ends(&[8; 32], ID, Direction::Down).1;
        assert_eq!(stranger.open(&mut packet.clone()), Err(Unsealed::Forged));
        let mut neighbour = ends(&[7; 32], *b"neighbor", Direction::Down).1;
        assert_eq!(neighbour.open(&mut packet.clone()), Err(Unsealed::Malformed));
    }

    #[test]
    fn a_body_that_fits_no_packet_is_not_sealed() {
        let mut sealer = both().0.0;
        assert!(sealer.seal(Kind::Message, &[0; MAX_BODY_BYTES]).is_some());
        assert!(sealer.seal(Kind::Message, &[0; MAX_BODY_BYTES + 1]).is_none());
    }

    /// An independent implementation of the standard (RFC 8439, RFC 5869), by Python's
    /// `cryptography` 48: key and packet of the client's first datagram.
    #[test]
    fn the_bytes_are_those_of_another_implementation() {
        let secret: Secret = std::array::from_fn(|i| i as u8);
        let (mut sealer, _) = ends(&secret, [1, 2, 3, 4, 5, 6, 7, 8], Direction::Up);
        let packet = sealer.seal(Kind::Datagram, b"touch").unwrap();
        let hex: String = packet.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(hex, include_str!("first_packet.hex").trim());
    }

    proptest! {
        #[test]
        fn whatever_is_changed_or_cut_is_refused_and_costs_the_next_nothing(
            body in proptest::collection::vec(any::<u8>(), 0..200),
            at in any::<proptest::sample::Index>(),
            change in 1_u8..,
            keep in any::<proptest::sample::Index>(),
        ) {
            let ((mut client, _), (_, mut server)) = both();
            let packet = client.seal(Kind::Datagram, &body).unwrap();
            let mut changed = packet.clone();
            changed[at.index(packet.len())] ^= change;
            prop_assert!(server.open(&mut changed).is_err());
            let mut cut = packet[..keep.index(packet.len())].to_vec();
            prop_assert!(server.open(&mut cut).is_err());
            let mut whole = packet;
            prop_assert_eq!(server.open(&mut whole), Ok((Kind::Datagram, &body[..])));
        }

        #[test]
        fn rubbish_is_refused(mut rubbish in proptest::collection::vec(any::<u8>(), 0..2000)) {
            prop_assert!(both().1.1.open(&mut rubbish).is_err());
        }
    }
}
