//! A bad network between two ends, in whatever time its caller keeps and from a seed.
//!
//! One direction of a path: datagrams are lost (alone or in bursts), late, overtaken, doubled,
//! damaged, or wait behind others on a slow line. Tests use it in virtual time, `netsim`
//! between real processes.

use std::collections::BTreeMap;
use std::ops::AddAssign;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// How bad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impairment {
    /// The least one-way delay.
    pub delay_ns: u64,
    /// Up to this much more, drawn anew for each datagram: they overtake one another.
    pub jitter_ns: u64,
    /// Share of datagrams that vanish.
    pub loss: f64,
    /// How many are lost in a row, on average; less than `1 / (1 - loss)` is what loss without
    /// memory gives, and means that.
    pub burst: f64,
    /// Share of datagrams that come twice.
    pub duplicates: f64,
    /// Share of datagrams that come with a bit turned over.
    pub corruption: f64,
    /// What the line carries, bits a second; infinite: whatever comes.
    pub rate_bit_per_s: f64,
    /// What would wait longer than this for the line is lost.
    pub queue_ns: u64,
}

impl Impairment {
    /// Everything arrives at once.
    pub const NONE: Self = Self {
        delay_ns: 0,
        jitter_ns: 0,
        loss: 0.0,
        burst: 0.0,
        duplicates: 0.0,
        corruption: 0.0,
        rate_bit_per_s: f64::INFINITY,
        queue_ns: 100_000_000,
    };

    /// Chances that a datagram is lost after one that came, and after one that was lost: two
    /// states, of which one loses everything (Gilbert 1960). Their stationary share is `loss`
    /// and the mean stay in the bad one `burst`.
    fn chances(&self) -> [f64; 2] {
        if self.loss >= 1.0 {
            return [1.0, 1.0];
        }
        let burst = self.burst.max(1.0 / (1.0 - self.loss));
        let after_one_that_came = self.loss / ((1.0 - self.loss) * burst);
        [after_one_that_came.min(1.0), 1.0 - 1.0 / burst]
    }
}

/// What can travel.
pub trait Parcel: Clone {
    /// Bytes on the line.
    fn bytes(&self) -> usize;
    /// Turns one bit over.
    fn damage(&mut self, bit: usize);
}

impl Parcel for Vec<u8> {
    fn bytes(&self) -> usize {
        self.len()
    }

    fn damage(&mut self, bit: usize) {
        let byte = bit / 8 % self.len().max(1);
        if let Some(byte) = self.get_mut(byte) {
            *byte ^= 1 << (bit % 8);
        }
    }
}

/// What became of the datagrams of one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Carried {
    /// Handed in.
    pub sent: u64,
    /// Of those, lost on the way.
    pub lost: u64,
    /// Of those, lost because too much waited for the line.
    pub crowded_out: u64,
    /// Came twice.
    pub doubled: u64,
    /// Came damaged.
    pub damaged: u64,
}

impl AddAssign for Carried {
    fn add_assign(&mut self, more: Self) {
        self.sent += more.sent;
        self.lost += more.lost;
        self.crowded_out += more.crowded_out;
        self.doubled += more.doubled;
        self.damaged += more.damaged;
    }
}

/// One direction.
#[derive(Debug)]
pub struct ImpairedPath<P> {
    impairment: Impairment,
    rng: ChaCha8Rng,
    in_flight: BTreeMap<(u64, u64), P>,
    launched: u64,
    lost_last: bool,
    /// When the line has carried what it was given.
    line_free_ns: u64,
    last_whole_ns: u64,
    carried: Carried,
}

impl<P: Parcel> ImpairedPath<P> {
    /// A path that nothing has gone yet.
    pub fn new(impairment: Impairment, seed: u64) -> Self {
        Self {
            impairment,
            rng: ChaCha8Rng::seed_from_u64(seed),
            in_flight: BTreeMap::new(),
            launched: 0,
            lost_last: false,
            line_free_ns: 0,
            last_whole_ns: 0,
            carried: Carried::default(),
        }
    }

    /// A datagram sets out.
    pub fn send(&mut self, parcel: P, now_ns: u64) {
        self.carried.sent += 1;
        let Some(through_ns) = self.through_the_line(parcel.bytes(), now_ns) else {
            self.carried.crowded_out += 1;
            return;
        };
        let copies = 1 + usize::from(self.rng.random_bool(self.impairment.duplicates));
        let mut came = 0;
        for _ in 0..copies {
            let chance = self.impairment.chances()[usize::from(self.lost_last)];
            self.lost_last = self.rng.random_bool(chance);
            if !self.lost_last {
                let mut parcel = parcel.clone();
                if self.rng.random_bool(self.impairment.corruption) {
                    parcel.damage(self.rng.random_range(0..8 * parcel.bytes().max(1)));
                    self.carried.damaged += 1;
                }
                came += 1;
                let arrival_ns = self.arrival_ns(through_ns);
                self.launch(parcel, arrival_ns);
            }
        }
        self.carried.lost += u64::from(came == 0);
        self.carried.doubled += u64::from(came == 2);
    }

    /// What is repeated until it arrives sets out: late perhaps, but whole and in order.
    pub fn send_whole(&mut self, parcel: P, now_ns: u64) {
        let arrival_ns = self.arrival_ns(now_ns).max(self.last_whole_ns);
        self.last_whole_ns = arrival_ns;
        self.launch(parcel, arrival_ns);
    }

