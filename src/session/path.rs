//! What is lost on the way from a client, and how much its one-way delay varies.
//!
//! Loss from the numbers that the client counts its datagrams with; a number has 64 more to
//! come late, overtaken is not lost. Variation as RFC 3550 (section 6.4.1) has it: the
//! smoothed difference of neighbouring transit times, where the clocks' offset cancels out.
//! Nothing is judged by when datagrams come: a client may send whenever it likes. Both are
//! plain means at first and forget exponentially later.

/// Numbers that may still come late.
const WINDOW: u32 = 64;

/// Numbers over which loss is forgotten: half a second at 1 kHz, a hundred bursts of five.
const LOSS_MEMORY: f64 = 512.0;

/// Datagrams over which variation is forgotten: one stall of a machine is not a bad path.
const VARIATION_MEMORY: f64 = 64.0;

/// A larger difference is a clock that was set.
const LARGEST_DIFFERENCE_NS: u64 = 1_000_000_000;

/// A mean that forgets.
#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    value: f64,
    count: f64,
}

impl Mean {
    fn take(&mut self, sample: f64, memory: f64) {
        self.count = (self.count + 1.0).min(memory);
        self.value += (sample - self.value) / self.count;
    }
}

/// One direction of one session.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Path {
    newest: u64,
    /// Bit N: `newest - N` came.
    came: u64,
    /// How many of those bits mean something.
    known: u32,
    settled: u32,
    loss: Mean,
    variation_ns: Mean,
    last_transit_ns: Option<i64>,
}

impl Path {
    /// A datagram came, sent at `sent_ns` of the client's clock (0: it has none).
    pub fn take(&mut self, seq: u64, sent_ns: u64, now_ns: u64) {
        if !self.number(seq) || sent_ns == 0 {
            return;
        }
        let transit_ns = now_ns.wrapping_sub(sent_ns) as i64;
        if let Some(last_ns) = self.last_transit_ns.replace(transit_ns) {
            let difference_ns = transit_ns.wrapping_sub(last_ns).unsigned_abs();
            let kept_ns = difference_ns.min(LARGEST_DIFFERENCE_NS);
            self.variation_ns.take(kept_ns as f64, VARIATION_MEMORY);
        }
    }

    /// Share of datagrams that never came.
    pub fn loss(&self) -> f64 {
        self.loss.value
    }

    /// Mean difference of the delays of neighbours, nanoseconds.
    pub fn variation_ns(&self) -> f64 {
        self.variation_ns.value
    }

    /// Numbers that were judged, up to a bound.
    pub fn settled(&self) -> u32 {
        self.settled
    }

    /// True for a number that was not seen before.
    fn number(&mut self, seq: u64) -> bool {
        if self.known == 0 {
            (self.newest, self.came, self.known) = (seq, 1, 1);
            return true;
        }
        if seq <= self.newest {
            let behind = self.newest - seq;
            let bit = if behind < u64::from(WINDOW) { 1 << behind } else { 0 };
            let new = bit != 0 && self.came & bit == 0;
            self.came |= bit;
            return new;
        }
        let ahead = seq - self.newest;
        for _ in 0..ahead.min(u64::from(WINDOW)) {
            self.shift();
        }
        // What lies between was jumped over; more of it than is remembered says no more.
        for _ in u64::from(WINDOW)..ahead.min(u64::from(WINDOW) + LOSS_MEMORY as u64) {
            self.settle(false);
        }
        self.newest = seq;
        self.came |= 1;
        true
    }

    fn shift(&mut self) {
        if self.known == WINDOW {
            self.settle(self.came >> (WINDOW - 1) & 1 == 1);
        } else {
            self.known += 1;
        }
        self.came <<= 1;
    }

    fn settle(&mut self, came: bool) {
        self.settled = self.settled.saturating_add(1);
        self.loss.take(if came { 0.0 } else { 1.0 }, LOSS_MEMORY);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const MS: u64 = 1_000_000;

    #[test]
    fn loss_is_the_share_that_never_came() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for loss in [0.0, 0.03, 0.2, 0.7] {
            let mut path = Path::default();
            for seq in (1..5000).filter(|_| !rng.random_bool(loss)) {
                path.take(seq, 0, 0);
            }
            assert!((path.loss() - loss).abs() < 0.08, "{} for {loss}", path.loss());
        }
    }

    #[test]
    fn overtaken_and_repeated_is_not_lost() {
        let mut path = Path::default();
        for block in 0..100 {
            for seq in [5, 3, 3, 4, 1, 2, 0, 5] {
                path.take(10 + block * 6 + seq, 0, 0);
            }
        }
        assert_eq!(path.loss(), 0.0);
        assert!(path.settled() > 500);
    }

    #[test]
    fn a_number_later_than_the_window_is_lost_and_a_leap_is_bounded() {
        let mut path = Path::default();
        for seq in (1..400).filter(|seq| seq % 2 == 0) {
            path.take(seq, 0, 0);
            path.take(seq.saturating_sub(65), 0, 0);
        }
        assert!((path.loss() - 0.5).abs() < 0.01, "{}", path.loss());
        path.take(u64::MAX, 0, 0);
        assert!(path.loss() > 0.5 && path.loss() < 1.0);
    }

    #[test]
    fn variation_is_of_the_delay_and_not_of_the_spacing_or_the_offset() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        for offset_ns in [0, 7 * MS, u64::MAX - 50 * MS] {
            let (mut steady, mut shaken) = (Path::default(), Path::default());
            let mut sent_ns = 1;
            for seq in 1..2000 {
                sent_ns += rng.random_range(0..40 * MS);
                let clock_ns = offset_ns.wrapping_add(sent_ns);
                steady.take(seq, clock_ns, sent_ns + 30 * MS);
                shaken.take(seq, clock_ns, sent_ns + 30 * MS + rng.random_range(0..15 * MS));
            }
            assert_eq!(steady.variation_ns(), 0.0);
            // Two uniform delays differ by a third of their range.
            assert!((shaken.variation_ns() / (5.0 * MS as f64) - 1.0).abs() < 0.4);
        }
    }
}
