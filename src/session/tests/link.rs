//! What travels between two endpoints of a test, on a bad network in virtual time.

use crate::impairment::{ImpairedPath, Parcel};
use crate::proto::StreamMessage;

/// What travels.
#[derive(Clone, Debug)]
pub enum Packet {
    Datagram(Vec<u8>),
    /// On the reliable stream: late perhaps, but whole and in order.
    Message(StreamMessage),
}

impl Parcel for Packet {
    fn bytes(&self) -> usize {
        match self {
            Self::Datagram(bytes) => bytes.len(),
            Self::Message(_) => 0,
        }
    }

    fn damage(&mut self, bit: usize) {
        if let Self::Datagram(bytes) = self {
            bytes.damage(bit);
        }
    }
}

/// One direction.
pub type Link = ImpairedPath<Packet>;

/// Sends it off as what it is.
pub fn send(link: &mut Link, packet: Packet, now_ns: u64) {
    match packet {
        Packet::Message(_) => link.send_whole(packet, now_ns),
        Packet::Datagram(_) => link.send(packet, now_ns),
    }
}
