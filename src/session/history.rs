//! When the newest ticks sensed: how old is what a command was computed from?
//!
//! By the device's clock, tick by tick, because ticks may be late. A tick that is further
//! back than is remembered, or whose report was lost, is placed by the period.

/// Most ticks remembered, whatever the greatest age allowed.
const MOST: u64 = 4096;

/// The newest ticks and their times.
#[derive(Clone, Debug)]
pub(super) struct History {
    tick_ns: u64,
    ticks: Vec<(u64, u64)>,
    newest: (u64, u64),
}

impl History {
    /// For ages up to `max_age_ns` of ticks that come every `tick_ns`.
    pub fn new(tick_ns: u64, max_age_ns: u64) -> Self {
        let ticks = (max_age_ns / tick_ns.max(1) + 2).min(MOST);
        Self { tick_ns, ticks: vec![(0, 0); ticks as usize], newest: (0, 0) }
    }

    /// The newest tick known, 0 for none.
    pub fn newest(&self) -> u64 {
        self.newest.0
    }

    /// A tick sensed at a time of the device clock.
    pub fn note(&mut self, tick: u64, time_ns: u64) {
        let place = self.place(tick);
        self.ticks[place] = (tick, time_ns);
        self.newest = self.newest.max((tick, time_ns));
    }

    /// How long ago a tick, none newer than the newest, was.
    pub fn age_ns(&self, tick: u64, now_ns: u64) -> u64 {
        let (known, time_ns) = self.ticks[self.place(tick)];
        if known == tick {
            return now_ns.saturating_sub(time_ns);
        }
        let back_ns = self.newest.0.saturating_sub(tick).saturating_mul(self.tick_ns);
        now_ns.saturating_sub(self.newest.1.saturating_sub(back_ns))
    }

    fn place(&self, tick: u64) -> usize {
        (tick % self.ticks.len() as u64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn age_is_by_the_clock_of_the_tick_and_by_the_period_where_that_is_not_known() {
        let mut history = History::new(MS, 200 * MS);
        assert_eq!(history.newest(), 0);
        for tick in (1..=1000).filter(|tick| tick % 10 != 5) {
            let late_ns = if tick >= 990 { 7 * MS } else { 0 };
            history.note(tick, tick * MS + late_ns);
        }
        let now_ns = 1010 * MS;
        assert_eq!(history.newest(), 1000);
        assert_eq!(history.age_ns(1000, now_ns), 3 * MS);
        assert_eq!(history.age_ns(989, now_ns), 21 * MS, "not late");
        assert_eq!(history.age_ns(995, now_ns), 8 * MS, "its report was lost");
        assert_eq!(history.age_ns(500, now_ns), 503 * MS, "long ago");
    }
}
