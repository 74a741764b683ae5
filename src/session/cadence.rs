//! Every how many ticks a session gets its State.
//!
//! Counted in tick numbers, not in times of arrival: a late tick shifts nothing, and an
//! interval that is no multiple of the tick is kept on average.

/// The rhythm of one session.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cadence {
    interval_ns: u64,
    next_ns: u64,
}

impl Cadence {
    /// One State per interval; 0: every tick.
    pub fn new(interval_ns: u64) -> Self {
        Self { interval_ns, next_ns: 0 }
    }

    /// True when this tick's State is due, at most once per tick; so many times as seldom as was
    /// asked for.
    pub fn due(&mut self, tick: u64, tick_ns: u64, slowed_by: u32) -> bool {
        let interval_ns = match slowed_by {
            0 | 1 => self.interval_ns,
            _ => self.interval_ns.max(tick_ns).saturating_mul(slowed_by.into()),
        };
        let tick_time_ns = tick.saturating_mul(tick_ns);
        if tick_time_ns < self.next_ns {
            return false;
        }
        // After a gap the rhythm starts anew: nothing is caught up with.
        let kept_ns = self.next_ns.saturating_add(interval_ns);
        let fresh_ns = tick_time_ns.saturating_add(interval_ns);
        self.next_ns = if kept_ns > tick_time_ns { kept_ns } else { fresh_ns };
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK_NS: u64 = 1_000_000;

    fn sent(interval_us: u64, ticks: std::ops::Range<u64>) -> usize {
        let mut cadence = Cadence::new(interval_us * 1000);
        ticks.filter(|tick| cadence.due(*tick, TICK_NS, 1)).count()
    }

    #[test]
    fn the_rate_is_the_one_that_was_asked_for() {
        assert_eq!(sent(0, 5000..6000), 1000);
        assert_eq!(sent(1000, 5000..6000), 1000);
        assert_eq!(sent(4000, 5000..6000), 250);
        assert_eq!(sent(1500, 5000..5999), 666, "every tick and a half, on average");
        assert_eq!(sent(13_889, 5000..15_000), 720);
        assert_eq!(sent(1_000_000, 5000..9999), 5);
    }

    #[test]
    fn a_slower_pace_divides_the_rate_whatever_it_is() {
        for (interval_us, whole) in [(0, 1000), (1000, 1000), (4000, 250)] {
            for slowed_by in [1, 2, 4] {
                let mut cadence = Cadence::new(interval_us * 1000);
                let sent = (5000..6000).filter(|tick| cadence.due(*tick, TICK_NS, slowed_by));
                assert_eq!(
                    sent.count() as u32,
                    whole / slowed_by + u32::from(whole % slowed_by > 0)
                );
            }
        }
    }

    #[test]
    fn missed_ticks_are_not_caught_up_with() {
        let mut cadence = Cadence::new(4 * TICK_NS);
        assert!(cadence.due(100, TICK_NS, 1));
        assert!(cadence.due(200, TICK_NS, 1));
        assert!(!(201..204).any(|tick| cadence.due(tick, TICK_NS, 1)));
        assert!(cadence.due(204, TICK_NS, 1));
    }
}
