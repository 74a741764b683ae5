//! Two endpoints with a bad network between them, in virtual time and from a seed.

use std::collections::BTreeMap;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::proto::StreamMessage;

/// How bad.
#[derive(Clone, Copy, Debug)]
pub struct Impairment {
    /// Share of datagrams that vanish.
    pub loss: f64,
    /// Share of datagrams that come twice.
    pub duplicates: f64,
    /// The least one-way delay.
    pub delay_ns: u64,
    /// Up to this much more, drawn anew for each datagram: they overtake one another.
    pub jitter_ns: u64,
}

/// What travels.
#[derive(Clone, Debug)]
pub enum Packet {
    Datagram(Vec<u8>),
    /// On the reliable stream: late perhaps, but whole and in order.
    Message(StreamMessage),
}

/// One direction.
#[derive(Debug)]
pub struct Link {
    impairment: Impairment,
    rng: ChaCha8Rng,
    in_flight: BTreeMap<(u64, u64), Packet>,
    sent: u64,
    last_message_ns: u64,
}

impl Link {
    pub fn new(impairment: Impairment, seed: u64) -> Self {
        Self {
            impairment,
            rng: ChaCha8Rng::seed_from_u64(seed),
            in_flight: BTreeMap::new(),
            sent: 0,
            last_message_ns: 0,
        }
    }

    pub fn send(&mut self, packet: Packet, now_ns: u64) {
        match packet {
            Packet::Message(_) => {
                let arrival_ns = self.arrival_ns(now_ns).max(self.last_message_ns);
                self.last_message_ns = arrival_ns;
                self.launch(packet, arrival_ns);
            }
            Packet::Datagram(_) => {
                let copies = 1 + usize::from(self.rng.random_bool(self.impairment.duplicates));
                for _ in 0..copies {
                    if !self.rng.random_bool(self.impairment.loss) {
                        let arrival_ns = self.arrival_ns(now_ns);
                        self.launch(packet.clone(), arrival_ns);
                    }
                }
            }
        }
    }

    fn arrival_ns(&mut self, now_ns: u64) -> u64 {
        now_ns + self.impairment.delay_ns + self.rng.random_range(0..=self.impairment.jitter_ns)
    }

    fn launch(&mut self, packet: Packet, arrival_ns: u64) {
        self.sent += 1;
        self.in_flight.insert((arrival_ns, self.sent), packet);
    }

    /// When the next packet arrives.
    pub fn next_ns(&self) -> Option<u64> {
        self.in_flight.keys().next().map(|(arrival_ns, _)| *arrival_ns)
    }

    /// A packet that has arrived.
    pub fn receive(&mut self, now_ns: u64) -> Option<Packet> {
        let entry = self.in_flight.first_entry()?;
        (entry.key().0 <= now_ns).then(|| entry.remove())
    }
}