    /// When the last bit is on its way; `None` where too much waits before it.
    fn through_the_line(&mut self, bytes: usize, now_ns: u64) -> Option<u64> {
        let begins_ns = self.line_free_ns.max(now_ns);
        if begins_ns - now_ns > self.impairment.queue_ns {
            return None;
        }
        let takes_ns = bytes as f64 * 8e9 / self.impairment.rate_bit_per_s;
        self.line_free_ns = begins_ns + takes_ns as u64;
        Some(self.line_free_ns)
    }

    fn arrival_ns(&mut self, from_ns: u64) -> u64 {
        let Impairment { delay_ns, jitter_ns, .. } = self.impairment;
        from_ns + delay_ns + self.rng.random_range(0..=jitter_ns)
    }

    fn launch(&mut self, parcel: P, arrival_ns: u64) {
        self.launched += 1;
        self.in_flight.insert((arrival_ns, self.launched), parcel);
    }

    /// When the next one arrives.
    pub fn next_ns(&self) -> Option<u64> {
        self.in_flight.keys().next().map(|(arrival_ns, _)| *arrival_ns)
    }

    /// One that has arrived.
    pub fn receive(&mut self, now_ns: u64) -> Option<P> {
        let entry = self.in_flight.first_entry()?;
        (entry.key().0 <= now_ns).then(|| entry.remove())
    }

    /// What became of them.
    pub fn carried(&self) -> Carried {
        self.carried
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// Numbers of those that came, of 200,000 sent a millisecond apart.
    fn arrivals(impairment: Impairment) -> (Vec<(u64, u32)>, Carried) {
        let mut path = ImpairedPath::new(impairment, 7);
        let mut came = Vec::new();
        for number in 0..200_000_u32 {
            let now_ns = u64::from(number) * MS;
            path.send(number.to_le_bytes().to_vec(), now_ns);
            while let Some(parcel) = path.receive(now_ns) {
                came.push((now_ns, u32::from_le_bytes(parcel.try_into().unwrap())));
            }
        }
        while let Some(at_ns) = path.next_ns() {
            let parcel = path.receive(at_ns).unwrap();
            came.push((at_ns, u32::from_le_bytes(parcel.try_into().unwrap())));
        }
        (came, path.carried())
    }

    /// How many were lost in a row, on average.
    fn mean_burst(came: &[(u64, u32)]) -> f64 {
        let gaps = came.windows(2).map(|pair| pair[1].1 - pair[0].1 - 1).filter(|gap| *gap > 0);
        let (count, sum) = gaps.fold((0, 0), |(count, sum), gap| (count + 1, sum + gap));
        f64::from(sum) / f64::from(count)
    }

    #[test]
    fn loss_has_the_share_and_the_bursts_that_were_asked_for() {
        for (loss, burst, lost_in_a_row) in
            [(0.03, 0.0, 1.0 / 0.97), (0.5, 0.0, 2.0), (0.03, 5.0, 5.0), (0.3, 20.0, 20.0)]
        {
            let (came, carried) = arrivals(Impairment { loss, burst, ..Impairment::NONE });
            let share = 1.0 - came.len() as f64 / 200_000.0;
            assert!((share / loss - 1.0).abs() < 0.05, "{share} of {loss} in bursts of {burst}");
            assert!((mean_burst(&came) / lost_in_a_row - 1.0).abs() < 0.05, "{loss} {burst}");
            assert_eq!(carried.lost as usize, 200_000 - came.len());
        }
        let (came, _) = arrivals(Impairment { loss: 1.0, burst: 3.0, ..Impairment::NONE });
        assert!(came.is_empty());
    }

    #[test]
    fn delay_and_jitter_are_within_their_bounds_and_jitter_overtakes() {
        let (delay_ns, jitter_ns) = (30 * MS, 5 * MS);
        let (came, _) = arrivals(Impairment { delay_ns, jitter_ns, ..Impairment::NONE });
        let mut path = ImpairedPath::new(Impairment { delay_ns, jitter_ns, ..Impairment::NONE }, 1);
        path.send(vec![0], 0);
        assert!((delay_ns..=delay_ns + jitter_ns).contains(&path.next_ns().unwrap()));
        assert_eq!(came.len(), 200_000);
        let overtaken = came.windows(2).filter(|pair| pair[1].1 < pair[0].1).count();
        assert!((20_000..100_000).contains(&overtaken), "{overtaken}");
    }

    #[test]
    fn a_slow_line_delays_and_then_drops() {
        // 4 bytes a millisecond are 32 kbit/s; the line carries half of that.
        let slow = Impairment { rate_bit_per_s: 16e3, queue_ns: 50 * MS, ..Impairment::NONE };
        let (came, carried) = arrivals(slow);
        let share = came.len() as f64 / 200_000.0;
        assert!((share - 0.5).abs() < 0.01, "{share}");
        assert_eq!(carried.crowded_out as usize, 200_000 - came.len());
        assert!(came.windows(2).all(|pair| pair[0].1 < pair[1].1), "a line keeps the order");
    }

    #[test]
    fn damage_turns_one_bit_over_and_doubles_come_twice() {
        let bad = Impairment { corruption: 0.25, duplicates: 0.5, ..Impairment::NONE };
        let mut path = ImpairedPath::new(bad, 3);
        let (mut turned, mut came) = ([0_u32; 2], 0);
        for _ in 0..10_000 {
            path.send(vec![0; 16], 0);
            while let Some(parcel) = path.receive(0) {
                let bits: u32 = parcel.iter().map(|byte| byte.count_ones()).sum();
                turned[bits as usize] += 1;
                came += 1;
            }
        }
        assert!((14_500..15_500).contains(&came), "{came}");
        let share = f64::from(turned[1]) / f64::from(turned[0] + turned[1]);
        assert!((share - 0.25).abs() < 0.02, "{share}");
        assert_eq!(path.carried().doubled + 10_000, came);
    }
}
